"""The two stages of a tick as the pipeline sees them: sensors to human, human to robot."""

from typing import TYPE_CHECKING, Protocol

from retarget.frames import SensorSample
from retarget.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from retarget.types import HumanPosture, RobotPosture


class ReconstructingStage(Protocol):
    """Takes sensor samples to the posture of the human. `dt` is s of the performer's time."""

    def start(self, sample: SensorSample) -> "HumanPosture":
        """The posture of the first sample."""
        ...

    def step(self, sample: SensorSample, dt: float) -> "HumanPosture":
        """Return the posture of the next sample, `dt` s later."""
        ...


class FollowingStage(Protocol):
    """Takes the posture of the human to a posture of the robot. `dt` is s of the robot's time."""

    def start(self, human: "HumanPosture") -> "RobotPosture":
        """The posture from which to follow."""
        ...

    def settle(self, human: "HumanPosture", dt: float) -> "RobotPosture | None":
        """Return the next posture (nq,) after `start` on the way to what this human posture asks for; None: it is
        there, and following can begin."""
        ...

    def step(self, human: "HumanPosture", dt: float) -> "RobotPosture":
        """Return the posture that follows the next posture of the human, `dt` s later."""
        ...

    def set_speed_override(self, override: float) -> None:
        """Follow, or return to stance, at a share (0, 1] of all speeds from the next tick on; called before every
        `step`, `settle` and `return_to_stance`. The robot lags behind faster motion, and catches up smoothly."""
        ...

    def set_contact_state(self, soles: BoolArray | None) -> None:
        """Set which soles (k,) of the robot press on the floor from now on; None: not known."""
        ...

    def halt(self, dt: float) -> FloatArray | None:
        """Return the next posture (nq,) of a stopping trajectory; None: there is none."""
        ...

    def begin_return_to_stance(self, q: FloatArray, dt: float) -> None:
        """Begin the return to stance from posture q (nq,), in which the robot stands; it may not have followed yet."""
        ...

    def return_to_stance(self, dt: float) -> FloatArray | None:
        """Return the next posture (nq,) of the return to stance, in which a raised foot touches down first; None: the
        robot has reached the stance, or needs none."""
        ...

    def pass_time(self, dt: float) -> None:
        """Let obstacles move on in a tick in which this stage does not lead the robot."""
        ...

    def reseed(self, q: FloatArray, velocity: FloatArray) -> None:
        """Go on from posture q (nq,) at velocity (nv,) per s, because something else was sent than was asked."""
        ...
