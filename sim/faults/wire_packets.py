"""What a host put on the wires, taken apart once more: frames of protocol 2.0, and what they write.

Shares nothing with the driver that it judges.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

HEADER = b"\xff\xff\xfd\x00"
READS = frozenset((0x01, 0x02, 0x82, 0x8A, 0x92, 0x9A))
"""Ping, read, (fast) sync read, (fast) bulk read: whoever hears them stays as he is."""
WRITE, REG_WRITE, SYNC_WRITE = 0x03, 0x04, 0x83
GOAL_POSITION, TORQUE_ENABLE, WATCHDOG = 116, 64, 98


@dataclass(frozen=True)
class Sent:
    """What the host handed to its port. time: s."""

    time: float
    data: bytes


@dataclass(frozen=True, slots=True)
class Packet:
    """An instruction. time: s; id: whom it is for; params: what follows the instruction, without stuffing."""

    time: float
    id: int
    instruction: int
    params: bytes


@dataclass(frozen=True, slots=True)
class Written:
    """A write that every servo takes at once: little-endian signed values by id, at an address."""

    time: float
    address: int
    values: dict[int, int]


def packets(sent: Sequence[Sent]) -> Iterator[Packet]:
    """Every instruction, in order."""
    for one in sent:
        data = one.data
        at = data.find(HEADER)
        while at >= 0:
            length = int.from_bytes(data[at + 5 : at + 7], "little")
            body = data[at + 7 : at + 7 + length - 2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            if body:
                yield Packet(one.time, data[at + 4], body[0], body[1:])
            at = data.find(HEADER, at + 7)


def written(sent: Sequence[Sent]) -> list[Written]:
    """Every write to a single servo or to several."""
    found = []
    for packet in packets(sent):
        params = packet.params
        if packet.instruction == SYNC_WRITE and len(params) > 4:
            address, size = (int.from_bytes(params[k : k + 2], "little") for k in (0, 2))
            items = range(4, len(params) - size, size + 1)
            values = {params[k]: int.from_bytes(params[k + 1 : k + 1 + size], "little", signed=True) for k in items}
            found.append(Written(packet.time, address, values))
        elif packet.instruction in (WRITE, REG_WRITE) and len(params) > 2:
            value = int.from_bytes(params[2:], "little", signed=True)
            found.append(Written(packet.time, int.from_bytes(params[:2], "little"), {packet.id: value}))
    return found


def goal_writes(writes: Sequence[Written]) -> list[tuple[float, dict[int, int]]]:
    """Times (s) and goals (ticks by id) of every write of goal positions."""
    return [(one.time, one.values) for one in writes if one.address == GOAL_POSITION]


def torque_off(writes: Sequence[Written], since: float) -> float | None:
    """When torque was first told to go off from a time on, s."""
    return next(
        (
            one.time
            for one in writes
            if one.time >= since and one.address == TORQUE_ENABLE and not any(one.values.values())
        ),
        None,
    )
