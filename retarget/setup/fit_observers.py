"""Fit of observers to a robot's body: shapes, pairs of links to ignore, and both as YAML text."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from hardware.errors import printable
from retarget import _solver
from retarget.errors import UsageError
from retarget.model.body import BodyModel, body_from_file
from retarget.model.body_file import compile_body
from retarget.model.observers import NEAR_LINKS, steps_between
from retarget.model.robot import load_profile
from retarget.rotations import multiply, rotate
from retarget.schema.catalogue import BODIES, HUMAN
from retarget.schema.profile import DRAFT
from retarget.setup.shape_fit import LinkShape, fitted_shapes
from retarget.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Zones:
    """Distances of an observer, m. influence: below it the observer acts. margin: it keeps this distance."""

    influence: float
    margin: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.influence) and self.influence > 0.0):
            raise UsageError(
                "no usable influence", where="--influence", found=f"{self.influence} m", allowed="more than 0 m"
            )
        if not 0.0 <= self.margin < self.influence:
            allowed = f"0 m to less than the influence, {self.influence} m"
            raise UsageError("no usable margin", where="--margin", found=f"{self.margin} m", allowed=allowed)


@dataclass(frozen=True)
class IgnoredLinks:
    """A pair of links that is proposed to be ignored, with the reason."""

    links: tuple[str, str]
    reason: str


class PlacedShapes:
    """Distances between shapes on the links of a body, in any posture."""

    def __init__(self, body: BodyModel, shapes: tuple[LinkShape, ...]) -> None:
        self._body, self.shapes = body, shapes
        self._solver, self._links = body.solver_body(), [body.body_index(shape.link_name) for shape in shapes]
        self._kinds = np.array([shape.kind for shape in shapes], dtype=np.int64)
        self._sizes, self._pos, self._quats = (
            np.array([getattr(shape, name) for shape in shapes], dtype=np.float64).reshape(len(shapes), -1)
            for name in ("size", "pos", "quat")
        )
        pairs = [(b, a) for a, b in zip(*np.tril_indices(len(shapes), -1), strict=True)]
        steps = {pair: steps_between(body, *(self._links[place] for place in pair)) for pair in pairs}
        looked = [pair for pair in pairs if steps[pair] > 1]
        self._pairs = np.array(looked, dtype=np.int64).reshape(-1, 2)
        self._near = np.array([steps[pair] <= NEAR_LINKS for pair in looked], dtype=np.bool_)
        axes = _Axes(body)
        links = [tuple(self._links[place] for place in pair) for pair in looked]
        self._joined = ~self._near & np.array([axes.meet(*pair) for pair in links], dtype=np.bool_)

    def distances(self, angles: Mapping[str, float]) -> FloatArray:
        """Signed distances (p,), m, of the pairs in a posture, rad by joint."""
        row = np.ascontiguousarray(self._body.posture(dict(angles))[None])
        pos = self._solver.points(row, self._links, np.ascontiguousarray(self._pos))[0]
        quat = multiply(self._solver.orientations(row, self._links)[0], self._quats)
        sides: list[Any] = []
        for half in self._pairs.T:
            sides += [self._kinds[half], self._sizes[half], pos[half], quat[half]]
        return np.asarray(_solver.shape_distances(*sides)[0])

    def touching(self, angles: Mapping[str, float], neutral: Mapping[str, float]) -> frozenset[frozenset[str]]:
        """The pairs of links that touch in a posture. Neighbours, and links on both sides of one shoulder or
        hip, count only if they are clear of each other in the neutral posture."""
        distance, home = self.distances(angles), self.distances(neutral)
        touches = np.where(self._near, (distance <= 0.0) & (home > 0.0), distance <= NEAREST_M)
        return self._named(touches & ~(self._joined & (home <= NEAREST_M)))

    def joined(self, neutral: Mapping[str, float]) -> frozenset[frozenset[str]]:
        """The pairs of links on both sides of one shoulder or hip that touch in the neutral posture."""
        return self._named(self._joined & (self.distances(neutral) <= NEAREST_M))

    def _named(self, touches: BoolArray) -> frozenset[frozenset[str]]:
        pairs = self._pairs[touches].tolist()
        return frozenset(frozenset(self.shapes[place].link_name for place in pair) for pair in pairs)


MEET = 0.02
"""Largest distance of axes that meet (three in a shoulder) from their common point, as a share of the body's size."""


class _Axes:
    def __init__(self, body: BodyModel) -> None:
        self._body, row, links = body, body.qpos0[None], body.joint_body.tolist()
        solver = body.solver_body()
        self._places = solver.points(row, links, np.ascontiguousarray(body.joint_pos))[0]
        self._axes = rotate(solver.orientations(row, links)[0], body.joint_axis)
        self._near = MEET * float(np.linalg.norm(np.ptp(self._places, axis=0)))

    def meet(self, one: int, other: int) -> bool:
        """True if the axes of all joints between two links pass one point, found by least squares."""
        path = self._body.links_between(one, other)
        between = [joint for joint, link in enumerate(self._body.joint_body.tolist()) if link in path]
        places = self._places[between]
        across = np.eye(3) - self._axes[between, :, None] * self._axes[between, None, :]  # (k, 3, 3)
        point = np.linalg.lstsq(across.sum(axis=0), np.einsum("kij,kj->i", across, places), rcond=None)[0]
        off = np.einsum("kij,kj->ki", across, point - places)
        return bool(np.linalg.norm(off, axis=1).max() <= self._near)


