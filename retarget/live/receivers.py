"""Receivers of datagrams: a UDP socket, and NatNet with its requests and answers.

Polls never block, and arrivals are the kernel's times.
"""

import errno
import itertools
import socket
import struct
from contextlib import suppress
from dataclasses import replace
from math import fsum
from operator import attrgetter

from hardware.clock import wall_to_monotonic
from hardware.processes import MOST_PROCESSES, PROCESSES, named_process
from retarget.errors import InputError
from retarget.live.address import EVERYWHERE, StreamAddress, interface_towards, listed_interfaces
from retarget.live.admission import MOST_BYTES_PER_POLL, MOST_PER_POLL, Datagram, Source
from retarget.live.advice import refusal
from retarget.sources.streams.natnet_session import NatnetSession
from retarget.sources.streams.natnet_wire import COMMAND_PORT
from retarget.sources.streams.stream_frame import MAX_DATAGRAM, Dropped

RECEIVE_BUFFER = 2**20
"""Bytes requested from the kernel, up to net.core.rmem_max: more than a second of SlimeVR's VMC. A larger buffer would
hold datagrams too old to use."""
SO_TIMESTAMPNS = 35  # time of arrival on the wall clock, as a timespec (socket(7); asm-generic/socket.h)
SO_RXQ_OVFL = 40  # datagrams lost so far because the buffer was full (socket(7))
IP_MULTICAST_ALL = 49  # receive datagrams of groups that other sockets joined (ip(7))
NO_INTERFACE = {errno.ENODEV, errno.EADDRNOTAVAIL, errno.ENXIO}


def open_socket(address: StreamAddress) -> socket.socket:
    """Open a bound, non-blocking UDP socket.

    Raises InputError: the port is taken or forbidden, there is no such interface, or the group cannot be joined.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        listener.setblocking(False)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        for option in (SO_TIMESTAMPNS, SO_RXQ_OVFL):
            with suppress(OSError):  # a kernel without them: arrival is then the time of the poll
                listener.setsockopt(socket.SOL_SOCKET, option, 1)
        if address.multicast is not None:
            # Listeners of a group get copies. A unicast port must not be shared, as it could be taken over.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((address.bind, address.port))
        except OSError as error:
            raise _not_bound(address, error) from error
        if address.multicast is not None:
            # Join on the named interface, else on that towards the server, else on the system's choice.
            interface = address.interface
            if interface == EVERYWHERE and address.host is not None:
                interface = interface_towards(address.host) or EVERYWHERE
            with suppress(OSError):  # it only keeps out groups that other programs joined
                listener.setsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL, 0)
            request = socket.inet_aton(address.multicast) + socket.inet_aton(interface)
            try:
                listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, request)
            except OSError as error:
                raise _not_joined(address, address.multicast, interface, error) from error
    except BaseException:
        listener.close()
        raise
    return listener


def _not_bound(address: StreamAddress, error: OSError) -> InputError:
    if error.errno in NO_INTERFACE:
        return _no_interface(address, address.bind)
    if error.errno == errno.EADDRINUSE:
        return refusal(InputError, "port taken", address.text, found=port_holder(address.port), port=address.port)
    if error.errno in {errno.EACCES, errno.EPERM}:
        return refusal(InputError, "port forbidden", address.text, port=address.port)
    found = f"{address.bind}:{address.port}: {error.strerror or error}"
    return refusal(InputError, "port unusable", address.text, found=found)


MOST_SOCKETS = 100_000  # bound of a search


def port_holder(port: int) -> str:
    """The processes that listen on a UDP port (IPv4 or IPv6): "process 12 (retarget run)", or "another process"."""
    sockets, found = set[str](), list[str]()
    for table in ("udp", "udp6"):
        with suppress(OSError), (PROCESSES / "net" / table).open(encoding="ascii", errors="replace") as lines:
            for line in itertools.islice(lines, 1, MOST_SOCKETS):
                words = line.split()  # the columns `local_address` and `inode`
                if len(words) > 9 and words[1].endswith(f":{port:04X}"):
                    sockets.add(f"socket:[{words[9]}]")
    for process in itertools.islice(PROCESSES.glob("[0-9]*"), MOST_PROCESSES) if sockets else ():
        with suppress(OSError):
            if any(str(link.readlink()) in sockets for link in (process / "fd").iterdir()):
                found.append(named_process(process.name))
    return ", ".join(sorted(found)) or "another process"


def _not_joined(address: StreamAddress, group: str, interface: str, error: OSError) -> InputError:
    if error.errno in NO_INTERFACE and interface != EVERYWHERE:
        return _no_interface(address, interface)
    if error.errno == errno.ENODEV:
        return refusal(InputError, "no interface to a group", address.text, group=group)
    found = f"{error.strerror or error}, on interface {interface}"
    return refusal(InputError, "group not joined", address.text, found=found, group=group, listed=listed_interfaces())


def _no_interface(address: StreamAddress, requested: str) -> InputError:
    return refusal(InputError, "no interface", address.text, found=requested, listed=listed_interfaces())


REMEASURE_S = 1.0  # [s] between measurements of the offset of wall and monotonic clock: NTP slews by 0.5 ms in it
TOLERANCE_S = 0.001  # a stamp this long before the socket was last empty is inexact; an earlier one is wrong
CONTROL_BYTES = socket.CMSG_SPACE(16) + socket.CMSG_SPACE(4)
TIMESPEC = struct.Struct("@ll")
COUNTER = struct.Struct("@I")
GONE = {errno.EAGAIN, errno.EWOULDBLOCK}
TRANSIENT = {errno.EINTR, errno.ECONNREFUSED, errno.EHOSTUNREACH, errno.ENETUNREACH}
"""Errors to ignore. The kernel reports those of a sent datagram (a keep-alive) on the next receive."""


class UdpReceiver:
    """A socket that is polled by the loop.

    dropped: counts by reason. overflowed: datagrams that the kernel lost because they were not fetched in time.
    """

    finished = False

    def __init__(self, address: StreamAddress) -> None:
        self.dropped = Dropped()
        self.overflowed = 0
        self._socket = open_socket(address)
        self.bound: Source = self._socket.getsockname()
        self._offset = 0  # [ns] to be added to the wall clock
        self._measured = float("-inf")
        self._emptied = float("-inf")  # when the socket was last empty: all that is read later arrived after it

    def fileno(self) -> int:
        """Number of the socket, for `select`; -1 once closed."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket. A second call has no effect, and later polls return nothing."""
        self._socket.close()

    def send(self, payload: bytes, to: Source) -> bool:
        """Send a request or keep-alive from this port. True if the kernel took it. Never blocks or raises."""
        try:
            return self._socket.sendto(payload, to) == len(payload)
        except OSError:
            return False

    def poll(self, now: float) -> list[Datagram]:
        """Return what has arrived until `now` (s), oldest first, bounded in number and bytes."""
        if now - self._measured >= REMEASURE_S:
            self._offset, self._measured = wall_to_monotonic(), now
        found: list[Datagram] = []
        room = MOST_BYTES_PER_POLL
        receive = self._socket.recvmsg
        for _ in range(MOST_PER_POLL):
            try:
                payload, control, _, source = receive(MAX_DATAGRAM, CONTROL_BYTES)
            except OSError as error:
                if error.errno in GONE:
                    self._emptied = now
                    break
                if error.errno in TRANSIENT:
                    continue
                self.dropped.note("the socket cannot be read")
                break
            arrival = self._arrival(control, now)
            if payload:
                found.append(Datagram(arrival, source, payload))
            else:
                self.dropped.note("empty datagram")
            room -= len(payload)
            if room <= 0:
                break
        return found

    def _arrival(self, control: list[tuple[int, int, bytes]], now: float) -> float:
        """Arrival of a datagram by the kernel, s on the clock of `now`; `now` if unknown. After an early one the offset
        to the wall clock is measured anew."""
        arrival = now
        for _, kind, content in control:
            if kind == SO_RXQ_OVFL and len(content) == COUNTER.size:
                self.overflowed = COUNTER.unpack(content)[0]
            elif kind == SO_TIMESTAMPNS and len(content) == TIMESPEC.size:
                seconds, nanoseconds = TIMESPEC.unpack(content)
                stamp = (seconds * 1_000_000_000 + nanoseconds + self._offset) * 1e-9
                if stamp >= self._emptied - TOLERANCE_S:
                    arrival = min(max(stamp, self._emptied), now)
                else:
                    self._measured = float("-inf")
        return arrival


