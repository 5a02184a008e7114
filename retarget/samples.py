"""What the pipeline plays, tick by tick: a recorded clip, or a performer who moves right now."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from retarget.frames import SensorSample
from retarget.human_dimensions import HumanDimensions
from retarget.sensor_intake import IntakeTimes

if TYPE_CHECKING:
    from retarget.clip import Clip

__all__ = ["Performance", "Samples"]


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

    @property
    def over(self) -> bool:
        """Whether the performance has ended before its last tick: a recorded stream is at its end."""
        ...

    @property
    def settled(self) -> float:
        """How much of its speed the robot may use beyond that of its slow approach, 0 to 1: who takes the performer up
        again after a hold comes back slowly."""
        ...

    def may_approach(self) -> bool:
        """Called in every tick in which the robot is on its way to where it follows tick 0: whether it is to go on."""
        ...

    def listen(self) -> None:
        """Called in every tick, also while nobody is followed: a stream is to be heard all the time."""
        ...

    def sample(self, tick: int) -> SensorSample | None:
        """What the sensors say at a tick; None: they cannot be trusted now, and nobody is to be followed. Not None for
        tick 0."""
        ...

    @property
    def hindrance(self) -> str:
        """Why nobody is followed, in a few words; of the last tick in which nobody was."""
        ...

    def recorded(self) -> "Clip":
        """What was said at the ticks that were followed, for those who look at the run afterwards."""
        ...


@dataclass(frozen=True, eq=False)
class Performance:
    """Somebody who performs: their sensors, their size, what is worth a note, and how sensors leave and come back."""

    samples: Samples
    dimensions: HumanDimensions
    notes: tuple[str, ...] = ()
    intake: IntakeTimes = field(default_factory=IntakeTimes)
