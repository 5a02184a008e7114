"""A stream's address and a performer in; what is wrong out: the address is opened, listened to, and judged."""

from contextlib import closing

from hardware.clock import Clock
from retarget.doctor.elsewhere import Elsewhere
from retarget.doctor.finding import Finding, mend, mend_all, note
from retarget.doctor.invented import invented_findings
from retarget.doctor.listening import Listening, listen_to
from retarget.doctor.rate_findings import rate_findings
from retarget.doctor.role_findings import UNNAMED, role_findings
from retarget.doctor.sender_findings import sender_findings
from retarget.doctor.silence_findings import silence_findings, stray_finding
from retarget.errors import InputError, UsageError
from retarget.live.address import StreamAddress
from retarget.live.natnet_receiver import NatnetReceiver
from retarget.live.open_stream import open_stream, stream_kinds
from retarget.live.port_holder import port_holder
from retarget.live.replay import recorded_kind
from retarget.live.roles import roles_of
from retarget.live.stream import LiveStream
from retarget.performer import Performer, WornSensor
from retarget.sources.natnet_trouble import natnet_problems

__all__ = ["judge", "stream_findings"]


def stream_findings(
    address: StreamAddress, performer: Performer, *, clock: Clock, seconds: float, everywhere: bool = False
) -> list[Finding]:
    """Listen for so long and judge. Raises InputError for a recording that cannot be read."""
    kind = recorded_kind(address) if address.kind == "replay" else address.kind
    convention = performer.roles or stream_kinds()[kind].roles
    holder = _holder(address)
    try:
        stream = open_stream(address, named_for(performer, convention), clock=clock)
    except InputError as error:
        if address.kind == "replay":
            raise
        return mend_all("port", error.problems)
    with closing(stream.receiver), closing(Elsewhere(address, everywhere=everywhere)) as elsewhere:
        heard = listen_to(stream, clock=clock, seconds=seconds, beside=elsewhere.poll)
        found = judge(address, performer, convention, heard, kind=kind)
        if not heard.arrived:
            found += silence_findings(address, elsewhere.strays, seconds=heard.seconds, answered=bool(found))
        elif not heard.frames:
            found += [stray_finding(address, stray) for stray in elsewhere.strays]
    return found + holder


def judge(
    address: StreamAddress, performer: Performer, convention: str, listening: Listening, *, kind: str
) -> list[Finding]:
    """What was heard, judged; nothing where nothing arrived and nobody answered."""
    found = _motive(address, listening.stream, listening.ended)
    if listening.arrived:
        found += sender_findings(address, kind, listening) if not (found and not listening.frames) else []
        found += rate_findings(kind, listening)
        found += role_findings(performer, convention, listening)
        found += invented_findings(convention, listening)
    return found


def named_for(performer: Performer, convention: str) -> Performer:
    """The performer, with a role that nobody tells for each sensor that this convention does not name: it is then
    found missing, beside what the sender tells instead."""
    sensors = dict[str, WornSensor]()
    for name, sensor in performer.sensors.items():
        alone = performer.model_copy(update={"sensors": {name: sensor}})
        try:
            roles_of(alone, convention, where=performer.name)
        except UsageError:
            sensor = sensor.model_copy(update={"role": UNNAMED})
        sensors[name] = sensor
    return performer.model_copy(update={"sensors": sensors})


def _motive(address: StreamAddress, stream: LiveStream, now: float) -> list[Finding]:
    receiver = stream.receiver
    if not isinstance(receiver, NatnetReceiver):
        return []
    found = mend_all("Motive", natnet_problems(receiver.session, now, host=address.host or ""))
    if receiver.trouble:
        found.append(mend("multicast", receiver.trouble, "Add interface=ADDRESS of the card that faces Motive"))
    return found


def _holder(address: StreamAddress) -> list[Finding]:
    """Who else has the port, on another address of this machine: looked at before it is opened."""
    if address.kind == "replay" or not address.port:
        return []
    protocol = "tcp" if address.kind == "mvn" and address.host is not None else "udp"
    holder = port_holder(address.port, protocol="tcp" if protocol == "tcp" else "udp")
    if holder == "another process":
        return []
    return [
        note("port", f"{holder} has a socket on port {address.port} too", "What is sent to that one is not heard here")
    ]
