"""Sensors that are missing, or told and not to be believed."""

import pytest

from doctor_rig import heard, json_poses, mends, played, steady, text_of
from live_rig import five
from retarget.doctor.role_findings import role_findings
from retarget.doctor.stream_findings import named_for
from retarget.performer import load_performer
from sim.faults.sender import SenderFault, frozen, lost, moved, swapped
from support.messages import shows, shows_lines


def found_with(*faults: SenderFault) -> str:
    return "\n".join(mends(role_findings(five(), "json", heard(*faults))))


def test_all_is_well() -> None:
    found = role_findings(five(), "json", heard())
    assert not mends(found)
    shows(text_of(found), "head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")


def test_one_that_is_missing_is_named_with_what_comes_instead() -> None:
    lines = found_with(lost("l_ankle", 0.0, 99.0))
    shows(lines, "l_ankle", "head", "--performer")


@pytest.mark.parametrize(
    ("fault", "who", "words"),
    [
        (frozen("l_wrist", 3.0, 99.0), "l_wrist", "repeats one value"),
        (moved("head", 3.0, 99.0, (50.0, 0.0, 0.0)), "head", "outside the room"),
        (moved("r_wrist", 3.0, 3.9, (1.5, 0.0, 0.5)), "r_wrist", "jumps"),
        (swapped("l_wrist", "r_wrist", 4.0, 99.0), "l_wrist, r_wrist", "change places"),
        (lost("head", 3.0, 99.0), "head", "cannot be used"),
    ],
)
def test_each_doubt_names_its_sensor_alone(fault: SenderFault, who: str, words: str) -> None:
    lines = found_with(fault).splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith(f"mend {who}: ") and words in lines[0]


def test_all_in_millimetres_is_one_line() -> None:
    poses = {name: {"p": [500.0, 20.0 * row, 1500.0]} for row, name in enumerate(five().sensors)}
    lines = mends(role_findings(five(), "json", played(steady(json_poses(1.0, poses), seconds=3.0))))
    assert sum("unit (metres)" in line for line in lines) == 1


def test_names_of_the_senders_own_need_roles() -> None:
    listening = played(steady(json_poses(1.0, {"Head": {"p": [0, 0, 1]}})))
    shows("\n".join(mends(role_findings(five(), "json", listening))), "`role`")


def test_vrchat_has_no_wrists() -> None:
    named = named_for(five(), "slimevr_vrchat")
    assert named.sensors["l_wrist"].role == "?" and named.sensors["head"].role is None
    optitrack = load_performer("optitrack")
    assert named_for(optitrack, "natnet") == optitrack


def test_nothing_is_said_of_nothing() -> None:
    assert role_findings(five(), "json", played([])) == []


def test_who_takes_what_there_is_misses_only_what_measures() -> None:
    everything = load_performer("all")
    found = role_findings(everything, "json", heard(lost("l_toe", 0.0, 99.0), performer=everything))
    assert not mends(found)
    shows(text_of(found), "l_toe")
    lines = mends(role_findings(everything, "json", heard(lost("head", 0.0, 99.0), performer=everything)))
    shows_lines(lines, "head")
