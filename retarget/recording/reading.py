"""A recording read back as topics and as cycles. The mcap library reads it and checks its CRCs."""

import json
import struct
from array import array
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import IO, Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

import retarget
from retarget.errors import InputError
from retarget.frames import SensorFrames
from retarget.human.samples import Clip
from retarget.model.robot import RobotBody
from retarget.recording.cdr import Rows, layout_from
from retarget.recording.cycles import Done
from retarget.recording.mcap_writer import METADATA, MOST_RECORDS, require_mcap
from retarget.recording.npz import MAX_BYTES, refuse_no_file
from retarget.recording.session import FORMAT, Session
from retarget.recording.topics import (
    CONTACT,
    GOALS,
    HUMAN_POSTURE,
    IMU,
    LANDMARKS,
    RECORDED,
    SENSORS,
    SERVOS,
    STICK,
    TICK,
    TRUTH,
    sent_postures,
)
from retarget.run.table import STAGES, RunTable, Widths, message_fields
from retarget.types import FloatArray

MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE = 0x03, 0x04, 0x05
"""Opcodes of records in a chunk."""
RECORD_HEAD, MESSAGE_HEAD = struct.Struct("<BQ"), struct.Struct("<HI16x")
"""Opcode and length; channel and sequence."""
HOSTILE = (ValueError, KeyError, IndexError, TypeError, SyntaxError, RecursionError, OverflowError, MemoryError)
"""Errors that forged content leads to."""


@dataclass(frozen=True, eq=False)
class TopicRows:
    """The messages of a topic: cycles (T,), their cycle numbers, and rows (T,), their fields."""

    cycles: NDArray[np.int64]
    rows: Rows


@dataclass(frozen=True, eq=False)
class Recording:
    """The content of a file. damage: the reason of an early end, "" if it is whole. texts: failures and stops by
    (cycle, source). attachments: config files that match the session, by name."""

    path: Path
    session: Session
    damage: str
    topics: dict[str, TopicRows]
    texts: dict[tuple[int, str], str]
    attachments: dict[str, bytes] = field(default_factory=dict)

    def topic(self, name: str) -> TopicRows:
        """The messages of a topic. Raises InputError if it has none."""
        if name not in self.topics:
            raise InputError(
                "the recording has no such topic",
                where=str(self.path),
                found=f"no {name}" + (f"; {self.damage}" if self.damage else ""),
                allowed="a file that `retarget run --record` wrote",
            )
        return self.topics[name]

    @cached_property
    def cycles(self) -> RunTable:
        """The whole cycles. Fields q_servos, human_q and truth are NaN in cycles without them. Raises InputError for
        missing or misshapen topics and fields."""
        with refusing_hostile(self):
            return _cycles(self)

    @property
    def missing(self) -> int:
        """Number of cycles that were never written."""
        return int(self.cycles.index[-1]) + 1 - len(self.cycles)

    @property
    def whole(self) -> bool:
        """True if nothing of the run is missing."""
        return not (self.damage or self.missing)

    @property
    def last_tick(self) -> int:
        """The last recorded tick of the performance; -1: none."""
        sampled = self.cycles.sampled != Done.NOT
        return int(self.cycles.tick[sampled].max(initial=-1))

    def clip(self, rows: NDArray[np.intp], ticks: int, *, dt: float, speed: float) -> Clip:
        """The sensors in some rows of the cycles, as a clip of `ticks` ticks, `dt` s apart."""
        valid = self.cycles.sensor_valid[rows]
        frames = SensorFrames(
            time=np.arange(len(rows), dtype=np.float64) * dt,
            names=self.session.sensors,
            position=np.where(valid[..., None], self.cycles.sensor_position[rows], np.nan),
            orientation=np.where(valid[..., None], self.cycles.sensor_orientation[rows], np.nan),
            valid=valid,
            source=self.session.source,
            rate_hz=1.0 / dt,
        )
        return Clip(frames, ticks, 1.0 / dt, speed, len(rows))


