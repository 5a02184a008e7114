"""Rows of the fault table: servos that are not those of the profile. Nothing may begin, and all is named at once."""

from collections.abc import Callable

from sim.emulator.faults import Fault, FaultKind
from sim.faults.bench import Bench
from sim.faults.bus_rows import on_line
from sim.faults.reaction import Idle, Reaction, Row
from sim.faults.stream_rows import later

__all__ = ["START_ROWS"]

XL430 = 1060
"""Model number."""
OLD = 37
"""A firmware before the bus watchdog."""
SLOW_BAUD = 1
"""Register value of 57,600 bits/s."""


def _register(device: int, name: str, value: int) -> Callable[[Bench], None]:
    """A servo is another one, from the factory."""

    def put(bench: Bench) -> None:
        servo = bench.servo(device)
        servo.memory.put(name, value)
        servo.tune()

    return put


def _everything(bench: Bench) -> None:
    bench.lines["main"].faults.add(Fault(FaultKind.ID_CLASH, ids=(6,)), bench.clock.now())
    for put in (_MODEL, _FIRMWARE, _BAUD):
        put(bench)


_MODEL, _FIRMWARE = _register(9, "model_number", XL430), _register(13, "firmware_version", OLD)
_BAUD = _register(17, "baud_rate", SLOW_BAUD)
START_ROWS: tuple[Row, ...] = (
    Row(
        "id clash",
        Reaction.STOP,
        0.100,
        on_line(Fault(FaultKind.ID_CLASH, ids=(6,))),
        Idle.ONLY_READS,
        refusal=("l_el (id 6)", "two servos have this id"),
    ),
    Row(
        "wrong model",
        Reaction.NONE,
        0.0,
        later(_MODEL),
        Idle.ONLY_READS,
        refusal=("r_hip_roll (id 9)", "XL430-W250", "XM430-W350"),
    ),
    Row(
        "wrong firmware",
        Reaction.NONE,
        0.0,
        later(_FIRMWARE),
        Idle.ONLY_READS,
        refusal=("r_knee (id 13)", "firmware 37", "no bus watchdog"),
    ),
    Row(
        "wrong baud rate",
        Reaction.STOP,
        0.100,
        later(_BAUD),
        Idle.ONLY_READS,
        refusal=("r_ank_roll (id 17)", "57600"),
    ),
    Row(
        "id clash, wrong model, firmware and baud rate",
        Reaction.STOP,
        0.100,
        later(_everything),
        Idle.ONLY_READS,
        refusal=("l_el (id 6)", "r_hip_roll (id 9)", "r_knee (id 13)", "r_ank_roll (id 17)"),
    ),
)
