"""How a live run begins and is heard."""

from dataclasses import dataclass

from retarget.errors import UsageError
from retarget.live.smoothing import LIGHT

__all__ = ["LONGEST_COUNTDOWN_S", "LiveOptions"]

LONGEST_COUNTDOWN_S = 600.0


@dataclass(frozen=True)
class LiveOptions:
    """How a live run begins. patience: s of waiting for data. countdown: s to get into the pose. duration: s of the
    run, None: until it is stopped. mirror: left and right exchanged. mass: kg of the performer, if known. smoothing:
    of `smoothing.SMOOTHINGS`. latest: the newest poses count, without a playout buffer. person: name under which the
    size is kept, None: it is not. recalibrate: measure also whoever was measured before. check_sides: the left arm is
    to be raised first. Raises UsageError: a countdown that is none."""

    patience: float = 10.0
    countdown: float = 3.0
    duration: float | None = None
    mirror: bool = False
    mass: float | None = None
    smoothing: str = LIGHT
    latest: bool = False
    person: str | None = None
    recalibrate: bool = False
    check_sides: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.countdown <= LONGEST_COUNTDOWN_S:  # nor NaN
            raise UsageError(
                "this is no time to get into the pose",
                where="--countdown",
                found=f"{self.countdown:g}",
                allowed=f"0 to {LONGEST_COUNTDOWN_S:g} s",
                next_step="Leave it out, or give some seconds",
            )
