"""What was seen of a live run that was hurt."""

from dataclasses import dataclass, field

from hardware.guard_state import GuardState, Stop
from retarget.rotations import FloatArray
from sim.faults.wire_packets import Sent

HOLDS = (GuardState.HOLDING,)


@dataclass(frozen=True, slots=True)
class Tick:
    """The end of a tick of the guard, at `time`, s. latched: a stop is; slow: share of its speed that the robot is
    left."""

    time: float
    state: GuardState
    latched: bool
    slow: float


@dataclass
class Trace:
    """All times in s of the run's clock. out: when which sensors took no part; steps: how far (m) the sensor that went
    farthest went from one followed sample to the next; sent: every packet of the host; let_go:
    when which servo (id) stopped driving by itself or was told to: its torque went, or its watchdog stopped it.

    began: when following began. arrived: when the robot was where it follows from. gone: when the host was killed.
    acted: when faults that wait for their cue had it, each once. rebased: when a leap of the sender's clock was
    understood. asked: postures (n,), rad, that a forced stage asked for. torque: registers of all servos in the end.
    mute: the host could not write any more. left: nobody looked at how it ended. endless: it did not end.
    """

    ticks: list[Tick] = field(default_factory=list)
    out: list[tuple[float, frozenset[str]]] = field(default_factory=list)
    steps: list[tuple[float, float]] = field(default_factory=list)
    sent: list[Sent] = field(default_factory=list)
    let_go: list[tuple[float, int]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    asked: list[tuple[float, FloatArray]] = field(default_factory=list)
    acted: list[float] = field(default_factory=list)
    stop: Stop | None = None
    began: float | None = None
    arrived: float | None = None
    gone: float | None = None
    rebased: float | None = None
    ended: float = 0.0
    mute: bool = False
    left: bool = False
    endless: bool = False
    error: str = ""
    torque: list[int] = field(default_factory=list)

    def first(self, state: GuardState, since: float) -> float | None:
        """When a state was first seen from a time on, s."""
        return next((tick.time for tick in self.ticks if tick.time >= since and tick.state is state), None)

    @property
    def armed(self) -> float | None:
        """When the first tick with torque ended, s."""
        return self.ticks[0].time if self.ticks else None

    @property
    def latched(self) -> float | None:
        """When a stop was latched, s: at the end of the tick that did it."""
        return next((tick.time for tick in self.ticks if tick.latched), None)

    @property
    def holds(self) -> list[tuple[float, float]]:
        """When the robot held, from and to, s."""
        found: list[tuple[float, float]] = []
        since: float | None = None
        for tick in self.ticks:
            if tick.state in HOLDS:
                since = tick.time if since is None else since
            elif since is not None:
                found.append((since, tick.time))
                since = None
        return found if since is None else [*found, (since, self.ticks[-1].time)]
