"""A recording as a file: MCAP, in chunks that are whole on the disk as soon as they are flushed."""

import os
from collections.abc import Iterable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import IO, Any, cast

from retarget.errors import UsageError
from retarget.outputs import check_place, refuse_existing
from retarget.recording.schemas import SCHEMAS
from retarget.recording.session import ConfigFile, Session
from retarget.recording.topics import EVENTS, Topic

__all__ = ["METADATA", "RecordingFile", "check_target", "require_mcap"]

OPTION = "--record"
METADATA = "retarget"
"""Name of the metadata that hold the session."""
PROFILE = "ros2"
CHUNK = 2**30
"""Bytes that never fill: chunks end when they are flushed."""
LARGEST = 4 * 2**20
"""Bytes of the largest config file that is attached."""


def require_mcap(where: str) -> None:
    """Raise UsageError where the library is not installed."""
    try:
        import mcap.writer  # noqa: F401
    except ImportError:
        raise UsageError(
            "recordings need the library mcap, which is not installed",
            where=where,
            next_step="Install it: pip install 'retarget[record]'",
        ) from None


def check_target(path: Path) -> None:
    """Raise UsageError unless a recording can be written at `path`; nothing is left behind."""
    require_mcap(OPTION)
    if path.suffix.lower() != ".mcap":
        raise UsageError("a recording is MCAP", where=OPTION, found=str(path)[:200], allowed="FILE.mcap")
    check_place(path, option=OPTION)


class RecordingFile:
    """A new recording. size: bytes so far."""

    def __init__(self, path: Path, session: Session, configs: Iterable[tuple[ConfigFile, bytes]]) -> None:
        """Write what is known before the first cycle. Raises UsageError if there is a file, or none can be written."""
        from mcap.writer import CompressionType, Writer

        self.path = path
        refuse_existing(path, option=OPTION)
        try:
            self._stream = _Direct(path)
        except OSError as error:
            raise UsageError(f"cannot write here ({error.strerror})", where=OPTION, found=str(path)) from error
        self._writer = Writer(cast(IO[Any], self._stream), chunk_size=CHUNK, compression=CompressionType.ZSTD)
        try:
            self._writer.start(profile=PROFILE)
            text = session.model_dump_json()
            told = {"format": str(session.format), "session": text, "sha256": sha256(text.encode()).hexdigest()}
            self._writer.add_metadata(METADATA, told)
            for config, content in configs:
                if len(content) <= LARGEST:
                    self._writer.add_attachment(session.begun_ns, session.begun_ns, config.name, "text/plain", content)
        except OSError as error:
            self.discard()
            raise UsageError(f"cannot write here ({error.strerror})", where=OPTION, found=str(path)) from error
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    @property
    def size(self) -> int:
        """Bytes so far."""
        return self._stream.tell()

    def announce(self, topics: Sequence[Topic]) -> None:
        """Say which topics there will be. Of each the metadata tell `layout`, a numpy dtype, and `names`."""
        for topic in topics:
            metadata = {"layout": topic.layout.told, "names": " ".join(_one_word(name) for name in topic.names)}
            self._register(topic.name, topic.schema, metadata)
        self._register(EVENTS, "rcl_interfaces/msg/Log", {})

    def add(self, topic: str, *, index: int, stamp_ns: int, data: bytes) -> None:
        """Take a message of a topic. index: of its cycle."""
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns, index)

    def flush(self) -> None:
        """Hand everything to the system: a crash of this process does not lose it. Raises OSError."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the rest and the index, and close. Raises OSError."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self.close()

    def close(self) -> None:
        """Close, whatever is missing. Twice does no harm."""
        self._stream.close()

    def discard(self) -> None:
        """Close and remove it: nothing was recorded."""
        self.close()
        self.path.unlink(missing_ok=True)

    def _register(self, topic: str, schema: str, metadata: dict[str, str]) -> None:
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(schema, "ros2msg", SCHEMAS[schema].encode())
        self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[schema], metadata)


def _one_word(name: str) -> str:
    """A name as the metadata have it, in which blanks part one from the next."""
    return "_".join(name.split()) or "_"


class _Direct:
    """A new file without a buffer: what is written is the system's, or an OSError."""

    def __init__(self, path: Path) -> None:
        self._file: IO[bytes] = path.open("xb", buffering=0)
        self._size = 0

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            count = self._file.write(view)
            if not count:
                raise OSError(5, os.strerror(5))
            self._size += count
            view = view[count:]
        return len(data)

    def tell(self) -> int:
        return self._size

    def flush(self) -> None:
        """There is nothing to flush."""

    def close(self) -> None:
        self._file.close()
