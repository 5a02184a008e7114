"""`steps` of a priority file and of the command line: one setting, and what refuses it."""

from pathlib import Path

import pytest

from followers import op3
from retarget.errors import ConfigError, RetargetError, UsageError
from retarget.options import RunOptions
from retarget.priorities import Priorities, load_priorities
from retarget.priority_choice import priority_names
from retarget.robot_body import load_robot
from retarget.step_setting import with_steps
from support.messages import refuses, shows

STEADY = Path(__file__).parent.parent / "configs" / "priorities" / "steady.yaml"


def written(folder: Path, steps: str) -> Priorities:
    file = folder / "mine.yaml"
    file.write_text(f"steps: {steps}\n" + STEADY.read_text())
    return load_priorities(file)


def test_the_option_goes_before_the_file(tmp_path: Path) -> None:
    mine = written(tmp_path, "shift")
    assert with_steps(mine, op3(), None, parts="whole")[0].steps == "shift"
    assert with_steps(mine, op3(), "planted", parts="whole")[0].steps == "planted"
    steady = load_priorities("steady")
    assert with_steps(steady, op3(), None, parts="whole") == (steady, ()) and steady.steps is None


@pytest.mark.parametrize(("robot", "steps"), [("op3", "shift"), ("wolfgang", "shift"), ("toddlerbot", "planted")])
def test_a_robot_that_is_too_weak_for_one_leg_stays_planted_and_says_so(robot: str, steps: str) -> None:
    priorities, notes = with_steps(load_priorities("lasting"), load_robot(robot), "shift", parts="whole")
    assert priorities.steps == steps
    if steps == "shift":
        assert notes == ()
    else:
        assert len(notes) == 1
        shows(notes[0], "left_hip_roll", "1.36", "76%")


def test_a_file_with_another_word_is_refused_with_its_line(tmp_path: Path) -> None:
    with refuses(ConfigError, "mine.yaml", "1"):
        written(tmp_path, "hop")


@pytest.mark.parametrize(
    ("steps", "root", "parts", "says"),
    [
        ("follow", "free", "whole", "shift"),
        ("shift", "suspended", "whole", "follow"),
        ("shift", "free", "upper", "whole"),
    ],
)
def test_what_a_robot_cannot_do_is_refused(tmp_path: Path, steps: str, root: str, parts: str, says: str) -> None:
    assert root in ("free", "suspended") and steps in ("follow", "shift")
    robot = load_robot("op3", root="free" if root == "free" else "suspended")
    asked = "follow" if steps == "follow" else "shift"
    with refuses(UsageError, "--steps", says):
        with_steps(load_priorities("steady"), robot, asked, parts=parts)  # type: ignore[arg-type]
    with refuses(ConfigError, "priorities", says):
        with_steps(written(tmp_path, steps), robot, None, parts=parts)


def test_a_robot_that_hangs_may_follow() -> None:
    robot = load_robot("op3", root="suspended")
    assert with_steps(load_priorities("steady"), robot, "follow", parts="whole")[0].steps == "follow"


def test_options_are_checked_before_any_file() -> None:
    for options, facts in (
        ({"steps": "walk"}, ("walk", "planted, shift, follow")),
        ({"steps": "shift", "parts": "upper"}, "--parts upper"),
    ):
        with refuses(RetargetError, facts):
            RunOptions(robot="op3", **options)  # type: ignore[arg-type]
    with refuses(UsageError):
        RunOptions(robot="human", steps="shift")


def test_who_steps_has_mass() -> None:
    assert priority_names(op3(), RunOptions(robot="op3", steps="shift"))[1] == "steady"
    assert priority_names(op3(), RunOptions(robot="op3", steps="planted"))[1] == "servo"
