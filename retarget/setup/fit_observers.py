"""Fits observers to a robot's body: the shapes, the pairs to ignore, and both as YAML text with reasons."""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from textwrap import wrap
from typing import Any, Literal, get_args

import numpy as np

from hardware.errors import printable
from retarget.errors import UsageError
from retarget.model.body import BodyModel, body_from_file
from retarget.model.body_file import BodyFile, compile_body
from retarget.model.observers import NEAR_LINKS, NEVER_NEAR, steps_between
from retarget.model.robot import load_profile
from retarget.schema.catalogue import HUMAN
from retarget.schema.profile import DRAFT
from retarget.setup.shape_fit import Capsule, Proposal, Zones, flattened, link_geometries, propose
from retarget.setup.survey import SAFETY_FACTOR, Pair, PairRecord, joint_ranges, survey

# Which pairs of links need no check, each with the numbers that say so.

Kind = Literal["touching", "always", "excluded", "neighbours", "never"]
"""touching: in the postures of a drafted profile."""


@dataclass(frozen=True)
class Verdict:
    """A pair of links that is proposed to be ignored. warning: what is lost by that, else empty."""

    kind: Kind
    links: tuple[str, str]
    reason: str
    warning: str = ""


def verdicts(
    records: Sequence[PairRecord],
    proposals: tuple[Proposal, ...],
    body: BodyModel,
    *,
    near: float,
    excluded: set[tuple[int, int]],
) -> tuple[Verdict, ...]:
    """The pairs to ignore: first those that always overlap, last those that never come as near as `near`, m.

    excluded: sorted link numbers of the body file's own pairs.
    """
    found = []
    for record in records:
        first, second = (proposals[place] for place in record.pair)
        names = (first.link_name, second.link_name)
        if record.largest is not None and record.own is not None:
            found.append(_always(record, record.largest, names, *record.own))
        elif (min(first.link, second.link), max(first.link, second.link)) in excluded:
            found.append(Verdict("excluded", names, f"the body file excludes their contact, {_closest(record)}"))
        elif record.at_neutral <= 0.0 and _neighbours(record.pair, proposals, body):
            reason = f"neighbours along the tree with no volume between them, {_closest(record)}"
            found.append(Verdict("neighbours", names, reason))
        elif record.smallest > near:
            found.append(Verdict("never", names, f"{NEVER_NEAR}, {_closest(record)}"))
    return tuple(sorted(found, key=lambda verdict: get_args(Kind).index(verdict.kind)))


def _always(
    record: PairRecord, largest: float, names: tuple[str, str], own_smallest: float, own_largest: float
) -> Verdict:
    deep = f"{_mm(-largest)} to {_mm(-record.smallest)} mm deep"
    reason = f"overlap at every posture, {deep} ({_looks(record)})"
    if own_largest <= 0.0:
        return Verdict("always", names, f"{reason}, and so do the links' own geoms")
    if not record.hides_collision:
        return Verdict("always", names, f"{reason}; their own geoms stay {_mm(own_smallest)} mm apart")
    apart = f"their own geoms come {_mm(own_largest)} mm apart and {_mm(-own_smallest)} mm into each other"
    warning = f"{names[0]} and {names[1]} can collide, which these shapes do not show: give one a tighter shape"
    return Verdict("always", names, f"{reason}; {apart}", warning)


def _neighbours(pair: Pair, proposals: tuple[Proposal, ...], body: BodyModel) -> bool:
    """Whether no link with a shape lies between the second link and the first on the way to the root."""
    shaped = {proposal.link for proposal in proposals}
    above = body.chain_to_root(proposals[pair[1]].link)[1:]
    return next((link for link in above if link in shaped), 0) == proposals[pair[0]].link


def _closest(record: PairRecord) -> str:
    if record.smallest < 0.0:
        return f"at most {_mm(-record.smallest)} mm deep ({_looks(record)})"
    return f"at least {_mm(record.smallest)} mm apart ({_looks(record)})"


def _looks(record: PairRecord) -> str:
    return f"{record.samples} postures" + (f", {record.searches} searches" if record.searches else "")


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.1f}"


# The proposal as a part of a robot profile: `observers` and `ignore_pairs` in YAML, with comments that say why.

MAX_PAIRS = 500
"""A profile ignores no more pairs."""
WIDTH = 118
"""Columns of a line of the YAML: those of the shipped profiles."""
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")
_RESERVED = {"true", "false", "null", "yes", "no", "on", "off", "y", "n"}


