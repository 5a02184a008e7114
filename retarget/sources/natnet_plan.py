"""What is worked out once for a set of NatNet ids and not again in every frame: names, rows kept, parents of bones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.frames import BoolArray
from retarget.rotations import FloatArray
from retarget.scalar_rotations import plus, product, rotated
from retarget.sources.natnet_frame import Owner, PoseGroup
from retarget.sources.natnet_names import NameTable, PoseName, pose_names

__all__ = ["ROOT", "UNKNOWN", "PosePlan", "compose_bones", "plan_poses"]

ROOT = -1
"""Parent row of a pose that is already in the world."""
UNKNOWN = -2
"""Parent row of a bone whose chain to the root is not known: it has no pose in the world."""


@dataclass(frozen=True, slots=True, eq=False)
class PosePlan:
    """Of k poses kept. rows (k,) of the frame, None if all. doubled, surplus: rows left out, by reason.

    bones: (row, parent row) of the bones that are not roots, parents first; lost: rows of bones whose parents are not
    known. Both index the rows kept.
    """

    names: tuple[str, ...]
    rows: NDArray[np.intp] | None
    doubled: int
    surplus: int
    all_defined: bool
    bones: tuple[tuple[int, int], ...]
    lost: tuple[int, ...]


def plan_poses(table: NameTable, groups: Sequence[PoseGroup], numbers: Sequence[int], *, limit: int) -> PosePlan:
    """The plan for these groups and wire numbers: each name once, at most `limit` of them."""
    found = pose_names(table, groups, numbers)
    first: dict[str, int] = {}
    for row, name in enumerate(found):
        first.setdefault(name.text, row)
    kept = list(first.values())[:limit]
    parents = _parents(groups, found, kept)
    depth_first = sorted((row for row in range(len(kept)) if parents[row] >= 0), key=lambda row: _depth(parents, row))
    return PosePlan(
        names=tuple(found[row].text for row in kept),
        rows=None if len(kept) == len(found) else np.array(kept, np.intp),
        doubled=len(found) - len(first),
        surplus=len(first) - len(kept),
        all_defined=all(found[row].defined for row in kept),
        bones=tuple((row, parents[row]) for row in depth_first),
        lost=tuple(row for row in range(len(kept)) if parents[row] == UNKNOWN),
    )


def _parents(groups: Sequence[PoseGroup], found: Sequence[PoseName], kept: Sequence[int]) -> list[int]:
    """Parent row of each row kept. Only skeletons have parents: rigid bodies and assets are in the world."""
    owners = [group for group in groups for _ in range(group.count)]
    places = {(owners[row].owner, owners[row].number, found[row].number): place for place, row in enumerate(kept)}
    parents = []
    for row in kept:
        name, group = found[row], owners[row]
        if group.owner is not Owner.SKELETON:
            parents.append(ROOT)
        elif not name.defined:
            parents.append(UNKNOWN)
        elif name.parent is None:
            parents.append(ROOT)
        else:
            parents.append(places.get((group.owner, group.number, name.parent), UNKNOWN))
    return [UNKNOWN if _depth(parents, row) < 0 else parent for row, parent in enumerate(parents)]


def _depth(parents: Sequence[int], row: int) -> int:
    """Steps to the root; -1 where the chain is not known or goes round."""
    for steps in range(len(parents) + 1):
        row = parents[row]
        if row == ROOT:
            return steps
        if row == UNKNOWN:
            return -1
    return -1


def compose_bones(plan: PosePlan, position: FloatArray, orientation: FloatArray, tracked: BoolArray) -> None:
    """Turns parent-relative poses of bones into the world, in place: T_world_bone = T_world_parent T_parent_bone.

    A bone is vouched for only if its parents are. Bones whose parents are not known become NaN and are not.
    """
    points = [(p[0], p[1], p[2]) for p in position.tolist()]
    turns = [(q[0], q[1], q[2], q[3]) for q in orientation.tolist()]
    for row, parent in plan.bones:
        points[row] = plus(points[parent], rotated(turns[parent], points[row]))
        turns[row] = product(turns[parent], turns[row])
        tracked[row] &= tracked[parent]
    position[:] = points
    orientation[:] = turns
    for row in plan.lost:
        position[row] = np.nan
        orientation[row] = np.nan
        tracked[row] = False
