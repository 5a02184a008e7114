"""Joint names as data: every style is complete and finds itself."""

import pytest

from retarget.frames import JOINTS
from retarget.sources.naming import REQUIRED, STYLES, NamingStyle, joints_by_name, plain_names


def names_of(style: NamingStyle) -> dict[str, str]:
    """Canonical joint -> the style's own first name."""
    names = {joint: options[0] for joint, options in style.middle.items()}
    for side, word in zip("lr", style.words, strict=True):
        names |= {f"{side}_{part}": options[0].format(s=word) for part, options in style.sided.items()}
    return names


@pytest.mark.parametrize("style", STYLES, ids=lambda style: str(style.name))
def test_each_style_finds_its_own_joints(style: NamingStyle) -> None:
    names = names_of(style)
    assert set(REQUIRED) <= set(names) <= {*JOINTS, "head_top"}
    assert len(set(names.values())) == len(names), "a name stands for two joints"
    found = joints_by_name(tuple(names.values()))
    assert found == {joint: i for i, joint in enumerate(names)}


def test_name_spaces_prefixes_blanks_and_case_do_not_matter() -> None:
    assert plain_names(("mixamorig:Hips", "mixamorig:LeftUpLeg")) == ["hips", "leftupleg"]
    assert plain_names(("Bip01", "Bip01 L Thigh", "Bip01_Pelvis")) == ["", "lthigh", "pelvis"]
    assert plain_names(("left_up.leg", "Left Arm-2")) == ["upleg", "arm2"]
    assert plain_names(("Hips",)) == ["hips"]
    assert plain_names(()) == []


def test_names_that_lack_a_limb_are_not_enough() -> None:
    names = names_of(STYLES[1])
    for joint in REQUIRED:
        rest = tuple(name for other, name in names.items() if other != joint)
        found = joints_by_name(rest)
        assert found is None or joint == "pelvis"  # the root stands in for a pelvis of another name
    assert joints_by_name(("tail", "fin")) is None
