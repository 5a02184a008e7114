"""A robot's body in, its observers and pairs to ignore out."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from retarget.body import BodyModel, body_from_file
from retarget.body_file import BodyFile, compile_body
from retarget.catalogue import HUMAN
from retarget.errors import UsageError
from retarget.fitting.capsule import Capsule
from retarget.fitting.fragment import MAX_PAIRS, fragment
from retarget.fitting.geometry import LinkGeometry, link_geometries
from retarget.fitting.own_geoms import own_distances
from retarget.fitting.proposals import Proposal, Zones, flattened, propose
from retarget.fitting.ranges import joint_ranges
from retarget.fitting.shape_model import Pair
from retarget.fitting.survey import SAFETY_FACTOR, PairRecord, survey
from retarget.fitting.verdicts import Verdict, always_overlapping, verdicts
from retarget.observer_pairs import NEAR_LINKS, steps_between
from retarget.profile import RobotProfile, load_profile
from retarget.rotations import FloatArray

__all__ = ["DEFAULT_SAMPLES", "Fit", "Subject", "find_subject", "fit"]

DEFAULT_SAMPLES = 4000
MAX_SAMPLES = 1_000_000
BODY_SUFFIXES = (".xml", ".mjcf", ".urdf")


@dataclass(frozen=True, eq=False)
class Subject:
    """What is fitted: a body, and where there is a profile, its joint limits and its neutral posture."""

    name: str
    file: BodyFile
    profile: RobotProfile | None

    @property
    def inputs(self) -> tuple[Path, ...]:
        """The files that it was read from."""
        profile = () if self.profile is None else (self.profile.path,)
        return (Path(self.file.source), *profile)


@dataclass(frozen=True, eq=False)
class Fit:
    """observers and the pairs to ignore, every pair that was looked at, and all as `text` for a profile."""

    observers: tuple[Proposal, ...]
    ignored: tuple[Verdict, ...]
    records: tuple[PairRecord, ...]
    text: str


def find_subject(robot: str) -> Subject:
    """A robot by name, by its profile, or by an MJCF or URDF file. Raises UsageError, ConfigError, InputError."""
    if robot == HUMAN:
        raise UsageError("the human is no robot", found=HUMAN, next_step="Give a robot's name, its profile or its body")
    path = Path(robot)
    if path.suffix.lower() in BODY_SUFFIXES:
        return Subject(path.name, compile_body(path), None)
    profile = load_profile(robot)
    return Subject(profile.name, compile_body(profile.body_path, root=profile.root), profile)


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
    observers = tuple(
        flattened(proposal, geometry, "a capsule would stand out too far, or touch another link where the robot stands")
        if isinstance(proposal.shape, Capsule) and (proposal.link_name in tight or (proposal.ratio or 0.0) > thickest)
        else proposal
        for proposal, geometry in zip(propose(geometries, zones), geometries, strict=True)
    )
    ranges = joint_ranges(body, _limits(subject.profile))
    near = SAFETY_FACTOR * zones.influence
    neutral = ranges.clipped(_neutral(subject.profile, body))
    for last in (False, True):
        records = survey(
            body, observers, ranges, neutral=neutral, near=near, samples=samples, seed=seed, progress=progress
        )
        overlapping = always_overlapping(records)
        links = [(observers[record.pair[0]].link, observers[record.pair[1]].link) for record in overlapping]
        own = own_distances(model, ranges, links, seed=seed)
        hidden = [record.pair for record, distances in zip(overlapping, own, strict=True) if distances.may_collide]
        tighter = observers if last else _tightened(observers, geometries, hidden)
        if tighter == observers:
            break
        observers = tighter
    ignored = verdicts(records, observers, body, near=near, own=own, excluded=_excluded(model))
    assumed = (*notes, *ranges.notes, *subject.file.notes)
    head = _head(subject, zones, samples=samples, seed=seed, notes=assumed)
    tail = _tail(observers, ignored[:MAX_PAIRS], records, body)
    return Fit(observers, ignored, records, fragment(head, observers, ignored, zones, tail=tail))


def _tightened(
    observers: tuple[Proposal, ...], geometries: tuple[LinkGeometry, ...], hidden: list[Pair]
) -> tuple[Proposal, ...]:
    """Observers in which, of each pair that overlaps always though its geoms do not, the larger capsule gives way."""
    tighter = list(observers)
    for pair in hidden:
        capsules = [place for place in pair if isinstance(observers[place].shape, Capsule)]
        if not capsules or any(tighter[place] is not observers[place] for place in pair):
            continue
        place = max(capsules, key=lambda place: observers[place].stands_out)
        other = observers[pair[0] if place == pair[1] else pair[1]]
        why = f"a capsule would overlap {other.link_name} at every posture, which the links themselves do not"
        tighter[place] = flattened(observers[place], geometries[place], why)
    return tuple(tighter)


def _limits(profile: RobotProfile | None) -> dict[str, tuple[float, float]]:
    return {} if profile is None else {joint: servo.limits for joint, servo in profile.servos.items()}


def _neutral(profile: RobotProfile | None, body: BodyModel) -> FloatArray:
    q = body.qpos0.copy()
    angles = {} if profile is None else profile.postures.neutral
    for joint, angle in angles.items():
        q[body.joint_qpos[body.joint_index(joint)]] = angle
    return q


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
    touching = [record.pair for record in checked if record.at_neutral <= 0.0]
    dropped = [pair for pair in touching if _steps(body, observers, pair) <= NEAR_LINKS]
    refused = [pair for pair in touching if pair not in dropped]
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


def _steps(body: BodyModel, observers: tuple[Proposal, ...], pair: Pair) -> int:
    return steps_between(body, observers[pair[0]].link, observers[pair[1]].link)


def _listed(observers: tuple[Proposal, ...], pairs: list[Pair]) -> str:
    return ", ".join(f"{observers[first].name} - {observers[second].name}" for first, second in pairs) or "none"
