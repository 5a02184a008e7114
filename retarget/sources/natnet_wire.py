"""Messages of OptiTrack NatNet 3.0 to 4.x, all but frames and model definitions: connect, server, commands.

All little-endian: u16 id, u16 payload size, payload. What a client sends goes to the command port of the server.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

COMMAND_PORT = 1510
"""UDP port of the server, where clients ask."""
DATA_PORT = 1511
"""UDP port that multicast frames are sent to."""
MULTICAST_GROUP = "239.255.42.99"
"""Default multicast group of Motive."""

MAX_NAME = 128
"""Characters of a name that are kept."""
CLIENT_NAME = b"retarget"
CLIENT_VERSION = bytes((3, 0, 0, 0))
"""What a client calls itself; 3.0 as the real captures have it. The bitstream is pinned apart from it."""

_HEADER = struct.Struct("<HH")
_SERVER = struct.Struct("<256s4s4sQHB4s")


class MessageId(IntEnum):
    """First word of a datagram."""

    CONNECT = 0
    SERVER_INFO = 1
    COMMAND = 2
    COMMAND_ANSWER = 3
    DEFINITIONS_REQUEST = 4
    DEFINITIONS = 5
    FRAME = 7
    TEXT = 8
    DISCONNECT = 9
    KEEP_ALIVE = 10
    ECHO = 12
    ECHO_ANSWER = 13
    DISCOVERY = 14
    UNRECOGNISED = 100


class Version(NamedTuple):
    """Of the bitstream; versions compare as tuples do."""

    major: int
    minor: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}"


@dataclass(frozen=True, slots=True)
class ServerInfo:
    """Answer of a server to the connect message. clock_hz: of its ticks (0: unknown). data_port and group:
    multicast."""

    name: str
    app_version: tuple[int, int, int, int]
    version: Version
    clock_hz: int
    data_port: int
    multicast: bool
    group: str


def message(kind: MessageId, payload: bytes = b"") -> bytes:
    """A whole datagram."""
    return _HEADER.pack(kind, len(payload)) + payload


def split(datagram: bytes) -> tuple[int, bytes] | None:
    """Id and payload; None where the datagram is shorter than its header says. What follows the payload is left."""
    if len(datagram) < 4:
        return None
    kind, size = _HEADER.unpack_from(datagram)
    if len(datagram) < 4 + size:
        return None
    return kind, datagram[4 : 4 + size]


def connect_message(version: Version | None = None) -> bytes:
    """Asks for a ServerInfo; a unicast server then sends its frames to the sender's port.

    version: of the bitstream that we want, which servers from 4.0 on heed where they send unicast. It stands behind the
    256 bytes of name and the two versions: one byte of a subscription flag, four of the version, one of padding.
    """
    sender = CLIENT_NAME.ljust(256, b"\0") + 2 * CLIENT_VERSION
    wanted = b"" if version is None else bytes((0, version.major, version.minor, 0, 0, 0))
    return message(MessageId.CONNECT, sender + wanted)


def definitions_request() -> bytes:
    """Asks for names, ids, parents and offsets of all that is streamed."""
    return message(MessageId.DEFINITIONS_REQUEST)


def keep_alive_message() -> bytes:
    """A unicast server stops sending to a client that stays silent."""
    return message(MessageId.KEEP_ALIVE)


def command_message(text: str) -> bytes:
    """A command in words, such as `Bitstream,4.1`."""
    return message(MessageId.COMMAND, text.encode("ascii") + b"\0")


def read_server_info(payload: bytes) -> ServerInfo | None:
    """None where it is too short (it has 279 bytes; more are left)."""
    if len(payload) < _SERVER.size:
        return None
    name, app, natnet, clock_hz, port, multicast, group = _SERVER.unpack_from(payload)
    return ServerInfo(
        name=text_until_zero(name),
        app_version=(app[0], app[1], app[2], app[3]),
        version=Version(natnet[0], natnet[1]),
        clock_hz=clock_hz,
        data_port=port,
        multicast=multicast != 0,
        group=".".join(str(part) for part in group),
    )


def text_until_zero(raw: bytes) -> str:
    """UTF-8 text up to the first NUL: what is not UTF-8 replaced, what cannot be shown or is too long left out."""
    text = raw.partition(b"\0")[0][: 4 * MAX_NAME].decode("utf-8", "replace")
    return "".join(letter for letter in text if letter.isprintable())[:MAX_NAME]
