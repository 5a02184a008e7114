"""The network interfaces of this machine, and which of them leads to a computer."""

import fcntl
import socket
import struct
from contextlib import suppress

__all__ = ["interface_towards", "local_interfaces"]

SIOCGIFADDR = 0x8915
"""Request for the IPv4 address of an interface (netdevice(7))."""
MOST = 256


def local_interfaces() -> dict[str, str]:
    """IPv4 address of every interface that has one, by its name; without those of more than the first address."""
    found = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex()[:MOST]:
            with suppress(OSError):
                answer = fcntl.ioctl(probe, SIOCGIFADDR, struct.pack("40s", name.encode()[:15]))
                found[name] = socket.inet_ntoa(answer[20:24])
    return found


def interface_towards(host: str) -> str | None:
    """Our own IPv4 address on the way to `host`, None where there is no way. Sends nothing."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((host, 9))
        except OSError:
            return None
        address: str = probe.getsockname()[0]
        return address
