"""What the pipeline plays, tick by tick: a recorded clip, or a performer who moves right now."""

from typing import Protocol

from retarget.frames import SensorSample

__all__ = ["Samples"]


class Samples(Protocol):
    """Sensors for every tick of a run."""

    @property
    def ticks(self) -> int:
        """Ticks that are followed, at most."""
        ...

    @property
    def kept(self) -> int:
        """Ticks of which a record is kept; what comes after them is not recorded."""
        ...

    @property
    def dt(self) -> float:
        """Seconds between ticks."""
        ...

    @property
    def motion_dt(self) -> float:
        """Seconds of the performer's time between ticks."""
        ...

    def listen(self) -> None:
        """Called in every tick, also while nobody is followed: a stream is to be heard all the time."""
        ...

    def sample(self, tick: int) -> SensorSample | None:
        """What the sensors say at a tick; None: they cannot be trusted now, and nobody is to be followed. Not None for
        tick 0."""
        ...
