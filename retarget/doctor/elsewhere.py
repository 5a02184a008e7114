"""Listens beside a stream's own address, for a sender that sends to another port or to another interface.

Nothing that is heard here is decoded or kept; only who sends what, and where to, is noted.
"""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from ipaddress import IPv4Address

from retarget.errors import InputError
from retarget.live.address import EVERYWHERE, KINDS, LOOPBACK, StreamAddress
from retarget.live.interfaces import local_interfaces
from retarget.live.udp import UdpReceiver
from retarget.sources.datagram_kinds import Recognised, recognise
from retarget.sources.json_pose import DEFAULT_PORT

__all__ = ["USUAL_PORTS", "Elsewhere", "Stray"]

USUAL_PORTS = (
    *(kind.port for kind in KINDS.values() if kind.port is not None),
    *(DEFAULT_PORT, 39_540, 14_043, 12_351),
)
"""Where senders send to unless told otherwise: those that are read, VMC's other port, Rokoko Studio and mocopi."""


@dataclass(frozen=True, slots=True)
class Stray:
    """Datagrams from `host` to `port` of this machine. interface: own address that they came to, EVERYWHERE: any."""

    host: str
    interface: str
    port: int
    got: Recognised


class Elsewhere:
    """Sockets at the same port of other interfaces, and at the usual ports. What cannot be opened is left out.

    everywhere: listen beyond the interface of `address`, which the user must have asked for.
    """

    def __init__(self, address: StreamAddress, *, everywhere: bool, ports: Iterable[int] = USUAL_PORTS) -> None:
        self._receivers: list[tuple[str, int, UdpReceiver]] = []
        self._found: dict[tuple[str, int], Stray] = {}
        if address.kind == "replay":
            return
        places = [
            (EVERYWHERE if everywhere else address.bind, port) for port in dict.fromkeys(ports) if port != address.port
        ]
        if everywhere and address.bind == LOOPBACK and address.port:
            places += [(own, address.port) for own in local_interfaces().values() if not IPv4Address(own).is_loopback]
        plain = replace(address, multicast=None, host=None)
        for bind, port in places:
            with suppress(InputError):
                self._receivers.append((bind, port, UdpReceiver(replace(plain, bind=bind, port=port))))

    def poll(self, now: float) -> None:
        """Note what has arrived until `now`, s."""
        for bind, port, receiver in self._receivers:
            for datagram in receiver.poll(now)[:4]:
                key = (datagram.source[0], port)
                if key not in self._found and len(self._found) < 16:
                    self._found[key] = Stray(datagram.source[0], bind, port, recognise(datagram.payload))

    def close(self) -> None:
        """Close all."""
        for _, _, receiver in self._receivers:
            receiver.close()

    @property
    def strays(self) -> tuple[Stray, ...]:
        """Each sender at each port once."""
        return tuple(self._found.values())
