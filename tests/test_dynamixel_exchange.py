"""Waiting for the answers to a group read: as seldom as the reply allows, and no longer than before it falls silent."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

from bus_rig import BusRig, Tapped
from hardware.dynamixel import protocol2
from hardware.dynamixel.exchange import Ask, Kind, collect
from hardware.dynamixel.packets import Status
from sim.emulator.faults import Fault, FaultKind

BAUD, SIZE = 1_000_000, 10
BYTE = 10 / BAUD
IDS = tuple(range(1, 21))
REPLY = protocol2.fast_status([Status(device, 0, bytes(range(device, device + SIZE))) for device in IDS])


@dataclass
class Wire:
    """A port on which pieces of a reply arrive at their times, s; `due` is asked for in order."""

    due: list[tuple[float, bytes]]
    baud: int = BAUD
    latency: float = 1e-3
    time: float = 0.0
    waits: int = 0
    name: str = "wire"
    read_at: list[float] = field(default_factory=list)

    def now(self) -> float:
        return self.time

    def wait(self, deadline: float) -> bool:
        self.waits += 1
        self.time = max(self.time, min([deadline, *(at for at, _ in self.due[:1])]))
        return bool(self.due) and self.due[0][0] <= self.time

    def sleep_until(self, deadline: float) -> None:
        self.time = max(self.time, deadline)

    def read(self) -> bytes:
        come = b"".join(data for at, data in self.due if at <= self.time)
        self.due = [one for one in self.due if one[0] > self.time]
        self.read_at.append(self.time)
        return come

    def write(self, data: bytes) -> None:
        raise AssertionError("it only listens")

    drop = close = open = set_baud = write


def pieces(reply: bytes, *, begun: float, size: int = SIZE + 4) -> list[tuple[float, bytes]]:
    """Each part of a reply, when its last byte is on the wire."""
    cuts = [0, *range(8 + size, len(reply), size), len(reply)]
    return [(begun + BYTE * end, reply[at:end]) for at, end in pairwise(cuts) if end > at]


def heard(wire: Wire) -> tuple[int, float]:
    """How many answers, and when it was known that there are no more, s."""
    ask = Ask(Kind.FAST, IDS, 126, SIZE)
    found = collect(wire, ask, 0.0, ask.timeouts(wire, 0.0))  # type: ignore[arg-type]
    return len(found.answers), wire.time


def test_a_whole_reply_wakes_twice_and_is_there_with_its_last_byte() -> None:
    wire = Wire(pieces(REPLY, begun=1e-3))
    answers, known = heard(wire)
    assert answers == 20 and known == pytest.approx(1e-3 + BYTE * len(REPLY)) and wire.waits <= 2


def test_one_that_comes_in_one_piece_costs_no_sleep() -> None:
    wire = Wire([(2e-3, REPLY)])
    assert heard(wire) == (20, 2e-3) and wire.waits == 1


@pytest.mark.parametrize("count", [1, 2, 10, 19])
def test_silence_is_counted_from_the_last_byte_and_not_from_when_somebody_looked(count: int) -> None:
    end = 8 + (SIZE + 4) * count
    wire = Wire(pieces(REPLY[:end], begun=1e-3))
    idle = Ask(Kind.FAST, IDS, 126, SIZE).timeouts(wire, 0.0).idle  # type: ignore[arg-type]
    answers, known = heard(wire)
    assert answers == count
    assert known <= 1e-3 + BYTE * end + idle + 1e-9


@pytest.mark.parametrize("pause", [0.2e-3, 0.8e-3])
def test_a_pause_in_the_middle_is_waited_for(pause: float) -> None:
    due = [(at + (pause if k >= 7 else 0.0), data) for k, (at, data) in enumerate(pieces(REPLY, begun=1e-3))]
    answers, known = heard(Wire(due))
    assert answers == 20 and known == pytest.approx(1e-3 + BYTE * len(REPLY) + pause, abs=2 * (SIZE + 4) * BYTE)


def test_an_adapter_that_collects_bytes_is_waited_for_no_longer_than_its_reply() -> None:
    """Full-speed USB: what has come by each whole ms."""
    due: dict[int, bytes] = {}
    for at, data in pieces(REPLY, begun=1e-3, size=1):
        due[int(at * 1e3) + 1] = due.get(int(at * 1e3) + 1, b"") + data
    wire = Wire([(1e-3 * ms, data) for ms, data in due.items()])
    last = 1e-3 * max(due)
    answers, known = heard(wire)
    assert answers == 20 and known == pytest.approx(last) and wire.waits <= len(due)


class Counting(Tapped):
    waits = 0

    def wait(self, deadline: float) -> bool:
        self.waits += 1
        return super().wait(deadline)


def test_a_cycle_of_twenty_servos_waits_a_few_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bus_rig.Tapped", Counting)
    rig = BusRig().ready(torque=True)
    assert isinstance(rig.port, Counting)
    rig.tick()
    rig.port.waits = 0
    usual = max(rig.tick().took for _ in range(20))
    assert rig.port.waits <= 4 * 20
    # One that goes missing: no later found out than the reply would have fallen silent.
    rig.fault(Fault(FaultKind.MISSING, ids=(10,)))
    states, took = rig.tick()
    others = np.arange(1, 21) != 10
    assert states.valid[others].all() and took - usual <= 6e-3
