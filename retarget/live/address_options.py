"""The options of a stream's address, `?allow=...&speed=...`: each known, given once, and read strictly."""

import re
from dataclasses import dataclass, replace
from ipaddress import AddressValueError, IPv4Address, IPv4Network
from math import isfinite
from typing import Literal, TypeVar

from retarget.errors import UsageError, suggest
from retarget.live.interfaces import local_interfaces

__all__ = ["ANYBODY", "RECORDED", "AddressOptions", "Bones", "UpAxis", "address_number", "bad_address", "read_options"]

Value = TypeVar("Value")
UpAxis = Literal["y", "z"]
Bones = Literal["global", "local"]
ANYBODY = IPv4Network("0.0.0.0/0")
MOST_ALLOWED = 64
"""Entries of an allow-list."""
MAX_SPEED = 100.0
RECORDED = ("vmc", "vrchat", "natnet", "mvn", "json")
"""Kinds of stream that a recording may hold."""
VERSIONS = ("3.0", "3.1", "4.0", "4.1", "4.2", "4.3", "4.4")
"""Bitstreams of NatNet (`facts/streams.md` section 4)."""

_ALLOWED = {
    "allow": f"any, or up to {MOST_ALLOWED} of ADDRESS or ADDRESS/BITS, with commas between them",
    "tcp": "the IPv4 address of the computer with MVN",
    "multicast": "a group from 224.0.0.0 to 239.255.255.255, such as 239.255.42.99",
    "interface": "the IPv4 address of an interface of this machine",
    "version": ", ".join(VERSIONS),
    "up": "y or z, as Up Axis in Motive's streaming settings",
    "bones": "global or local, as Skeleton Coordinates in Motive's streaming settings",
    "speed": f"above 0, to {MAX_SPEED:g}",
    "loop": "0 or 1",
    "kind": ", ".join(RECORDED),
}


@dataclass(frozen=True, slots=True)
class AddressOptions:
    """What the options of an address say; None where it says nothing."""

    allow: tuple[IPv4Network, ...] | None = None
    tcp: IPv4Address | None = None
    multicast: IPv4Address | None = None
    interface: IPv4Address | None = None
    version: tuple[int, int] | None = None
    up: UpAxis = "y"
    bones: Bones = "global"
    speed: float = 1.0
    loop: bool = False
    kind: str | None = None


def read_options(text: str, query: str, known: tuple[str, ...]) -> AddressOptions:
    """Read `NAME=VALUE&NAME=VALUE` of the address `text`. Raises UsageError unless all are `known`, once and right."""
    options, seen = AddressOptions(), set[str]()
    for part in query.split("&"):
        name, _, value = part.partition("=")
        if name not in known:
            allowed = ", ".join(known)
            raise bad_address(text, "unknown option", found=name, allowed=allowed, next_step=suggest(name, known))
        if name in seen:
            raise bad_address(text, f"the option '{name}' is given twice", next_step="Leave one out")
        seen.add(name)
        try:
            options = _with(options, name, value)
        except ValueError:
            what = f"the option '{name}' cannot be {'read' if value else 'empty'}"
            raise bad_address(text, what, found=value, allowed=_ALLOWED[name] + _present(name)) from None
    return options


def address_number(text: str, host: str) -> IPv4Address:
    """An IPv4 address of `localhost` or four numbers. Raises UsageError for anything else; no name is looked up."""
    try:
        return IPv4Address("127.0.0.1" if host == "localhost" else host)
    except AddressValueError:
        allowed = "an IPv4 address such as 192.168.1.5, or localhost"
        raise bad_address(text, "this is no address of a computer", found=host, allowed=allowed) from None


def bad_address(text: str, what: str, *, found: str = "", allowed: str = "", next_step: str = "") -> UsageError:
    """The error for a part of the address `text`; what came from outside is shortened and made printable."""
    where, found = (repr(part if len(part) <= 200 else part[:200] + "...")[1:-1] for part in (text, found))
    return UsageError(what, where=where or "an empty address", found=found, allowed=allowed, next_step=next_step)


def _with(options: AddressOptions, name: str, value: str) -> AddressOptions:
    """Raises ValueError for a value that cannot be read."""
    match name:
        case "allow":
            return replace(options, allow=_networks(value))
        case "tcp":
            return replace(options, tcp=_single(value))
        case "multicast":
            return replace(options, multicast=_chosen(IPv4Address(value), IPv4Address(value).is_multicast))
        case "interface":
            return replace(options, interface=_single(value))
        case "version":
            major, minor = _chosen(value, value in VERSIONS).split(".")
            return replace(options, version=(int(major), int(minor)))
        case "up":
            return replace(options, up="z" if _chosen(value, value in {"y", "z"}) == "z" else "y")
        case "bones":
            local = _chosen(value, value in {"global", "local"}) == "local"
            return replace(options, bones="local" if local else "global")
        case "speed":
            plain = re.fullmatch(r"[0-9]{1,9}(\.[0-9]{1,9})?", value, re.ASCII) is not None
            speed = float(_chosen(value, plain))
            return replace(options, speed=_chosen(speed, isfinite(speed) and 0.0 < speed <= MAX_SPEED))
        case "kind":
            return replace(options, kind=_chosen(value, value in RECORDED))
    assert name == "loop"
    return replace(options, loop=_chosen(value, value in {"0", "1"}) == "1")


def _present(name: str) -> str:
    """Addresses that an option may name here."""
    found = local_interfaces() if name == "interface" else {}
    return f": {', '.join(f'{address} ({own})' for own, address in found.items())}" if found else ""


def _networks(value: str) -> tuple[IPv4Network, ...]:
    if value == "any":
        return (ANYBODY,)
    parts = value.split(",")
    networks = tuple(IPv4Network(part) for part in parts)
    senders = all(network.prefixlen and not network.network_address.is_multicast for network in networks)
    return _chosen(networks, senders and len(parts) <= MOST_ALLOWED)


def _single(value: str) -> IPv4Address:
    address = IPv4Address(value)
    return _chosen(address, not (address.is_multicast or address.is_unspecified))


def _chosen(value: Value, fits: bool) -> Value:
    if not fits:
        raise ValueError
    return value
