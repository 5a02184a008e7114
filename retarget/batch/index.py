"""The index of a batch: a line of JSON for each finished clip, written by the driver alone, and a table at the end.

Each shard has its own file. Together they list the finished clips for any later command, whatever its shards are.
"""

import fcntl
import json
import os
import re
import shutil
import typing
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath
from typing import Any

from retarget.batch.clip import BatchClip, BatchSettings, ClipRow, ClipStatus, places_of, source_hash, source_state
from retarget.batch.inputs import Shard
from retarget.errors import InputError, UsageError
from retarget.recording.exports.tables import arrow
from retarget.schema.files import make_folder, write_atomic, write_stream

ALL, ALL_BEGUN = "index*.jsonl", "index*.begun"
BLOCK = 500
"""Rows of the table in memory at once."""


@dataclass(frozen=True, slots=True)
class KnownClip:
    """The fields of a `ClipRow` that are kept in memory."""

    source: str
    status: ClipStatus
    source_hash: str
    source_bytes: int
    source_time_ns: int
    settings_hash: str


class BatchIndex:
    """The index in the folder of outputs, open for one driver: a context manager."""

    def __init__(self, folder: Path, shard: Shard | None = None) -> None:
        """Open and lock the index. Raises UsageError if it is not writable, or another driver writes it."""
        name = "index" if shard is None else f"index-{shard.number}-of-{shard.count}"
        self.folder, self.path = folder, folder / f"{name}.jsonl"
        self._whole = shard is None
        self._begun_path = self.path.with_suffix(".begun")
        make_folder(folder, option="--out")
        try:
            self._file = self.path.open("ab+")
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _cut_half_line(self._file, self.path)
        except BlockingIOError as error:
            step = "Wait for it, or give another --out or --shard"
            raise UsageError(
                "another batch writes this", where="--out", found=str(self.path), next_step=step
            ) from error
        except OSError as error:
            raise UsageError("cannot write here", where="--out", found=f"{self.path}: {error.strerror}") from error
        self._begun = _read_begun(self._begun_path)

    def __enter__(self) -> "BatchIndex":
        return self

    def __exit__(self, *_: object) -> None:
        if not self._begun:
            self._begun_path.unlink(missing_ok=True)
        self._file.close()

    def known(self) -> dict[str, KnownClip]:
        """The latest row of each clip in all files of the folder, by output. Raises InputError."""
        names, found = [field.name for field in fields(KnownClip)], {}
        one_text = dict[str, str]()  # shares the hash of settings, which is the same in most rows
        for path in _files_of(self.folder):
            for row, _ in _rows(path):
                values = {name: row[name] for name in names}
                values["status"] = ClipStatus(values["status"])
                values["settings_hash"] = one_text.setdefault(values["settings_hash"], values["settings_hash"])
                found[row["output"]] = KnownClip(**values)
        return found

    def begin(self, clips: Sequence[BatchClip], settings: BatchSettings, known: dict[str, KnownClip]) -> None:
        """Reserve the outputs of these clips, in a file beside the index until they have rows, so that a killed driver
        can go on. Raises UsageError, and reserves none, if an existing file was not made of the same source."""
        begun, table = dict[str, str](), self.path.with_suffix(".parquet")
        strange = [table] if not known and os.path.lexists(table) else []
        for path in self.folder.glob(ALL_BEGUN):
            begun |= _read_begun(path)
        for clip in clips:
            of = known[clip.output].source if clip.output in known else None
            if clip.source not in (of, begun.get(clip.output)):
                strange += [place for place in places_of(clip, settings) if os.path.lexists(place)]
        if strange:
            found = f"{strange[0]}{f', and {len(strange) - 1} more' if len(strange) > 1 else ''}"
            step = f"Give another --out, or move {'them' if len(strange) > 1 else 'it'} away"
            raise UsageError(
                "an output would replace what was not made of its source", where="--out", found=found, next_step=step
            )
        self._begun = {output: source for output, source in self._begun.items() if output not in known}
        self._begun |= {clip.output: clip.source for clip in clips}
        write_atomic(self._begun_path, json.dumps(self._begun).encode(), option="--out")

    def add(self, row: ClipRow) -> None:
        """Add a row, and flush it."""
        self._file.write(row.as_json().encode() + b"\n")
        self._file.flush()
        self._begun.pop(row.output, None)

    def write_table(self) -> Path:
        """Write the latest row of each clip as Parquet beside the index, sorted by output, and return its path. Without
        a shard it has all files of the folder. Raises UsageError without pyarrow."""
        pa = arrow()
        files = _files_of(self.folder) if self._whole else [self.path]
        latest = {row["output"]: (number, at) for number, path in enumerate(files) for row, at in _rows(path)}
        arrow_types = {float: "float64", int: "int64", bool: "bool_", str: "string", ClipStatus: "string"}
        columns = {name: (typing.get_args(kind) or (kind,))[0] for name, kind in typing.get_type_hints(ClipRow).items()}
        schema = pa.schema([pa.field(name, getattr(pa, arrow_types[kind])()) for name, kind in columns.items()])
        place = self.path.with_suffix(".parquet")

        def write(stream: typing.IO[bytes]) -> None:
            opened = [path.open("rb") for path in files]
            try:
                with pa.parquet.ParquetWriter(stream, schema) as table:
                    places = [latest[output] for output in sorted(latest)]
                    for first in range(0, len(places), BLOCK):
                        rows = [_line_at(opened[number], at) for number, at in places[first : first + BLOCK]]
                        table.write_table(pa.Table.from_pylist(rows, schema=schema))
            finally:
                for file in opened:
                    file.close()

        write_stream(place, write, option="--out")
        return place


