"""The two stages of a tick as the pipeline sees them: sensors to human, human to robot."""

from typing import TYPE_CHECKING, Protocol

from retarget.frames import SensorSample
from retarget.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from retarget.types import HumanPosture, RobotPosture

__all__ = ["FollowingStage", "ReconstructingStage"]


class ReconstructingStage(Protocol):
    """From what the sensors say to the posture of the human. `dt` is s of the performer's time."""

    def start(self, sample: SensorSample) -> "HumanPosture":
        """The posture that the sensors show first."""
        ...

    def step(self, sample: SensorSample, dt: float) -> "HumanPosture":
        """The next posture."""
        ...


class FollowingStage(Protocol):
    """From the posture of the human to a posture of the robot. `dt` is s of the robot's time."""

    def start(self, human: "HumanPosture") -> "RobotPosture":
        """The posture from which to follow."""
        ...

    def settle(self, human: "HumanPosture", dt: float) -> "list[RobotPosture]":
        """After `start`: the postures, tick by tick, from there to where this human posture wants the robot."""
        ...

    def step(self, human: "HumanPosture", dt: float) -> "RobotPosture":
        """The next posture."""
        ...

    def set_speed_override(self, pace: float) -> None:
        """From the next tick on, follow or land at a share (0, 1] of all speeds, called before every `step` and
        `return_to_stance`: the robot lags behind what is too fast for that, and catches up smoothly."""
        ...

    def set_contact_state(self, soles: BoolArray | None) -> None:
        """Which soles (k,) of the robot press on the floor from now on; None: nobody knows."""
        ...

    def halt(self, dt: float) -> FloatArray | None:
        """The next posture (nq,) on a way to a stop; None: none is known."""
        ...

    def begin_return_to_stance(self, q: FloatArray) -> None:
        """Land from posture q (nq,), in which the robot stands, whether it has followed or not."""
        ...

    def return_to_stance(self, dt: float) -> FloatArray | None:
        """The next posture (nq,) of a robot on its way to a stand, a foot put down first; None: it stands there, or
        needs none."""
        ...

    def separate_limbs(self) -> None:
        """If the robot stands, since a goal was refused, let the next thought be of parting limbs."""
        ...

    def pass_time(self, dt: float) -> None:
        """Let obstacles move on in a tick in which somebody else leads the robot."""
        ...

    def reseed(self, q: FloatArray, velocity: FloatArray) -> None:
        """Go on from posture q (nq,), moving at velocity (nv,) per s: something else was sent than was asked."""
        ...