def flow(value: Any) -> str:
    """Flow YAML of a name, a number, or a list or mapping of these; a list of one name is written as that name."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{flow(key)}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, str):
        return value if _PLAIN.fullmatch(value) and value.lower() not in _RESERVED else json.dumps(value)
    if isinstance(value, float):
        return np.format_float_positional(value + 0.0, trim="-")  # no -0, no exponent
    if isinstance(value, int):
        return str(value)
    if len(value) == 1 and isinstance(value[0], str):
        return flow(value[0])
    return "[" + ", ".join(map(flow, value)) + "]"


def wrapped(line: str, indent: int) -> str:
    """A long line of flow YAML, broken where a space may be a line's end; further lines are indented."""
    first = line[: len(line) - len(line.lstrip())]
    parts = wrap(line.strip(), WIDTH - indent, break_long_words=False, break_on_hyphens=False)
    return ("\n" + " " * indent).join([first + parts[0], *parts[1:]])


def comment(text: str, indent: str = "") -> str:
    """A paragraph as lines of comment."""
    text = " ".join(printable(text).split())
    lines = wrap(text, WIDTH - len(indent) - 1, break_long_words=False, break_on_hyphens=False)
    return "\n".join(f"{indent}# {line}" for line in lines)


def fragment(
    head: Iterable[str],
    proposals: Sequence[Proposal],
    pairs: Sequence[Verdict],
    zones: Zones,
    *,
    tail: Iterable[str] = (),
) -> str:
    """YAML text; head, tail: paragraphs of comment before and after it. What a profile cannot hold is left out."""
    lines = [comment(paragraph) for paragraph in head]
    lines += ["", "observers:"]
    for proposal in proposals:
        lines += [
            comment(_about(proposal), "  "),
            f"  {flow(proposal.name)}: {{link: {flow(proposal.link_name)},",
            f"      shape: {flow(proposal.shape.entry)},",
            f"      influence: {flow(zones.influence)}, margin: {flow(zones.margin)}}}",
        ]
    kept, dropped = pairs[:MAX_PAIRS], len(pairs) - MAX_PAIRS
    lines += ["", "ignore_pairs:" if kept else "ignore_pairs: []"]
    for verdict in kept:
        if verdict.warning:
            lines.append(comment(f"Beware: {verdict.warning}.", "  "))
        mark = f"  {DRAFT}" if verdict.kind == "touching" else ""
        lines += [f"  - pair: {flow(verdict.links)}{mark}", f"    reason: {json.dumps(verdict.reason)}"]
    closing = list(tail)
    if dropped > 0:
        closing.append(f"{dropped} more pairs are never near: a profile holds {MAX_PAIRS}, and they only cost time.")
    lines += ["", *map(comment, closing)] if closing else []
    return "\n".join(lines) + "\n"


def _about(proposal: Proposal) -> str:
    ratio = "flat geometry" if proposal.ratio is None else f"{proposal.ratio:.2f} times the volume of the geometry"
    size = f"{ratio}, stands out by {1e3 * proposal.stands_out:.0f} mm at most"
    about = f"{proposal.why}; this: {size}" if proposal.why else size
    return about[0].upper() + about[1:] + "."


DEFAULT_SAMPLES = 4000
MAX_SAMPLES = 1_000_000
ROUNDS = 2
"""Capsules that hide that two links can collide give way once."""
GIVES_WAY = "a capsule would stand out too far, or overlap another link"
BODY_SUFFIXES = (".xml", ".mjcf", ".urdf")


@dataclass(frozen=True, eq=False)
class Subject:
    """What is fitted: a body, with its joint limits and the joint angles of its neutral posture, rad, where a profile
    says them. inputs: the files that it was read from."""

    name: str
    file: BodyFile
    limits: Mapping[str, tuple[float, float]]
    neutral: Mapping[str, float]
    inputs: tuple[Path, ...]


@dataclass(frozen=True, eq=False)
class Fit:
    """observers with their zones, the pairs to ignore, and every pair that was looked at.

    head, tail: paragraphs of comment.
    """

    observers: tuple[Proposal, ...]
    zones: Zones
    ignored: tuple[Verdict, ...]
    records: tuple[PairRecord, ...]
    head: tuple[str, ...]
    tail: tuple[str, ...]

    @property
    def text(self) -> str:
        """The proposal for a profile, in YAML."""
        return fragment(self.head, self.observers, self.ignored, self.zones, tail=self.tail)


def find_subject(robot: str) -> Subject:
    """A robot by name, by its profile, or by an MJCF or URDF file. Raises UsageError, ConfigError, InputError."""
    if robot == HUMAN:
        raise UsageError("the human is no robot", found=HUMAN, next_step="Give a robot's name, its profile or its body")
    path = Path(robot)
    if path.suffix.lower() in BODY_SUFFIXES:
        return Subject(path.name, compile_body(path), {}, {}, (path,))
    profile = load_profile(robot)
    limits = {joint: servo.limits for joint, servo in profile.servos.items()}
    body, neutral = compile_body(profile.body_path, root=profile.root), profile.postures.neutral
    return Subject(profile.name, body, limits, neutral, (profile.body_path, profile.path))