NEAREST_M = 0.002
"""Distance below which links touch, m."""
TOUCHES = "touch in the posture {}: draw their shapes tighter, or move it, then remove this; nothing keeps them apart"

JOINED = "touch in the posture neutral beside the joint between them, whose axes meet: nothing keeps them apart"


def ignored_links(
    placed: PlacedShapes, neutral: Mapping[str, float], postures: Mapping[str, Mapping[str, float]]
) -> tuple[IgnoredLinks, ...]:
    """The pairs of links that touch in the neutral posture or in others (rad by joint, by name), in which a run
    could not begin otherwise."""
    found: dict[tuple[str, ...], IgnoredLinks] = {}
    for first, second in sorted(tuple(sorted(pair)) for pair in placed.joined(neutral)):
        found[first, second] = IgnoredLinks((first, second), JOINED)
    for name, angles in {"neutral": neutral, **postures}.items():
        for pair in sorted(tuple(sorted(pair)) for pair in placed.touching(angles, neutral)):
            found.setdefault(pair, IgnoredLinks((pair[0], pair[1]), TOUCHES.format(name)))
    return tuple(found.values())


# The proposal as sections `observers` and `ignore_pairs` of a robot profile, with comments.

MAX_PAIRS = 500
"""Most ignored pairs of a profile."""
WIDTH = 118
"""Columns of the YAML, as in the shipped profiles."""
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")
_RESERVED = {"true", "false", "null", "yes", "no", "on", "off", "y", "n"}


def flow(value: Any) -> str:
    """Return flow YAML of a name, a number, or a list or mapping of these. A list of one name becomes that name."""
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
    """Break a long line of flow YAML at spaces. Further lines are indented."""
    first = line[: len(line) - len(line.lstrip())]
    parts = wrap(line.strip(), WIDTH - indent, break_long_words=False, break_on_hyphens=False)
    return ("\n" + " " * indent).join([first + parts[0], *parts[1:]])


def comment(text: str) -> str:
    """A paragraph as lines of comment."""
    text = " ".join(printable(text).split())
    lines = wrap(text, WIDTH - 1, break_long_words=False, break_on_hyphens=False)
    return "\n".join(f"# {line}" for line in lines)


def fragment(head: Iterable[str], shapes: Sequence[LinkShape], pairs: Sequence[IgnoredLinks], zones: Zones) -> str:
    """Return both sections as YAML. head: paragraphs of comment before them. An observer has the name of its link,
    without `_link` if all names stay distinct. Pairs beyond MAX_PAIRS are left out."""
    short = [shape.link_name.removesuffix("_link") or shape.link_name for shape in shapes]
    names = short if len(set(short)) == len(short) else [shape.link_name for shape in shapes]
    lines = [*map(comment, head), "", "observers:" if shapes else "observers: {}"]
    for name, shape in zip(names, shapes, strict=True):
        size = "flat geometry" if shape.ratio is None else f"{shape.ratio:.2f} times the volume of the geometry"
        lines += [
            f"  {flow(name)}: {{link: {flow(shape.link_name)},  # {size}",
            f"      shape: {flow(shape.entry)},",
            f"      influence: {flow(zones.influence)}, margin: {flow(zones.margin)}}}",
        ]
    lines += ["", "ignore_pairs:" if pairs else "ignore_pairs: []"]
    for pair in pairs[:MAX_PAIRS]:
        lines += [f"  - pair: {flow(pair.links)}  {DRAFT}", f"    reason: {json.dumps(pair.reason)}"]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, eq=False)
class Fit:
    """Observers of a robot, and the pairs to ignore. inputs: the files that were read."""

    shapes: tuple[LinkShape, ...]
    ignored: tuple[IgnoredLinks, ...]
    text: str
    inputs: tuple[Path, ...]


def fit(robot: str, zones: Zones) -> Fit:
    """Propose observers and pairs to ignore. robot: name, profile, or MJCF or URDF file. Raises UsageError,
    ConfigError, InputError."""
    if robot == HUMAN:
        raise UsageError("the human is no robot", found=HUMAN, next_step="Give a robot's name, its profile or its body")
    path = Path(robot)
    if path.suffix.lower() in BODIES:
        file, neutral, name = compile_body(path), dict[str, float](), path.name
        inputs: tuple[Path, ...] = (path,)
    else:
        profile = load_profile(robot)
        file, name = compile_body(profile.body_path, root=profile.root), profile.name
        neutral, inputs = profile.postures.neutral, (profile.body_path, profile.path)
    shapes = fitted_shapes(file.model, source=file.source)
    ignored = ignored_links(PlacedShapes(body_from_file(file), shapes), neutral, {})
    head = [
        f"Proposed by retarget fit-observers for {name}: put it in place of the profile's own two sections.",
        *(f"Note: {note}." for note in file.notes),
    ]
    return Fit(shapes, ignored, fragment(head, shapes, ignored, zones), inputs)
