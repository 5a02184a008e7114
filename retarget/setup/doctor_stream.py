"""The doctor's findings on a stream: silence, wrong senders and protocols, and losses. For `web://` it serves the page,
waits for a performer, and reports on the browser, too.
"""

from collections import Counter
from collections.abc import Callable
from contextlib import closing
from ipaddress import AddressValueError, IPv4Address
from typing import Any

import numpy as np

from hardware.clock import Clock
from retarget.errors import InputError
from retarget.live.address import EVERYWHERE, KINDS, StreamAddress, for_others, local_interfaces
from retarget.live.admission import NEW_SOCKETS, NOT_ALLOWED, SECOND_SOURCE
from retarget.live.begin import HUMAN_RATE_HZ
from retarget.live.open_stream import open_stream, stream_kinds
from retarget.live.raw_recording import recorded_kind
from retarget.live.receivers import NatnetReceiver, port_holder
from retarget.live.roles import CONVENTIONS
from retarget.live.stream import MOST_DECODED
from retarget.live.stream_report import advice_for, natnet_problems
from retarget.schema.performer import Performer
from retarget.setup.doctor_machine import (
    UNKNOWN_HOLDER,
    DoctorFinding,
    finding,
    findings,
    firewall_findings,
    fix_all,
)
from retarget.setup.doctor_sensors import (
    UNNAMED,
    StreamCapture,
    capture_stream,
    invented_findings,
    rate_findings,
    role_findings,
)
from retarget.sources.streams.datagram_kinds import DAMAGED, reads
from retarget.sources.streams.natnet_decoder import NatnetDecoder
from retarget.sources.streams.natnet_wire import DATA_PORT
from retarget.sources.streams.vmc import VmcDecoder
from retarget.web.link import PoseReceiver
from retarget.web.runtime import runtime_folder

# Silence.


def silence_findings(address: StreamAddress, *, seconds: float, answered: bool = False) -> list[DoctorFinding]:
    """Findings on why nothing arrives at an address, the surest cause first. answered: the cause is known."""
    found = []
    if not answered:
        found.append(finding("stream/silent", seconds=seconds, place=_place(address), start=_start(address)))
    if address.kind == "replay":
        return found
    interfaces = ", ".join(f"{number} ({name})" for name, number in local_interfaces().items()) or "none"
    if IPv4Address(address.bind).is_loopback:
        if address.kind != "natnet":
            others = for_others(address.kind, address.port)
            found.append(finding("network/loopback", interfaces=interfaces, others=others))
        return found
    allowed = ", ".join(str(network) for network in address.allow)
    found.append(finding("network/allowed", interfaces=interfaces, allowed=allowed))
    return found + firewall_findings(address.port or DATA_PORT)


def _place(address: StreamAddress) -> str:
    if address.kind == "replay":
        return address.text
    if not address.port:
        return f"{address.bind}, any UDP port"
    return f"{address.bind}, UDP port {address.port}"


def _start(address: StreamAddress) -> str:
    if address.kind == "replay":
        return "Record again: this recording holds no datagram"
    if address.kind == "natnet":
        return "Start Motive, switch its streaming on, and see that this is its computer"
    target = "one of this machine's addresses" if address.bind == EVERYWHERE else address.bind
    return f"Start {KINDS[address.kind].sender}, and let it send to {target}, port {address.port}"


# Senders: the wrong protocol, refused senders, damaged or large datagrams, datagrams that the kernel lost.

UNFRAGMENTED = 1472
"""Largest UDP payload in one Ethernet frame of 1500 bytes."""
_HARMLESS = ("not used", "none of 1 to 8 and head", "type ", "late", "repeated")
"""Parts of the reasons for which datagrams of a healthy sender are dropped."""


