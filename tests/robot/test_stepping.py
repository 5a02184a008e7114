"""A follower that steps in place: its soles, its balance and its limits, on postures alone; then with mass."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from followers import DT, Followed, assert_within_limits, balance_margin, collect, dimensions, op3, performer, postures
from hardware.clock import VirtualClock
from retarget.cli.buses import PhysicsBench
from retarget.cli.exit import StopRequest
from retarget.cli.operator import RunOperator
from retarget.human.samples import Playback
from retarget.ik.gravity_torque import GRAVITY, GravityTorque
from retarget.ik.support_polygon import convex_hull, plant, support_distance
from retarget.ik.tasks import SUPPORT_EDGES
from retarget.report.measure import measure
from retarget.robot.balance import HEAVE_ROWS, SUSTAINED, Room, StandingStrength, inside
from retarget.robot.follower import Follower
from retarget.robot.step_plan import CONTACT_WAIT_S, StepState
from retarget.robot.stepping import ACCELERATION, HIGH, LOW, SPEED, WAY, Glide, StepBalance, SwingFoot, WeightShift
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.schema.priorities import load_priorities
from retarget.sources.open import open_source
from retarget.types import Carrying, FloatArray, HumanPosture

BOTH, LEFT, RIGHT = Carrying.BOTH, Carrying.LEFT, Carrying.RIGHT
STANDS: HumanPosture = postures(performer())[0]


def stepper() -> Follower:
    priorities = load_priorities("balanced").model_copy(update={"steps": "shift"})
    return Follower(op3(), priorities, dimensions(performer()))


def lifting(carrying: Carrying, high: float = 0.3, low: float = 0.0) -> HumanPosture:
    """The performer, standing, one ankle lifted, and all but the ankles `low` m lower."""
    joints = STANDS.joints.copy()
    joints[["ankle" not in name for name in STANDS.joint_names], 2] -= low
    if carrying in (LEFT, RIGHT):
        joints[STANDS.joint_names.index("r_ankle" if carrying is LEFT else "l_ankle"), 2] += high
    return replace(STANDS, joints=joints, carrying=carrying)


def played(robot: Follower, story: Sequence[tuple[Carrying, float]], *, low: float = 0.0) -> Followed:
    """Each for so many seconds, `low` m below standing."""
    rows = [robot.start(STANDS)]
    for carrying, seconds in story:
        human = lifting(carrying, low=low)
        rows += [robot.step(human, DT) for _ in range(round(seconds / DT))]
    return collect(rows)


def state(robot: Follower) -> StepState:
    assert robot.steps is not None
    return robot.steps.plan.state


@cache
def two_steps() -> tuple[Follower, Followed]:
    robot = stepper()
    return robot, played(robot, ((BOTH, 0.5), (LEFT, 3.0), (RIGHT, 4.0), (BOTH, 3.5)))


def soles(q: FloatArray) -> FloatArray:
    """Places (T, 2, 3) m."""
    return op3().points(q, ("l_sole", "r_sole"))


def test_each_foot_is_lifted_in_turn_and_put_down_in_its_place() -> None:
    robot, done = two_steps()
    height = soles(done.q)[..., 2]
    assert robot.steps is not None and robot.steps.plan.state is StepState.DOUBLE_SUPPORT
    assert (robot.steps.plan.tally.asked, robot.steps.plan.tally.made) == (2, 2)
    assert (height.max(axis=0) > 0.03).all() and height.min() > -2e-4
    assert (height < 2e-4).any(axis=1).all(), "one is always down"
    places = np.array([sole.position for sole in robot.stance.soles])
    assert np.abs(soles(done.q[-1:])[0] - places).max() < 2e-4


def test_it_keeps_its_limits_and_the_sole_that_carries() -> None:
    robot, done = two_steps()
    assert_within_limits(done.joints)
    places = np.array([sole.position for sole in robot.stance.soles])
    off = np.linalg.norm(soles(done.q) - places, axis=2)
    assert off.min(axis=1).max() < 2e-4
    quats = op3().orientations(done.q, ("l_sole", "r_sole"))
    tilt = 2.0 * np.arcsin(np.hypot(quats[..., 1], quats[..., 2]))
    assert tilt.max() < 0.02


def test_no_foot_is_off_the_floor_before_the_balance_is_over_the_other() -> None:
    robot, done = two_steps()
    balance = StepBalance(robot.stance, 0.25)
    com = op3().body.solver_body().centre_of_mass(np.ascontiguousarray(done.q))
    velocity = np.gradient(com, DT, axis=0)
    height = soles(done.q)[..., 2]
    still = np.zeros(3)
    for foot in (0, 1):
        for row in np.flatnonzero(height[:, 1 - foot] > 5e-4):
            assert balance.depth(balance.over[foot], com[row], velocity[row], still) > 0.0
    assert balance_margin(robot, done.q) > 0.02


@pytest.mark.long
def test_a_crouched_robot_rises_to_what_one_leg_can_carry() -> None:
    """A performer who crouches, then on one foot: both knees share the crouch, and one leg alone could not hold it."""
    robot = stepper()
    done = played(robot, ((BOTH, 3.0), (LEFT, 4.0), (BOTH, 4.0)), low=0.35)
    strength, left = StandingStrength(op3(), robot.stance, share=SUSTAINED), robot.stance.soles[:1]
    on_left = GravityTorque(op3(), replace(robot.stance, soles=left))
    lifted = soles(done.q)[:, 1, 2] > 5e-4
    assert lifted.sum() * DT > 1.0 and state(robot) is StepState.DOUBLE_SUPPORT
    used = [np.abs(on_left.torques(q, np.zeros(3))[strength.dofs]) / strength.most for q in done.q[lifted]]
    assert np.max(used) < 1.15
    crouch = done.q[[round(3.0 / DT), -1], 2]
    assert np.ptp(crouch) < 2e-3 and done.q[lifted, 2].min() > crouch.max() + 0.02, (
        "on both feet it crouches as deep as ever"
    )
    assert_within_limits(done.joints)


def test_a_stop_on_one_foot_keeps_it_and_the_return_to_stance_ends_on_both() -> None:
    robot = stepper()
    played(robot, ((LEFT, 1.0),))
    assert robot.steps is not None and robot.steps.plan.state is StepState.SWING
    stop = robot.stop(DT)
    assert stop is not None and stop.contact == (True, False) and len(stop.postures) > 1
    assert np.abs(soles(stop.postures)[:, 0] - robot.stance.soles[0].position).max() < 1e-3
    landed: list[FloatArray] = []
    robot.begin_return_to_stance(stop.postures[-1], DT)
    while (q := robot.return_to_stance(DT)) is not None and len(landed) < 500:
        landed.append(q)
    assert len(landed) < 500 and robot.steps.stands
    assert np.abs(soles(np.array(landed[-1:]))[0, :, 2]).max() < 2e-4
    assert_within_limits(np.array(landed)[:, op3().servo_columns])


def leaning(away: float) -> FloatArray:
    """A posture (nq,) on both soles whose mass is so far (m) ahead of its room of standing."""
    body, stand = op3().body.solver_body(), op3().profile.postures.stand
    front = max(offset for nx, _, offset in StepBalance(STANCE, 0.22).both.capture_point if nx > 0.99)

    def lean(angle: float) -> FloatArray:
        at = stand | {f"{side}_ank_pitch": stand[f"{side}_ank_pitch"] + sign * angle for side, sign in SIDES}
        return plant(op3(), at).q

    def beyond(angle: float) -> float:
        return float(body.centre_of_mass(lean(angle)[None])[0, 0]) - front - away

    return lean(brentq(beyond, 0.0, 0.3))


SIDES = (("l", 1.0), ("r", -1.0))


@pytest.mark.parametrize("away", [0.004, 0.009])
def test_a_mass_that_was_stopped_outside_its_room_is_led_back_before_it_stands(away: float) -> None:
    robot, seen = stepper(), set()
    robot.start(STANDS)
    robot.begin_return_to_stance(leaning(away), DT)
    for _ in range(400):
        if robot.return_to_stance(DT) is None:
            break
        seen.add(state(robot))
    assert state(robot) is StepState.DOUBLE_SUPPORT and StepState.RETURN_WEIGHT in seen


@pytest.mark.long
def test_a_foot_without_contact_is_waited_for() -> None:
    took = []
    for contact in (None, (True, True), (True, False)):
        robot = stepper()
        played(robot, ((LEFT, 3.0),))
        robot.set_contact_state(None if contact is None else np.array(contact))
        ticks = 0
        while state(robot) in (StepState.SWING, StepState.TOUCHDOWN):
            q, ticks = robot.step(STANDS, DT).q, ticks + 1
        took.append(ticks * DT)
        assert ticks > 0 and soles(q[None])[0, 1, 2] < 3e-4
    assert took[1] == took[0] and took[2] - took[0] == pytest.approx(CONTACT_WAIT_S, abs=2.0 * DT)


@pytest.mark.long
def test_with_mass_it_stands_on_one_foot_and_goes_to_rest_on_both(shared: Path) -> None:
    """A performer who balances on the left foot, for two seconds."""
    source = shared / "mocap" / "cmu_asfamc" / "49_18.amc"
    options = RunOptions(robot="op3", bus="physics", steps="shift", playback=Playback(end=1.5))
    bench = PhysicsBench(options, lambda text: None)
    clock = VirtualClock()
    with prepare(
        lambda: open_source(source), options, clock=clock, make_bus=bench.make_bus, goes_to_rest=True
    ) as prepared:
        run = prepared.run(RunOperator(prepared, StopRequest(), bench=bench))
    report = measure(bench.seen(run))
    assert report.steps is not None and (report.steps.asked, report.steps.made, report.steps.declined) == (1, 1, 0)
    assert report.fallen is False and report.gated_frames == 0 and report.stop.reason is None
    assert report.physics is not None and report.soles is not None
    assert report.soles.height_mm > 20.0 and report.physics.sole_tilt_max_deg < 3.0
    assert report.physics.foot_slip_mm["total"] < 10.0
    assert report.priority_violation_max is not None and report.priority_violation_max < 1.0
    assert '"steps": {' in report.as_json()


LEG = 0.2
PLACE = np.array([0.01, 0.05, 0.0])


def offsets() -> st.SearchStrategy[tuple[float, float, float]]:
    return st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


@settings(max_examples=20)
@given(asked=st.lists(offsets(), min_size=1, max_size=5), outward=st.sampled_from([1.0, -1.0]))
def test_it_stays_within_bounds_and_comes_back(asked: list[tuple[float, float, float]], outward: float) -> None:
    foot = SwingFoot(PLACE, outward=outward, leg=LEG)
    up = np.array([foot.follow(offset, DT).copy() for offset in asked for _ in range(100)]) - PLACE
    assert up[:, 2].min() >= 0.0 and up[:, 2].max() <= HIGH * LEG + 1e-9
    assert np.abs(up[:, 0]).max() <= WAY * LEG + 1e-9
    assert (outward * up[:, 1]).min() >= -1e-9 and (outward * up[:, 1]).max() <= WAY * LEG + 1e-9
    assert up[-1, 2] >= LOW * LEG - 1e-9
    aside = np.abs(up[:, :2]).max(axis=1) > 1e-9
    assert not aside.any() or up[aside, 2].min() > 0.5 * LOW * LEG
    down = np.array([foot.lower(DT).copy() for _ in range(400)]) - PLACE
    assert np.abs(down[-1]).max() < 1e-6
    low = down[:, 2] < 0.5 * LOW * LEG
    assert np.abs(down[low, :2]).max() < 1.1e-3, "straight down at the end"


def test_it_goes_on_from_where_it_was_sent() -> None:
    foot = SwingFoot(PLACE, outward=1.0, leg=LEG)
    foot.restart([0.02, 0.06, 0.03])
    assert np.abs(np.array(foot.lower(DT)) - [0.02, 0.06, 0.03]).max() < 1e-4


HEIGHT = 0.25
STANCE = plant(op3(), op3().profile.postures.stand)
BALANCE = StepBalance(STANCE, 0.25)
STILL = np.zeros(3)


def depth(room: Room, x: float, y: float) -> float:
    return BALANCE.depth(room, np.array([x, y, 0.25]), STILL, STILL)


def test_each_room_lies_in_what_carries_and_all_in_the_way() -> None:
    for foot, (room, sole) in enumerate(zip(BALANCE.over, STANCE.soles, strict=True)):
        assert depth(room, *BALANCE.middles[1 + foot].tolist()) > 0.0
        edges = np.array(room.capture_point)
        corners = convex_hull(sole.outline)
        inward = BALANCE.middles[1 + foot] + 0.25 * (corners - BALANCE.middles[1 + foot])
        assert np.abs(support_distance(inward, edges)).max() < 1e-9
        assert (support_distance(inward, np.array(BALANCE.on_the_way.capture_point)) > -1e-9).all()
    assert depth(BALANCE.both, 0.0, 0.0) > 0.01 and depth(BALANCE.over[0], 0.0, 0.0) < -0.03
    way = BALANCE.on_the_way
    assert len(way.capture_point) + len(way.zero_moment_point) + HEAVE_ROWS <= SUPPORT_EDGES


def test_capture_point_and_zero_moment_point_count() -> None:
    over = np.array([*BALANCE.middles[1], 0.25])
    time = np.sqrt(0.25 / GRAVITY)
    still = BALANCE.depth(BALANCE.over[0], over, STILL, STILL)
    moving = BALANCE.depth(BALANCE.over[0], over, np.array([0.0, 0.01, 0.0]), STILL)
    pushed = BALANCE.depth(BALANCE.over[0], over, STILL, np.array([0.0, -0.3, 0.0]))
    assert abs(still - moving - 0.01 * time) < 1e-9
    assert abs(inside(BALANCE.over[0].zero_moment_point, over) - pushed - 0.3 * 0.25 / GRAVITY) < 1e-9


@given(x=st.floats(-0.2, 0.2), y=st.floats(-0.2, 0.2))
def test_a_place_is_inside_and_what_is_inside_stays(x: float, y: float) -> None:
    place = BALANCE.place(np.array([x, y]))
    assert depth(BALANCE.both, *place.tolist()) > 0.0
    again = BALANCE.place(place)
    assert np.abs(again - place).max() < 1e-9


def shift() -> WeightShift:
    return WeightShift(room=BALANCE.least, height=HEIGHT)


@settings(max_examples=20)
@given(share_x=st.floats(-0.99, 0.99), share_y=st.floats(-0.99, 0.99), foot=st.sampled_from([1, 2]))
def test_from_anywhere_it_gets_to_its_goal_and_is_never_pushed_from_outside(
    share_x: float, share_y: float, foot: int
) -> None:
    way = shift()
    way.restart(np.array([0.0158 * share_x, 0.0216 * share_y, HEIGHT]), STILL, DT)
    rows = [np.array(way.at)] * 2
    rows += [way.step(BALANCE.middles[foot], BALANCE.on_the_way.zero_moment_point, DT).copy() for _ in range(500)]
    path = np.array(rows)
    pushed = path[1:-1] - HEIGHT / GRAVITY * np.diff(path, n=2, axis=0) / DT**2
    worst = min(inside(BALANCE.on_the_way.zero_moment_point, np.array([*point, 0.0])) for point in pushed)
    assert worst > -1e-9
    assert np.abs(path[-1] - BALANCE.middles[foot]).max() < 1e-6


@pytest.mark.parametrize("away", [0.003, 0.01])
def test_from_outside_of_the_room_it_gets_to_its_goal_too(away: float) -> None:
    way, edges = shift(), BALANCE.on_the_way.zero_moment_point
    way.restart(np.array([max(offset for nx, _, offset in edges if nx > 0.99) + away, 0.0, HEIGHT]), STILL, DT)
    for _ in range(500):
        at = way.step(BALANCE.middles[0], edges, DT)
    assert np.abs(at - BALANCE.middles[0]).max() < 1e-6


# A point that glides to a goal which may jump.


@settings(max_examples=30)
@given(goals=st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)), min_size=1, max_size=8))
def test_whatever_is_asked_it_keeps_its_speed_and_acceleration(goals: list[tuple[float, float]]) -> None:
    glide, way = Glide((0.0, 0.0), acceleration=ACCELERATION, speed=SPEED), [[0.0, 0.0]]
    for goal in goals:
        way += [glide.step(goal, DT).copy() for _ in range(40)]
    velocity = np.diff(np.array(way), axis=0) / DT
    assert np.abs(velocity).max() <= SPEED + 1e-9
    assert np.abs(np.diff(velocity, axis=0, prepend=0.0)).max() <= ACCELERATION * DT + 1e-9


@given(goal=st.floats(-0.2, 0.2))
def test_from_rest_it_settles_without_overshoot(goal: float) -> None:
    glide = Glide((0.0,), acceleration=ACCELERATION, speed=SPEED)
    way = np.array([glide.step((goal,), DT)[0] for _ in range(500)])
    assert (np.abs(way) <= abs(goal) + 1e-12).all()
    assert abs(way[-1] - goal) < 1e-9 and abs(glide.moved[0]) < 1e-9
