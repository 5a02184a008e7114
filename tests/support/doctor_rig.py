"""Streams that the doctor captures on virtual time: of a JSON sender with faults, or any datagrams at given times."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field

from hardware.clock import VirtualClock
from live_rig import five, live_stream
from retarget.live.address import parse_address
from retarget.live.admission import Datagram, Source, admission_for
from retarget.live.open_stream import stream_kinds
from retarget.live.playout import Playout
from retarget.live.roles import roles_of
from retarget.live.sensor_validity import SensorValidity
from retarget.live.stream import LiveStream
from retarget.schema.performer import Performer
from retarget.setup.doctor_machine import DoctorFinding, FindingLevel
from retarget.setup.doctor_sensors import StreamCapture, capture_stream
from retarget.setup.doctor_stream import judge, named_for
from retarget.sources.streams.stream_frame import Dropped
from sim.faults.sender import FakeSender, SenderFault
from sim.performer import synthetic_performer

JSON = parse_address("json://:14150")
FRAMES = synthetic_performer(1)
HERE: Source = ("127.0.0.1", 40000)


@dataclass
class Played:
    """A Receiver of datagrams at times, s."""

    rows: Sequence[Datagram]
    dropped: Dropped = field(default_factory=Dropped)
    next: int = 0

    finished = False

    def poll(self, now: float) -> list[Datagram]:
        found = []
        while self.next < len(self.rows) and self.rows[self.next].arrival <= now:
            found.append(self.rows[self.next])
            self.next += 1
        return found

    def close(self) -> None:
        """Nothing is open."""


def json_poses(time: float, poses: dict[str, dict[str, list[float]]], **more: object) -> bytes:
    return json.dumps({"axes": "rep103", "time": time, "poses": poses} | more).encode()


def captured(
    *faults: SenderFault,
    sender: FakeSender | None = None,
    performer: Performer | None = None,
    seconds: float = 5.0,
) -> StreamCapture:
    """A sender of JSON whose performer begins to move after 2 s."""
    sender = sender or FakeSender(frames=FRAMES)
    sender.faults += faults
    return capture_stream(live_stream(sender, performer or five()), clock=VirtualClock(), seconds=seconds)


def played(
    rows: Sequence[Datagram], *, text: str = "json://:14150", performer: Performer | None = None, seconds: float = 4.0
) -> StreamCapture:
    """Any datagrams, at an address."""
    address = parse_address(text)
    how, performer = stream_kinds()[address.kind], performer or five()
    roles = roles_of(named_for(performer, how.roles), how.roles, where="test")
    stream = LiveStream(
        Played(rows),
        how.decoder(),
        roles,
        admission=admission_for(address),
        clock_map=how.clock(),
        validity=SensorValidity(roles.sensors),
        playout=Playout(len(roles.sensors)),
    )
    return capture_stream(stream, clock=VirtualClock(), seconds=seconds)


def steady(payload: bytes, *, rate: float = 100.0, seconds: float = 2.0, source: Source = HERE) -> list[Datagram]:
    """One datagram again and again."""
    return [Datagram(k / rate, source, payload) for k in range(round(rate * seconds))]


def judged(
    capture: StreamCapture, *, text: str = "json://:14150", performer: Performer | None = None
) -> list[DoctorFinding]:
    address = parse_address(text)
    roles = stream_kinds()[address.kind].roles
    return judge(address, performer or five(), roles, capture, kind=address.kind)


def fixes(found: Sequence[DoctorFinding]) -> list[str]:
    return [finding.render() for finding in found if finding.level is FindingLevel.FIX]


def text_of(found: Sequence[DoctorFinding]) -> str:
    return "\n".join(finding.render() for finding in found)
