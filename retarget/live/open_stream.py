"""Opening a live stream: its receiver, decoder and roles, from an address or from the caller's own receiver."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from retarget.errors import InputError, UsageError
from retarget.frames import SensorFrames
from retarget.live.address import StreamAddress
from retarget.live.admission import Admission, Receiver, admission_for
from retarget.live.clock_map import ClockMap
from retarget.live.playout import LIGHT, Playout, PlayoutDelay, pose_filter
from retarget.live.raw_recording import RawTap, open_replay, recorded_kind
from retarget.live.receivers import NatnetReceiver, UdpReceiver
from retarget.live.roles import roles_of
from retarget.live.sensor_validity import SensorValidity
from retarget.live.stream import LiveStream
from retarget.schema.performer import Performer
from retarget.sources.streams.camera import WebDecoder
from retarget.sources.streams.json_pose import JsonPoseDecoder
from retarget.sources.streams.mvn import MvnDecoder
from retarget.sources.streams.natnet_decoder import NatnetDecoder
from retarget.sources.streams.raw_record import RawReader
from retarget.sources.streams.stream_frame import StreamDecoder, StreamFrame
from retarget.sources.streams.vmc import VmcBodyDecoder, VmcDecoder
from retarget.sources.streams.vrchat import VrchatDecoder


def open_receiver(address: StreamAddress, *, names_missing: Callable[[], bool] = lambda: False) -> Receiver:
    """Open the receiver of an address. names_missing: True if Motive's frames have ids without names, which are
    requested.

    Arrivals of a replay are on the clock of `poll`, others on the monotonic clock. Raises InputError: port taken or
    forbidden, no such interface, group not joined, no such recording.
    """
    if address.kind == "replay":
        return open_replay(address)
    if address.kind == "natnet":
        motive = NatnetReceiver(address)
        motive.session.names_missing = names_missing
        return motive
    return UdpReceiver(address)


BONES = "unity_bones"  # convention whose poses are relative to each other on the wire


@dataclass(frozen=True)
class StreamKind:
    """One kind of sender. roles: the convention of its names; clock: makes the map of its stamps."""

    decoder: Callable[[], StreamDecoder]
    roles: str
    clock: Callable[[], ClockMap]


def stream_kinds() -> dict[str, StreamKind]:
    """Decoders and stamps of streams, by the scheme of the address."""
    return {
        # VMC sends seconds as float32.
        "vmc": StreamKind(VmcDecoder, "slimevr", lambda: ClockMap(significand=24)),
        "vrchat": StreamKind(VrchatDecoder, "slimevr_vrchat", ClockMap),
        "mvn": StreamKind(MvnDecoder, "mvn", lambda: ClockMap(resolution=1e-3)),
        "json": StreamKind(JsonPoseDecoder, "json", ClockMap),
        "natnet": StreamKind(NatnetDecoder, "natnet", ClockMap),
        "web": StreamKind(WebDecoder, "json", ClockMap),
    }


def open_stream(
    address: StreamAddress | None,
    performer: Performer,
    *,
    receiver: Receiver | None = None,
    tap: RawTap | None = None,
    smoothing: str = LIGHT,
    latest: bool = False,
    use_generated_legs: bool = False,
    mirrored_camera: bool = False,
) -> LiveStream:
    """Open the port or recording of an address, or read the caller's own receiver (by default, poses in JSON).

    latest: use the newest poses at once, without a playout buffer. use_generated_legs: see `WebDecoder`.
    mirrored_camera: the camera shows a mirror image. Raises InputError: port taken, no such interface, no such
    recording; UsageError: sensors that such a sender lacks.
    """
    kind, decoder = _decoder(address)
    if kind == "vmc" and performer.roles == BONES:
        decoder = VmcBodyDecoder()
    elif kind == "web":
        decoder = WebDecoder(use_generated_legs=use_generated_legs)
    how = stream_kinds()[kind]
    roles = roles_of(
        performer, performer.roles or how.roles, where=f"performer {performer.name}", mirrored=mirrored_camera
    )
    count = len(roles.sensors)
    pose_filter(smoothing, count)  # an unknown name is refused before a port is opened
    if receiver is None:  # when all else was found right
        assert address is not None, "an address, or a receiver"
        receiver = open_receiver(
            address, names_missing=lambda: isinstance(decoder, NatnetDecoder) and decoder.names_missing
        )
    return LiveStream(
        receiver,
        decoder,
        roles,
        admission=Admission() if address is None else admission_for(address),
        clock_map=how.clock(),
        validity=SensorValidity(roles.sensors),
        playout=Playout(count, delay=None if latest else PlayoutDelay()),
        smoothing=smoothing,
        tap=tap,
        kind="" if address is None else kind,
    )


def _decoder(address: StreamAddress | None) -> tuple[str, StreamDecoder]:
    if address is None:
        return "json", JsonPoseDecoder()
    kind = recorded_kind(address) if address.kind == "replay" else address.kind
    if kind == "natnet":
        return kind, NatnetDecoder(up=address.up, bones=address.bones)
    if (address.up, address.bones) != ("y", "global"):
        raise UsageError("only Motive has this", where=address.text, found="up or bones", next_step="Leave it out")
    return kind, stream_kinds()[kind].decoder()


MOST_READ = 4_000_000  # poses: 224 MB


def read_recording(address: StreamAddress) -> SensorFrames:
    """Every pose of a `replay://` address at its time of capture, by the sender's names, in the stream's world.

    Notes list what is left out. Raises InputError without poses, or if the file is missing or no recording.
    """
    assert address.path is not None
    kind, decoder = _decoder(address)
    clock, reader, frames = stream_kinds()[kind].clock(), RawReader(address.path), dict[float, StreamFrame]()
    read, names, notes = 0, dict[str, int](), list[str]()
    for datagram in reader:
        for frame in decoder.decode(datagram.payload):
            time = clock.map(datagram.time_s, frame.stamp, frame.number)
            if time is not None and frame.names:
                frames[time] = frame
                read += len(frame.names)
                for name in frame.names:
                    names.setdefault(name, len(names))
        if read > MOST_READ or len(frames) * len(names) > MOST_READ:
            notes.append(f"only the first {len(frames)} frames were read")
            break
    left_out = decoder.dropped.reasons + clock.dropped.reasons
    notes += [f"not used: {reason} ({count})" for reason, count in left_out.most_common()]
    notes += [reader.damage] if reader.damage else []
    if not frames:
        found = "; ".join(notes)[:300] or "no datagram"
        raise InputError("no pose in the recording", where=address.text, found=found)
    times = np.array(sorted(frames))
    poses = np.full((len(times), len(names), 7), np.nan)
    for row, time in enumerate(times.tolist()):
        frame, columns = frames[time], [names[name] for name in frames[time].names]
        poses[row, columns] = np.hstack((frame.position, frame.orientation))
        poses[row, columns] = np.where(frame.tracked[:, None], poses[row, columns], np.nan)
    return SensorFrames(
        time=times - times[0],
        names=tuple(names),
        position=poses[..., :3],
        orientation=poses[..., 3:],
        valid=np.isfinite(poses[..., :3]).all(axis=2),
        source=address.text,
        rate_hz=float(1.0 / np.median(np.diff(times))) if len(times) > 1 else 0.0,
        notes=tuple(notes),
    )
