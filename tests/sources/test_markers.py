"""Marker groups as data."""

from retarget.frames import SENSORS
from retarget.sources.c3d import KNOWN_MARKERS, MARKER_GROUPS, groups_in, marker_name


def test_groups_are_those_of_sensors_and_sides_do_not_mix() -> None:
    assert set(MARKER_GROUPS) <= set(SENSORS)
    for sensor, groups in MARKER_GROUPS.items():
        assert all(len(set(group)) == len(group) > 0 for group in groups)
        if sensor[1] == "_":
            assert {name[0] for group in groups for name in group} == {sensor[0].upper()}


def test_the_first_whole_group_counts() -> None:
    assert groups_in(["LWRA", "LWRB"]) == {"l_wrist": ("LWRA", "LWRB")}
    assert groups_in(["LWRA"]) == {"l_wrist": ("LWRA",)}
    assert groups_in(["LASI", "RASI", "SACR"]) == {"pelvis": ("LASI", "RASI", "SACR")}
    assert groups_in([]) == {} == groups_in(["LFHD"])


def test_plug_in_gait_and_the_cmu_set_give_fifteen_sensors() -> None:
    limbs = {f"{s}{name}" for s in "LR" for name in ("WRA", "WRB", "ELB", "SHO", "KNE", "ANK", "TOE", "FHD", "BHD")}
    torso = {"C7", "T10", "CLAV", "STRN"}
    for waist in ({"LASI", "RASI", "LPSI", "RPSI"}, {"LFWT", "RFWT", "LBWT", "RBWT"}):
        assert len(groups_in(limbs | torso | waist)) == 15


def test_names_come_without_subject_and_in_upper_case() -> None:
    assert marker_name("TakeoMonday:LAnk ") == "LANK" and marker_name("a:b:c7") == "C7"
    assert "LANK" in KNOWN_MARKERS and "LFIN" not in KNOWN_MARKERS
