"""Group reads, registers side by side, and pings."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

import more_frames
from bus_rig import BusRig, Tapped
from hardware.dynamixel import single_requests
from hardware.dynamixel.codec import Status, side_by_side
from hardware.dynamixel.cyclic import Ask, Kind, collect
from scripted_port import ScriptedPort
from sim.emulator.faults import Fault, FaultKind

SLACK = 0.004


def test_a_line_that_never_falls_silent_is_left() -> None:
    port = ScriptedPort(lambda request: [(1e-5 * at, bytes(1000)) for at in range(200)])
    received = single_requests.broadcast_ping(port, 252, SLACK)
    assert received.damaged <= single_requests.MAX_RECEIVED + 1000
    assert port.now() < 0.1


BAUD, SIZE = 1_000_000, 10
BYTE = 10 / BAUD
IDS = tuple(range(1, 21))
REPLY = more_frames.fast_status([Status(device, 0, bytes(range(device, device + SIZE))) for device in IDS])


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


def received(wire: Wire) -> tuple[int, float]:
    """How many answers, and when it was known that there are no more, s."""
    ask = Ask(Kind.FAST, IDS, 126, SIZE)
    found = collect(wire, ask, 0.0, ask.timeouts(wire, 0.0))  # type: ignore[arg-type]
    return len(found.answers), wire.time


def test_a_whole_reply_wakes_twice_and_is_there_with_its_last_byte() -> None:
    wire = Wire(pieces(REPLY, begun=1e-3))
    answers, known = received(wire)
    assert answers == 20 and known == pytest.approx(1e-3 + BYTE * len(REPLY)) and wire.waits <= 2


@pytest.mark.parametrize("count", [1, 2, 10, 19])
def test_silence_is_counted_from_the_last_byte_and_not_from_the_read(count: int) -> None:
    end = 8 + (SIZE + 4) * count
    wire = Wire(pieces(REPLY[:end], begun=1e-3))
    idle = Ask(Kind.FAST, IDS, 126, SIZE).timeouts(wire, 0.0).idle  # type: ignore[arg-type]
    answers, known = received(wire)
    assert answers == count
    assert known <= 1e-3 + BYTE * end + idle + 1e-9


@pytest.mark.parametrize("pause", [0.2e-3, 0.8e-3])
def test_a_pause_in_the_middle_is_waited_for(pause: float) -> None:
    due = [(at + (pause if k >= 7 else 0.0), data) for k, (at, data) in enumerate(pieces(REPLY, begun=1e-3))]
    answers, known = received(Wire(due))
    assert answers == 20 and known == pytest.approx(1e-3 + BYTE * len(REPLY) + pause, abs=2 * (SIZE + 4) * BYTE)


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


def test_an_answer_to_the_same_request_in_another_order_is_taken() -> None:
    """A request is repeated in another order; the answer to the first one may still come."""
    parts = [Status(device, 0, bytes((device, 0, 0, 0))) for device in (1, 2, 3)]
    found = Ask(Kind.FAST, (3, 2, 1), 132, 4).answers(more_frames.fast_status(parts))
    assert found == side_by_side(parts)
    assert not Ask(Kind.FAST, (3, 2, 4), 132, 4).answers(more_frames.fast_status(parts[:2])).ids
