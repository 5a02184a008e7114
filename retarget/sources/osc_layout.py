"""Datagrams that differ in their numbers only are taken apart once: a sender's next one mostly looks like its last."""

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from retarget.sources.osc import OscPacket, read_osc

__all__ = ["MAX_REMEMBERED", "OscLayouts"]

MAX_REMEMBERED = 16_384
"""Bytes of the longest datagram whose layout is remembered: all the bones, fingers and expressions of an avatar."""
MIN_MESSAGES = 4
"""Messages from which remembering saves anything."""
MAX_LENGTHS = 32
"""Lengths of datagrams that are remembered; all are forgotten when one more comes."""
MAX_ALIKE = 4
"""Layouts remembered of one length, the latest first."""

PER_ELEMENT, PER_ARGUMENT = 5.0, 0.4

Plan = TypeVar("Plan")


class _Known(Generic[Plan]):
    """One layout: the words of a datagram that are no number, and the plan made for it."""

    __slots__ = ("_mask", "_words", "plan")

    def __init__(self, datagram: bytes, packet: OscPacket, plan: Plan) -> None:
        self._mask: NDArray[np.uint32] = np.full(len(datagram) // 4, 0xFFFFFFFF, np.uint32)
        for start, end in _variable(packet):
            self._mask[start // 4 : end // 4] = 0
        self._words = self._fixed(datagram)
        self.plan = plan

    def fits(self, datagram: bytes) -> bool:
        """Whether a datagram of the same length has the same addresses, types, sizes and texts."""
        return self._fixed(datagram) == self._words

    def _fixed(self, datagram: bytes) -> bytes:
        return (np.frombuffer(datagram, np.uint32) & self._mask).tobytes()


class OscLayouts(Generic[Plan]):
    """Plans by the layout of a datagram: `plan` is asked once for each layout, and must not look at its numbers."""

    def __init__(self, plan: Callable[[OscPacket], Plan]) -> None:
        self._make = plan
        self._known: dict[int, list[_Known[Plan]]] = {}
        self.work = 0.0
        """Microseconds, about, that taking apart has cost so far: of each element and each argument."""

    def of(self, datagram: bytes) -> Plan:
        """The plan of this datagram's layout."""
        alike = self._known.get(len(datagram), ())
        for known in alike:
            if known.fits(datagram):
                return known.plan
        packet = read_osc(datagram)
        self.work += PER_ELEMENT * packet.elements + PER_ARGUMENT * packet.arguments
        plan = self._make(packet)
        if len(packet.messages) >= MIN_MESSAGES and len(datagram) <= MAX_REMEMBERED:
            self._remember(_Known(datagram, packet, plan), len(datagram))
        return plan

    def __len__(self) -> int:
        return sum(len(alike) for alike in self._known.values())

    def _remember(self, known: _Known[Plan], length: int) -> None:
        if length not in self._known and len(self._known) >= MAX_LENGTHS:
            self._known.clear()
        alike = self._known.setdefault(length, [])
        alike.insert(0, known)
        del alike[MAX_ALIKE:]


def _variable(packet: OscPacket) -> list[tuple[int, int]]:
    """Bytes of a datagram that may differ within one layout: numbers and time tags."""
    numbers = [span for message in packet.messages for span in message.numbers()]
    return numbers + [(at, at + 8) for at in packet.time_tags]
