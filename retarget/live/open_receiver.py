"""What listens to an address: a UDP socket, the sockets of NatNet, a TCP port for MVN, or a recording."""

from retarget.live.address import StreamAddress
from retarget.live.datagram import Receiver
from retarget.live.natnet_receiver import NatnetReceiver, session_for
from retarget.live.replay import open_replay
from retarget.live.tcp import TcpReceiver
from retarget.live.udp import UdpReceiver

__all__ = ["open_receiver"]


def open_receiver(address: StreamAddress) -> Receiver:
    """Open it. Arrivals are on the machine's monotonic clock, of a replay on whatever clock it is polled by.

    Raises InputError: port taken or forbidden, no such interface, group not joined, no such recording.
    """
    if address.kind == "replay":
        return open_replay(address)
    if address.kind == "natnet":
        return NatnetReceiver(address, session_for(address))
    return UdpReceiver(address) if address.host is None else TcpReceiver(address)
