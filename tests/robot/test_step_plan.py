"""When a foot is lifted, and when it stays: the plan by itself, tick by tick."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import DT as STEP_BALANCE_DT
from followers import op3
from hardware.errors import RetargetError
from messages import refuses, shows
from retarget.errors import ConfigError, UsageError
from retarget.ik.support_polygon import convex_hull, plant, support_distance, support_edges
from retarget.model.robot import load_robot
from retarget.robot.balance import GRAVITY
from retarget.robot.posture_reader import robot_frames
from retarget.robot.step_plan import (
    CONTACT_WAIT_S,
    HELD_S,
    MOST_CORNERS,
    OVER_M,
    SWINGING,
    WEIGHT,
    Sight,
    StepBalance,
    StepPlan,
    StepState,
    at_most,
    balance_in_motion,
    stepping_priorities,
    swinging_frames,
    with_steps,
)
from retarget.robot.step_plan import swinging as step_levels_swinging
from retarget.run.options import RunOptions, priority_names
from retarget.schema.priorities import Priorities, load_priorities
from retarget.types import Carrying

STANCE = plant(op3(), op3().profile.postures.stand)
BALANCE = StepBalance(STANCE, 0.25)
STILL = np.zeros(3)


def depth(region: list[list[float]], x: float, y: float) -> float:
    return BALANCE.depth(region, np.array([x, y, 0.25]), STILL, STILL)


def test_each_region_lies_in_what_carries_and_all_in_the_way() -> None:
    for foot, (region, sole) in enumerate(zip(BALANCE.over, STANCE.soles, strict=True)):
        assert depth(region, *BALANCE.middles[1 + foot].tolist()) > 0.0
        edges = np.array(region)
        corners = convex_hull(sole.outline)
        inward = BALANCE.middles[1 + foot] + 0.25 * (corners - BALANCE.middles[1 + foot])
        assert np.abs(support_distance(inward, edges)).max() < 1e-9
        assert (support_distance(inward, np.array(BALANCE.on_the_way)) > -1e-9).all()
    assert depth(BALANCE.both, 0.0, 0.0) > 0.01 and depth(BALANCE.over[0], 0.0, 0.0) < -0.03
    assert len(BALANCE.on_the_way) <= MOST_CORNERS


def test_capture_point_and_zero_moment_point_count() -> None:
    over = np.array([*BALANCE.middles[1], 0.25])
    time = np.sqrt(0.25 / GRAVITY)
    still = BALANCE.depth(BALANCE.over[0], over, STILL, STILL)
    moving = BALANCE.depth(BALANCE.over[0], over, np.array([0.0, 0.01, 0.0]), STILL)
    pushed = BALANCE.depth(BALANCE.over[0], over, STILL, np.array([0.0, -0.1, 0.0]))
    assert abs(still - moving - 0.01 * time) < 1e-9
    assert abs(still - pushed - 0.1 * 0.25 / GRAVITY) < 1e-9


def test_on_the_way_height_is_no_way_out() -> None:
    """A robot that may not go aside fast enough gets there no sooner by throwing up its mass."""
    com = np.array([*BALANCE.middles[1], 0.25])
    assert (BALANCE.spaces(BALANCE.on_the_way, com, STILL, STEP_BALANCE_DT)[:, 2] == 0.0).all()
    both = BALANCE.spaces(BALANCE.both, np.array([0.0, 0.0, 0.25]), STILL, STEP_BALANCE_DT)
    assert (both[1::2, 2] != 0.0).all(), "standing keeps the law of `standing_balance`"
    inside = BALANCE.spaces(BALANCE.on_the_way, com, STILL, STEP_BALANCE_DT) @ np.append(com, -1.0)
    assert (inside < 0.0).all()


def test_from_the_edge_of_the_way_a_mass_at_rest_may_be_pushed_back() -> None:
    """Its zero-moment point has to go beyond that edge for it."""
    for nx, ny, offset in BALANCE.on_the_way:
        at = np.array([nx * offset, ny * offset])
        com = np.array([*at, 0.25])
        back = com - np.array([nx, ny, 0.0]) * GRAVITY / 0.25 * 0.003 * STEP_BALANCE_DT**2  # as from 3 mm farther out
        spaces = BALANCE.spaces(BALANCE.on_the_way, com, STILL, STEP_BALANCE_DT)
        across = spaces[:, :2] @ np.array([nx, ny])
        assert (spaces[np.abs(across) > 0.999] @ np.append(back, -1.0) <= 0.0).all()


@given(x=st.floats(-0.2, 0.2), y=st.floats(-0.2, 0.2))
def test_a_place_is_inside_and_what_is_inside_stays(x: float, y: float) -> None:
    place = BALANCE.place(np.array([x, y]))
    assert depth(BALANCE.both, *place.tolist()) > 0.0
    again = BALANCE.place(place)
    assert np.abs(again - place).max() < 1e-9


def test_distance_is_to_the_outline_of_what_carries() -> None:
    com = np.array([0.0, 0.0, 0.25])
    assert BALANCE.inside(com, (True, True)) > 0.05
    assert BALANCE.inside(com, (True, False)) < 0.0 and BALANCE.inside(com, (False, True)) < 0.0
    left = np.array([*BALANCE.middles[1], 0.25])
    assert BALANCE.inside(left, (True, False)) > 0.03 > BALANCE.inside(left, (False, True))


def test_a_polygon_of_fewer_corners_is_never_larger() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    less = at_most(circle, 16)
    assert len(less) == 16
    assert (support_distance(less, support_edges([circle])) > -1e-12).all()


def test_which_priorities_look_at_motion() -> None:
    assert balance_in_motion(load_priorities("balanced")) == 0.22
    assert balance_in_motion(load_priorities("servo")) is None


SOLES = ("l_sole", "r_sole")


def test_two_levels_come_below_all_that_keeps_it_safe() -> None:
    before = load_priorities("balanced")
    names = [level.name for level in stepping_priorities(before, SOLES).levels]
    assert names.index("fixtures") + 1 == names.index(WEIGHT) == names.index(SWINGING) - 1
    assert names.index(SWINGING) < names.index("hands and trunk")
    assert [name for name in names if name not in (WEIGHT, SWINGING)] == [level.name for level in before.levels]


def test_a_sole_that_swings_has_another_name_for_the_same_frame() -> None:
    frames = swinging_frames(robot_frames(op3()), SOLES)
    assert frames[step_levels_swinging("l_sole")] is frames["l_sole"]


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
IDLE = Sight(Carrying.BOTH, (-0.04, -0.04), settled=True, down=True)
LIFTS = replace(IDLE, performer=Carrying.LEFT, settled=False)
OVER_LEFT = replace(LIFTS, over=(2.0 * OVER_M, -0.09))
TICKS = round(HELD_S / DT) + 2


def looked(plan: StepPlan, sight: Sight, ticks: int = 1) -> StepState:
    for _ in range(ticks):
        plan.look(sight, DT)
    return plan.state


def swinging() -> StepPlan:
    plan = StepPlan()
    assert looked(plan, LIFTS, 50) is StepState.SHIFT and plan.onto == 0 and plan.feet == (True, True)
    assert looked(plan, OVER_LEFT, TICKS) is StepState.SWING
    return plan


def test_a_step_from_its_beginning_to_its_end() -> None:
    plan = swinging()
    assert plan.feet == (True, False)
    off = replace(OVER_LEFT, down=False)
    assert looked(plan, off, 100) is StepState.SWING
    back = replace(off, performer=Carrying.BOTH)
    assert looked(plan, back) is StepState.SWING and plan.lowers, "not before it is down"
    assert looked(plan, replace(back, down=True)) is StepState.BACK and plan.feet == (True, True)
    assert looked(plan, replace(back, settled=False)) is StepState.BACK
    assert looked(plan, replace(IDLE, settled=True)) is StepState.BOTH
    assert (plan.tally.asked, plan.tally.made, plan.tally.declined) == (1, 1, 0)


def test_a_sole_is_locked_again_on_contact_or_after_the_wait() -> None:
    back = replace(OVER_LEFT, performer=Carrying.BOTH, contact=(True, False))
    plan = swinging()
    assert looked(plan, back, round(0.5 * CONTACT_WAIT_S / DT)) is StepState.SWING
    assert looked(plan, replace(back, contact=(True, True))) is StepState.BACK
    plan = swinging()
    looked(plan, back, round(0.9 * CONTACT_WAIT_S / DT))
    assert (
        looked(plan, back) is StepState.SWING and looked(plan, back, round(0.2 * CONTACT_WAIT_S / DT)) is StepState.BACK
    )


def test_no_weight_goes_to_a_sole_without_contact() -> None:
    plan = StepPlan()
    assert looked(plan, replace(OVER_LEFT, contact=(False, True)), 10 * TICKS) is StepState.SHIFT
    assert looked(plan, replace(OVER_LEFT, contact=(True, False)), TICKS) is StepState.SWING


def test_the_weight_is_held_over_the_foot_before_the_other_lifts() -> None:
    plan = StepPlan()
    for _ in range(20):  # there, and gone again before it is believed
        looked(plan, OVER_LEFT, TICKS // 2)
        assert looked(plan, LIFTS) is StepState.SHIFT


def test_a_step_faster_than_the_weight_is_declined() -> None:
    plan = StepPlan()
    looked(plan, LIFTS, 20)
    assert looked(plan, replace(IDLE, settled=False)) is StepState.BACK
    assert (plan.tally.asked, plan.tally.made, plan.tally.declined) == (1, 0, 1)
    looked(plan, replace(LIFTS, performer=Carrying.RIGHT), 20)
    assert plan.onto == 1 and plan.tally.asked == 2
    looked(plan, LIFTS, 5)
    assert plan.onto == 0 and (plan.tally.asked, plan.tally.made) == (3, 0)


def test_in_flight_it_stays_planted_and_comes_down() -> None:
    plan = StepPlan()
    assert looked(plan, replace(IDLE, performer=Carrying.FLIGHT), 50) is StepState.BOTH
    plan = swinging()
    looked(plan, replace(OVER_LEFT, performer=Carrying.FLIGHT, down=False))
    assert plan.lowers


def test_a_foot_that_comes_down_is_put_down_before_it_lifts_again() -> None:
    plan = swinging()
    looked(plan, replace(OVER_LEFT, performer=Carrying.BOTH, down=False))
    assert looked(plan, replace(OVER_LEFT, down=False), 50) is StepState.SWING and plan.lowers
    assert looked(plan, OVER_LEFT) is StepState.BACK
    assert looked(plan, OVER_LEFT, TICKS) is StepState.SWING and plan.tally.made == 2


@settings(max_examples=50)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(list(Carrying)),
            st.tuples(st.sampled_from([-0.04, 0.01]), st.sampled_from([-0.04, 0.01])),
            st.booleans(),
            st.booleans(),
            st.tuples(st.booleans(), st.booleans()),
            st.integers(1, 40),
        ),
        max_size=30,
    )
)
def test_whatever_happens_one_sole_is_locked_and_the_counts_agree(
    story: list[tuple[Carrying, tuple[float, float], bool, bool, tuple[bool, bool], int]],
) -> None:
    plan = StepPlan()
    for performer, over, settled, down, contact, ticks in story:
        for _ in range(ticks):
            before, feet = plan.state, plan.feet
            plan.look(Sight(performer, over, settled, down, contact), DT)
            assert any(plan.feet)
            if feet == (True, True) and plan.feet != feet:
                assert before is StepState.SHIFT and plan.onto is not None and over[plan.onto] > OVER_M
                assert contact[plan.onto]
            if feet != (True, True) and plan.feet == (True, True):
                assert down and plan.state is StepState.BACK
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


@pytest.mark.parametrize(("robot", "steps"), [("op3", "shift"), ("wolfgang", "shift"), ("toddlerbot", "planted")])
def test_a_robot_that_is_too_weak_for_one_leg_stays_planted_and_says_so(robot: str, steps: str) -> None:
    priorities, notes = with_steps(load_priorities("balanced_sustained"), load_robot(robot), "shift", parts="whole")
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


def test_a_robot_that_hangs_may_follow() -> None:
    robot = load_robot("op3", root="suspended")
    assert with_steps(load_priorities("balanced"), robot, "follow", parts="whole")[0].steps == "follow"


def test_options_are_checked_before_any_file() -> None:
    for options, facts in (
        ({"steps": "walk"}, ("walk", "planted, shift, follow")),
        ({"steps": "shift", "parts": "upper"}, "--parts upper"),
    ):
        with refuses(RetargetError, facts):
            RunOptions(robot="op3", **options)  # type: ignore[arg-type]
    with refuses(UsageError):
        RunOptions(robot="human", steps="shift")


def test_a_robot_that_steps_has_mass() -> None:
    assert priority_names(op3(), RunOptions(robot="op3", steps="shift"))[1] == "balanced"
    assert priority_names(op3(), RunOptions(robot="op3", steps="planted"))[1] == "servo"
