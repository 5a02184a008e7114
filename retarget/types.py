"""Names for array types, and the data that travel between folders."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
ModeArray = NDArray[np.uint8]
"""What observers do: 0 free, 1 preventive, 2 reactive."""
MM = 1e3
"""Millimetres in a metre."""
Notify = Callable[[str], object]
"""Takes a message for the operator, one sentence without a line end. It must be said, unless it is `News`."""


class News(str):
    """A message that may come again and again, and may be counted instead of said.

    kind: what comes again, without times and counts; usually the text. is_due: the first of its kind must be said.
    """

    kind: str
    is_due: bool

    def __new__(cls, text: str, kind: str = "", *, is_due: bool = False) -> "News":
        """Of a text, one sentence."""
        news = super().__new__(cls, text)
        news.kind, news.is_due = kind or text, is_due
        return news


class RunState(Enum):
    """The state of a run. `retarget.run.supervisor` has the table of states and transitions."""

    IDLE = "idle"
    COUNTDOWN = "countdown"
    CALIBRATING = "calibrating"
    CHECKING_SIDES = "checking sides"
    ARMING = "arming"
    APPROACH = "approach"
    FOLLOW = "follow"
    HOLD = "hold"
    STOPPING = "stopping"
    RETURN_TO_STANCE = "return to stance"
    GO_TO_REST = "go to rest"
    STANDING = "standing"
    OFF = "off"
    FAULT = "fault"
    FALLING = "falling"


class Carrying(Enum):
    """The feet that carry. The value is what reports call it."""

    BOTH = "both"
    LEFT = "left"
    RIGHT = "right"
    FLIGHT = "flight"

    @property
    def feet(self) -> tuple[bool, bool]:
        """Whether the left foot carries, and the right one."""
        return self in (Carrying.BOTH, Carrying.LEFT), self in (Carrying.BOTH, Carrying.RIGHT)


ORIENTED: tuple[str, ...] = ("pelvis", "chest", "head")
"""Parts whose orientation is known."""


def _no_modes() -> ModeArray:
    return np.zeros(0, dtype=np.uint8)


@dataclass(frozen=True, eq=False, slots=True)
class HumanPosture:
    """One posture, world frame.

    q (nq,): as the solver has it. joint_names: m canonical names; joints (m, 3): their centres, m. orientations (3, 4):
    wxyz of ORIENTED; the identity stands upright and faces x. centre_of_mass (3,) m. sensor_error (k,) m: distance of
    each sensor's joint from where it was last measured, NaN where it is missing. balance_error: distance of the
    centre of mass from its goal, m; NaN where there is none. heading: unit vector on the ground. observer_modes (o,):
    0 free, 1 preventive, 2 reactive. carrying: which feet carry.
    """

    q: FloatArray
    joint_names: tuple[str, ...]
    joints: FloatArray
    orientations: FloatArray
    centre_of_mass: FloatArray
    sensor_error: FloatArray
    balance_error: float
    heading: tuple[float, float]
    observer_modes: ModeArray = field(default_factory=_no_modes)
    carrying: Carrying = Carrying.BOTH

    def joint(self, name: str) -> FloatArray:
        """Centre (3,) m of one joint."""
        return np.asarray(self.joints[self.joint_names.index(name)])

    def orientation(self, name: str) -> FloatArray:
        """Orientation (4,) wxyz of one of ORIENTED."""
        return np.asarray(self.orientations[ORIENTED.index(name)])


@dataclass(frozen=True, eq=False, slots=True)
class RobotPosture:
    """One posture of the robot, in its own world: origin on the ground between the soles, x forward.

    q (nq,): root_position (3,) m, root_quaternion (4,) wxyz (fixed robots: where the body file has it) and joints.
    joint_positions (n,): rad, servo order. landmarks_asked, landmarks_reached (k, 3): m, in order of landmark_names.
    centre_of_mass (3,) m.
    observer_modes (o,): 0 free, 1 preventive, 2 reactive, in the order of the profile.
    """

    q: FloatArray
    joint_positions: FloatArray
    root_position: FloatArray
    root_quaternion: FloatArray
    landmark_names: tuple[str, ...]
    landmarks_asked: FloatArray
    landmarks_reached: FloatArray
    centre_of_mass: FloatArray
    observer_modes: ModeArray


Watch = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""Around what takes time: what is made, and how many steps it has; it yields what takes the steps that are done."""


@contextmanager
def unwatched(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """Watch nothing."""
    yield lambda done: None