def fit(
    subject: Subject,
    zones: Zones,
    *,
    samples: int = DEFAULT_SAMPLES,
    seed: int = 0,
    thickest: float = inf,
    tight: frozenset[str] = frozenset(),
    progress: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Propose observers and pairs to ignore. The same input gives the same text.

    No capsule has more than `thickest` times its link's volume, and none is on a link of `tight`. Raises InputError,
    UsageError.
    """
    if not 1 <= samples <= MAX_SAMPLES:
        raise UsageError(
            "no usable number of samples", where="--samples", found=str(samples), allowed=f"1 to {MAX_SAMPLES}"
        )
    if seed < 0:
        raise UsageError("no usable seed", where="--seed", found=str(seed), allowed="0 or more")
    model, body = subject.file.model, body_from_file(subject.file)
    geometries, notes = link_geometries(model)
    proposals = propose(geometries, zones)
    flat = {proposal.link_name for proposal in proposals if (proposal.ratio or 0.0) > thickest} | tight
    ranges = joint_ranges(body, subject.limits)
    near = SAFETY_FACTOR * zones.influence
    neutral = ranges.clipped(body.posture(subject.neutral))
    for _ in range(ROUNDS):
        observers = tuple(
            flattened(proposal, geometry, GIVES_WAY)
            if proposal.link_name in flat and isinstance(proposal.shape, Capsule)
            else proposal
            for proposal, geometry in zip(proposals, geometries, strict=True)
        )
        records = survey(
            body,
            observers,
            ranges,
            neutral=neutral,
            near=near,
            samples=samples,
            seed=seed,
            model=model,
            geometries=geometries,
            progress=progress,
        )
        hidden = {place for record in records if record.hides_collision for place in record.pair}
        hiding = {observers[place].link_name for place in hidden if isinstance(observers[place].shape, Capsule)}
        if not hiding:
            break
        flat |= hiding
    ignored = verdicts(records, observers, body, near=near, excluded=_excluded(model))
    assumed = (*notes, *ranges.notes, *subject.file.notes)
    head = _head(subject, zones, samples=samples, seed=seed, notes=assumed)
    tail = _tail(observers, ignored[:MAX_PAIRS], records, body)
    return Fit(observers, zones, ignored, records, tuple(head), tuple(tail))


def _excluded(model: Any) -> set[tuple[int, int]]:
    """Sorted link numbers of the pairs that the body file excludes from contact (`exclude_signature`, 16 bits each)."""
    pairs = ((int(code) >> 16, int(code) & 0xFFFF) for code in np.asarray(model.exclude_signature))
    return {(min(pair), max(pair)) for pair in pairs}


def _head(subject: Subject, zones: Zones, *, samples: int, seed: int, notes: tuple[str, ...]) -> list[str]:
    return [
        f"Proposed by retarget fit-observers for {subject.name}: put it in place of the profile's own two sections.",
        f"Influence {zones.influence:g} m, margin {zones.margin:g} m, {samples} postures, seed {seed}. A pair is never "
        f"near if it keeps {SAFETY_FACTOR:g} times the influence in every posture and in every search that drives it "
        "together; that is strong evidence, not a proof.",
        *(f"Note: {note}." for note in notes),
    ]


def _tail(
    observers: tuple[Proposal, ...], ignored: tuple[Verdict, ...], records: tuple[PairRecord, ...], body: BodyModel
) -> list[str]:
    skipped = {verdict.links for verdict in ignored}
    checked = [
        record for record in records if tuple(observers[place].link_name for place in record.pair) not in skipped
    ]
    dropped, refused = list[Pair](), list[Pair]()
    for record in checked:
        if record.at_neutral <= 0.0:
            steps = steps_between(body, *(observers[place].link for place in record.pair))
            (dropped if steps <= NEAR_LINKS else refused).append(record.pair)
    looked_at = {record.pair for record in records}
    everything = [(first, second) for second in range(len(observers)) for first in range(second)]
    neighbours = [pair for pair in everything if pair not in looked_at]
    lines = [
        f"{len(checked)} pairs are left to check.",
        f"Of these, overlapping in the neutral posture, so dropped when a run starts: {_listed(observers, dropped)}.",
        f"At most one joint apart, never checked, so not listed: {_listed(observers, neighbours)}.",
    ]
    if refused:
        lines.append(
            f"Beware: more than {NEAR_LINKS} joints apart and overlapping in the neutral posture, so a run would not "
            f"start: {_listed(observers, refused)}. Choose another neutral posture, or tighter shapes."
        )
    return lines


def _listed(observers: tuple[Proposal, ...], pairs: list[Pair]) -> str:
    return ", ".join(f"{observers[first].name} - {observers[second].name}" for first, second in pairs) or "none"
