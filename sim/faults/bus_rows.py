"""Rows of the fault table: what goes wrong on the bus and with servos."""

from collections.abc import Callable

from sim.emulator.faults import Direction, Fault, FaultKind
from sim.faults.bench import Bench
from sim.faults.reaction import Idle, Reaction, Row
from sim.faults.stream_rows import later

__all__ = ["BUS", "BUS_ROWS", "on_line"]

BUS = "main"
ELBOW, HEAD = 6, 19
"""Ids of a servo that moves a lot, and of one that hardly does."""
SLIP_RAD = 0.25


def on_line(fault: Fault) -> Callable[[Bench, float], object]:
    """A fault of the emulated line."""
    return later(lambda bench: bench.lines[BUS].faults.add(fault, bench.clock.now()))


def _slip(bench: Bench) -> None:
    """A shaft is blocked, away from its goal."""
    servo, now = bench.servo(HEAD), bench.clock.now()
    servo.jam(True, now)
    servo.shaft.position += SLIP_RAD / servo.servo_model.tick_rad


def _unwritable(bench: Bench) -> None:
    for port in bench.ports.values():
        port.mute = True
    bench.trace.mute = True


def _reset(bench: Bench) -> None:
    bench.servo(ELBOW).reboot(bench.clock.now())


def _garbage() -> Callable[[Bench, float], object]:
    return on_line(Fault(FaultKind.SHORT, value=20.0))


BUS_ROWS: tuple[Row, ...] = (
    Row("servo unplugged", Reaction.STOP, 0.100, on_line(Fault(FaultKind.MISSING, ids=(ELBOW,))), Idle.ONLY_READS),
    Row("1 % of packets damaged", Reaction.NONE, 0.0, on_line(Fault(FaultKind.FLIP, rate=0.01)), Idle.ANY),
    Row("30 % of packets damaged", Reaction.STOP, 0.100, on_line(Fault(FaultKind.FLIP, rate=0.3)), Idle.ANY),
    Row(
        "30 % of answers damaged",
        Reaction.STOP,
        0.100,
        on_line(Fault(FaultKind.CRC_STORM, rate=0.3, direction=Direction.TO_HOST)),
        Idle.ANY,
    ),
    Row("garbage on the bus", Reaction.CUT, 0.050, _garbage(), Idle.ONLY_READS, watchdog=0.100),
    Row(
        "every answer damaged",
        Reaction.CUT,
        0.050,
        on_line(Fault(FaultKind.CRC_STORM, direction=Direction.TO_HOST)),
        Idle.ONLY_READS,
        watchdog=0.100,
    ),
    Row("writes fail, reads succeed", Reaction.GONE, 0.120, later(_unwritable), Idle.REFUSES, watchdog=0.120),
    Row(
        "servo warm",
        Reaction.SLOW,
        1.1,
        on_line(Fault(FaultKind.OVER_TEMPERATURE, value=62.0, ids=(ELBOW,))),
        said="hotter than 60",
        after=2.0,
    ),
    Row(
        "servo too hot",
        Reaction.STOP,
        1.1,
        on_line(Fault(FaultKind.OVER_TEMPERATURE, value=78.0, ids=(ELBOW,))),
        Idle.REFUSES,
        said="hotter than 65",
        after=1.2,
    ),
    Row(
        "brown-out of a servo",
        Reaction.STOP,
        0.100,
        on_line(Fault(FaultKind.UNDER_VOLTAGE, value=3.0, ids=(ELBOW,), end=0.3)),
        Idle.ANY,
    ),
    Row("reset of a servo", Reaction.STOP, 0.100, later(_reset), Idle.ANY),
    Row(
        "reset of a servo, soon back",
        Reaction.STOP,
        0.100,
        on_line(Fault(FaultKind.UNDER_VOLTAGE, ids=(HEAD,), end=0.01)),
        Idle.ANY,
    ),
    Row(
        "overload shutdown", Reaction.STOP, 0.100, later(lambda b: b.servo(ELBOW).overload(b.clock.now())), Idle.REFUSES
    ),
    Row("following error for 0.2 s", Reaction.STOP, 0.250, later(_slip), Idle.ANY),
    Row("adapter unplugged", Reaction.CUT, 0.050, on_line(Fault(FaultKind.UNPLUG)), Idle.ONLY_READS, watchdog=0.100),
)
