"""What listens to an address: a UDP socket, the sockets of NatNet, a TCP port for MVN, or a recording."""

from collections.abc import Callable

from retarget.live.address import StreamAddress
from retarget.live.datagram import Receiver
from retarget.live.natnet_receiver import NatnetReceiver, session_for
from retarget.live.replay import open_replay
from retarget.live.tcp import TcpReceiver
from retarget.live.udp import UdpReceiver

__all__ = ["open_receiver"]


def open_receiver(address: StreamAddress, *, names_missing: Callable[[], bool] = lambda: False) -> Receiver:
    """Open it. names_missing: whether Motive's frames have ids of which no name is known; then it is asked for names.

    Arrivals are on the machine's monotonic clock, of a replay on whatever clock it is polled by.

    Raises InputError: port taken or forbidden, no such interface, group not joined, no such recording.
    """
    if address.kind == "replay":
        return open_replay(address)
    if address.kind == "natnet":
        session = session_for(address)
        session.names_missing = names_missing
        return NatnetReceiver(address, session)
    return UdpReceiver(address) if address.host is None else TcpReceiver(address)
