"""Addresses of live streams: `vmc://:39539`, `natnet://HOST?multicast=GROUP`, `replay://FILE`; parsed strictly."""

import re
from dataclasses import dataclass
from ipaddress import IPv4Network
from pathlib import Path

from retarget.errors import UsageError, suggest
from retarget.live.address_options import (
    ANYBODY,
    AddressOptions,
    Bones,
    UpAxis,
    address_number,
    bad_address,
    read_options,
)

__all__ = ["KINDS", "NATNET_COMMAND_PORT", "StreamAddress", "StreamKind", "for_others", "parse_address"]

NATNET_COMMAND_PORT = 1510
"""Where Motive listens for requests."""
LOOPBACK = "127.0.0.1"
EVERYWHERE = "0.0.0.0"
LONGEST = 4096


@dataclass(frozen=True, slots=True)
class StreamKind:
    """What an address of one scheme may hold. port: the usual one, None where there is none."""

    example: str
    port: int | None
    options: tuple[str, ...]


KINDS = {
    "vmc": StreamKind("vmc://:39539", 39_539, ("allow",)),
    "vrchat": StreamKind("vrchat://:9000", 9_000, ("allow",)),
    "natnet": StreamKind("natnet://192.168.1.5", 1_511, ("multicast", "interface", "version", "up", "bones")),
    "mvn": StreamKind("mvn://:9763", 9_763, ("allow", "tcp")),
    "json": StreamKind("json://:14150", None, ("allow",)),
    "replay": StreamKind("replay://walk.raw", None, ("speed", "loop", "kind", "up", "bones")),
}
"""The schemes by name, with the usual ports of their senders (project facts on streams, sections 2 to 5)."""


@dataclass(frozen=True, slots=True)
class StreamAddress:
    """Where a stream comes from, and who may send it.

    text: as the user wrote it, for messages. kind: one of KINDS. bind: the IPv4 address that is listened on (0.0.0.0:
    every interface; of a multicast: the group). port: of UDP (MVN with a host: of TCP), 0 for any free one. allow: who
    may send. host: the computer that is asked (NatNet) or that connects to us (MVN over TCP), else None. multicast,
    interface: group, and own address on the interface where it is joined (0.0.0.0: the system chooses). version: the
    bitstream that NatNet is asked for; up, bones: how Motive is set. path, speed, loop: of a replay; recorded: the kind
    of stream that it holds, where the user said it.
    """

    text: str
    kind: str
    bind: str = LOOPBACK
    port: int = 0
    allow: tuple[IPv4Network, ...] = (ANYBODY,)
    host: str | None = None
    multicast: str | None = None
    interface: str = EVERYWHERE
    version: tuple[int, int] | None = None
    up: UpAxis = "y"
    bones: Bones = "global"
    path: Path | None = None
    speed: float = 1.0
    loop: bool = False
    recorded: str | None = None


def for_others(kind: str, port: int, *, option: str = "allow") -> str:
    """What to do where only loopback is listened on, and the sender is elsewhere."""
    return f"If the sender is another computer: {kind}://{EVERYWHERE}:{port}?{option}=ITS_ADDRESS"


def parse_address(text: str) -> StreamAddress:
    """Read the address of a stream.

    It listens on loopback unless an address is given; one that others can reach needs `?allow=192.168.1.20,10.0.0.0/8`
    (who may send) or `?allow=any`. Raises UsageError for whatever is wrong, with the place and the way out.
    """
    match = re.fullmatch(r"([A-Za-z][A-Za-z0-9+.-]*)://([^\x00-\x1f]*)", text)
    if match is None or len(text) > LONGEST:
        allowed = "SCHEME://[ADDRESS][:PORT][?OPTION=VALUE&...]"
        raise bad_address(text, "this is no address of a stream", allowed=allowed, next_step=_for_example())
    kind, rest = match[1].lower(), match[2]
    if kind not in KINDS:
        step = suggest(kind, KINDS) or _for_example()
        raise bad_address(text, "unknown kind of stream", found=match[1], allowed=", ".join(KINDS), next_step=step)
    place, asked, query = rest.rpartition("?") if "?" in rest else (rest, "", "")
    options = read_options(text, query, KINDS[kind].options) if asked else AddressOptions()
    if kind == "replay":
        if not place:
            raise bad_address(text, "the file is missing", allowed=KINDS[kind].example)
        return StreamAddress(
            text,
            kind,
            path=Path(place),
            speed=options.speed,
            loop=options.loop,
            recorded=options.kind,
            up=options.up,
            bones=options.bones,
        )
    host, port = _place(text, kind, place)
    if kind == "natnet":
        return _natnet(text, host, port, options)
    if options.tcp is not None:
        return _connected(text, host, port, options)
    return _listener(text, kind, host, port, options)


