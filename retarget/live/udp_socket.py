"""Opening the socket of a stream: bound, large enough for bursts, in its multicast group; or an error that says how."""

import errno
import socket
from contextlib import suppress
from typing import Literal

from retarget.errors import InputError
from retarget.live.address import EVERYWHERE, StreamAddress
from retarget.live.interfaces import interface_towards, local_interfaces
from retarget.live.port_holder import port_holder

__all__ = ["RECEIVE_BUFFER", "SO_RXQ_OVFL", "SO_TIMESTAMPNS", "not_bound", "open_socket"]

RECEIVE_BUFFER = 2**20
"""Bytes asked of the kernel, which doubles them, within net.core.rmem_max: more than a second of SlimeVR's VMC with
what the kernel adds to each. No more: behind a flood, what waits there is old before it is read."""
SO_TIMESTAMPNS = 35
"""Option and control message: time of arrival on the wall clock, as a timespec (socket(7); asm-generic/socket.h)."""
SO_RXQ_OVFL = 40
"""Option and control message: datagrams lost so far because the buffer was full (socket(7))."""
IP_MULTICAST_ALL = 49
"""Whether groups that other sockets joined are heard too (ip(7))."""
NO_INTERFACE = {errno.ENODEV, errno.EADDRNOTAVAIL, errno.ENXIO}


def open_socket(address: StreamAddress) -> socket.socket:
    """A bound, non-blocking UDP socket for `address`. Raises InputError: the port is taken or forbidden, there is no
    such interface, the group cannot be joined."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        listener.setblocking(False)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        for option in (SO_TIMESTAMPNS, SO_RXQ_OVFL):
            with suppress(OSError):  # a kernel without them: arrival is then the time of the poll
                listener.setsockopt(socket.SOL_SOCKET, option, 1)
        if address.multicast is not None:
            # Every listener of a group gets its own copy; a unicast port that is shared could be taken over.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        _bind(listener, address)
        if address.multicast is not None:
            _join(listener, address, address.multicast)
    except BaseException:
        listener.close()
        raise
    return listener


def _bind(listener: socket.socket, address: StreamAddress) -> None:
    try:
        listener.bind((address.bind, address.port))
    except OSError as error:
        raise not_bound(address, error) from error


def _join(listener: socket.socket, address: StreamAddress, group: str) -> None:
    """Join on the interface that is named, else on the one towards the server, else on the system's choice."""
    interface = address.interface
    if interface == EVERYWHERE and address.host is not None:
        interface = interface_towards(address.host) or EVERYWHERE
    with suppress(OSError):  # only keeps out what other programs joined
        listener.setsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL, 0)
    request = socket.inet_aton(group) + socket.inet_aton(interface)
    try:
        listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, request)
    except OSError as error:
        raise _not_joined(address, group, interface, error) from error


def not_bound(address: StreamAddress, error: OSError, *, protocol: Literal["udp", "tcp"] = "udp") -> InputError:
    """The error for an address that cannot be listened on: taken, not of this machine, not for this user."""
    name = f"{protocol.upper()} port {address.port}"
    if error.errno == errno.EADDRINUSE:
        step = "Stop it, or send to another port and name that here"
        holder = port_holder(address.port, protocol=protocol)
        return InputError(f"{name} is taken", where=address.text, found=holder, next_step=step)
    if error.errno in NO_INTERFACE:
        return _no_interface(address, address.bind)
    if error.errno in {errno.EACCES, errno.EPERM}:
        step = "Choose a port from 1024 on, here and at the sender"
        return InputError(f"{name} is not for this user", where=address.text, next_step=step)
    found = f"{address.bind}:{address.port}: {error.strerror or error}"
    return InputError("cannot listen there", where=address.text, found=found)


def _not_joined(address: StreamAddress, group: str, interface: str, error: OSError) -> InputError:
    if error.errno in NO_INTERFACE and interface != EVERYWHERE:
        return _no_interface(address, interface)
    if error.errno == errno.ENODEV:
        step = "Connect the network that Motive is on, and add interface=ADDRESS of this machine on it"
        return InputError(f"no interface leads to the group {group}", where=address.text, next_step=step)
    return InputError(
        f"the group {group} cannot be joined",
        where=address.text,
        found=f"{error.strerror or error}, on interface {interface}",
        allowed=f"interfaces: {_interfaces()}",
        next_step="Add interface=ADDRESS, or let Motive send unicast and leave multicast out",
    )


def _no_interface(address: StreamAddress, wanted: str) -> InputError:
    return InputError(
        "this machine has no interface with such an address",
        where=address.text,
        found=wanted,
        allowed=_interfaces(),
        next_step="Give one of these, and check that its network is connected",
    )


def _interfaces() -> str:
    return ", ".join(f"{number} ({name})" for name, number in local_interfaces().items()) or "none has an address"
