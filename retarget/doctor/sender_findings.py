"""Who sends and what: the wrong protocol, refused senders, damaged or large datagrams, what the kernel lost."""

from collections import Counter
from ipaddress import AddressValueError, IPv4Address

from retarget.doctor.finding import Finding, mend, note, ok
from retarget.doctor.listening import Listening
from retarget.live.address import StreamAddress
from retarget.live.admission import NOT_ALLOWED, SECOND_SOURCE
from retarget.live.mix_ups import SENDERS, advice_for
from retarget.sources.datagram_kinds import DAMAGED
from retarget.sources.natnet_decoder import NatnetDecoder
from retarget.sources.vmc import VmcDecoder

__all__ = ["sender_findings"]

UNFRAGMENTED = 1472
"""Bytes of a UDP payload that fit one Ethernet frame of 1500."""
DAMAGED_SHARE = 0.01
"""Of the datagrams, from where on what is dropped is a fault of the stream."""
_HARMLESS = ("not used", "none of 1 to 8 and head", "type ", "late", "repeated")
"""Parts of reasons of what a healthy sender sends beside its poses."""


def sender_findings(address: StreamAddress, kind: str, listening: Listening) -> list[Finding]:
    """kind: of the stream; of a replay, what it holds."""
    found = _refused(address, listening) + _foreign(kind, listening, address)
    if listening.frames:
        senders = ", ".join(dict.fromkeys(host for host, _ in listening.sources))
        found.append(ok("stream", f"{listening.stream.frames} frames from {senders}"))
    elif not found:
        reasons = "; ".join(reason for reason, _ in listening.stream.decoder.dropped.reasons.most_common(3))
        what = f"{listening.arrived} datagrams arrive, and none holds a pose" + (f" ({reasons})" if reasons else "")
        found.append(mend("stream", what, f"Look at the settings of {SENDERS[kind]}"))
    if listening.frames:
        found += _dropped(listening)
    return found + _lost(listening) + _large(listening) + _states(listening)


def _refused(address: StreamAddress, listening: Listening) -> list[Finding]:
    """Senders that were not listened to."""
    found = []
    for (host, port), reason in listening.stream.admission.news():
        if reason == NOT_ALLOWED:
            step = f"Add {host} to ?allow= of the address if it is the sender, else stop it"
            found.append(mend("sender", f"{host}, port {port}, sends, and is not on the allow-list", step))
        elif reason == SECOND_SOURCE:
            owner = listening.stream.admission.owner
            first = f"; {owner[0]}, port {owner[1]}, was first and is followed" if owner is not None else ""
            step = "Let only one send here: stop the other, or give it another port"
            found.append(mend("sender", f"{host}, port {port}, is a second source{first}", step))
    too_many = listening.stream.admission.refused.reasons["more datagrams than the rate allows"]
    if too_many:
        step = "Lower the sender's rate, or see whether a second copy of it runs"
        found.append(mend("sender", f"{too_many} datagrams beyond the rate that is taken", step))
    others = listening.stream.receiver.dropped.reasons
    found += [
        mend("sender", f"{reason} ({count} times)", f"Stop that one, or correct {address.text}")
        for reason, count in others.items()
    ]
    return found


def _foreign(kind: str, listening: Listening, address: StreamAddress) -> list[Finding]:
    """What is no part of the protocol, or another part than is read."""
    found, looked, counts = [], listening.kinds.total(), Counter[str]()
    for got, count in listening.kinds.items():
        counts[got.name] += count
    seen, recording = set[str](), "" if address.path is None else str(address.path)
    for got, _ in listening.kinds.most_common():
        advice = advice_for(kind, got, port=address.port, recording=recording)
        mixed = bool(listening.frames) and (got.kind == kind or got.name.startswith(DAMAGED))
        if not advice or mixed or got.name in seen:
            continue
        seen.add(got.name)
        told = f"{got.text}, {counts[got.name]} of {looked} datagrams looked at"
        told += f", and {kind}:// is {'read' if recording else 'listened for'}" if got.kind != kind else ""
        if listening.frames and not got.kind:
            found.append(note("protocol", f"also: {told}", advice))
        else:
            found.append(mend("protocol", told, advice))
    return found


def _dropped(listening: Listening) -> list[Finding]:
    """What the decoder could not use, though frames came."""
    found = []
    for reason, count in listening.stream.decoder.dropped.reasons.most_common(8):
        told = f"{reason}: {count} times in {listening.arrived} datagrams"
        if any(part in reason for part in _HARMLESS):
            found.append(ok("decoder", told))
        elif count > DAMAGED_SHARE * listening.arrived:
            found.append(mend("decoder", told, "Look at the sender's settings and version"))
        else:
            found.append(note("decoder", told))
    return found


def _lost(listening: Listening) -> list[Finding]:
    overflowed = int(getattr(listening.stream.receiver, "overflowed", 0))
    if not overflowed:
        return []
    step = "End what else runs, and raise the buffer: sudo sysctl -w net.core.rmem_max=1048576"
    return [mend("buffer", f"the kernel lost {overflowed} datagrams that were not fetched in time", step)]


def _large(listening: Listening) -> list[Finding]:
    """Datagrams that travel in pieces, of which one that is lost costs the whole."""
    found = []
    for host, size in listening.largest.items():
        if size > UNFRAGMENTED and not _is_here(host):
            step = "Use a cable, not Wi-Fi; let the sender tell less, if it can"
            what = f"{host} sends datagrams of {size} bytes, in IP fragments: one lost piece loses the frame"
            found.append(note("network", what, step))
    return found


def _is_here(host: str) -> bool:
    try:
        return IPv4Address(host).is_loopback
    except AddressValueError:
        return False


def _states(listening: Listening) -> list[Finding]:
    """What the sender says of itself."""
    decoder = listening.stream.decoder
    if isinstance(decoder, VmcDecoder):
        if decoder.loaded is False:
            return [mend("sender", "it says that no avatar is loaded: no pose counts", "Load one in the sender")]
        if decoder.tracking is False:
            return [mend("sender", "it says that its tracking is bad: no pose counts", "Look at its trackers")]
    if isinstance(decoder, NatnetDecoder) and decoder.names_missing:
        step = "See that nothing drops large UDP datagrams from port 1510, and that the bodies are streamed"
        return [mend("sender", "bodies have numbers and no names", step)]
    return []
