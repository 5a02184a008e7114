"""The clips of a batch: files, folders, patterns and lists become sorted clips with distinct outputs."""

import glob
import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from retarget.batch.clip import BatchClip
from retarget.errors import InputError, UsageError
from retarget.sources.open import SUFFIXES

LISTS = (".txt", ".lst", ".list")
"""Suffixes of text files with a path per line."""
MAX_LIST_BYTES = 256 * 2**20
MAX_CLIPS = 1_000_000
"""Largest list, bytes, and most clips of a batch: more is a mistake."""
TABLE = re.compile(r"index(-\d+-of-\d+)?\.parquet", re.IGNORECASE)
"""Names of tables in `out`, which no output may have."""


def find_clips(
    inputs: Sequence[str], *, out: Path, ending: str, sources: Mapping[str, str] | None = None
) -> tuple[BatchClip, ...]:
    """The clips of files, folders, patterns (also `**`) and lists, sorted by output, each source once.

    A folder is searched recursively, without hidden files and `out`. A missing path in a list is a clip that fails. An
    output has the path of its source below the folder, pattern or list, with `ending`, and a hash if it would not be
    unique or would be a table. sources: by output, from the index: a source keeps its output. Raises UsageError if an
    input has no clip, or an output would replace a source, InputError for an unreadable list.
    """
    real_out = Path(os.path.realpath(out))
    below = dict[str, str]()  # source -> path of the output without its ending
    for text in inputs:
        found = False
        for source, base in _sources(text, real_out):
            inside_base = source.relative_to(base) if source.is_relative_to(base) else Path(source.name)
            below.setdefault(str(source), inside_base.with_suffix("").as_posix())
            found = True
        if not found:
            suffixes = ", ".join(f".{suffix}" for suffix in SUFFIXES)
            inside = Path(os.path.realpath(text)).is_relative_to(real_out)
            step = "Give another --out: files in it are no input" if inside else ""
            raise UsageError(
                "no motion file here", where="INPUT", found=text[:200], allowed=f"files {suffixes}", next_step=step
            )
        if len(below) > MAX_CLIPS:
            raise UsageError(
                "too many clips", where="INPUT", allowed=f"up to {MAX_CLIPS}", next_step="Use several --out"
            )
    clips = [BatchClip(path, output) for path, output in _outputs(below, ending, sources or {})]
    _refuse_sources(clips, out)
    return tuple(sorted(clips, key=lambda clip: clip.output))


