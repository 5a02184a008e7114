"""What to do when something else arrives than the address reads: the mix-ups that people make."""

from retarget.live.address import KINDS
from retarget.sources.datagram_kinds import DAMAGED, Recognised
from retarget.sources.stream_axes import CONVENTIONS

__all__ = ["advice_for"]

SENDERS = {
    "vmc": "the sender's VMC output",
    "vrchat": "the sender's OSC trackers",
    "natnet": "Motive",
    "mvn": "MVN's network streamer",
    "json": "the sender",
}
"""Who is to be set, by the kind of an address."""

_ALIEN = {
    "Rokoko Studio": "Its stream is not read: let a bridge send VMC, or poses as JSON (docs/json-input.md)",
    "Axis Studio (Perception Neuron)": "Its broadcast is not read: let a bridge send VMC, or poses as JSON "
    "(docs/json-input.md)",
    "mocopi": "Its own protocol is not read: let MCP2VMCP or the receiver send VMC, to vmc://:39539",
    "VRChat OSC": "Switch OSC trackers on at the sender; better still VMC, which has wrists",
    "JSON": "docs/json-input.md says which keys there are; examples/send_poses.py sends them",
}


def advice_for(kind: str, got: Recognised, *, port: int, recording: str = "") -> str:
    """What a person is to do about datagrams `got` at an address of `kind`; "" where it is what is read. recording: the
    file that holds them, "" where they arrive."""
    if got.kind == kind:
        return _own(kind, got)
    if got.kind and recording:
        return f"Read it as replay://{recording}?kind={got.kind}"
    if got.kind:
        usual = KINDS[got.kind].port
        there = f"{got.kind}://:{port}" if got.kind != "natnet" else "natnet://HOST"
        to = f", its usual port being {KINDS[kind].port}" if KINDS[kind].port else ""
        elsewhere = f" (it usually goes to port {usual})" if usual and usual != port else ""
        return f"Listen with {there}, or send {got.name} elsewhere{elsewhere} and let {SENDERS[kind]} send here{to}"
    if got.name.startswith(DAMAGED):
        return f"Look at the settings of {SENDERS[kind]}, and at what may cut its datagrams on the way"
    if got.name in _ALIEN:
        return _ALIEN[got.name]
    return f"Look which program sends it, and let {SENDERS[kind]} send here instead"


def _own(kind: str, got: Recognised) -> str:
    """The right protocol, and the wrong part of it."""
    if kind == "mvn" and got.detail and got.detail[5:7] not in ("01", "12", "13"):
        return "In MVN's network streamer choose Position + Orientation (Quaternion)"
    if kind == "json" and got.detail:
        return f'Send "axes" as one of {", ".join(CONVENTIONS)}'
    if kind == "vmc" and got.detail == "bones only":
        return "Such senders are followed with --performer avatar"
    if kind == "vmc" and got.detail == "no poses":
        return "Load an avatar in the sender, start its tracking, and let it send bones or trackers"
    if kind == "natnet" and got.detail in ("connect", "discovery", "definitions request", "keep alive", "command"):
        return "This is another client's question, not Motive: HOST must be the computer with Motive"
    return ""
