"""The protocol of a datagram by its first bytes: OSC, MVN, NatNet, mocopi, Axis Studio, Rokoko Studio, or JSON."""

import json
import struct
from dataclasses import dataclass

from retarget.sources.streams.mvn import QUATERNION, TYPES, read_header
from retarget.sources.streams.natnet_wire import MessageId, split
from retarget.sources.streams.osc import OscPacket, read_osc
from retarget.sources.streams.stream_frame import CONVENTIONS

LONGEST_NAME = 60
"""Characters of a sender's text that are shown."""
DAMAGED = "damaged "
"""Prefix of the name of a datagram that cannot be parsed."""
_LZ4 = b"\x04\x22\x4d\x18"
_AXIS_STUDIO = b"\xff\xdd"


@dataclass(frozen=True, slots=True)
class Recognised:
    """Protocol of a datagram. kind: scheme of the address that reads it, "" if none does. name: in words. detail:
    bounded in length."""

    kind: str
    name: str
    detail: str = ""

    @property
    def text(self) -> str:
        """Name and detail as one text."""
        return f"{self.name} ({self.detail})" if self.detail else self.name


def reads(kind: str, got: Recognised) -> bool:
    """True if an address of a kind reads such a datagram; `web://` also reads a headset's poses."""
    return got.kind == kind or (kind, got.kind) == ("web", "json")


def recognise(datagram: bytes) -> Recognised:
    """The protocol of a datagram. Never raises."""
    if datagram.startswith((b"#bundle\0", b"/")):
        return _osc(read_osc(datagram))
    if datagram.startswith(b"MXTP"):
        return _mvn(datagram)
    if datagram.lstrip(b" \t\r\n\xef\xbb\xbf")[:1] in (b"{", b"["):
        return _json(datagram)
    if datagram.startswith(_LZ4):
        return Recognised("", "Rokoko Studio", "JSON in LZ4")
    if datagram.startswith(_AXIS_STUDIO):
        return Recognised("", "Axis Studio (Perception Neuron)", "BVH broadcast")
    if datagram[4:8] in (b"head", b"sndf", b"skdf", b"fram"):
        return Recognised("", "mocopi")
    begins = f"begins with {datagram[:8].hex(' ')}" if datagram else "empty"
    return _natnet(datagram) or Recognised("", "an unknown protocol", begins)


def _osc(packet: OscPacket) -> Recognised:
    addresses = [message.address for message in packet.messages]
    if not addresses:
        return Recognised("", DAMAGED + "OSC", packet.dropped[0] if packet.dropped else "an empty bundle")
    if any(address.startswith("/VMC/") for address in addresses):
        devices = tuple(f"/VMC/Ext/{device}/Pos" for device in ("Hmd", "Con", "Tra"))
        if any(address.startswith(devices) for address in addresses):
            return Recognised("vmc", "VMC")
        return Recognised("vmc", "VMC", "bones only" if "/VMC/Ext/Bone/Pos" in addresses else "no poses")
    if any(address.startswith("/tracking/trackers/") for address in addresses):
        return Recognised("vrchat", "VRChat OSC trackers")
    if any(address.startswith(("/avatar/", "/input/", "/chatbox/")) for address in addresses):
        return Recognised("", "VRChat OSC", "avatar parameters, no trackers")
    return Recognised("", "OSC", f"address {_shown(addresses[0])}")


def _mvn(datagram: bytes) -> Recognised:
    header = read_header(datagram)
    if header is None:
        return Recognised("", DAMAGED + "MVN")
    if header.kind == QUATERNION:
        return Recognised("mvn", "MVN")
    return Recognised("mvn", "MVN", f"type {header.kind:02d}, {TYPES.get(header.kind, 'unknown')}")


def _json(datagram: bytes) -> Recognised:
    try:
        message = json.loads(datagram)
    except (ValueError, RecursionError):
        return Recognised("", DAMAGED + "JSON")
    if type(message) is not dict:
        return Recognised("", "JSON", "no object")
    if {"scene", "version"} <= message.keys():
        return Recognised("", "Rokoko Studio", "JSON")
    if "landmarks" in message:
        return Recognised("web", "landmarks of a camera")
    if "poses" not in message:
        return Recognised("", "JSON", "without poses")
    axes = message.get("axes")
    if type(axes) is not str or axes not in CONVENTIONS:
        return Recognised("json", "poses as JSON", f"axes {_shown(axes)}" if type(axes) is str else "no axes")
    return Recognised("json", "poses as JSON")


def _natnet(datagram: bytes) -> Recognised | None:
    """NatNet, by a known id and a size that fits to the byte."""
    parts = split(datagram)
    if parts is None or len(datagram) != 4 + struct.unpack_from("<H", datagram, 2)[0]:
        return None
    try:
        kind = MessageId(parts[0])
    except ValueError:
        return None
    name = kind.name.lower().replace("_", " ")
    return Recognised("natnet", "NatNet", "" if kind is MessageId.FRAME else name)


def _shown(text: str) -> str:
    return repr(text[:LONGEST_NAME])
