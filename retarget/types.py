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
"""Modes of observers: 0 free, 1 preventive, 2 reactive."""
MM = 1e3
"""Millimetres in a metre."""
Notify = Callable[[str], object]
"""Takes a message of one sentence for the operator."""


class News(str):
    """A message whose repeats, known by their kind, may be counted, not shown. is_due: the first must be shown."""

    kind: str
    is_due: bool

    def __new__(cls, text: str, kind: str = "", *, is_due: bool = False) -> "News":
        """A message of one sentence, by default its own kind."""
        news = super().__new__(cls, text)
        news.kind, news.is_due = kind or text, is_due
        return news


class RunState(Enum):
    """The state of a run; `retarget.run.supervisor` has the transitions."""

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
    """The feet that carry. Reports show the value."""

    BOTH = "both"
    LEFT = "left"
    RIGHT = "right"
    FLIGHT = "flight"

    @property
    def feet(self) -> tuple[bool, bool]:
        """Flags of the left and the right foot."""
        return self in (Carrying.BOTH, Carrying.LEFT), self in (Carrying.BOTH, Carrying.RIGHT)


ORIENTED: tuple[str, ...] = ("pelvis", "chest", "head")
"""Parts whose orientation is known."""


@dataclass(frozen=True, eq=False, slots=True)
class HumanPosture:
    """One posture of the virtual human, world frame, m.

    orientations (3, 4): wxyz of ORIENTED, the identity when upright and facing x. sensor_error (k,): distance of each
    sensor's joint from its last measurement, NaN if missing. balance_error: distance of the centre of mass from its
    goal, NaN without one. heading: unit vector on the ground.
    """

    q: FloatArray
    joint_names: tuple[str, ...]
    joints: FloatArray
    orientations: FloatArray
    centre_of_mass: FloatArray
    sensor_error: FloatArray
    balance_error: float
    heading: tuple[float, float]
    observer_modes: ModeArray = field(default_factory=lambda: np.zeros(0, dtype=np.uint8))
    carrying: Carrying = Carrying.BOTH

    def joint(self, name: str) -> FloatArray:
        """Centre (3,) of one joint."""
        return np.asarray(self.joints[self.joint_names.index(name)])

    def orientation(self, name: str) -> FloatArray:
        """Orientation (4,) wxyz of one of ORIENTED."""
        return np.asarray(self.orientations[ORIENTED.index(name)])


@dataclass(frozen=True, eq=False, slots=True)
class RobotPosture:
    """One posture of the robot, in its own world: m, origin on the ground between the soles, x forward.

    root_quaternion (4,): wxyz. joint_positions (n,): rad, servo order. landmarks_asked, landmarks_reached (k, 3):
    desired and actual. observer_modes (o,): order of the profile.
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


ShowProgress = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""Progress display, given a name and a number of steps; yields a function that takes the steps done."""


@contextmanager
def no_progress(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """No progress display."""
    yield lambda done: None