def _place(text: str, kind: str, place: str) -> tuple[str, int]:
    """Host ("" where none is given) and port of `HOST:PORT`."""
    host, colon, number = place.removesuffix("/").partition(":")
    if "[" in place or ":" in number:
        raise bad_address(text, "IPv6 is not supported", found=place, allowed="an IPv4 address, or none for loopback")
    default = KINDS[kind].port
    if not colon and default is not None:
        return host, default
    if re.fullmatch(r"[1-9][0-9]{0,4}", number, re.ASCII) is None or int(number) > 65_535:
        what = "this is no port" if number else "the port is missing"
        raise bad_address(text, what, found=number, allowed=f"1 to 65535, as in {KINDS[kind].example}")
    return host, int(number)


def _listener(text: str, kind: str, host: str, port: int, options: AddressOptions) -> StreamAddress:
    """A port of ours that the sender is pointed at."""
    bind = address_number(text, host or LOOPBACK)
    if bind.is_multicast:
        raise bad_address(text, "a group cannot be listened on", found=host, allowed="an address of this machine")
    if options.allow is None and not bind.is_loopback:
        raise _open_to_all(text, str(bind), port, kind)
    return StreamAddress(text, kind, str(bind), port, options.allow or (ANYBODY,))


def _open_to_all(text: str, bind: str, port: int, kind: str) -> UsageError:
    listed = f"{kind}://{bind}:{port}?allow=192.168.1.20"
    return bad_address(
        text,
        "others on the network could move the robot",
        found=f"{bind}, which is more than this machine, and no list of who may send",
        allowed=f"{kind}://:{port} (this machine only), or with a list, such as {listed}",
        next_step="Add ?allow= with the sender's address (allow=any only where you trust everybody on the network)",
    )


def _connected(text: str, host: str, port: int, options: AddressOptions) -> StreamAddress:
    """A TCP port of ours that one computer connects to: only it is heard."""
    sender = options.tcp
    assert sender is not None
    if options.allow is not None:
        step = f"Write mvn://{host}:{port}?tcp={sender}"
        raise bad_address(text, "over TCP only one computer is heard, so there is no list", next_step=step)
    bind = address_number(text, host or (LOOPBACK if sender.is_loopback else EVERYWHERE))
    if bind.is_multicast:
        raise bad_address(text, "a group cannot be listened on", found=host, allowed="an address of this machine")
    return StreamAddress(text, "mvn", str(bind), port, (IPv4Network(sender),), host=str(sender))


def _natnet(text: str, host: str, port: int, options: AddressOptions) -> StreamAddress:
    """Motive on the computer `host`: only it is heard."""
    if not host:
        missing = "the address of the computer with Motive is missing"
        raise bad_address(text, missing, allowed=KINDS["natnet"].example)
    server, group = address_number(text, host), options.multicast
    if server.is_multicast or server.is_unspecified:
        step = f"Write natnet://HOST?multicast={server}" if server.is_multicast else ""
        raise bad_address(text, "this is not the address of one computer", found=host, next_step=step)
    here = LOOPBACK if server.is_loopback else EVERYWHERE
    interface = str(options.interface) if options.interface is not None else here
    return StreamAddress(
        text,
        "natnet",
        interface if group is None else str(group),
        0 if group is None else port,  # in unicast, Motive answers to the port that asked
        (IPv4Network(server),),
        host=str(server),
        multicast=None if group is None else str(group),
        interface=interface,
        version=options.version,
        up=options.up,
        bones=options.bones,
    )


def _for_example() -> str:
    return "Write " + ", ".join(kind.example for kind in KINDS.values()) + ", for example"
