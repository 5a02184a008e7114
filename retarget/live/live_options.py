"""How a live run begins and is heard."""

from dataclasses import dataclass

from retarget.live.smoothing import LIGHT

__all__ = ["LiveOptions"]


@dataclass(frozen=True)
class LiveOptions:
    """How a live run begins. patience: s of waiting for data. countdown: s to get into the pose. duration: s of the
    run, None: until it is stopped. mirror: left and right exchanged. mass: kg of the performer, if known. smoothing:
    of `smoothing.SMOOTHINGS`. latest: the newest poses count, without a playout buffer. person: name under which the
    size is kept, None: it is not. recalibrate: measure also whoever was measured before. check_sides: the left arm is
    to be raised first."""

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