def _outputs(below: Mapping[str, str], ending: str, sources: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield each source of `below` with its output. sources: by existing output, which they keep."""
    taken = {output.casefold(): source for output, source in sources.items() if source in below}
    new = list[tuple[str, str, str]]()
    for path, name in below.items():
        plain, marked = f"{name}{ending}", f"{name}-{hashlib.sha256(os.fsencode(path)).hexdigest()[:8]}{ending}"
        if own := next((output for output in (plain, marked) if sources.get(output) == path), ""):
            yield path, own
        else:
            new.append((path, plain, marked))
    shared = Counter(plain.casefold() for _, plain, _ in new)
    for path, plain, marked in new:
        is_taken = shared[plain.casefold()] > 1 or plain.casefold() in taken or TABLE.fullmatch(plain)
        yield path, marked if is_taken else plain


def _refuse_sources(clips: Sequence[BatchClip], out: Path) -> None:
    """Raise UsageError if an output is a source, or a folder that contains one. Links are followed."""
    real_folder, place = cache(os.path.realpath), out.absolute()

    def real(path: str) -> str:
        folder, _, name = path.rpartition("/")
        linked = os.path.islink(path)  # noqa: PTH114 - of a million paths
        return os.path.realpath(path) if linked else f"{real_folder(folder or '/').rstrip('/')}/{name}"

    sources = {real(clip.source) for clip in clips}
    folders = {Path(folder) for folder in {source.rpartition("/")[0] for source in sources}}
    above = {str(one) for folder in folders for one in (folder, *folder.parents)}
    if replaced := sorted({real(f"{place}/{clip.output}") for clip in clips} & (sources | above)):
        found, step = replaced[0][:200], "Give another --out"
        raise UsageError("an output would replace a source", where="--out", found=found, next_step=step)


def _sources(text: str, out: Path) -> Iterator[tuple[Path, Path]]:
    """Yield the sources of an input, absolute and without `..`, each with the base folder of its output."""
    path = _absolute(text)
    if path.is_dir():
        yield from ((found, path) for found in _in_folder(path, out))
    elif path.is_file() and path.suffix.lower() in LISTS:
        yield from ((_absolute(path.parent / line), path.parent) for line in _lines(path))
    elif path.is_file():
        yield path, path.parent
    elif glob.has_magic(text):
        parts = Path(text).parts
        fixed = next(number for number, part in enumerate(parts) if glob.has_magic(part))
        base = _absolute(Path(*parts[:fixed]))
        for match in sorted(glob.glob(text, recursive=True)):  # noqa: PTH207 - Path.glob takes no absolute pattern
            found = _absolute(match)
            if found.is_dir():
                if "**" not in parts:  # else its files match by themselves
                    yield from ((inside, base) for inside in _in_folder(found, out))
            elif not Path(os.path.realpath(found.parent)).is_relative_to(out) and found.suffix.lower() != ".asf":
                yield found, base
    else:
        raise UsageError("no such file or folder", where="INPUT", found=text[:200], next_step="Check the path")


def _absolute(path: str | Path) -> Path:
    return Path(os.path.abspath(path))  # noqa: PTH100 - removes `..` without following links


def _in_folder(folder: Path, out: Path) -> Iterator[Path]:
    suffixes = {f".{suffix}" for suffix in SUFFIXES}
    for place, folders, files in os.walk(folder):
        if os.path.realpath(place) == str(out):
            folders.clear()
            continue
        folders[:] = sorted(name for name in folders if name[0] != ".")
        yield from (
            Path(place, name) for name in sorted(files) if name[0] != "." and Path(name).suffix.lower() in suffixes
        )


def _lines(path: Path) -> list[str]:
    try:
        if path.stat().st_size > MAX_LIST_BYTES:
            found = f"{path.stat().st_size} bytes"
            raise InputError("list too large", where=str(path), found=found, allowed=f"up to {MAX_LIST_BYTES}")
        text = path.read_bytes().decode(errors="surrogateescape")
    except OSError as error:
        raise InputError("cannot read the list", where=str(path), found=error.strerror or error) from error
    if "\0" in text:
        raise InputError("this is no list of paths", where=str(path), found="a NUL byte", allowed="a path a line")
    lines = (line.strip() for line in text.splitlines())
    return [line for line in lines if line and not line.startswith("#")]


MAX_SHARDS = 100_000
"""Most shards, more than any array of jobs has."""


@dataclass(frozen=True)
class Shard:
    """Every `count`-th clip of the sorted list, from clip `number` on (1 to `count`), for an independent job."""

    number: int
    count: int

    @classmethod
    def parsed(cls, text: str) -> "Shard":
        """Parse `i/N`. Raises UsageError."""
        number, _, count = text.partition("/")
        if number.isascii() and count.isascii() and number.isdigit() and count.isdigit():
            shard = cls(int(number[:9]), int(count[:9]))
            if 1 <= shard.number <= shard.count <= MAX_SHARDS:
                return shard
        allowed = f"i/N, i from 1 to N, N up to {MAX_SHARDS}"
        raise UsageError("no such shard", where="--shard", found=text[:80], allowed=allowed)

    def of(self, clips: Sequence[BatchClip]) -> Sequence[BatchClip]:
        """Return its clips."""
        return clips[self.number - 1 :: self.count]
