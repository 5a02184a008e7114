"""When a foot is lifted, and when it stays: the plan by itself, tick by tick."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.carrying_feet import Carrying
from retarget.step_plan import HELD_S, OVER_M, UNFELT_S, Sight, StepPlan, StepState

DT = 0.008
IDLE = Sight(Carrying.BOTH, (-0.04, -0.04), settled=True, down=True)
LIFTS = replace(IDLE, performer=Carrying.LEFT, settled=False)
OVER_LEFT = replace(LIFTS, over=(2.0 * OVER_M, -0.09))
TICKS = round(HELD_S / DT) + 2


def told(plan: StepPlan, sight: Sight, ticks: int = 1) -> StepState:
    for _ in range(ticks):
        plan.look(sight, DT)
    return plan.state


def swinging() -> StepPlan:
    plan = StepPlan()
    assert told(plan, LIFTS, 50) is StepState.SHIFT and plan.onto == 0 and plan.feet == (True, True)
    assert told(plan, OVER_LEFT, TICKS) is StepState.SWING
    return plan


def test_a_step_from_its_beginning_to_its_end() -> None:
    plan = swinging()
    assert plan.feet == (True, False)
    off = replace(OVER_LEFT, down=False)
    assert told(plan, off, 100) is StepState.SWING
    back = replace(off, performer=Carrying.BOTH)
    assert told(plan, back) is StepState.SWING and plan.lowers, "not before it is down"
    assert told(plan, replace(back, down=True)) is StepState.BACK and plan.feet == (True, True)
    assert told(plan, replace(back, settled=False)) is StepState.BACK
    assert told(plan, replace(IDLE, settled=True)) is StepState.BOTH
    assert (plan.tally.asked, plan.tally.made, plan.tally.declined) == (1, 1, 0)


def test_a_sole_is_locked_again_when_it_feels_the_floor_or_has_been_waited_for() -> None:
    back = replace(OVER_LEFT, performer=Carrying.BOTH, felt=(True, False))
    plan = swinging()
    assert told(plan, back, round(0.5 * UNFELT_S / DT)) is StepState.SWING
    assert told(plan, replace(back, felt=(True, True))) is StepState.BACK
    plan = swinging()
    told(plan, back, round(0.9 * UNFELT_S / DT))
    assert told(plan, back) is StepState.SWING and told(plan, back, round(0.2 * UNFELT_S / DT)) is StepState.BACK


def test_no_weight_is_trusted_to_a_sole_that_does_not_feel_the_floor() -> None:
    plan = StepPlan()
    assert told(plan, replace(OVER_LEFT, felt=(False, True)), 10 * TICKS) is StepState.SHIFT
    assert told(plan, replace(OVER_LEFT, felt=(True, False)), TICKS) is StepState.SWING


def test_the_weight_is_held_over_the_foot_before_the_other_lifts() -> None:
    plan = StepPlan()
    for _ in range(20):  # there, and gone again before it is believed
        told(plan, OVER_LEFT, TICKS // 2)
        assert told(plan, LIFTS) is StepState.SHIFT


def test_who_is_faster_than_the_weight_is_declined() -> None:
    plan = StepPlan()
    told(plan, LIFTS, 20)
    assert told(plan, replace(IDLE, settled=False)) is StepState.BACK
    assert (plan.tally.asked, plan.tally.made, plan.tally.declined) == (1, 0, 1)
    told(plan, replace(LIFTS, performer=Carrying.RIGHT), 20)
    assert plan.onto == 1 and plan.tally.asked == 2
    told(plan, LIFTS, 5)
    assert plan.onto == 0 and (plan.tally.asked, plan.tally.made) == (3, 0)


def test_in_flight_it_stays_planted_and_comes_down() -> None:
    plan = StepPlan()
    assert told(plan, replace(IDLE, performer=Carrying.FLIGHT), 50) is StepState.BOTH
    plan = swinging()
    told(plan, replace(OVER_LEFT, performer=Carrying.FLIGHT, down=False))
    assert plan.lowers


def test_a_foot_that_comes_down_is_put_down_before_it_lifts_again() -> None:
    plan = swinging()
    told(plan, replace(OVER_LEFT, performer=Carrying.BOTH, down=False))
    assert told(plan, replace(OVER_LEFT, down=False), 50) is StepState.SWING and plan.lowers
    assert told(plan, OVER_LEFT) is StepState.BACK
    assert told(plan, OVER_LEFT, TICKS) is StepState.SWING and plan.tally.made == 2


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
    for performer, over, settled, down, felt, ticks in story:
        for _ in range(ticks):
            before, feet = plan.state, plan.feet
            plan.look(Sight(performer, over, settled, down, felt), DT)
            assert any(plan.feet)
            if feet == (True, True) and plan.feet != feet:
                assert before is StepState.SHIFT and plan.onto is not None and over[plan.onto] > OVER_M
                assert felt[plan.onto]
            if feet != (True, True) and plan.feet == (True, True):
                assert down and plan.state is StepState.BACK
    assert 0 <= plan.tally.made <= plan.tally.asked and plan.tally.declined >= 0
