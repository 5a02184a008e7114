"""Which priorities a run takes: what was tried in physics is what real servos get."""

from dataclasses import replace

import pytest

from retarget.options import RunOptions
from retarget.priority_choice import name_with_mass, priority_names
from retarget.robot_body import load_robot


@pytest.mark.parametrize(("name", "usual"), [("toddlerbot", "lasting"), ("op3", "steady")])
def test_a_profile_names_the_priorities_of_a_robot_with_mass(name: str, usual: str) -> None:
    robot = load_robot(name)
    for bus in ("physics", "physics+wire", "profile", "/dev/ttyUSB0"):
        assert priority_names(robot, RunOptions(robot=name, bus=bus))[-1] == usual
        assert priority_names(robot, RunOptions(robot=name, bus=bus, priorities="paper"))[-1] == "paper"
    for bus in ("mock", "emulator"):
        assert priority_names(robot, RunOptions(robot=name, bus=bus))[-1] == "servo"


def test_only_the_priorities_that_look_at_no_motion_are_replaced() -> None:
    def named(retarget: str, *, standing: str | None, hangs: bool) -> str:
        robot = load_robot("op3", root="suspended" if hangs else "free")
        profile = robot.profile.model_copy(update={"retarget": retarget, "standing": standing})
        return name_with_mass(replace(robot, profile=profile))

    assert named("servo", standing=None, hangs=False) == "steady"
    assert named("servo", standing=None, hangs=True) == "held"
    assert named("mine", standing=None, hangs=False) == named("mine", standing=None, hangs=True) == "mine"
    assert named("mine", standing="lasting", hangs=False) == "lasting"
    assert named("mine", standing="lasting", hangs=True) == "mine"
