"""Goal positions of all servos of a port as one sync write: only the goals change from cycle to cycle.

A goal switches the torque of a 1.0 servo on (field knowledge, in no manual): one that is limp, or may have started
anew, is sent none.
"""

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hardware.arrays import BoolArray
from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.packets import BROADCAST, Instruction


class HasPlace(Protocol):
    """A servo: where its goal stands in servo order, its id, its table."""

    @property
    def index(self) -> int: ...  # noqa: D102
    @property
    def id(self) -> int: ...  # noqa: D102
    @property
    def table(self) -> ControlTable: ...  # noqa: D102


class GoalPacket:
    """Makes the packets: one for each place where servos keep their goal position."""

    def __init__(self, servos: Sequence[HasPlace]) -> None:
        places: dict[tuple[int, int, int], list[HasPlace]] = {}
        for servo in servos:
            goal = servo.table["goal_position"]
            places.setdefault((servo.table.protocol, goal.address, goal.size), []).append(servo)
        self._parts = [_Part(*place, members) for place, members in places.items()]

    def packets(self, ticks: NDArray[np.int64], driven: BoolArray) -> Iterator[bytes]:
        """The packets for goals (n,) of the whole robot, in ticks. driven (n,): who has torque."""
        return (packet for part in self._parts if (packet := part.packet(ticks, driven)))


class _Part:
    """One sync write."""

    def __init__(self, protocol: int, address: int, size: int, servos: Sequence[HasPlace]) -> None:
        self._protocol = protocol
        self._who = np.array([servo.index for servo in servos])
        self._rows = np.zeros(len(servos), dtype=[("id", "u1"), ("goal", f"<i{size}")])
        self._rows["id"] = [servo.id for servo in servos]
        width = 1 if protocol == 1 else 2
        self._span = address.to_bytes(width, "little") + size.to_bytes(width, "little")

    def packet(self, ticks: NDArray[np.int64], driven: BoolArray) -> bytes:
        """The packet for goals (n,); none when nobody is to have one."""
        self._rows["goal"] = ticks[self._who]
        if self._protocol == 2:
            return protocol2.frame(BROADCAST, Instruction.SYNC_WRITE, self._span + self._rows.tobytes())
        rows = self._rows[driven[self._who]]
        return protocol1.frame(BROADCAST, Instruction.SYNC_WRITE, self._span + rows.tobytes()) if rows.size else b""