def sender_findings(address: StreamAddress, kind: str, capture: StreamCapture) -> list[DoctorFinding]:
    """Findings on senders and their datagrams. kind: of the stream, or of the stream in a replay."""
    found = _refused(address, capture) + _foreign(kind, capture, address)
    if capture.frames:
        senders = ", ".join(dict.fromkeys(host for host, _ in capture.sources))
        found.append(finding("stream", frames=capture.stream.frames, senders=senders))
    elif not found:
        reasons = "; ".join(reason for reason, _ in capture.stream.decoder.dropped.reasons.most_common(3))
        why = f" ({reasons})" if reasons else ""
        found.append(finding("stream/no pose", arrived=capture.arrived, reasons=why, sender=KINDS[kind].sender))
    for reason, count in capture.stream.decoder.dropped.reasons.most_common(8) if capture.frames else ():
        facts: dict[str, Any] = {"reason": reason, "count": count, "arrived": capture.arrived}
        harmless, share = any(part in reason for part in _HARMLESS), count / max(capture.arrived, 1)
        found.append(finding("decoder", **facts, harmless=harmless, share=share))
    found += findings("buffer", count=getattr(capture.stream.receiver, "overflowed", 0))  # lost by the kernel
    for host, size in capture.largest.items():
        if size > UNFRAGMENTED and not _is_here(host):
            found.append(finding("network/fragments", host=host, size=size))
    return found + _states(capture)


def _refused(address: StreamAddress, capture: StreamCapture) -> list[DoctorFinding]:
    found, admission = [], capture.stream.admission
    news = admission.news()
    many = {host for (host, _), reason in news if reason == NEW_SOCKETS}
    found += [finding("sender/sockets", host=host) for host in many]
    for (host, port), reason in news:
        if reason == NOT_ALLOWED:
            found.append(finding("sender/not allowed", host=host, port=port))
        elif reason == SECOND_SOURCE and host not in many:
            owner = admission.owner
            first = f"; {owner[0]}, port {owner[1]}, was first and is followed" if owner is not None else ""
            found.append(finding("sender/second", host=host, port=port, first=first))
    found += findings(
        "sender/rate", rate=capture.arrived / max(capture.seconds, 0.1), taken=MOST_DECODED * HUMAN_RATE_HZ
    )
    others = capture.stream.receiver.dropped.reasons.items()
    return found + [finding("sender/refused", reason=why, count=n, address=address.text) for why, n in others]


def _foreign(kind: str, capture: StreamCapture, address: StreamAddress) -> list[DoctorFinding]:
    found, looked, counts = [], capture.kinds.total(), Counter[str]()
    for got, count in capture.kinds.items():
        counts[got.name] += count
    seen, recording = set[str](), "" if address.path is None else str(address.path)
    for got, _ in capture.kinds.most_common():
        advice = advice_for(kind, got, port=address.port, recording=recording)
        mixed = bool(capture.frames) and (reads(kind, got) or got.name.startswith(DAMAGED))
        if not advice or mixed or got.name in seen:
            continue
        seen.add(got.name)
        what = f"{got.text}, {counts[got.name]} of {looked} datagrams looked at"
        if not reads(kind, got):
            what += f", and {kind}:// is read" if recording else f", and {kind}:// is listened for"
        also = capture.frames and not got.kind
        found.append(finding("protocol/also" if also else "protocol", got=what, advice=advice))
    return found


def _is_here(host: str) -> bool:
    try:
        return IPv4Address(host).is_loopback
    except AddressValueError:
        return False


def _states(capture: StreamCapture) -> list[DoctorFinding]:
    decoder = capture.stream.decoder
    if isinstance(decoder, VmcDecoder) and decoder.loaded is False:
        return [finding("sender/no avatar")]
    if isinstance(decoder, VmcDecoder) and decoder.tracking is False:
        return [finding("sender/bad tracking")]
    if isinstance(decoder, NatnetDecoder) and decoder.names_missing:
        return [finding("sender/no names")]
    return []


# A stream, judged as a whole.


