"""Opening a live stream: its receiver, decoder and roles, from an address or from the caller's own receiver."""

from collections.abc import Callable
from dataclasses import dataclass

from hardware.clock import Clock, VirtualClock
from retarget.errors import InputError, UsageError
from retarget.live.address import StreamAddress
from retarget.live.admission import Admission, Receiver, admission_for
from retarget.live.clock_map import ClockMap
from retarget.live.playout import LIGHT, Playout, PlayoutDelay, pose_filter
from retarget.live.raw_recording import RawTap, open_replay, recorded_kind
from retarget.live.receivers import NatnetReceiver, TcpReceiver, session_for
from retarget.live.roles import roles_of
from retarget.live.sensor_validity import SensorValidity
from retarget.live.stream import LiveStream
from retarget.live.udp import UdpReceiver
from retarget.schema.performer import Performer
from retarget.sources.json_pose import JsonPoseDecoder
from retarget.sources.mvn import MvnDecoder
from retarget.sources.natnet_decoder import NatnetDecoder
from retarget.sources.stream_frame import StreamDecoder
from retarget.sources.vmc import VmcBodyDecoder, VmcDecoder
from retarget.sources.vrchat import VrchatDecoder

# The receiver of an address: a UDP socket, the sockets of NatNet, a TCP port for MVN, or a recording.


def open_receiver(address: StreamAddress, *, names_missing: Callable[[], bool] = lambda: False) -> Receiver:
    """Open the receiver of an address. names_missing: whether Motive's frames have ids without a known name; Motive is
    then asked for names.

    Arrivals are on the machine's monotonic clock; those of a replay are on the clock that it is polled by.

    Raises InputError: port taken or forbidden, no such interface, group not joined, no such recording.
    """
    if address.kind == "replay":
        return open_replay(address)
    if address.kind == "natnet":
        session = session_for(address)
        session.names_missing = names_missing
        return NatnetReceiver(address, session)
    return UdpReceiver(address) if address.host is None else TcpReceiver(address)


BONES = "unity_bones"
"""The convention whose poses are relative to each other on the wire."""


@dataclass(frozen=True)
class StreamKind:
    """How one kind of sender is read. roles: the convention of its names; clock: makes the map of its stamps."""

    decoder: Callable[[], StreamDecoder]
    roles: str
    clock: Callable[[], ClockMap]


def stream_kinds() -> dict[str, StreamKind]:
    """By the scheme of the address."""
    return {
        # VMC sends seconds as float32.
        "vmc": StreamKind(VmcDecoder, "slimevr", lambda: ClockMap(significand=24)),
        "vrchat": StreamKind(VrchatDecoder, "slimevr_vrchat", ClockMap),
        "mvn": StreamKind(MvnDecoder, "mvn", lambda: ClockMap(resolution=1e-3)),
        "json": StreamKind(JsonPoseDecoder, "json", ClockMap),
        "natnet": StreamKind(NatnetDecoder, "natnet", ClockMap),
    }


def open_stream(
    address: StreamAddress,
    performer: Performer,
    *,
    clock: Clock,
    tap: RawTap | None = None,
    smoothing: str = LIGHT,
    latest: bool = False,
) -> LiveStream:
    """Open the port, or the recording, of an address. smoothing: see `playout.SMOOTHINGS`. latest: use the newest
    poses at once, instead of a playout buffer.

    Raises InputError: port taken, no such interface, no such recording; UsageError: sensors that such a sender does not
    have.
    """
    kind = recorded_kind(address) if address.kind == "replay" else address.kind
    decoder: StreamDecoder
    if kind == "natnet":
        decoder = NatnetDecoder(up=address.up, bones=address.bones)
    elif (address.up, address.bones) != ("y", "global"):
        raise UsageError("only Motive has this", where=address.text, found="up or bones", next_step="Leave it out")
    elif kind == "vmc" and performer.roles == BONES:
        decoder = VmcBodyDecoder()
    else:
        decoder = stream_kinds()[kind].decoder()
    if address.kind != "replay" and isinstance(clock, VirtualClock):
        raise InputError("a live stream runs on real time", where=address.text)
    return _stream(
        kind,
        decoder,
        lambda: open_receiver(
            address, names_missing=lambda: isinstance(decoder, NatnetDecoder) and decoder.names_missing
        ),
        performer,
        admission=admission_for(address),
        tap=tap,
        smoothing=smoothing,
        latest=latest,
    )


def stream_of(
    receiver: Receiver,
    performer: Performer,
    *,
    tap: RawTap | None = None,
    smoothing: str = LIGHT,
    latest: bool = False,
) -> LiveStream:
    """A stream of poses in JSON from the caller's own receiver, as `retarget.run.own_source.OwnSource` sends them. The
    rest as in `open_stream`.

    Raises UsageError: sensors that such a sender does not have.
    """
    return _stream(
        "json",
        JsonPoseDecoder(),
        lambda: receiver,
        performer,
        admission=Admission(),
        tap=tap,
        smoothing=smoothing,
        latest=latest,
    )


def _stream(
    kind: str,
    decoder: StreamDecoder,
    receiver: Callable[[], Receiver],
    performer: Performer,
    *,
    admission: Admission,
    tap: RawTap | None,
    smoothing: str,
    latest: bool,
) -> LiveStream:
    """receiver: opens it, when all else was found right."""
    how = stream_kinds()[kind]
    roles = roles_of(performer, performer.roles or how.roles, where=f"performer {performer.name}")
    count = len(roles.sensors)
    smooth = pose_filter(smoothing, count)
    return LiveStream(
        receiver(),
        decoder,
        roles,
        admission=admission,
        clock_map=how.clock(),
        validity=SensorValidity(roles.sensors),
        playout=Playout(count, delay=None if latest else PlayoutDelay()),
        smooth=smooth,
        tap=tap,
    )