@dataclass
class _Found:
    """State of a read. sequences, contents: of all messages of a channel. room: bytes that may still be unpacked."""

    metadata: dict[str, str] | None = None
    attachments: dict[str, bytes] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    sequences: dict[int, "array[int]"] = field(default_factory=lambda: defaultdict(lambda: array("I")))
    contents: dict[int, bytearray] = field(default_factory=lambda: defaultdict(bytearray))
    texts: dict[tuple[int, str], str] = field(default_factory=dict)
    room: int = MAX_BYTES
    records: int = 0


def read_recording(path: Path) -> Recording:
    """Read a recording up to its end or its first damage, which `damage` names.

    Raises UsageError without the library, and InputError for any other file, another format, or no cycles.
    """
    require_mcap(str(path))
    where = str(path)[:200]
    found = _Found()
    try:
        refuse_no_file(path)
        with path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise InputError("this is no MCAP file", where=where, allowed="a file that --record wrote")
            stream.seek(0)
            damage = _read(stream, found)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError("cannot read the recording", where=where, found=reason) from None
    session = _session(found.metadata, where, damage)
    topics = {name: rows for name, rows in _topics(found, where) if len(rows.rows)}
    said = {file.name: file.sha256 for file in session.files}
    attached = {name: data for name, data in found.attachments.items() if sha256(data).hexdigest() == said.get(name)}
    return Recording(path, session, damage, topics, found.texts, attached)


def _read(stream: IO[bytes], found: _Found) -> str:
    """Read record by record. Returns the reason of an early end."""
    import zstandard
    from mcap.exceptions import EndOfFile, McapError
    from mcap.records import Attachment, Chunk, Metadata
    from mcap.stream_reader import StreamReader

    reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=MAX_BYTES)
    try:
        for record in reader.records:
            if isinstance(record, Chunk):
                found.room -= record.uncompressed_size
                if found.room < 0:
                    return f"it ends early: of what is packed in it no more than {MAX_BYTES} bytes are read"
                _take_chunk(record, found)
            elif isinstance(record, Metadata) and record.name == METADATA:
                found.metadata = record.metadata
            elif isinstance(record, Attachment):
                found.attachments[record.name] = record.data
    except EndOfFile:
        return "it ends early: the run was cut off, or the file is not whole"
    except (McapError, struct.error, zstandard.ZstdError, *HOSTILE) as error:
        return f"it ends early, in a damaged record ({error})"
    return ""


