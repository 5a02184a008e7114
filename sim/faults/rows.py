"""The rows of the fault table: what is done to a run that moves, and what the robot has to do about it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from retarget.live.datagram import Datagram
from sim.emulator.faults import Direction, Fault, FaultKind
from sim.faults.bench import Bench
from sim.faults.sender import encoded, flapping, frozen, lost, moved, silent, swapped

BUS = "main"
EVER = math.inf


class Reaction(Enum):
    """What a robot has to do."""

    NONE = "goes on"
    OUT = "the sensor takes no part"
    HOLD = "holds: brakes and stands, torque on"
    RESUME = "holds, and goes on by itself"
    STOP = "stops: brakes, is parked, torque off, latched"
    CUT = "torque off at once, latched"


@dataclass(frozen=True)
class Row:
    """One fault. hurt: does it to a bench at a time (s after following began). limit: s from its onset to the reaction.

    sensor: whose place is judged for OUT. said: what a person has to be told.
    """

    name: str
    reaction: Reaction
    limit: float
    hurt: Callable[[Bench, float], object]
    sensor: str = ""
    said: str = ""


def _sender(make: Callable[[Bench], object]) -> Callable[[Bench, float], object]:
    """A fault of the sender that begins when it is due."""
    return lambda bench, at: bench.at(at, lambda: make(bench))


def _line(fault: Fault) -> Callable[[Bench, float], object]:
    """A fault of the emulated line."""
    return lambda bench, at: bench.at(at, lambda: bench.lines[BUS].faults.add(fault, bench.clock.now()))


def _garbage(time: float, datagram: bytes) -> list[bytes]:
    return [datagram[: len(datagram) // 2], b"", b"\x00\xff" * 20, datagram, b'{"poses": [[[[']


def _restless(bench: Bench) -> None:
    before = bench.sender.stamp
    bench.sender.stamp = lambda time: before(time) + 3600.0


def _reordered(bench: Bench) -> None:
    kept: list[bytes] = []

    def garble(time: float, datagram: bytes) -> list[bytes]:
        kept.append(datagram)
        return [kept[-1], kept[-2], kept[-1]] if len(kept) % 3 == 0 else []

    bench.sender.garbles.append(garble)


def _second_source(bench: Bench) -> None:
    def other(first: float, last: float) -> list[Datagram]:
        payload = encoded(last, {"head": bench.sender._track[0, 0] + 1.0})
        return [Datagram(bench.clock.now(), ("127.0.0.1", 50_000), payload)]

    bench.sender.others.append(other)


def _flood(bench: Bench) -> None:
    def other(first: float, last: float) -> list[Datagram]:
        return [Datagram(bench.clock.now(), ("127.0.0.1", 50_001), b"x" * 64)] * 100

    bench.sender.others.append(other)


def _nan(time: float, datagram: bytes) -> list[bytes]:
    return [datagram.replace(b'"p": [', b'"p": [NaN, ')]


def _raising(bench: Bench) -> None:
    def broken(now: float) -> object:
        raise ArithmeticError("forced")

    bench.stream.read = broken  # type: ignore[method-assign, assignment]


ROWS: tuple[Row, ...] = (
    Row("stream silent", Reaction.HOLD, 0.160, _sender(lambda b: b.sender.faults.append(silent(0.0, EVER)))),
    Row("stream silent for ever", Reaction.STOP, 5.2, _sender(lambda b: b.sender.faults.append(silent(0.0, EVER)))),
    Row("flapping stream", Reaction.HOLD, 0.4, _sender(lambda b: b.sender.faults.append(flapping(0.0, EVER)))),
    Row("not a number", Reaction.HOLD, 0.160, _sender(lambda b: b.sender.garbles.append(_nan))),
    Row(
        "teleport of a wrist",
        Reaction.HOLD,
        0.150,
        _sender(lambda b: b.sender.faults.append(moved("r_wrist", 0.0, EVER, (0.0, 0.0, 0.8)))),
        said="r_wrist",
    ),
    Row(
        "wrist frozen",
        Reaction.OUT,
        0.300,
        _sender(lambda b: b.sender.faults.append(frozen("l_wrist", 0.0, EVER))),
        sensor="l_wrist",
        said="l_wrist",
    ),
    Row(
        "wrist lost",
        Reaction.OUT,
        0.300,
        _sender(lambda b: b.sender.faults.append(lost("l_wrist", 0.0, EVER))),
        sensor="l_wrist",
    ),
    Row("ankle lost", Reaction.HOLD, 0.300, _sender(lambda b: b.sender.faults.append(lost("l_ankle", 0.0, EVER)))),
    Row(
        "left and right swapped",
        Reaction.HOLD,
        0.120,
        _sender(lambda b: b.sender.faults.append(swapped("l_wrist", "r_wrist", 0.0, EVER))),
        said="changed places",
    ),
    Row("late, reordered, twice", Reaction.NONE, 0.0, _sender(_reordered)),
    Row("sender's clock jumps", Reaction.RESUME, 1.0, _sender(_restless)),
    Row("malformed and truncated", Reaction.NONE, 0.0, _sender(lambda b: b.sender.garbles.append(_garbage))),
    Row("second source", Reaction.NONE, 0.0, _sender(_second_source)),
    Row("flood", Reaction.NONE, 0.0, _sender(_flood)),
    Row("exception in the tick", Reaction.STOP, 0.020, _sender(_raising)),
    Row("servo silent", Reaction.STOP, 0.150, _line(Fault(FaultKind.MISSING, ids=(6,)))),
    Row("1 % of packets damaged", Reaction.NONE, 0.0, _line(Fault(FaultKind.FLIP, rate=0.01))),
    Row(
        "every answer damaged",
        Reaction.STOP,
        0.150,
        _line(Fault(FaultKind.CRC_STORM, direction=Direction.TO_HOST)),
    ),
    Row("line shorted", Reaction.STOP, 0.150, _line(Fault(FaultKind.SHORT, value=20.0))),
    Row("servo too hot", Reaction.STOP, 1.1, _line(Fault(FaultKind.OVER_TEMPERATURE, value=78.0, ids=(6,)))),
    Row(
        "brown-out of a servo",
        Reaction.STOP,
        0.150,
        _line(Fault(FaultKind.UNDER_VOLTAGE, value=3.0, ids=(6,), end=0.3)),
    ),
    Row("adapter unplugged", Reaction.CUT, 0.050, _line(Fault(FaultKind.UNPLUG))),
    Row("person stops it", Reaction.STOP, 0.020, _sender(lambda b: b.guard.stop("space bar"))),
)
