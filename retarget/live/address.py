"""Addresses of live streams: `vmc://:39539`, `natnet://HOST?multicast=GROUP`, `replay://FILE`; parsed strictly."""

import fcntl
import re
import socket
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Address, IPv4Network
from pathlib import Path
from typing import Any, Literal, TypeVar

from retarget.errors import UsageError, suggest

SIOCGIFADDR = 0x8915  # request for the IPv4 address of an interface (netdevice(7))
MOST_INTERFACES = 256  # interfaces that are looked at


def local_interfaces() -> dict[str, str]:
    """First IPv4 address of every interface that has one, by its name."""
    found = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex()[:MOST_INTERFACES]:
            with suppress(OSError):
                answer = fcntl.ioctl(probe, SIOCGIFADDR, struct.pack("40s", name.encode()[:15]))
                found[name] = socket.inet_ntoa(answer[20:24])
    return found


def listed_interfaces() -> str:
    """The interfaces' addresses in words."""
    return ", ".join(f"{address} ({name})" for name, address in local_interfaces().items()) or "none has an address"


def interface_towards(host: str) -> str | None:
    """This machine's IPv4 address on the route to `host`, None without a route. Sends nothing."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((host, 9))
        except OSError:
            return None
        address: str = probe.getsockname()[0]
        return address


Value = TypeVar("Value")
UpAxis = Literal["y", "z"]
Bones = Literal["global", "local"]
ANY_ADDRESS = IPv4Network("0.0.0.0/0")
MOST_ALLOWED = 64  # entries of an allow-list
MAX_SPEED = 100.0  # times the recorded speed
RECORDED = ("vmc", "vrchat", "natnet", "mvn", "json", "web")  # kinds of stream that a recording may hold


def read_options(text: str, query: str, known: tuple[str, ...]) -> dict[str, Any]:
    """Read `NAME=VALUE&NAME=VALUE`. Raises UsageError unless all options are `known`, once and valid."""
    options: dict[str, Any] = {}
    for part in query.split("&"):
        name, _, value = part.partition("=")
        if name not in known:
            allowed = ", ".join(known)
            raise bad_address(text, "unknown option", found=name, allowed=allowed, next_step=suggest(name, known))
        if name in options:
            raise bad_address(text, f"the option '{name}' is given twice", next_step="Leave one out")
        allowed, read = _OPTIONS[name]
        try:
            options[name] = read(value)
        except ValueError:
            present = f": {listed_interfaces()}" if name == "interface" else ""
            what = f"the option '{name}' cannot be {'read' if value else 'empty'}"
            raise bad_address(text, what, found=value, allowed=allowed + present) from None
    return options


def address_number(text: str, host: str) -> IPv4Address:
    """An IPv4 address of `localhost` or four numbers; no name is looked up. Raises UsageError."""
    try:
        return IPv4Address("127.0.0.1" if host == "localhost" else host)
    except AddressValueError:
        allowed, what = "an IPv4 address such as 192.168.1.5, or localhost", "this is no address of a computer"
        raise bad_address(text, what, found=host, allowed=allowed, next_step=_intended(text)) from None


def bad_address(text: str, what: str, *, found: str = "", allowed: str = "", next_step: str = "") -> UsageError:
    """Make the error for a part of the address `text`. Outside text is shortened and made printable."""
    where, found = (repr(part if len(part) <= 200 else part[:200] + "...")[1:-1] for part in (text, found))
    return UsageError(what, where=where or "an empty address", found=found, allowed=allowed, next_step=next_step)


def _networks(value: str) -> tuple[IPv4Network, ...]:
    if value == "any":
        return (ANY_ADDRESS,)
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


def _speed(value: str) -> float:
    plain = re.fullmatch(r"[0-9]{1,9}(\.[0-9]{1,9})?", value, re.ASCII) is not None
    speed = float(_chosen(value, plain))
    return _chosen(speed, 1.0 <= speed <= MAX_SPEED)


def _one_of(*values: str) -> Callable[[str], str]:
    return lambda value: _chosen(value, value in values)


# Allowed values in words, and the reader, which raises ValueError.
_OPTIONS: dict[str, tuple[str, Callable[[str], Any]]] = {
    "allow": (f"any, or up to {MOST_ALLOWED} of ADDRESS or ADDRESS/BITS, with commas between them", _networks),
    "multicast": (
        "a group from 224.0.0.0 to 239.255.255.255, such as 239.255.42.99",
        lambda value: _chosen(IPv4Address(value), IPv4Address(value).is_multicast),
    ),
    "interface": ("the IPv4 address of an interface of this machine", _single),
    "up": ("y or z, as Up Axis in Motive's streaming settings", _one_of("y", "z")),
    "bones": ("global or local, as Skeleton Coordinates in Motive's streaming settings", _one_of("global", "local")),
    "speed": (f"1 to {MAX_SPEED:g} (slower, frames are too old when they arrive)", _speed),
    "kind": (", ".join(RECORDED), _one_of(*RECORDED)),
}

WEB_PORT = 8790  # TCP port of the page of `web://`, where it is free
VIEW_PORT = 8080  # of `--view` and `retarget view`
LOOPBACK = "127.0.0.1"
EVERYWHERE = "0.0.0.0"
LONGEST_ADDRESS = 4096  # characters: the longest path that Linux takes (PATH_MAX)


@dataclass(frozen=True, slots=True)
class AddressKind:
    """Properties of addresses of one scheme. port: the usual one. sender: the program that is to be configured."""

    example: str
    port: int | None
    options: tuple[str, ...]
    sender: str


# Usual ports: the default of each sender.
KINDS = {
    "vmc": AddressKind("vmc://:39539", 39_539, ("allow",), "the sender's VMC output"),
    "vrchat": AddressKind("vrchat://:9000", 9_000, ("allow",), "the sender's OSC trackers"),
    "natnet": AddressKind("natnet://192.168.1.5", 1_511, ("multicast", "interface", "up", "bones"), "Motive"),
    "mvn": AddressKind("mvn://:9763", 9_763, ("allow",), "MVN's network streamer"),
    "json": AddressKind("json://:14150", None, ("allow",), "the sender"),
    "web": AddressKind("web://", WEB_PORT, (), "the page"),
    "replay": AddressKind("replay://walk.raw", None, ("speed", "kind", "up", "bones"), "the recording"),
}


@dataclass(frozen=True, slots=True)
class StreamAddress:
    """The address of a stream, and the senders that are allowed.

    text: as written. kind: one of KINDS. bind: bound IPv4 address (0.0.0.0: every interface; the group of a multicast).
    port: of UDP, 0 for any. host: the NatNet server. interface: own address where the group is joined (0.0.0.0: the
    system chooses). up, bones: settings of Motive. recorded: kind of a replay, where given.
    """

    text: str
    kind: str
    bind: str = LOOPBACK
    port: int = 0
    allow: tuple[IPv4Network, ...] = (ANY_ADDRESS,)
    host: str | None = None
    multicast: str | None = None
    interface: str = EVERYWHERE
    up: UpAxis = "y"
    bones: Bones = "global"
    path: Path | None = None
    speed: float = 1.0
    recorded: str | None = None


def for_others(kind: str, port: int) -> str:
    """The next step where the port is on loopback, and the sender is another computer."""
    return f"If the sender is another computer: {kind}://{EVERYWHERE}:{port}?allow=ITS_ADDRESS"


def is_address(text: str) -> bool:
    """True if a text means a stream and not a file: `://`, or a known scheme and a colon."""
    scheme, colon, _ = text.partition(":")
    return "://" in text or bool(colon and scheme.lower() in KINDS)


def _intended(text: str) -> str:
    """The next step for a bare port behind the scheme (`vmc:39539`, `vmc://39539`), or ""."""
    match = re.fullmatch(r"(\w+):/{0,2}([0-9]{1,5}(?:\?.*)?)", text, re.ASCII)
    is_listener = match is not None and match[1].lower() in KINDS and "allow" in KINDS[match[1].lower()].options
    return f"Did you mean {match[1].lower()}://:{match[2]}?" if match is not None and is_listener else ""


def parse_address(text: str) -> StreamAddress:
    """Read the address of a stream.

    It is on loopback unless an address is given, which then needs `?allow=192.168.1.20,10.0.0.0/8` or `?allow=any`.
    Raises UsageError for any mistake, with its place and the next step.
    """
    match = re.fullmatch(r"([A-Za-z][A-Za-z0-9+.-]*)://([^\x00-\x1f]*)", text)
    if match is None or len(text) > LONGEST_ADDRESS:
        what, allowed = "this is no address of a stream", "SCHEME://[ADDRESS][:PORT][?OPTION=VALUE&...]"
        raise bad_address(text, what, allowed=allowed, next_step=_intended(text) or _for_example())
    kind, rest = match[1].lower(), match[2]
    if kind not in KINDS:
        step = suggest(kind, KINDS) or _for_example()
        raise bad_address(text, "unknown kind of stream", found=match[1], allowed=", ".join(KINDS), next_step=step)
    place, mark, query = rest.rpartition("?") if "?" in rest else (rest, "", "")
    options = read_options(text, query, KINDS[kind].options) if mark else {}
    if kind == "replay":
        if not place:
            raise bad_address(text, "the file is missing", allowed=KINDS[kind].example)
        return StreamAddress(text, kind, path=Path(place), recorded=options.pop("kind", None), **options)
    host, port = _place(text, kind, place)
    if kind == "web" and host not in ("", "localhost", LOOPBACK):
        step = "Write web://, and add --listen for phones and headsets"
        raise bad_address(text, "the page names its own addresses", found=host, allowed="web://[:PORT]", next_step=step)
    if kind == "natnet":
        return _natnet(text, host, port, options)
    return _listener(text, kind, host, port, options)


def _place(text: str, kind: str, place: str) -> tuple[str, int]:
    """Host ("" for none) and port of `HOST:PORT`."""
    host, colon, number = place.removesuffix("/").partition(":")
    if "[" in place or ":" in number:
        raise bad_address(text, "IPv6 is not supported", found=place, allowed="an IPv4 address, or none for loopback")
    default = KINDS[kind].port
    if not colon and default is not None:
        return host, default
    if re.fullmatch(r"[1-9][0-9]{0,4}", number, re.ASCII) is None or int(number) > 65_535:
        what, allowed = (
            "this is no port" if number else "the port is missing",
            f"1 to 65535, as in {KINDS[kind].example}",
        )
        raise bad_address(text, what, found=number, allowed=allowed)
    return host, int(number)


def _listener(text: str, kind: str, host: str, port: int, options: dict[str, Any]) -> StreamAddress:
    allow, bind = options.get("allow"), address_number(text, host or LOOPBACK)
    if bind.is_multicast:
        raise bad_address(text, "a group cannot be listened on", found=host, allowed="an address of this machine")
    if allow is None and not bind.is_loopback:
        found = f"{bind}, which is more than this machine, and no list of who may send"
        list_of_one = f"{kind}://{bind}:{port}?allow=192.168.1.20"
        step = "Add ?allow= with the sender's address (allow=any only where every computer on the network is safe)"
        raise bad_address(
            text,
            "others on the network could move the robot",
            found=found,
            allowed=f"{kind}://:{port} (this machine only), or with a list, such as {list_of_one}",
            next_step=step,
        )
    return StreamAddress(text, kind, str(bind), port, allow or (ANY_ADDRESS,))


def _natnet(text: str, host: str, port: int, options: dict[str, Any]) -> StreamAddress:
    if not host:
        what = "the address of the computer with Motive is missing"
        raise bad_address(text, what, allowed=KINDS["natnet"].example)
    server = address_number(text, host)
    if server.is_multicast or server.is_unspecified:
        step = f"Write natnet://HOST?multicast={server}" if server.is_multicast else ""
        raise bad_address(text, "this is not the address of one computer", found=host, next_step=step)
    addresses: dict[str, Any] = {name: str(options.pop(name)) for name in ("multicast", "interface") if name in options}
    interface = addresses.setdefault("interface", LOOPBACK if server.is_loopback else EVERYWHERE)
    group = addresses.get("multicast")
    # In unicast, Motive answers to the port of the request.
    bind, port = (interface, 0) if group is None else (group, port)
    return StreamAddress(text, "natnet", bind, port, (IPv4Network(server),), host=str(server), **addresses, **options)


def _for_example() -> str:
    return "Write " + ", ".join(kind.example for kind in KINDS.values()) + ", for example"