def _take_chunk(chunk: Any, found: _Found) -> None:
    """Keep the channels and messages of a chunk. Raises ValueError or struct.error for foreign records. Every length is
    compared with the data before use."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel

    data, at = _unpacked(chunk), 0
    while at < len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        begin = at + RECORD_HEAD.size
        at = begin + length
        found.records += 1
        if at > len(data):
            raise ValueError("a record is longer than its chunk")
        if found.records > MOST_RECORDS:
            raise ValueError(f"one of more than {MOST_RECORDS}")
        if opcode == CHANNEL:
            channel = Channel.read(ReadDataStream(BytesIO(data[begin:at])))
            found.channels.setdefault(channel.id, channel)
        elif opcode == MESSAGE:
            number, sequence = MESSAGE_HEAD.unpack_from(data, begin)
            if number not in found.channels:
                raise ValueError(f"a message of channel {number}, which is not there")
            content = data[begin + MESSAGE_HEAD.size : at]
            if "layout" in found.channels[number].metadata:
                found.sequences[number].append(sequence)
                found.contents[number] += content
            else:  # the log, of which the first text of each cycle and source is kept
                source, text = _log_of(content)
                found.texts.setdefault((sequence, source), text)
        elif opcode != SCHEMA:
            raise ValueError(f"an unknown record of type {opcode}")


def _unpacked(chunk: Any) -> bytes:
    """The content of a chunk, at most of its stated size. Raises ValueError or ZstdError."""
    import zstandard

    data: bytes = chunk.data
    if chunk.compression:
        if chunk.compression != "zstd":
            raise ValueError(f"packed by {chunk.compression[:20]}, and not by zstd")
        data = zstandard.ZstdDecompressor().stream_reader(data).read(chunk.uncompressed_size + 1)
    if len(data) != chunk.uncompressed_size or (chunk.uncompressed_crc and crc32(data) != chunk.uncompressed_crc):
        raise ValueError("the CRC of a chunk, or its size, is wrong")
    return data


def _session(metadata: dict[str, str] | None, where: str, damage: str) -> Session:
    allowed = "a file that `retarget run --record` wrote"
    if metadata is None:
        raise InputError(
            "no recording of ours", where=where, found=damage or "no metadata of retarget", allowed=allowed
        )
    given = metadata.get("format", "")[:20]
    if given != str(FORMAT):
        raise InputError(
            "the recording has another format",
            where=where,
            found=(f"format {given}" if given else "no format") + _written_by(metadata.get("session", "")),
            allowed=f"format {FORMAT}, of version {retarget.__version__}",
            next_step="Read it with the version of retarget that wrote it",
        )
    text = metadata.get("session", "")
    if sha256(text.encode()).hexdigest() != metadata.get("sha256"):  # MCAP has no CRC for metadata
        raise InputError("its metadata are damaged", where=where, found="another SHA-256", allowed=allowed)
    try:
        return Session.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        fault = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
        raise InputError("its metadata are damaged", where=where, found=fault[:200], allowed=allowed) from None


def _written_by(session: str) -> str:
    try:
        version = json.loads(session)["version"]
    except (ValueError, TypeError, KeyError, RecursionError):
        return ""
    return f", written by version {str(version)[:20]}"


def _topics(found: _Found, where: str) -> Iterator[tuple[str, TopicRows]]:
    for number, channel in found.channels.items():
        if "layout" not in channel.metadata:
            continue
        try:
            rows = np.frombuffer(found.contents[number], layout_from(channel.metadata["layout"]))
        except HOSTILE as error:
            raise InputError("a topic is damaged", where=where, found=f"{channel.topic}: {error}") from None
        cycles = np.array(found.sequences[number], dtype=np.int64)
        if len(rows) != len(cycles):
            raise InputError("a topic is damaged", where=where, found=f"{channel.topic}: messages of another size")
        yield str(channel.topic), TopicRows(cycles, rows)


def _log_of(data: bytes) -> tuple[str, str]:
    """Name and text of an rcl_interfaces/msg/Log in CDR; empty if damaged."""
    try:
        at, values = 16, []
        for _ in range(2):
            (size,) = struct.unpack_from("<I", data, at)
            values.append(data[at + 4 : at + 3 + size].decode("utf-8", "replace"))
            at += 4 + size
            at += -at % 4
    except struct.error:
        return "", ""
    return values[0], values[1]


MOVED_BODY = "Give the robot that was moved: --robot NAME, or --body FILE.xml"
"""A next step; commands have one of the two options."""
MOST_CYCLES = 50_000_000
"""Four days at 125 Hz."""


@contextmanager
def refusing_hostile(recording: Recording) -> Iterator[None]:
    """Raise InputError for forged content of a recording."""
    try:
        yield
    except HOSTILE as error:
        what, where = "the recording cannot be used", str(recording.path)
        raise InputError(what, where=where, found=error, next_step="Record it anew") from None


def postures_sent(found: Recording, robot: RobotBody, rows: NDArray[np.intp]) -> FloatArray:
    """The postures (k, nq), m, wxyz and rad, sent in some rows of the cycles. Raises InputError for another body."""
    cycles, body = found.cycles[rows], robot.body
    servos, recorded = len(robot.servo_columns), (cycles.q_servos.shape[1], cycles.q_rest.shape[1])
    if recorded != (servos, body.nq - servos):
        raise InputError(
            "joints and body do not belong together",
            where=str(found.path),
            found=f"{sum(recorded)} coordinates, {body.source} has {body.nq}",
            next_step=MOVED_BODY,
        )
    return sent_postures(robot, cycles)


def _cycles(recording: Recording) -> RunTable:
    ticks, sensors, session = recording.topic(TICK), recording.topic(SENSORS), recording.session
    _, first = np.unique(ticks.rows["cycle"], return_index=True)
    rows = ticks.rows[first]  # in order, each cycle once
    if rows["cycle"][0] != 0 or rows["tick"].min() < 0 or rows["tick"].max() > rows["cycle"][-1]:
        raise ValueError("ticks that do not begin where a run begins")
    if rows["cycle"][-1] > MOST_CYCLES:
        raise ValueError(f"more than {MOST_CYCLES} cycles")
    if session.joints:
        recording.topic(SERVOS)
    widths = _widths(recording, rows)
    if 8 * len(rows) * (widths["human"] + widths["truth"]) > MAX_BYTES:
        raise ValueError("wider postures than a body has")
    cycles = RunTable.empty(len(rows), widths, RECORDED)
    for name, own in message_fields(TICK).items():
        if cycles.known[own].size and (own not in STAGES or name in (rows.dtype.names or ())):
            cycles.known[own][:] = rows[name]
    _take_sensors(cycles, sensors, rows["sensor_oriented"])
    sampled = cycles.sampled != Done.NOT
    first = np.flatnonzero(sampled & (cycles.tick == 0))
    if not sampled[0] or cycles.tick[0] != 0 or (cycles.sampled[first] != Done.WELL).any():
        raise ValueError("no valid sensors in its first tick")
    if cycles.tick[sampled].max() >= session.ticks:
        raise ValueError("more ticks than its session has")
    cycles.q_servos[:], cycles.human_q[:], cycles.truth[:] = np.nan, np.nan, np.nan
    for topic in {SERVOS, GOALS, HUMAN_POSTURE, TRUTH, IMU, CONTACT, STICK} & set(recording.topics):
        at, known = _places(cycles, recording.topics[topic])
        for name, own in message_fields(topic).items():
            cycles.known[own][at] = recording.topics[topic].rows[name][known]
    cycles.imu_orientation[:] = cycles.imu_orientation[:, [3, 0, 1, 2]]
    return cycles


def _widths(recording: Recording, rows: Rows) -> Widths:
    session, topics = recording.session, recording.topics
    fields = {"human": (HUMAN_POSTURE, "q"), "truth": (TRUTH, "q"), "landmarks": (LANDMARKS, "poses")}
    return {
        "sensors": len(session.sensors),
        "servos": len(session.joints),
        "rest": rows["root"].shape[1] if "root" in (rows.dtype.names or ()) else 0,
        "observers": len(session.observers) if session.joints else 0,
        **{name: topics[at].rows[key].shape[1] if at in topics else 0 for name, (at, key) in fields.items()},
    }


def _places(cycles: RunTable, topic: TopicRows) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    at = np.searchsorted(cycles.index, topic.cycles)
    known = at < len(cycles)
    known[known] = cycles.index[at[known]] == topic.cycles[known]
    return at[known], known


def _take_sensors(cycles: RunTable, topic: TopicRows, oriented: NDArray[np.bool_]) -> None:
    at, known = _places(cycles, topic)
    poses = topic.rows["poses"][known]
    cycles.sensor_position[at] = poses[..., :3]
    cycles.sensor_orientation[at] = np.where(oriented[at][..., None], poses[..., [6, 3, 4, 5]], np.nan)
    unsaid = cycles.sampled == Done.WELL
    unsaid[at] = False
    if unsaid.any():
        cycles.sampled[unsaid] = Done.FAILED
