"""The gate: whatever is asked, what is sent is finite, inside the limits, and can stop."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_rig import four_servos
from gates import DrivenGate, PathCheck, admit, as_clearance, sent
from hardware.arrays import FloatArray
from hardware.errors import HardwareError
from hardware.guard import CheckedGoal
from hardware.imu import ImuSample
from hardware.joint_map import JointMap
from messages import refuses
from oracles.frame_bounds import braking_displacement
from oracles.frame_bounds import frame_bounds as bounds_oracle
from retarget._solver import Braking
from retarget.ik.whole_body_stop import StopPath
from retarget.safety.gate import MOST_OFFSET, OFFSET_SPEED, Compensated, Gate, PassThroughGate

MAP = JointMap(four_servos())
DT = 0.008
STEP = MAP.max_velocity * DT
CHANGE = MAP.max_acceleration * DT**2
TINY = 1e-8


def make(start: FloatArray | None = None, path_is_clear: PathCheck | None = None) -> DrivenGate:
    gate = Gate(MAP, dt=DT, clearance=as_clearance(path_is_clear))
    return DrivenGate(gate, np.zeros(4) if start is None else start)


def passes(gate: DrivenGate, goal: FloatArray) -> bool:
    """Whether the goal is what is sent, to the bit."""
    return bool(np.array_equal(admit(gate, goal), goal))


def check_motion(path: FloatArray) -> None:
    """Assert that postures (T, 4), starting at rest, keep every limit."""
    steps = np.diff(path, axis=0)
    changes = np.diff(steps, axis=0, prepend=0.0)
    assert np.isfinite(path).all()
    assert np.all((path >= MAP.lower - TINY) & (path <= MAP.upper + TINY))
    assert np.all(np.abs(steps) <= STEP + TINY)
    assert np.all(np.abs(changes) <= CHANGE + TINY)


def test_a_goal_within_reach_passes_untouched() -> None:
    gate = make()
    goal = 0.5 * CHANGE
    assert passes(gate, goal)
    np.testing.assert_allclose(gate.goal.displacement, goal)


@pytest.mark.parametrize(
    "goal",
    [
        pytest.param([0.0, np.nan, 0.0, 0.0], id="not a number"),
        pytest.param([np.inf, 0.0, 0.0, 0.0], id="not finite"),
        pytest.param([0.0, 0.0, 0.7, 0.0], id="position"),
        pytest.param([0.0, 0.0, 0.0, -0.5], id="velocity"),
        pytest.param([0.003, 0.0, 0.0, 0.0], id="acceleration"),
        pytest.param([0.0, 0.0, 0.0], id="wrong size"),
    ],
)
def test_a_goal_beyond_a_limit_is_refused_whole(goal: list[float]) -> None:
    assert admit(make(), np.array(goal)).tolist() == [0.0] * 4


def test_a_share_of_the_speed_is_the_bound() -> None:
    for speed, passed in ((1.0, True), (0.5, False)):
        gate = DrivenGate(Gate(MAP, dt=DT, speed=speed), np.zeros(4))
        displacement = np.zeros(4)
        while (displacement < 0.51 * STEP).any():
            displacement = np.minimum(displacement + CHANGE, 0.51 * STEP)
            last = passes(gate, sent(gate) + displacement)
        assert last == passed


def test_goals_at_the_bound_pass_to_the_bit_for_ever() -> None:
    """Rounding of another program must not add up: its difference would be asked for again in every tick, and grow."""
    gate, rng = make(), np.random.default_rng(3)
    position, before, rounding = np.zeros(4), np.zeros(4), 1e-13
    braking = Braking(MAP.lower, MAP.upper, MAP.max_velocity, MAP.max_acceleration, dt=DT)
    for _ in range(5000):
        lo, hi = braking.bounds(position, before)
        step = np.where(rng.random(4) < 0.5, lo, hi) * (1.0 + rounding * rng.standard_normal(4))
        before = np.clip(step, lo, hi)
        position = position + step
        assert passes(gate, position)


def test_a_goal_from_which_no_braking_is_left_is_refused() -> None:
    gate = make()
    refused = 0
    velocity = np.zeros(4)
    for _ in range(400):  # always faster towards the upper limits, and never braking
        velocity = np.minimum(velocity + CHANGE, STEP)
        goal = sent(gate) + velocity
        refused += not passes(gate, goal) and bool((goal <= MAP.upper).all())
        velocity = gate.goal.displacement
    assert refused > 0
    assert np.all(sent(gate) <= MAP.upper + TINY)


def test_a_refusal_brakes_at_full_deceleration() -> None:
    gate = make()
    for k in range(1, 6):
        admit(gate, sent(gate) + k * CHANGE)
    path = [sent(gate)]
    admit(gate, np.full(4, np.nan))
    path.append(sent(gate))
    while gate.goal.displacement.any():
        path.append(gate.brake().joints)
    np.testing.assert_allclose(np.diff(path, axis=0)[:4], np.array([4, 3, 2, 1])[:, None] * CHANGE, rtol=1e-9)
    rest = sent(gate)
    assert gate.brake().joints.tolist() == rest.tolist()


@given(st.integers(0, 2**32 - 1))
def test_nothing_that_is_asked_breaks_a_limit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gate = make(rng.uniform(MAP.lower, MAP.upper))
    path = [sent(gate)]
    for _ in range(60):
        kind = rng.integers(4)
        lo, hi = bounds_oracle(
            sent(gate), gate.goal.displacement, MAP.lower, MAP.upper, MAP.max_velocity, MAP.max_acceleration, DT
        )
        goals = (
            sent(gate) + rng.uniform(lo, hi),  # legal
            sent(gate) + rng.choice([lo, hi]),  # at the bound
            sent(gate) + rng.normal(0.0, 2.0, 4) * STEP,  # wild
            np.where(rng.random(4) < 0.3, np.nan, 0.0),
        )
        path.append(admit(gate, goals[kind]))
        if kind < 2:
            assert path[-1].tolist() == goals[kind].tolist()
    while gate.goal.displacement.any():
        path.append(gate.brake().joints)
    check_motion(np.array(path))


def test_from_beyond_a_limit_it_may_stand_or_walk_back_in() -> None:
    start = np.array([1.7, 0.0, 0.0, 0.0])  # 0.2 beyond
    gate = make(start)
    assert passes(gate, start)
    assert not passes(gate, np.add(start, [1e-3, 0.0, 0.0, 0.0]))
    assert passes(gate, start - [CHANGE[0], 0.0, 0.0, 0.0])
    assert sent(gate)[0] < start[0]


def test_a_path_that_collides_is_refused_and_the_clear_one_is_followed() -> None:
    seen: list[FloatArray] = []

    def below_a_wall(path: FloatArray, instead: FloatArray) -> bool:
        seen.append(path)
        return bool((path[:, 0] < 0.5).all())

    gate = make(path_is_clear=below_a_wall)
    way = [sent(gate)]
    passed = True
    while passed:
        before = sent(gate)
        goal = before + np.minimum(gate.goal.displacement + CHANGE, STEP) * [1, 0, 0, 0]
        passed = passes(gate, goal)
        way.append(sent(gate))
        path = seen[-1]
        assert path[0].tolist() == before.tolist()
        assert np.all(np.abs(path[-1] - path[-2]) <= CHANGE + TINY), "it ends at rest"
    while gate.goal.displacement.any():
        way.append(gate.brake().joints)
    assert 0.4 < sent(gate)[0] < 0.5
    check_motion(np.array(way))


@pytest.mark.parametrize("start", [np.full(4, np.nan), np.zeros(5)])
def test_a_senseless_start_is_refused(start: FloatArray) -> None:
    with refuses(HardwareError, 4):
        make(start)


@pytest.mark.parametrize(
    "change", [{"upper": MAP.lower}, {"max_velocity": np.zeros(4)}, {"lower": np.full(4, -np.inf)}]
)
def test_senseless_limits_are_refused(change: dict[str, FloatArray], monkeypatch: pytest.MonkeyPatch) -> None:
    servos = JointMap(four_servos())
    for name, values in change.items():
        monkeypatch.setattr(servos, name, values)
    with refuses(HardwareError):
        Gate(servos, dt=DT)


@given(st.floats(1e-6, 3.0), st.floats(1e-5, 1e-2))
def test_the_oracle_uses_the_gap_to_the_last_bit(gap: float, change: float) -> None:
    x = float(braking_displacement(np.array(gap), np.array(change)))
    terms = x - change * np.arange(int(x / change) + 2)
    assert terms[terms > 0].sum() == pytest.approx(gap, rel=1e-9)


@given(st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=20))
def test_only_the_goal_before_decides(sizes: list[float]) -> None:
    """What is sent is the same whatever else was checked in between, refused or not."""
    one, other = make(), make()
    for size in sizes:
        goal = sent(one) + one.goal.displacement + size * CHANGE
        assert one.gate.check(one.goal, goal + 10.0) is None
        one.gate.check(one.goal, sent(one) + one.goal.displacement)
        one.gate.brake(one.goal)
        np.testing.assert_array_equal(admit(one, goal), admit(other, goal))


class NotedCompensation:
    """Offsets nothing, and notes the postures that it is asked for."""

    forced = False
    free = False

    def __init__(self) -> None:
        self.asked = list[FloatArray]()

    def begin(self, posture: FloatArray) -> Compensated:
        return self

    def measure(self, joints: FloatArray, imu: ImuSample | None) -> None:
        pass

    def propose(
        self,
        last: Compensated,
        posture: FloatArray,
        nearest: Callable[[FloatArray], FloatArray],
        *,
        ahead: FloatArray,
        walks: bool | None,
    ) -> tuple[FloatArray, Compensated]:
        self.asked.append(posture)
        return posture, self


def test_a_senseless_goal_reaches_no_compensation() -> None:
    compensation = NotedCompensation()
    gate = DrivenGate(Gate(MAP, dt=DT, compensation=compensation), np.zeros(4))
    for senseless in ([0.0, np.nan, 0.0, 0.0], [0.0, 0.0, 0.0]):
        assert gate.check(np.array(senseless)) is None and not compensation.asked
    assert gate.check(0.5 * CHANGE) is not None and len(compensation.asked) == 1


def test_a_goal_that_an_offset_forces_is_refused() -> None:
    compensation = NotedCompensation()
    gate = DrivenGate(Gate(MAP, dt=DT, compensation=compensation), np.zeros(4))
    compensation.forced = True
    assert gate.check(np.zeros(4)) is None


class NotedStanding:
    """Soles and balance of a robot whose postures are its joints. held: whether it keeps them."""

    held = True

    def joints(self, postures: FloatArray) -> FloatArray:
        return postures

    def holds(self, stop: StopPath, last: FloatArray, standing: FloatArray) -> bool:
        return self.held


def planned(*steps: float) -> tuple[NotedStanding, Gate, CheckedGoal | None]:
    """A gate, and its first goal for a stop with these displacements of all joints, in largest changes."""
    standing = NotedStanding()
    gate = Gate(MAP, dt=DT, standing=standing)  # type: ignore[arg-type]
    path = np.cumsum(steps)[:, None] * CHANGE
    return standing, gate, gate.check(gate.begin(np.zeros(4)), path[0], stop=StopPath(path), standing=np.zeros(0))


def test_a_planners_stop_is_followed_row_by_row() -> None:
    _, gate, goal = planned(1.0, 1.5, 0.75, -0.25)
    assert goal is not None and not gate.at_rest(goal)
    for left, at in enumerate((2.5, 3.25, 3.0)):
        goal = gate.brake(goal)
        np.testing.assert_allclose(goal.joints, at * CHANGE, atol=TINY)
        assert gate.at_rest(goal) == (left == 2)
    np.testing.assert_array_equal(gate.brake(goal).joints, goal.joints)


@pytest.mark.parametrize("steps", [(1.0, 2.5, 1.5, 0.5), (1.0, 1.8), (1.0, -0.5, np.nan)])
def test_a_planners_stop_that_breaks_a_limit_is_refused(steps: tuple[float, ...]) -> None:
    assert planned(*steps)[2] is None
    gate = planned(1.0, 0.5)[1]
    elsewhere = StopPath(np.array([0.2, 0.1])[:, None] * CHANGE)
    assert gate.check(gate.begin(np.zeros(4)), 0.3 * CHANGE, stop=elsewhere, standing=np.zeros(0)) is None


def test_soles_and_balance_are_checked_on_a_planners_stop() -> None:
    standing, gate, goal = planned(1.0, 0.5)
    assert goal is not None
    standing.held = False
    assert gate.check(goal, goal.joints + 0.1 * CHANGE, standing=np.zeros(0)) is not None, "not on one of joints alone"
    stop = StopPath(goal.joints[None])
    assert gate.check(goal, goal.joints, stop=stop, standing=np.zeros(0)) is None


def test_a_stop_ends_where_its_joints_rest() -> None:
    """A part of a long stop and a short one is as long as the long one."""
    for steps in ((1.0, 0.5, 0.0, 0.0, 0.0), (0.5, 0.0)):
        _, _, goal = planned(*steps)
        assert goal is not None and len(goal.stop) == sum(step > 0.0 for step in steps[1:])


def test_goals_belong_to_their_gate() -> None:
    gate, other = make(), make()
    goals = [gate.check(sent(gate) + 0.1 * k * CHANGE) or gate.brake() for k in range(5)]
    assert {goal.seal for goal in goals} == {gate.brake().seal} != {other.brake().seal}


def test_without_limits_goals_pass_and_braking_ends_at_rest() -> None:
    gate = DrivenGate(PassThroughGate(MAP, dt=DT), np.zeros(4))
    far = np.array([0.25, -5.0, 0.0, 0.0])
    np.testing.assert_array_equal(admit(gate, far), far)
    np.testing.assert_allclose(gate.brake().joints, far + np.sign(far) * (np.abs(far) - CHANGE * (far != 0.0)))
    while gate.goal.displacement.any():
        gate.brake()
    np.testing.assert_array_equal(gate.brake().joints, sent(gate))


@pytest.mark.parametrize("goal", [[np.nan, 0.0, 0.0, 0.0], [np.inf, 0.0, 0.0, 0.0], [0.0]])
def test_without_limits_what_no_servo_can_take_is_refused(goal: list[float]) -> None:
    gate = DrivenGate(PassThroughGate(MAP, dt=DT), np.zeros(4))
    assert gate.check(np.array(goal)) is None


# A robot that walks: limits are those of its posture, and its offset has a bound of its own.


class Offset(NotedCompensation):
    """Holds every posture by one offset, rad, of all joints."""

    free = True

    def __init__(self, offset: float) -> None:
        super().__init__()
        self.offset = offset

    def propose(
        self,
        last: Compensated,
        posture: FloatArray,
        nearest: Callable[[FloatArray], FloatArray],
        *,
        ahead: FloatArray,
        walks: bool | None,
    ) -> tuple[FloatArray, Compensated]:
        return posture + self.offset, self


FASTEST = OFFSET_SPEED * DT * float(MAP.max_velocity.min())


def test_an_offset_of_a_walk_is_quicker_than_a_joint_and_has_bounds() -> None:
    held = Offset(0.0)
    gate = Gate(MAP, dt=DT, compensation=held)
    goal = gate.begin(np.zeros(4))
    while held.offset < MOST_OFFSET - 0.5 * FASTEST:
        held.offset += 0.99 * min(FASTEST, MOST_OFFSET - held.offset)
        passed = gate.check(goal, goal.posture)
        assert passed is not None
        goal = passed
        np.testing.assert_allclose(goal.joints - goal.posture, held.offset)
        np.testing.assert_array_equal(goal.displacement, 0.0)
    before = held.offset
    for refused in (before + 1.01 * FASTEST, before - 1.01 * FASTEST, MOST_OFFSET + 0.01, np.nan):
        held.offset = refused
        assert gate.check(goal, goal.posture) is None
    after = gate.brake(goal)  # with an offset that is not finite
    np.testing.assert_allclose(after.joints - after.posture, before)


def test_the_posture_of_a_walk_keeps_every_limit() -> None:
    gate = Gate(MAP, dt=DT, compensation=Offset(0.5 * FASTEST))
    assert gate.check(gate.begin(np.zeros(4)), 1.01 * CHANGE) is None
    top = gate.begin(MAP.upper - 0.25 * FASTEST)
    assert gate.check(top, MAP.upper - 0.25 * FASTEST) is None, "the goal is beyond the joint's range"
