"""The proposal as a part of a robot profile: `observers` and `ignore_pairs` in YAML, with comments that say why."""

import json
import re
from collections.abc import Iterable, Sequence

from retarget.fitting.box import Box
from retarget.fitting.capsule import Capsule
from retarget.fitting.geometry import Lone
from retarget.fitting.proposals import DIGITS, Proposal, Zones
from retarget.fitting.verdicts import Verdict

__all__ = ["MAX_PAIRS", "fragment"]

MAX_PAIRS = 500
"""A profile ignores no more pairs."""
WIDTH = 116
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")
_RESERVED = {"true", "false", "null", "yes", "no", "on", "off", "y", "n"}


def fragment(
    head: Iterable[str],
    proposals: Sequence[Proposal],
    pairs: Sequence[Verdict],
    zones: Zones,
    *,
    tail: Iterable[str] = (),
) -> str:
    """YAML text; head, tail: paragraphs of comment before and after it. What a profile cannot hold is left out."""
    lines = [line for paragraph in head for line in _comment(paragraph, "")]
    lines += ["", "observers:"]
    for proposal in proposals:
        lines += _observer(proposal, zones)
    kept, dropped = pairs[:MAX_PAIRS], len(pairs) - MAX_PAIRS
    lines += ["", "ignore_pairs:" if kept else "ignore_pairs: []"]
    for verdict in kept:
        if verdict.warning:
            lines += _comment(f"Beware: {verdict.warning}.", "  ")
        pair = ", ".join(map(_name, verdict.links))
        lines += [f"  - pair: [{pair}]", f"    reason: {json.dumps(verdict.reason)}"]
    closing = list(tail)
    if dropped > 0:
        closing.append(f"{dropped} more pairs are never near: a profile holds {MAX_PAIRS}, and they only cost time.")
    lines += ["", *(line for paragraph in closing for line in _comment(paragraph, ""))] if closing else []
    return "\n".join(lines) + "\n"


def _observer(proposal: Proposal, zones: Zones) -> list[str]:
    ratio = "flat geometry" if proposal.ratio is None else f"{proposal.ratio:.2f} times the volume of the geometry"
    size = f"{ratio}, stands out by {1e3 * proposal.stands_out:.0f} mm at most"
    about = f"{proposal.why}; this: {size}" if proposal.why else size
    return [
        *_comment(about[0].upper() + about[1:] + ".", "  "),
        f"  {_name(proposal.name)}: {{link: {_name(proposal.link_name)},",
        f"      shape: {_shape(proposal.shape)},",
        f"      influence: {zones.influence!r}, margin: {zones.margin!r}}}",
    ]


def _shape(shape: Capsule | Box | Lone) -> str:
    if isinstance(shape, Lone):
        return f"{{geom: {_name(shape.geom)}}}"
    if isinstance(shape, Box):
        quat = ", ".join(f"{part:.9g}" for part in shape.quat)
        turn = "" if abs(abs(shape.quat[0]) - 1.0) < 1e-12 else f" quat: [{quat}],"
        return f"{{box: {{pos: {_vector(shape.pos)},{turn} size: {_vector(shape.size)}}}}}"
    if shape.is_ball:
        return f"{{sphere: {{at: {_vector(shape.start)}, radius: {_number(shape.radius)}}}}}"
    return f"{{capsule: {{from: {_vector(shape.start)}, to: {_vector(shape.end)}, radius: {_number(shape.radius)}}}}}"


def _vector(values: Iterable[float]) -> str:
    return "[" + ", ".join(map(_number, values)) + "]"


def _number(value: float) -> str:
    text = f"{value:.{DIGITS}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _name(name: str) -> str:
    return name if _PLAIN.fullmatch(name) and name.lower() not in _RESERVED else json.dumps(name)


def _comment(text: str, indent: str) -> list[str]:
    """A paragraph as lines of comment."""
    lines, line = [], ""
    for word in text.split():
        if line and len(indent) + len(line) + len(word) > WIDTH:
            lines.append(line)
            line = ""
        line = f"{line} {word}" if line else word
    return [f"{indent}# {line}" for line in [*lines, line]]
