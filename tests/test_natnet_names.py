"""Names of NatNet poses."""

from retarget.sources.natnet_frame import Owner, PoseGroup
from retarget.sources.natnet_models import BodyDefinition, Definitions, GroupDefinition
from retarget.sources.natnet_names import NameTable, PoseName, pose_names


def body(name: str, number: int, parent: int = -1) -> BodyDefinition:
    return BodyDefinition(name, number, parent, (0.0, 0.0, 0.0))


BODIES = PoseGroup(Owner.RIGID_BODIES, 0, 1)
ANN = PoseGroup(Owner.SKELETON, 5, 1)
TABLE = NameTable(
    Definitions(
        (body("Quad", 2), body("Quad", 3), body("", 4)),
        (GroupDefinition("Ann", 5, (body("Hip", 1, 0), body("Spine", 2, 1), body("Loose", 3, 9), body("Own", 4, 4))),),
        (GroupDefinition("Cloth", 8, (body("Patch", 1),)),),
    )
)


def test_rigid_bodies() -> None:
    assert TABLE.of(BODIES, 2) == PoseName("rigid://Quad", 2, True)
    assert TABLE.of(BODIES, 9) == PoseName("rigid://#9", 9, False)


def test_a_name_told_twice_or_empty_becomes_a_number() -> None:
    assert TABLE.of(BODIES, 3).text == "rigid://#3"
    assert TABLE.of(BODIES, 4).text == "rigid://#4"
    twins = NameTable(Definitions(skeletons=(GroupDefinition("A", 1, ()), GroupDefinition("A", 2, ()))))
    assert twins.of(PoseGroup(Owner.SKELETON, 2, 1), 2 << 16 | 3).text == "bone://#2/#3"


def test_bones_carry_their_skeleton_in_the_upper_half() -> None:
    assert TABLE.of(ANN, 5 << 16 | 2) == PoseName("bone://Ann/Spine", 2, True, 1)
    assert TABLE.of(ANN, 5 << 16 | 7) == PoseName("bone://Ann/#7", 7, False)
    assert TABLE.of(PoseGroup(Owner.SKELETON, 6, 1), 6 << 16 | 1).text == "bone://#6/#1"


def test_a_bone_has_no_parent_that_is_not_there() -> None:
    assert [TABLE.of(ANN, number).parent for number in (1, 2, 3, 4)] == [None, 1, None, None]


def test_assets() -> None:
    assert TABLE.of(PoseGroup(Owner.ASSET, 8, 1), 8 << 16 | 1).text == "asset://Cloth/Patch"


def test_names_follow_the_groups() -> None:
    groups = (PoseGroup(Owner.RIGID_BODIES, 0, 2), PoseGroup(Owner.SKELETON, 5, 1))
    names = pose_names(TABLE, groups, [2, 77, 5 << 16 | 1])
    assert [name.text for name in names] == ["rigid://Quad", "rigid://#77", "bone://Ann/Hip"]
    assert [name.text for name in pose_names(NameTable(), groups, [2, 77, 1])] == [
        "rigid://#2",
        "rigid://#77",
        "bone://#5/#1",
    ]
