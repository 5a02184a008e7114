"""Two outcomes of one run, held against each other to the bit."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.golden.play import Arrays, Outcome

TIMINGS = {
    "frames_per_s": "wall clock: how fast this machine computed",
    "solve_us": "CPU time of both stages",
    "reconstruct_us": "CPU time of the human stage",
    "retarget_us": "CPU time of the robot stage",
    "bus.cycle_ms": "wall clock of a tick's look at the servos",
    "physics.realtime_factor": "wall clock of the simulation",
    "latency_ms": "it counts what the stages took to compute",
}
"""Keys of a report that are not compared, and why: they measure the machine, not the robot."""
MESSAGES = {
    "notes": "texts for the user",
    "stop.reason": "text for the user",
    "live.refused": "texts for the user, one of each sender",
    "physics.heat_model": "text for the user",
    "physics.how": "text for the user",
    "physics.toppled": "text for the user",
}
"""Keys of a report that hold wording; only whether there is one is compared."""
COUNTED_MESSAGES = {"live.dropped": "counts by a text for the user"}
"""Keys whose own keys are wording; the counts are compared, in order of size."""
Floats = np.ndarray[Any, Any]


@dataclass(frozen=True)
class Difference:
    """what: array, report key, or part of the wire. first: tick of the first one, where there are ticks."""

    what: str
    text: str
    first: int | None = None


def differences(ours: Outcome, theirs: Outcome) -> list[Difference]:
    """Everything that differs: exit code and wire, then arrays, the earliest first, then the report."""
    problems = [
        Difference("run", f"{side}: {one.problem}") for side, one in (("here", ours), ("there", theirs)) if one.problem
    ]
    if problems:
        return problems
    found = [] if ours.code == theirs.code else [Difference("exit code", f"{ours.code} here, {theirs.code} there")]
    found += _array_differences(ours.arrays, theirs.arrays)
    wire = wire_difference(ours.wire, theirs.wire)
    found += [] if wire is None else [wire]
    found += _report_differences(compared_report(ours.report), compared_report(theirs.report))
    return sorted(found, key=lambda one: (one.what.startswith("report "), -1 if one.first is None else one.first))


def _array_differences(ours: Arrays, theirs: Arrays) -> list[Difference]:
    found = [array_difference(name, ours[name], theirs[name]) for name in ours if name in theirs]
    return [*_only_in_one(ours, theirs), *(one for one in found if one is not None)]


def _only_in_one(ours: Mapping[str, Any], theirs: Mapping[str, Any], what: str = "") -> list[Difference]:
    """What one version alone has."""
    there = [Difference(what + name, "only there") for name in theirs if name not in ours]
    return [*there, *(Difference(what + name, "only here") for name in ours if name not in theirs)]


def array_difference(name: str, ours: Floats, theirs: Floats) -> Difference | None:
    """The first tick that differs in two arrays (T, ...), and the largest difference of all; None for the same bits. Of
    texts only whether they are the same."""
    if ours.dtype != theirs.dtype and (ours.dtype.kind, theirs.dtype.kind) != ("U", "U"):
        return Difference(name, f"{ours.dtype} here, {theirs.dtype} there")
    if ours.ndim != theirs.ndim or ours.shape[1:] != theirs.shape[1:]:
        return Difference(name, f"shape {ours.shape} here, {theirs.shape} there")
    if ours.ndim == 0:
        same = str(ours) == str(theirs) if ours.dtype.kind == "U" else ours.tobytes() == theirs.tobytes()
        return (
            None
            if same
            else Difference(name, _texts(ours, theirs) if ours.dtype.kind == "U" else f"{ours} here, {theirs} there")
        )
    rows = min(len(ours), len(theirs))
    differ = np.flatnonzero(_rows_differ(ours[:rows], theirs[:rows]))
    if differ.size:
        first = int(differ[0])
        text = f"{differ.size} of {rows} rows, {_amount(ours[:rows], theirs[:rows])}"
        return Difference(name, text + _lengths(ours, theirs), first)
    return None if len(ours) == len(theirs) else Difference(name, f"the same so far{_lengths(ours, theirs)}", rows)


def _lengths(ours: Floats, theirs: Floats) -> str:
    return "" if len(ours) == len(theirs) else f"; {len(ours)} rows here, {len(theirs)} there"


def _texts(ours: Floats, theirs: Floats) -> str:
    """Where two texts part."""
    a, b = str(ours), str(theirs)
    at = next((place for place, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
    return f"{a[at : at + 40]!r} here, {b[at : at + 40]!r} there, from character {at} on"


def _rows_differ(ours: Floats, theirs: Floats) -> Floats:
    """Mask (T,) of rows that are not the same bits: -0 is not 0, and a NaN is the same NaN."""
    unlike = np.asarray(ours != theirs if ours.dtype.kind == "U" else _bits(ours) != _bits(theirs))
    return np.asarray(unlike.any(axis=tuple(range(1, unlike.ndim))))


def _bits(values: Floats) -> Floats:
    """Every number as its bytes, along one more axis."""
    return np.ascontiguousarray(values)[..., None].view(np.uint8)


def _amount(ours: Floats, theirs: Floats) -> str:
    if ours.dtype.kind == "U":
        return "other texts"
    if ours.dtype.kind == "b":
        return f"{int((ours != theirs).sum())} values"
    apart = np.abs(ours.astype(np.float64) - theirs.astype(np.float64))
    if np.isnan(ours.astype(np.float64)).tolist() != np.isnan(theirs.astype(np.float64)).tolist():
        return f"some not a number in one alone, others by at most {np.nanmax(apart, initial=0.0):.3g}"
    return f"by at most {np.nanmax(apart, initial=0.0):.3g}"


def wire_difference(ours: Arrays, theirs: Arrays) -> Difference | None:
    """None for the same messages at the same times; else the first one that is another."""
    if not ours and not theirs:
        return None
    count = min(len(ours["size"]), len(theirs["size"]))
    heads = np.any(
        [_rows_differ(ours[key][:count], theirs[key][:count]) for key in ("time", "port", "direction", "size")], axis=0
    )
    head = int(np.argmax(heads)) if heads.any() else count
    size = min(len(ours["data"]), len(theirs["data"]))
    bytes_differ = np.flatnonzero(ours["data"][:size] != theirs["data"][:size])
    ends = np.cumsum(ours["size"])
    place = int(np.searchsorted(ends, bytes_differ[0], side="right")) if bytes_differ.size else count
    first = min(head, place)
    if first == count:
        if len(ours["size"]) == len(theirs["size"]):
            return None
        text = f"the same for {count} messages; {len(ours['size'])} here, {len(theirs['size'])} there"
        return Difference("wire", text)
    return Difference(
        "wire", f"message {first}: {_message(ours, theirs, first)} here, {_message(theirs, ours, first)} there"
    )


def _message(wire: Arrays, other: Arrays, place: int) -> str:
    """One message from the byte on that is another one in `other`, and when it was where."""
    data, beside = _data(wire, place), _data(other, place)
    at = next((byte for byte, (a, b) in enumerate(zip(data, beside, strict=False)) if a != b), 0)
    shown = f"{data[at : at + 12].hex(' ')}{' ...' if len(data) > at + 12 else ''} from byte {at} of {len(data)} on,"
    way = "from" if wire["direction"][place] else "to"
    return f"{shown} {way} the servos of port {wire['port'][place]} at {wire['time'][place]:.6f} s"


def _data(wire: Arrays, place: int) -> bytes:
    end = int(wire["size"][: place + 1].sum())
    data: bytes = wire["data"][end - int(wire["size"][place]) : end].tobytes()
    return data


def compared_report(report: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Keys with the path to them, and their values, without timings and wording."""
    flat: dict[str, Any] = {}
    for key, value in report.items():
        path = f"{above}{key}"
        if path in TIMINGS:
            continue
        if path in MESSAGES:
            flat[path] = bool(value)
        elif path in COUNTED_MESSAGES and value is not None:
            flat[path] = sorted(value.values())
        elif isinstance(value, dict) and value:
            flat |= compared_report(value, f"{path}.")
        else:
            flat[path] = value
    return flat


def _report_differences(ours: dict[str, Any], theirs: dict[str, Any]) -> list[Difference]:
    return _only_in_one(ours, theirs, "report ") + [
        Difference(f"report {path}", f"{ours[path]} here, {theirs[path]} there")
        for path in ours
        if path in theirs and ours[path] != theirs[path]
    ]
