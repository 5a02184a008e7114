"""Motion files as bytes, lines and numbers, and the checks that all formats share."""

import math
import re
import stat
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from retarget.errors import InputError
from retarget.types import BoolArray, FloatArray

MAX_FILE_BYTES = 128 * 2**20
"""Largest motion file, bytes: 128 MiB are about 20 minutes of AMC at 120 Hz."""
HEAD_BYTES = 4096
"""Bytes of the beginning of a file, by which its format is recognised."""
MAX_FRAMES = 200_000
"""Most frames of a recording: 28 minutes at 120 Hz."""
MIN_RATE_HZ, MAX_RATE_HZ = 0.1, 10_000.0
"""Rates of a recording, Hz. No motion capture has another one, so anything else is a wrong unit."""
MAX_VALUE = 1e9
"""Largest magnitude of a number: no coordinate or angle is larger, and its square stays finite."""


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options of the user for one motion file; None if not given.

    unit: of length, a name of `UNITS`. rate: Hz. stature: of the performer, m; it scales a body. up (3,): the file's up
    axis. skeleton: the ASF of an AMC. markers: the user's marker table. performer_root: the ROOT to read of a BVH.
    """

    unit: str | None = None
    rate: float | None = None
    stature: float | None = None
    up: FloatArray | None = None
    skeleton: Path | None = None
    markers: Path | None = None
    performer_root: str | None = None


SAVED_RUN = "`retarget view`, `judge` and `export` read it"
"""A next step."""
AS_WRITTEN = ReadOptions()


def read_bytes(path: Path, count: int = MAX_FILE_BYTES + 1, *, missing: str = "Check the path") -> bytes:
    """The first bytes of a motion file, at most `count`. Raises InputError if it is missing, no plain file, empty, too
    large or unreadable. missing: the next step if there is no such file."""
    where = str(path)
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or pipe"
            raise InputError("not a motion file", where=where, found=kind, next_step="Give the file itself")
        if status.st_size > MAX_FILE_BYTES:
            raise InputError(
                "motion file too large",
                where=where,
                found=f"{status.st_size / 2**20:.0f} MiB",
                allowed=f"up to {MAX_FILE_BYTES // 2**20} MiB",
                next_step="Cut the recording into parts",
            )
        with path.open("rb") as file:
            content = file.read(min(count, status.st_size + 1))  # allocates no more than the file can hold
    except FileNotFoundError:
        raise InputError("no such motion file", where=where, next_step=missing) from None
    except (OSError, ValueError) as error:  # ValueError: a path with a NUL character
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError("cannot read the motion file", where=where, found=reason) from None
    if not content:
        raise InputError("empty motion file", where=where, next_step="Export or download it again")
    return content


def read_lines(path: Path) -> list[str]:
    """Lines of a text file with any line ends. Raises InputError as `read_bytes` does, and for binary content."""
    content = read_bytes(path)
    if b"\0" in content:
        line = content[: content.index(b"\0")].count(b"\n") + 1
        raise InputError(
            "not a text file",
            where=f"{path}:{line}",
            found="a NUL byte",
            allowed="ASF, AMC or BVH text",
            next_step="Unpack it if it is packed (zip, gz); else export the recording as text",
        )
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")  # older exporters
    if not text.strip():
        raise InputError("empty motion file", where=str(path), next_step="Export or download it again")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def numbers(tokens: Sequence[str], where: str) -> list[float]:
    """Finite numbers with a decimal point or comma, at most MAX_VALUE. Raises InputError that names the bad one."""
    try:
        values = list(map(float, tokens))
        # NaN or infinity would make the sum fail this test, so one comparison checks all.
        if sum(map(abs, values)) <= MAX_VALUE:
            return values
    except ValueError:
        pass
    return [_number(token, where) for token in tokens]


_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)


def _number(token: str, where: str) -> float:
    step = "Correct it, or export the recording again with its gaps filled"
    try:
        value = float(token.replace(",", ".") if _DECIMAL_COMMA.fullmatch(token) else token)
    except ValueError:
        value = math.nan
        step = "Correct it, or export the file again with decimal points and blanks between numbers"
    if abs(value) <= MAX_VALUE:
        return value
    allowed = "a finite number up to 1e9"
    raise InputError("not a usable number", where=where, found=repr(token[:40]), allowed=allowed, next_step=step)


def cut_short(error: InputError, rest: Sequence[str]) -> InputError:
    """The error of a line; if no content follows in `rest`, the next step says that the file seems cut short."""
    if any(line.partition("#")[0].strip() for line in rest):
        return error
    step = "The file ends here and seems cut short: get it again"
    return InputError.from_problems([replace(problem, next_step=step) for problem in error.problems])


COUNT_SHARE = 0.01
"""Share of the declared frames, and at least one frame, by which a file may differ: common exporters count one too
few."""


def frames_held(held: int, declared: int, where: str) -> tuple[str, ...]:
    """A note if a file holds a few frames more or fewer than it declares. Raises InputError for more."""
    if held == declared:
        return ()
    if abs(held - declared) <= max(1, int(COUNT_SHARE * declared)):
        return (f"the file declares {declared} frames and holds {held}: all of these are read",)
    fewer = held < declared
    raise InputError(
        f"{'fewer' if fewer else 'more'} frames than declared",
        where=where,
        found=held,
        allowed=f"{declared}, give or take one frame or {COUNT_SHARE:.0%}",
        next_step="The file is cut short: get it again" if fewer else "Correct the number of frames that it declares",
    )


def lost_notes(names: Sequence[str], valid: BoolArray) -> tuple[str, ...]:
    """A note for each sensor or joint that is lost in some frames; valid (T, k)."""
    counts = zip(names, (~valid).sum(axis=0).tolist(), strict=True)
    return tuple(f"{name} lost in {count} of {len(valid)} frames" for name, count in counts if count)


def no_frame_rate(where: str, *, allowed: str = "") -> InputError:
    """The error for a file without a frame rate. allowed: names of the field."""
    step = "Say the frames per second with --rate"
    return InputError("no frame rate in the file", where=where, allowed=allowed, next_step=step)


def assumed_rate(rate: float | None, usual: float) -> tuple[float, tuple[str, ...]]:
    """The user's rate, Hz, or else the usual one of the format, with a note. Raises InputError."""
    if rate is None:
        return usual, (f"frame rate not stated: taken as {usual:g} Hz (change it with --rate)",)
    return check_rate(rate, "--rate"), ()


def check_frame_count(count: int, where: str) -> None:
    """Raise InputError if a recording has no frame, or more than MAX_FRAMES."""
    if count < 1:
        raise InputError("no frame of motion", where=where, allowed=f"1 to {MAX_FRAMES} frames")
    if count > MAX_FRAMES:
        raise InputError(
            "too many frames",
            where=where,
            found=count,
            allowed=f"up to {MAX_FRAMES}",
            next_step="Cut the recording into parts",
        )


def check_rate(rate: float, where: str) -> float:
    """The frame rate, Hz, if it is possible. Raises InputError."""
    if not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
        allowed = f"{MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz"
        step = "" if where == "--rate" else "Say the frames per second with --rate"
        raise InputError("impossible frame rate", where=where, found=f"{rate:g} Hz", allowed=allowed, next_step=step)
    return rate