NOT_THE_SERVER = "sender is not the server"


class NatnetReceiver:
    """Receives frames from Motive. Each poll also sends the requests of the session, and gives it the answers.

    In multicast, frames come through a second socket. dropped: datagrams of others than the server.
    """

    finished = False

    def __init__(self, address: StreamAddress, *, command_port: int = COMMAND_PORT) -> None:
        assert address.kind == "natnet" and address.host is not None
        self.session = NatnetSession(group=None if address.multicast is None else (address.multicast, address.port))
        self.dropped = Dropped()
        self.host = address.host
        self._server = (address.host, command_port)
        self._sockets = [UdpReceiver(replace(address, bind=address.interface, port=0, multicast=None))]
        self.bound = self._sockets[0].bound
        if address.multicast is not None:
            try:
                self._sockets.append(UdpReceiver(address))
            except InputError:
                self.close()
                raise

    @property
    def overflowed(self) -> int:
        """Datagrams that the kernel lost because they were not fetched in time."""
        return int(fsum(one.overflowed for one in self._sockets))

    def close(self) -> None:
        """Close the sockets. A second call has no effect."""
        for one in self._sockets:
            one.close()

    def poll(self, now: float) -> list[Datagram]:
        """The server's datagrams until `now` (s), oldest first, bounded as for two sockets. Never raises."""
        for message in self.session.poll(now):
            self._sockets[0].send(message, self._server)
        found = [datagram for one in self._sockets for datagram in one.poll(now)]
        received = sorted((one for one in found if one.source[0] == self._server[0]), key=attrgetter("arrival"))
        for _ in range(len(found) - len(received)):
            self.dropped.note(NOT_THE_SERVER)
        for datagram in received:
            self.session.receive(now, datagram.payload)
        return received
