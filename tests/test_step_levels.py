"""The levels of a robot that steps, and which priorities it refuses."""

from followers import op3
from retarget.errors import ConfigError
from retarget.priorities import load_priorities
from retarget.robot_reader import robot_frames
from retarget.step_levels import SWINGING, WEIGHT, stepping_priorities, swinging, swinging_frames
from support.messages import refuses

SOLES = ("l_sole", "r_sole")


def test_two_levels_come_below_all_that_keeps_it_safe() -> None:
    before = load_priorities("steady")
    names = [level.name for level in stepping_priorities(before, SOLES).levels]
    assert names.index("fixtures") + 1 == names.index(WEIGHT) == names.index(SWINGING) - 1
    assert names.index(SWINGING) < names.index("hands and trunk")
    assert [name for name in names if name not in (WEIGHT, SWINGING)] == [level.name for level in before.levels]


def test_a_sole_that_swings_has_another_name_for_the_same_frame() -> None:
    frames = swinging_frames(robot_frames(op3()), SOLES)
    assert frames[swinging("l_sole")] is frames["l_sole"]


def test_a_balance_at_rest_is_refused() -> None:
    with refuses(ConfigError):
        stepping_priorities(load_priorities("servo"), SOLES)


def test_soles_that_are_not_planted_are_refused() -> None:
    steady = load_priorities("steady")
    level = steady.levels[0]
    for kept, missing in ((level.tasks[:1], "orientation"), (level.tasks[1:], "position")):
        levels = (level.model_copy(update={"tasks": kept}), *steady.levels[1:])
        with refuses(ConfigError, missing, "l_sole", "r_sole"):
            stepping_priorities(steady.model_copy(update={"levels": levels}), SOLES)