def _files_of(folder: Path) -> list[Path]:
    """The files of an index, the one that was written last at the end."""
    return sorted(folder.glob(ALL), key=lambda path: (path.stat().st_mtime_ns, path.name))


def sources_of(folder: Path) -> dict[str, str]:
    """The source of each output in the index of a folder, and of reserved ones. Raises InputError."""
    begun = [_read_begun(path) for path in folder.glob(ALL_BEGUN)]
    rows = {row["output"]: row["source"] for path in _files_of(folder) for row, _ in _rows(path)}
    return {output: source for one in begun for output, source in one.items()} | rows


def _read_begun(path: Path) -> dict[str, str]:
    try:
        begun = json.loads(path.read_bytes())
    except FileNotFoundError:  # another shard has ended
        return {}
    except ValueError:
        begun = None
    if not isinstance(begun, dict):
        step = "Remove it, and the outputs that have no row in the index"
        raise InputError("no clips that were begun", where=str(path), next_step=step)
    return begun


def _cut_half_line(file: typing.BinaryIO, path: Path) -> None:
    """Cut an incomplete last line, which a killed driver left. Raises InputError if it is not the start of a row."""
    end, block = file.seek(0, os.SEEK_END), 1 << 16
    while end > 0:
        begin = max(end - block, 0)
        file.seek(begin)
        found = file.read(end - begin).rfind(b"\n")
        if found >= 0:
            end = begin + found + 1
            break
        end = begin
    file.seek(end)
    if not BEGINS.startswith(half := file.read(len(BEGINS))):
        raise InputError("no row of an index", where=str(path), found=half, next_step="Give another --out")
    file.truncate(end)


BEGINS = b'{"source": "'
"""First bytes of each row."""
NEEDED = frozenset({"output", *(field.name for field in fields(KnownClip))})
STATUSES = frozenset(ClipStatus)


def _rows(path: Path) -> Iterator[tuple[dict[str, Any], int]]:
    """Yield the rows of an index, each with its offset in the file, without an incomplete last line. Raises
    InputError."""
    with path.open("rb") as file:
        at = 0
        for number, line in enumerate(file, 1):
            if not line.endswith(b"\n"):
                return
            try:
                row = json.loads(line)
            except ValueError:
                row = None
            if not isinstance(row, dict) or not row.keys() >= NEEDED or row["status"] not in STATUSES:
                step = "Remove the line: its clip is then run again"
                raise InputError("no row of an index", where=f"{path}:{number}", found=line[:80], next_step=step)
            yield row, at
            at += len(line)


def _line_at(file: typing.BinaryIO, at: int) -> dict[str, Any]:
    file.seek(at)
    row: dict[str, Any] = json.loads(file.readline())
    # JSON can hold a name that is not UTF-8, but Parquet cannot.
    return {
        name: value.encode(errors="backslashreplace").decode() if isinstance(value, str) else value
        for name, value in row.items()
    }


# Remaining clips, and leftovers of killed processes.


@dataclass(frozen=True)
class Todo:
    """Remaining clips of a batch. done, failed: numbers of the others."""

    clips: tuple[BatchClip, ...]
    done: int
    failed: int


def still_to_do(
    clips: Sequence[BatchClip], settings: BatchSettings, known: dict[str, KnownClip], *, retry_failed: bool
) -> Todo:
    """The clips without an output of the same source and settings. A failed clip is among them with
    `retry_failed`, or if source or settings have changed.

    A source with the same path, size and modification time is unchanged; else its hash decides.
    """
    reading, todo, done, failed = dict(settings.reading), [], 0, 0
    for clip in clips:
        then = known.get(clip.output)
        if then is None or then.settings_hash != settings.hash or not _is_same(clip, then, reading):
            todo.append(clip)
        elif then.status.has_output:
            if (settings.out / clip.output).exists():
                done += 1
            else:
                todo.append(clip)
        elif retry_failed:
            todo.append(clip)
        else:
            failed += 1
    return Todo(tuple(todo), done, failed)


def _is_same(clip: BatchClip, then: KnownClip, reading: dict[str, Any]) -> bool:
    source, state = Path(clip.source), source_state(Path(clip.source), reading)
    if (clip.source, state.bytes, state.time_ns) == (then.source, then.source_bytes, then.source_time_ns):
        return True
    return source_hash(source, reading) == then.source_hash


PART = re.compile(r"\.(.{1,50})\.\w{8}(\.part)?")
"""Name of a file or folder before it is renamed (`retarget.schema.files`)."""


def remove_parts(out: Path, clips: Iterable[BatchClip]) -> None:
    """Remove partly written files of these clips, which killed processes left."""
    begun: dict[str, set[str]] = {}
    for clip in clips:
        output = PurePosixPath(clip.output)
        begun.setdefault(str(output.parent), set()).add(output.name[:50])
    for folder, names in begun.items():
        with suppress(FileNotFoundError):
            for entry in (out / folder).iterdir():
                if (part := PART.fullmatch(entry.name)) and part[1] in names:
                    if entry.is_dir():
                        shutil.rmtree(entry, ignore_errors=True)
                    else:
                        entry.unlink(missing_ok=True)
