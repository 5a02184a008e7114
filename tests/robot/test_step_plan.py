"""When a foot is lifted, and when it stays: the plan by itself, tick by tick."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import op3
from hardware.errors import RetargetError
from messages import refuses, shows
from retarget.errors import ConfigError, UsageError
from retarget.model.robot import load_robot
from retarget.robot.step_plan import (
    CONTACT_WAIT_S,
    HELD_S,
    OVER_M,
    SWINGING,
    TRANSITIONS,
    WEIGHT,
    StepInput,
    StepPlan,
    StepState,
    stepping_priorities,
    with_steps,
)
from retarget.run.options import RunOptions
from retarget.schema.priorities import Priorities, load_priorities

SOLES = ("l_sole", "r_sole")


def test_two_levels_come_below_all_that_keeps_it_safe() -> None:
    before = load_priorities("balanced")
    names = [level.name for level in stepping_priorities(before, SOLES).levels]
    assert names.index("fixtures") + 1 == names.index(WEIGHT) == names.index(SWINGING) - 1
    assert names.index(SWINGING) < names.index("likeness")
    assert [name for name in names if name not in (WEIGHT, SWINGING)] == [level.name for level in before.levels]


def test_a_balance_at_rest_is_refused() -> None:
    with refuses(ConfigError):
        stepping_priorities(load_priorities("servo"), SOLES)


def test_soles_that_are_not_planted_are_refused() -> None:
    steady = load_priorities("balanced")
    level = steady.levels[0]
    for kept, missing in ((level.tasks[:1], "orientation"), (level.tasks[1:], "position")):
        levels = (level.model_copy(update={"tasks": kept}), *steady.levels[1:])
        with refuses(ConfigError, missing, "l_sole", "r_sole"):
            stepping_priorities(steady.model_copy(update={"levels": levels}), SOLES)


DT = 0.008
IDLE = StepInput(None, (-0.04, -0.04), outside=False, settled=True, down=False)
LIFTS = replace(IDLE, foot=0, settled=False)
OVER_LEFT = replace(LIFTS, over=(2.0 * OVER_M, -0.09))
TICKS = round(HELD_S / DT) + 2


def after(plan: StepPlan, now: StepInput, ticks: int = 1) -> StepState:
    for _ in range(ticks):
        plan.step(now, DT)
    return plan.state


def swinging() -> StepPlan:
    plan = StepPlan()
    assert after(plan, LIFTS, 50) is StepState.SHIFT_WEIGHT and (plan.support, plan.single_support) == (0, None)
    assert after(plan, OVER_LEFT, TICKS) is StepState.SWING
    return plan


def test_every_state_is_entered_and_left() -> None:
    for way in ("start", "end"):
        assert {getattr(transition, way) for transition in TRANSITIONS} == set(StepState)


def test_a_step_from_its_beginning_to_its_end() -> None:
    plan = swinging()
    assert after(plan, OVER_LEFT, 100) is StepState.SWING and (plan.support, plan.single_support) == (0, 0)
    back = replace(OVER_LEFT, foot=None)
    assert after(plan, back, 100) is StepState.TOUCHDOWN, "not before it is down"
    assert after(plan, replace(back, down=True)) is StepState.RETURN_WEIGHT and plan.single_support is None
    assert after(plan, replace(back, settled=False)) is StepState.RETURN_WEIGHT
    assert after(plan, IDLE) is StepState.DOUBLE_SUPPORT
    assert (plan.tally.asked, plan.tally.made, plan.tally.declined) == (1, 1, 0)


def test_a_sole_is_planted_again_on_contact_or_after_the_wait() -> None:
    back = replace(OVER_LEFT, foot=None, down=True, contact=(True, False))
    plan = swinging()
    assert after(plan, back, round(0.5 * CONTACT_WAIT_S / DT)) is StepState.TOUCHDOWN
    assert after(plan, replace(back, contact=(True, True))) is StepState.RETURN_WEIGHT
    plan = swinging()
    assert after(plan, back, round(0.9 * CONTACT_WAIT_S / DT)) is StepState.TOUCHDOWN
    assert after(plan, back, round(0.2 * CONTACT_WAIT_S / DT)) is StepState.RETURN_WEIGHT


def test_no_weight_goes_to_a_sole_without_contact() -> None:
    plan = StepPlan()
    assert after(plan, replace(OVER_LEFT, contact=(False, True)), 10 * TICKS) is StepState.SHIFT_WEIGHT
    assert after(plan, replace(OVER_LEFT, contact=(True, False)), TICKS) is StepState.SWING


def test_no_foot_lifts_before_one_leg_can_carry() -> None:
    plan = StepPlan()
    assert after(plan, replace(OVER_LEFT, risen=False), 10 * TICKS) is StepState.SHIFT_WEIGHT


def test_the_weight_is_held_over_the_foot_before_the_other_lifts() -> None:
    plan = StepPlan()
    for _ in range(20):  # there, and gone again too soon
        after(plan, OVER_LEFT, TICKS // 2)
        assert after(plan, LIFTS) is StepState.SHIFT_WEIGHT


def test_a_step_faster_than_the_weight_is_declined() -> None:
    plan = StepPlan()
    after(plan, LIFTS, 20)
    assert after(plan, replace(IDLE, settled=False)) is StepState.RETURN_WEIGHT
    assert (plan.tally.asked, plan.tally.made, plan.tally.declined) == (1, 0, 1)
    after(plan, replace(LIFTS, foot=1), 20)
    assert plan.support == 1 and plan.tally.asked == 2
    after(plan, LIFTS, 5)
    assert plan.support == 0 and (plan.tally.asked, plan.tally.made) == (3, 0)


@settings(max_examples=50)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([None, 0, 1]),
            st.tuples(st.sampled_from([-0.04, 0.01]), st.sampled_from([-0.04, 0.01])),
            st.booleans(),
            st.booleans(),
            st.tuples(st.booleans(), st.booleans()),
            st.integers(1, 40),
        ),
        max_size=30,
    )
)
def test_whatever_happens_weight_is_over_a_lone_foot_and_the_counts_agree(
    story: list[tuple[int | None, tuple[float, float], bool, bool, tuple[bool, bool], int]],
) -> None:
    plan = StepPlan()
    for foot, over, settled, down, contact, ticks in story:
        for _ in range(ticks):
            before, alone = plan.state, plan.single_support
            plan.step(StepInput(foot, over, False, settled, down, contact), DT)
            if alone is None and plan.single_support is not None:
                assert before is StepState.SHIFT_WEIGHT and over[plan.single_support] > OVER_M
                assert contact[plan.single_support]
            if alone is not None and plan.single_support is None:
                assert down and plan.state is StepState.RETURN_WEIGHT
    assert 0 <= plan.tally.made <= plan.tally.asked and plan.tally.declined >= 0


BALANCED = Path(__file__).parent.parent.parent / "configs" / "priorities" / "balanced.yaml"


def written(folder: Path, steps: str) -> Priorities:
    file = folder / "mine.yaml"
    file.write_text(f"steps: {steps}\n" + BALANCED.read_text())
    return load_priorities(file)


def test_the_option_goes_before_the_file(tmp_path: Path) -> None:
    mine = written(tmp_path, "shift")
    assert with_steps(mine, op3(), None, parts="whole")[0].steps == "shift"
    assert with_steps(mine, op3(), "planted", parts="whole")[0].steps == "planted"
    steady = load_priorities("balanced")
    assert with_steps(steady, op3(), None, parts="whole") == (steady, ()) and steady.steps is None


@pytest.mark.parametrize(
    ("robot", "why"),
    [("op3", ()), ("wolfgang", ()), ("toddlerbot", ("left_hip_roll", "1.36", "76%")), ("poppy", "3.3 mm off")],
)
def test_a_robot_that_cannot_stand_on_one_leg_stays_planted_and_says_so(robot: str, why: str | tuple[str, ...]) -> None:
    """ToddlerBot's hips are too weak; Poppy's ankles do not roll, so its mass does not get over one sole."""
    priorities, notes = with_steps(load_priorities("balanced_sustained"), load_robot(robot), "shift", parts="whole")
    assert priorities.steps == ("planted" if why else "shift") and len(notes) == bool(why)
    if why:
        shows(notes[0], *([why] if isinstance(why, str) else why))


def test_a_file_with_another_word_is_refused_with_its_line(tmp_path: Path) -> None:
    with refuses(ConfigError, "mine.yaml", "1"):
        written(tmp_path, "hop")


@pytest.mark.parametrize(
    ("steps", "root", "parts", "fault"),
    [
        ("follow", "free", "whole", "shift"),
        ("shift", "suspended", "whole", "follow"),
        ("shift", "free", "upper", "whole"),
    ],
)
def test_what_a_robot_cannot_do_is_refused(tmp_path: Path, steps: str, root: str, parts: str, fault: str) -> None:
    assert root in ("free", "suspended") and steps in ("follow", "shift")
    robot = load_robot("op3", root="free" if root == "free" else "suspended")
    asked = "follow" if steps == "follow" else "shift"
    with refuses(UsageError, "--steps", fault):
        with_steps(load_priorities("balanced"), robot, asked, parts=parts)  # type: ignore[arg-type]
    with refuses(ConfigError, "priorities", fault):
        with_steps(written(tmp_path, steps), robot, None, parts=parts)


def test_options_are_checked_before_any_file() -> None:
    for options, facts in (
        ({"steps": "walk"}, ("walk", "planted, shift, follow")),
        ({"steps": "shift", "parts": "upper"}, "--parts upper"),
    ):
        with refuses(RetargetError, facts):
            RunOptions(robot="op3", **options)  # type: ignore[arg-type]
    with refuses(UsageError):
        RunOptions(robot="human", steps="shift")