def stream_findings(
    address: StreamAddress, performer: Performer, *, clock: Clock, seconds: float
) -> list[DoctorFinding]:
    """Findings on a stream after listening for `seconds`. Raises InputError for a recording that cannot be read."""
    kind = recorded_kind(address) if address.kind == "replay" else address.kind
    convention = performer.roles or stream_kinds()[kind].roles
    # Another process may have the port, on another address of this machine; this one does not have it yet.
    holder = port_holder(address.port) if address.kind != "replay" and address.port else UNKNOWN_HOLDER
    try:
        stream = open_stream(address, named_for(performer, convention))
    except InputError as error:
        if address.kind == "replay":
            raise
        return fix_all("port", error.problems)
    with closing(stream.receiver):
        capture = capture_stream(stream, clock=clock, seconds=seconds)
        found = judge(address, performer, convention, capture, kind=kind)
    if not capture.arrived:
        found += silence_findings(address, seconds=capture.seconds, answered=bool(found))
    shared = holder != UNKNOWN_HOLDER
    return found + ([finding("port/shared", holder=holder, port=address.port)] if shared else [])


def judge(
    address: StreamAddress, performer: Performer, convention: str, capture: StreamCapture, *, kind: str
) -> list[DoctorFinding]:
    """Findings on a capture; none if nothing arrived and Motive did not answer."""
    found, receiver = list[DoctorFinding](), capture.stream.receiver
    if isinstance(receiver, NatnetReceiver):
        found = fix_all("Motive", natnet_problems(receiver.session, capture.ended, host=address.host or ""))
    if capture.arrived:
        found += sender_findings(address, kind, capture) if not (found and not capture.frames) else []
        found += rate_findings(kind, capture)
        found += role_findings(performer, convention, capture)
        found += invented_findings(convention, capture)
    return found


def named_for(performer: Performer, convention: str) -> Performer:
    """The performer with the role UNNAMED for each sensor that this convention does not name. No sender has a
    pose of that name, so the sensor is reported as missing."""
    known = CONVENTIONS.get(performer.roles or convention, {})
    sensors = {}
    for name, sensor in performer.sensors.items():
        place = known.get(name)
        sends = place is not None and (not sensor.beside or place.position == place.orientation)
        named = sends or sensor.role is not None
        sensors[name] = sensor if named else sensor.model_copy(update={"role": UNNAMED})
    return performer.model_copy(update={"sensors": sensors})


# The page of `web://`.

OPENING_S = 120.0
"""Time for a performer to open the page and choose an input, s."""
POLL_S = 0.05
"""Time between two polls, s."""


def web_findings(
    address: StreamAddress,
    performer: Performer,
    receiver: PoseReceiver,
    health: Callable[[], list[dict[str, Any]]],
    *,
    clock: Clock,
    seconds: float,
) -> list[DoctorFinding]:
    """Findings on the page, the browser and the poses, after a performer was there for `seconds`. health: returns the
    `health` messages of browsers so far."""
    found = findings("page/runtime", installed=runtime_folder() is not None)
    convention = stream_kinds()["web"].roles
    stream = open_stream(address, named_for(performer, convention), receiver=receiver)
    with closing(receiver):
        end = clock.now() + OPENING_S
        while not health() and clock.now() < end:
            clock.sleep_until(clock.now() + POLL_S)
        capture = capture_stream(stream, clock=clock, seconds=seconds)
    reports = health()
    if not reports:
        return [*found, finding("page/no performer", seconds=OPENING_S)]
    return found + page_findings(reports) + judge(address, performer, convention, capture, kind="web")


def page_findings(reports: list[dict[str, Any]]) -> list[DoctorFinding]:
    """Findings on the `health` messages of a performer's page, oldest first."""
    last, facts = reports[-1], dict[str, float]()
    for key in ("fps", "infer_ms", "rtt_ms", "send_ms"):
        values = [one[key] for one in reports if isinstance(one.get(key), int | float)]
        facts[key] = float(np.median(values)) if values else float("nan")
    facts |= {key: int(last.get(key) is True) for key in ("secure", "wasm")}
    texts = {key: str(last.get(key) or "not said")[:60] for key in ("agent", "camera", "permission")}
    names = ["browser", "browser/secure", "browser/wasm", "camera/permission"]
    names += [f"camera/{key}" for key in ("fps", "infer_ms") if np.isfinite(facts[key])]
    names += ["network/latency"] if np.isfinite(facts["rtt_ms"]) else []
    found = findings(*names, granted=int(last.get("permission") != "denied"), **facts, **texts)
    if trouble := str(last.get("trouble") or "")[:200]:
        found.append(finding("page/trouble", trouble=trouble))
    return found
