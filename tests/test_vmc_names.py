"""Names of bones and devices."""

import pytest

from retarget.sources.vmc_names import BODY_BONES, BONES, MAX_SERIAL, bone_name, device_name


def test_unity_has_55_bones() -> None:
    assert len(BONES) == len(set(BONES)) == 55 and len(BODY_BONES) == 22
    assert {"LeftThumbProximal", "RightLittleDistal", "Jaw", "LeftEye", "UpperChest"} <= set(BONES)


@pytest.mark.parametrize("told", ["LeftUpperArm", "leftUpperArm", "LEFTUPPERARM", "leftupperarm"])
def test_bones_in_any_case(told: str) -> None:
    assert bone_name(told) == "bone://LeftUpperArm"


@pytest.mark.parametrize("told", ["", "LastBone", "Left Upper Arm", "LeftUpperArm ", "bone://Hips"])
def test_no_bones(told: str) -> None:
    assert bone_name(told) is None


def test_serials() -> None:
    for fine in ("human://HEAD", "LHR-ABCD0001", "a", "é", "x" * MAX_SERIAL):
        assert device_name(fine) == fine
    for bad in ("", "x" * (MAX_SERIAL + 1), "a\nb", "\x1b[2J", "bone://Hips", "Root://root", "local://a"):
        assert device_name(bad) is None
