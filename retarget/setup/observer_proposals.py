"""Proposed observers: a capsule per link, or a flat shape where a capsule is far too large."""

import math
from dataclasses import dataclass

import numpy as np

from retarget.errors import UsageError
from retarget.rotations import normalise, to_matrix
from retarget.setup.enclosing_shapes import (
    Capsule,
    LinkGeometry,
    Solid,
    directions,
    distances_to_segment,
    enclosing_box,
    enclosing_capsule,
)
from retarget.types import FloatArray

DIGITS = 5
"""Decimals of lengths in m: shapes are rounded outwards to them, so that what is written still encloses."""
FAR_TOO_LARGE = 3.0
"""A capsule of so many times the other shape's volume gives way to it."""
SOMEWHAT_LARGE = 2.0
"""So does one of so many times, if it also stands out of the geometry by more than the influence."""


@dataclass(frozen=True)
class Zones:
    """influence: distance at which the observers act, margin: distance that they keep, m."""

    influence: float
    margin: float

    def __post_init__(self) -> None:
        """Raise UsageError for zones that no profile may have."""
        if not (math.isfinite(self.influence) and self.influence > 0.0):
            raise UsageError(
                "no usable influence", where="--influence", found=f"{self.influence} m", allowed="more than 0 m"
            )
        if not 0.0 <= self.margin < self.influence:
            allowed = f"0 m to less than the influence, {self.influence} m"
            raise UsageError("no usable margin", where="--margin", found=f"{self.margin} m", allowed=allowed)


@dataclass(frozen=True, eq=False)
class Proposal:
    """An observer `name` on `link` (its index and its name).

    ratio: volume of the shape over that of the geometry's convex hull, None where that is flat. stands_out: how far
    the shape reaches beyond the hull, m. why: why it is no capsule, else empty.
    """

    link: int
    link_name: str
    name: str
    shape: Capsule | Solid
    ratio: float | None
    stands_out: float
    why: str


def propose(geometries: tuple[LinkGeometry, ...], zones: Zones) -> tuple[Proposal, ...]:
    """An observer for every link, named for it."""
    return tuple(_propose(geometry, name, zones) for geometry, name in zip(geometries, _names(geometries), strict=True))


def flattened(proposal: Proposal, geometry: LinkGeometry, why: str) -> Proposal:
    """The same observer as a box or a cylinder, and why it is none of a capsule."""
    flat = _flat(geometry)
    return _proposal(geometry, proposal.name, flat, f"{flat.kind}: {why}")


def _propose(geometry: LinkGeometry, name: str, zones: Zones) -> Proposal:
    axes = geometry.axes.transpose(0, 2, 1).reshape(-1, 3)
    capsule = _rounded_capsule(enclosing_capsule(geometry.centres, geometry.radii, axes=axes), geometry)
    round_one = _proposal(geometry, name, capsule, "")
    times, out = capsule.volume / _flat(geometry).volume, round_one.stands_out
    if times < FAR_TOO_LARGE and not (times >= SOMEWHAT_LARGE and out > zones.influence):
        return round_one
    why = f"the smallest capsule is {times:.1f} times as large and stands out by {1e3 * out:.0f} mm"
    return flattened(round_one, geometry, why)


def _flat(geometry: LinkGeometry) -> Solid:
    return geometry.lone or _rounded_box(enclosing_box(geometry), geometry)


def _proposal(geometry: LinkGeometry, name: str, shape: Capsule | Solid, why: str) -> Proposal:
    """With the largest difference of the support functions: for nested convex bodies, how far the outer reaches out."""
    hull, stands_out = geometry.hull_volume(), 0.0
    if shape is not geometry.lone:
        inner = np.max(directions() @ geometry.centres.T + geometry.radii, axis=1)
        stands_out = float(max(np.max(shape.support(directions()) - inner), 0.0))
    ratio = shape.volume / hull if hull > 0.0 else None
    return Proposal(geometry.link, geometry.name, name, shape, ratio, stands_out, why)


def _names(geometries: tuple[LinkGeometry, ...]) -> list[str]:
    """The links' names without an ending `_link`, where that leaves them different."""
    short = [geometry.name.removesuffix("_link") or geometry.name for geometry in geometries]
    if len(set(short)) == len(short):
        return short
    return [geometry.name for geometry in geometries]


def _rounded_capsule(capsule: Capsule, geometry: LinkGeometry) -> Capsule:
    start, end = _round(capsule.start), _round(capsule.end)
    if capsule.is_ball:
        end = start
    needed = float(np.max(distances_to_segment(geometry.centres, start, end) + geometry.radii))
    return Capsule(start, end, round_up(max(needed, 10.0**-DIGITS)))


def _rounded_box(box: Solid, geometry: LinkGeometry) -> Solid:
    pos, quat = _round(box.pos), np.round(box.quat, 9)
    local = (geometry.centres - pos) @ to_matrix(normalise(quat))
    needed = np.max(np.abs(local) + geometry.radii[:, None], axis=0)
    return Solid("box", pos, quat, np.array([round_up(max(float(half), 10.0**-DIGITS)) for half in needed]))


def _round(values: FloatArray) -> FloatArray:
    return np.round(values, DIGITS) + 0.0  # no -0.0


def round_up(value: float) -> float:
    """To DIGITS decimals, never below; a value within 1e-12 above a decimal counts as that decimal."""
    return round(math.ceil(value * 10.0**DIGITS - 10.0 ** (DIGITS - 12)) / 10.0**DIGITS, DIGITS)
