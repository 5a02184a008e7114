"""A recording read back, by the mcap library with its CRC checks on: whole, or as far as it goes."""

import struct
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from retarget.errors import InputError
from retarget.recording.cdr import Rows, layout_from
from retarget.recording.file import METADATA, require_mcap
from retarget.recording.session import FORMAT, Session

__all__ = ["Recording", "TopicRows", "read_recording"]

LARGEST = 256 * 2**20
"""Bytes of the largest record that is read."""
MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True, eq=False)
class TopicRows:
    """The messages of a topic. cycles (T,): the number of the cycle of each. rows (T,): its fields, by name."""

    cycles: NDArray[np.int64]
    rows: Rows


@dataclass(frozen=True, eq=False)
class Recording:
    """What a file holds. damage: how it ended early, "" if it is whole. texts: failures and stops by (cycle, who).
    attachments: content of the config files by name, of those that are as the session says."""

    path: Path
    session: Session
    damage: str
    topics: dict[str, TopicRows]
    texts: dict[tuple[int, str], str]
    attachments: dict[str, bytes] = field(default_factory=dict)

    def topic(self, name: str) -> TopicRows:
        """The messages of a topic. Raises InputError where it has none."""
        if name not in self.topics:
            raise InputError(
                "the recording lacks a topic",
                where=str(self.path),
                found=f"no {name}" + (f"; {self.damage}" if self.damage else ""),
                allowed="a file that `retarget run --record` wrote",
            )
        return self.topics[name]


@dataclass
class _Found:
    """While it is read."""

    metadata: dict[str, str] | None = None
    attachments: dict[str, bytes] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    data: dict[int, list[bytes]] = field(default_factory=dict)
    cycles: dict[int, list[int]] = field(default_factory=dict)


def read_recording(path: Path) -> Recording:
    """Read a recording. What stands before a damage is read, and `damage` tells of it.

    Raises UsageError without the library, InputError: no file, no MCAP file, none of ours, another format, no cycles.
    """
    require_mcap(str(path))
    where = str(path)[:200]
    found = _Found()
    try:
        with path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise InputError("this is no MCAP file", where=where, allowed="a file that --record wrote")
            stream.seek(0)
            damage = _read(stream, found)
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError("cannot read the recording", where=where, found=reason) from None
    session = _session(found.metadata, where, damage)
    topics = {name: rows for name, rows in _topics(found, where) if len(rows.rows)}
    said = {file.name: file.sha256 for file in session.files}
    attached = {name: data for name, data in found.attachments.items() if sha256(data).hexdigest() == said.get(name)}
    return Recording(path, session, damage, topics, _texts(found), attached)


def _read(stream: Any, found: _Found) -> str:
    """Read record by record. Returns how it ended early."""
    import zstandard
    from mcap.exceptions import EndOfFile, McapError
    from mcap.records import Attachment, Channel, Message, Metadata
    from mcap.stream_reader import StreamReader

    reader = StreamReader(stream, validate_crcs=True, record_size_limit=LARGEST)
    try:
        for record in reader.records:
            if isinstance(record, Message):
                found.data.setdefault(record.channel_id, []).append(record.data)
                found.cycles.setdefault(record.channel_id, []).append(record.sequence)
            elif isinstance(record, Channel):
                found.channels[record.id] = record
            elif isinstance(record, Metadata) and record.name == METADATA:
                found.metadata = record.metadata
            elif isinstance(record, Attachment):
                found.attachments[record.name] = record.data
    except EndOfFile:
        return "it ends early: the run was cut off, or the file is not whole"
    except (McapError, ValueError, struct.error, zstandard.ZstdError, RuntimeError, MemoryError) as error:
        return f"it ends early, in a damaged record ({error})"
    return ""


def _session(metadata: dict[str, str] | None, where: str, damage: str) -> Session:
    allowed = "a file that `retarget run --record` wrote"
    if metadata is None:
        raise InputError(
            "no recording of ours", where=where, found=damage or "no metadata of retarget", allowed=allowed
        )
    told = metadata.get("format", "")
    if told != str(FORMAT):
        raise InputError(
            "a recording of another version",
            where=where,
            found=f"format {told[:20] or 'not told'}",
            allowed=f"format {FORMAT}",
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


def _topics(found: _Found, where: str) -> list[tuple[str, TopicRows]]:
    """All topics that have a layout."""
    made = []
    for number, channel in found.channels.items():
        told = channel.metadata.get("layout")
        if told is None:
            continue
        try:
            layout = layout_from(told)
            rows = np.frombuffer(b"".join(found.data.get(number, [])), dtype=layout)
        except (ValueError, TypeError, KeyError, SyntaxError) as error:
            raise InputError("a topic is damaged", where=where, found=f"{channel.topic}: {error}") from None
        cycles = np.array(found.cycles.get(number, []), dtype=np.int64)
        if len(rows) != len(cycles):
            raise InputError("a topic is damaged", where=where, found=f"{channel.topic}: messages of another size")
        made.append((str(channel.topic), TopicRows(cycles, rows)))
    return made


def _texts(found: _Found) -> dict[tuple[int, str], str]:
    """Texts of the log, by cycle and who said them; the first of each."""
    texts: dict[tuple[int, str], str] = {}
    for number, channel in found.channels.items():
        if channel.metadata.get("layout") is None:
            for cycle, data in zip(found.cycles.get(number, []), found.data.get(number, []), strict=True):
                who, text = _log_of(data)
                texts.setdefault((cycle, who), text)
    return texts


def _log_of(data: bytes) -> tuple[str, str]:
    """Name and text of an rcl_interfaces/msg/Log in CDR; empty where it is damaged."""
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
