"""Output files: places are checked before anything moves, and a file is written whole or not at all."""

import os
import shlex
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from retarget.errors import UsageError


def check_place(path: Path, *, option: str) -> None:
    """Raise UsageError unless a file can be written at `path`; nothing is left behind."""
    check_path(path, option=option)
    if path.is_dir():
        raise UsageError("this is a folder", where=option, found=str(path), next_step="Give the name of a file in it")
    if path.exists() and not path.is_file():
        raise UsageError("this is no regular file", where=option, found=str(path))
    if not path.parent.is_dir():
        step = f"Make it first: mkdir -p {shlex.quote(str(path.parent))}"
        raise UsageError("there is no such folder", where=option, found=str(path.parent), next_step=step)
    _try_folder(path.parent, option)


def check_folder(path: Path, *, option: str) -> None:
    """Raise UsageError unless `path` is a writable folder, or can become one; nothing is left behind."""
    check_path(path, option=option)
    if path.exists() and not path.is_dir():
        raise UsageError("this is a file, not a folder", where=option, found=str(path))
    existing = next(parent for parent in (path, *path.absolute().parents) if parent.exists())
    if not existing.is_dir():
        raise UsageError("part of this path is a file", where=option, found=str(existing))
    _try_folder(existing, option)


def refuse_existing(
    path: Path, *, option: str, step: str = "Give another name, or add --overwrite to replace it"
) -> None:
    """Raise UsageError if something is at `path`."""
    check_path(path, option=option)
    if path.is_symlink() or path.exists():
        raise UsageError("something is there already", where=option, found=str(path)[:200], next_step=step)


def remove(path: Path, *, option: str) -> None:
    """Remove a file before a growing one replaces it. Raises UsageError."""
    with _refused(path, option):
        path.unlink(missing_ok=True)


def make_folder(path: Path, *, option: str) -> None:
    """Make a folder, and those above it. Raises UsageError."""
    with _refused(path, option):
        path.mkdir(parents=True, exist_ok=True)


def write_atomic(path: Path, content: bytes, *, option: str) -> None:
    """Write a file, whole or not at all. Raises UsageError."""
    write_stream(path, lambda stream: stream.write(content), option=option)


def write_own(path: Path, content: bytes, *, option: str) -> None:
    """Write a user's file in its folder; the one before stays as `.previous.yaml`."""
    make_folder(path.parent, option=option)
    if path.is_file():
        write_atomic(previous_path(path), path.read_bytes(), option=option)
    write_atomic(path, content, option=option)


def previous_path(path: Path) -> Path:
    """Path of the replaced version of a user's file."""
    return path.with_suffix(".previous.yaml")


def write_stream(path: Path, write: Callable[[IO[bytes]], object], *, option: str) -> None:
    """Write a file, whole or not at all, by a function of a stream. Raises UsageError."""
    with _refused(path, option):
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:50]}.", suffix=".part")
        try:
            with os.fdopen(descriptor, "wb") as stream:
                write(stream)
                _sync(stream)
            Path(name).chmod(0o666 & ~umask())
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise


def write_folder(path: Path, contents: Mapping[str, bytes], *, option: str) -> None:
    """Write or replace a folder of files, by their paths in it. Any interrupt leaves the old folder or the new one.
    Raises UsageError."""
    make_folder(path.parent, option=option)
    with _refused(path, option):
        part = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name[:50]}.", suffix=".part"))
        new, old = part / "new", part / "old"
        try:
            for name, content in contents.items():
                (new / name).parent.mkdir(parents=True, exist_ok=True)
                with (new / name).open("wb") as stream:
                    stream.write(content)
                    _sync(stream)
            if os.path.lexists(path):
                path.replace(old)
            new.replace(path)
        finally:
            if os.path.lexists(old) and not os.path.lexists(path):
                old.replace(path)
            shutil.rmtree(part)  # not reached while the old one is still in it


def _sync(stream: IO[bytes]) -> None:
    stream.flush()
    os.fsync(stream.fileno())


def check_path(path: Path, *, option: str) -> None:
    """Raise UsageError for a path that the system cannot look up: too long, a zero byte, a locked folder."""
    try:
        with _refused(path, option), suppress(FileNotFoundError, NotADirectoryError):
            path.lstat()
    except ValueError as error:
        raise UsageError("this is no path", where=option, found=repr(str(path)[:200]), allowed=str(error)) from error


def _try_folder(folder: Path, option: str) -> None:
    with _refused(folder, option), tempfile.NamedTemporaryFile(dir=folder, prefix=".retarget."):
        pass


@contextmanager
def _refused(path: Path, option: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        found = f"{str(path)[:200]}: {error.strerror or error}"
        raise UsageError("cannot write here", where=option, found=found, next_step="Choose another place") from error


def umask() -> int:
    """The process's mask for new files, which can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
