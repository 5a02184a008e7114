"""Names of the poses of a NatNet frame: from the model definitions where they are known, else by number."""

from collections.abc import Sequence
from dataclasses import dataclass

from retarget.sources.natnet_frame import Owner, PoseGroup
from retarget.sources.natnet_models import BodyDefinition, Definitions, GroupDefinition

__all__ = ["NO_PARENT", "NameTable", "PoseName", "pose_names"]

NO_PARENT = None
"""Parent of a bone that has none."""


@dataclass(frozen=True, slots=True)
class PoseName:
    """Of one pose. defined: the definitions know it. parent: number of the parent bone, None at the root.

    number: id within its owner (of a bone: without the skeleton's id, which the wire keeps in the upper 16 bits).
    """

    text: str
    number: int
    defined: bool
    parent: int | None = NO_PARENT


class NameTable:
    """Looks names up. Two things of one name are told apart by their numbers."""

    def __init__(self, definitions: Definitions | None = None) -> None:
        known = definitions or Definitions()
        self._bodies = _by_number(known.rigid_bodies)
        self._groups = {
            Owner.SKELETON: _groups_by_number(known.skeletons),
            Owner.ASSET: _groups_by_number(known.assets),
        }

    def of(self, group: PoseGroup, number: int) -> PoseName:
        """`rigid://NAME`, `bone://SKELETON/BONE` or `asset://ASSET/BODY`; `#NUMBER` where a name is not known."""
        scheme = f"{group.owner.value}://"
        if group.owner is Owner.RIGID_BODIES:
            body = self._bodies.get(number)
            return PoseName(scheme + _text(body.name if body else "", number), number, body is not None)
        # The wire writes owner << 16 | bone; the definitions only the bone.
        bone = number & 0xFFFF
        owner = self._groups[group.owner].get(group.number)
        known = owner.bones.get(bone) if owner else None
        text = f"{scheme}{_text(owner.name if owner else '', group.number)}/{_text(known.name if known else '', bone)}"
        if owner is None or known is None:
            return PoseName(text, bone, False)
        parent = known.parent & 0xFFFF
        return PoseName(text, bone, True, parent if parent in owner.bones and parent != bone else NO_PARENT)


@dataclass(frozen=True, slots=True)
class _Group:
    name: str
    bones: dict[int, BodyDefinition]


def _by_number(bodies: Sequence[BodyDefinition]) -> dict[int, BodyDefinition]:
    """The first of each number; a name that was there before is left out."""
    found: dict[int, BodyDefinition] = {}
    names: set[str] = set()
    for body in bodies:
        name = "" if body.name in names else body.name
        names.add(body.name)
        found.setdefault(body.number, BodyDefinition(name, body.number, body.parent, body.offset))
    return found


def _groups_by_number(groups: Sequence[GroupDefinition]) -> dict[int, _Group]:
    found: dict[int, _Group] = {}
    names: set[str] = set()
    for group in groups:
        name = "" if group.name in names else group.name
        names.add(group.name)
        bones = {number & 0xFFFF: bone for number, bone in _by_number(group.bones).items()}
        found.setdefault(group.number, _Group(name, bones))
    return found


def _text(name: str, number: int) -> str:
    return name or f"#{number}"


def pose_names(table: NameTable, groups: Sequence[PoseGroup], numbers: Sequence[int]) -> list[PoseName]:
    """Names of all poses of a frame in their order. numbers: as the wire has them, group after group."""
    names: list[PoseName] = []
    at = 0
    for group in groups:
        names += [table.of(group, number) for number in numbers[at : at + group.count]]
        at += group.count
    return names
