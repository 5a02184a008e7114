"""The walker: paths that end standing, from the posture of a robot, in whatever order they are requested and
refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import op3, shipped, stance
from retarget._solver import Braking
from retarget.ik.whole_body_stop import StopPath
from retarget.model.body import JointLimits
from retarget.robot.following_limits import following_limits, servo_limits
from retarget.robot.landmarks import standing_dofs
from retarget.robot.walking.gait import fastest, gait_of
from retarget.robot.walking.path import WalkPath
from retarget.robot.walking.pattern import Request, Swing
from retarget.robot.walking.walker import Walker
from retarget.safety.standing import SOLE_M, StandingCheck
from retarget.types import FloatArray

FORWARD = Request(forward=0.1)


def dt(name: str = "op3") -> float:
    return 1.0 / shipped(name).profile.safety.rate_hz


def walker(name: str = "op3") -> Walker:
    """A walker of a robot that has come to rest in its stance."""
    one, where = shipped(name), stance(name)
    own, servos = following_limits(one, where), servo_limits(one)
    limits = JointLimits(own.lower, own.upper, servos.max_velocity, servos.max_acceleration)
    made = Walker(one, where, limits, standing_dofs(one), gait_of(one, where, dt=dt(name)))
    made.begin(where.q[None])
    return made


def swung(t: float, period: float) -> Swing:
    """The last swing of a performer whose left foot is in the middle of one at t = 0, and then the feet in turn."""
    return Swing(int(t / period) % 2, t % period, period)


def walked(
    one: Walker, request: Request | None, ticks: int, q: FloatArray, *, period: float | None = None
) -> list[tuple[WalkPath, int]]:
    """Where it is on which path, tick by tick, until it stands. period: of a performer's steps, s."""
    found = list[tuple[WalkPath, int]]()
    for tick in range(ticks):
        one.step(request, q, None if period is None else swung(one.gait.dt * tick, period))
        assert one.path is not None
        found.append((one.path, one.row))
        if one.is_over:
            one.stand()
            break
    return found


@pytest.mark.parametrize("name", ["op3", "wolfgang"])
@pytest.mark.parametrize(
    "share", [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (-0.7, 0.0, 0.7), (0.0, 1.0, 0.0), (0.5, -0.7, -1.0)]
)
@pytest.mark.parametrize("period", [None, 1.05, 1.3, 1.65], ids=lambda period: f"{period} times")
def test_every_path_keeps_soles_pressure_and_limits_to_its_end(
    name: str, share: tuple[float, float, float], period: float | None
) -> None:
    """Alone, and in time with a performer whose steps last longer than its own."""
    one, robot = walker(name), shipped(name)
    most = fastest(one.gait)
    request = Request(share[0] * most.forward, share[1] * most.left, share[2] * most.turn)
    ticks, period = 9 * one.gait.ticks, None if period is None else period * one.gait.period
    paths = {id(path): path for path, _ in walked(one, request, ticks, stance(name).q, period=period)}
    assert one.steps >= 4 and len(paths) > 4
    check, servos = StandingCheck(robot, stance(name), dt=dt(name)), robot.joint_map
    gate = Braking(servos.lower, servos.upper, servos.max_velocity, servos.max_acceleration, dt=dt(name))
    for path in list(paths.values())[1:]:  # the first is the stand
        lost = check.losses(StopPath(path.postures, None, path.pattern.carries))
        assert lost.slip < 0.1 * SOLE_M and lost.shortfall < -0.003
        joints = np.ascontiguousarray(path.postures[:, robot.servo_columns])
        assert gate.keeps(joints[1], joints[1] - joints[0], joints[2:], tolerance=1e-9)


@pytest.mark.parametrize("period", [0.56, 0.65, 0.8, 0.98])
@pytest.mark.parametrize("begins", [0.0, 0.2, 0.45])
def test_it_keeps_step_with_a_performer(period: float, begins: float) -> None:
    """The middle of its third swing, and of all that follow, is that of one of the same foot of theirs."""
    one, q, lifted, off = walker(), stance().q, list[tuple[int, int]](), list[float]()
    for tick in range(900):
        one.step(FORWARD, q, swung(begins + one.gait.dt * tick, period))
        assert one.path is not None
        carries = one.path.pattern.carries[one.row].tolist()
        if not all(carries):
            lifted.append((tick, carries.index(False)))
        elif lifted and lifted[-1][0] == tick - 1:
            foot = lifted[-1][1]
            first = next(
                at
                for (at, one_foot), after in zip(lifted[::-1], [*lifted[-2::-1], (-9, 0)], strict=True)
                if after[0] != at - 1
            )
            middle = begins + one.gait.dt * 0.5 * (first + tick)
            off.append((middle - foot * period + period) % (2.0 * period) - period)
    assert len(off) > 4 and np.abs(off[2:]).max() < 0.1 and abs(off[-1]) < 0.02


def test_a_path_that_is_late_is_dropped() -> None:
    """The robot goes on to its stand, and from there."""
    one, q = walker(), stance().q
    walked(one, FORWARD, 200, q)
    while one.path is not None and one.row + 4 < one.path.touchdown:
        one.step(FORWARD, q)
    assert one.path is not None
    one.locate(one.path.postures[one.row + 1])
    for _ in range(6):
        assert one.path is not None
        one.locate(one.path.postures[min(one.row + 1, len(one.path.postures) - 1)])
    steps = one.steps
    walked(one, FORWARD, 400, q)
    assert one.steps > steps


def test_it_goes_where_it_should_and_stands_as_in_its_stance() -> None:
    one, q = walker(), stance().q
    walked(one, FORWARD, 1000, q)
    assert one.steps >= 10
    end = walked(one, None, 1000, q)[-1][0]
    left, right = one.feet
    np.testing.assert_allclose((left.place - right.place)[1], one.gait.width, atol=1e-4)
    assert left.place[0] == pytest.approx(right.place[0], abs=1e-4) and left.place[0] > 0.4
    body, soles = op3().kinematics, [sole.frame for sole in stance().soles]
    for frame, sole, foot in zip(soles, stance().soles, one.feet, strict=True):
        at = body.points(end.postures[-1:], [frame.body], frame.position[None])[0, 0]
        np.testing.assert_allclose(at[:2] - foot.place, sole.position[:2] - sole.outline.mean(axis=0), atol=1e-5)


@pytest.mark.parametrize("stop", range(600, 672, 9))
def test_from_any_tick_it_stands_within_two_more_steps(stop: int) -> None:
    one, q = walker(), stance().q
    walked(one, FORWARD, stop, q)
    steps = one.steps
    left = walked(one, None, 1000, q)
    assert one.path is None and one.steps == steps, "no more are requested"
    end = round(4.0 / one.gait.omega / one.gait.dt)
    assert len(left) <= 3 * one.gait.ticks + end


def test_where_a_path_is_refused_it_stays_on_the_one_before() -> None:
    one, q = walker(), stance().q
    walked(one, FORWARD, 400, q)
    path, row = one.path, one.row
    while one.path is path:
        row = one.row
        one.step(FORWARD, q)
    assert path is not None and row == path.touchdown
    steps = one.steps
    one.locate(path.postures[row + 1])
    assert one.path is path and one.row == row + 1 and one.steps == steps - 1
    rest = walked(one, FORWARD, len(path.postures) - row - 2, q)
    assert rest[-1] == (path, len(path.postures) - 1), "it stops, and begins again from there"
    walked(one, FORWARD, 400, q)
    assert one.steps > steps


def test_a_robot_that_brakes_is_found_again_on_its_path() -> None:
    one, q = walker(), stance().q
    walked(one, FORWARD, 500, q)
    path = one.path
    assert path is not None
    for row in range(one.row + 1, len(path.postures)):
        one.locate(path.postures[row])
        assert one.path is path and np.array_equal(path.postures[one.row], path.postures[row])
    walked(one, None, 5, q)
    assert one.path is None


@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(
            st.integers(1, 150),
            st.none() | st.builds(Request, st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-0.6, 0.6)),
            st.booleans(),
        ),
        min_size=1,
        max_size=8,
    )
)
def test_whatever_is_requested_or_refused_postures_go_on_from_each_other(
    requests: list[tuple[int, Request | None, bool]],
) -> None:
    """Ticks of a request, and whether a new path is refused meanwhile: legs never jump, and in the end they stand."""
    one, q, sent = walker(), stance().q, [stance().q]
    for ticks, request, refuses in [*requests, (800, None, False)]:
        for _ in range(ticks):
            if one.path is None:
                one.begin(sent[-1][None])
            before, row = one.path, one.row
            one.step(request, q)
            assert one.path is not None
            if refuses and one.path is not before and before is not None:
                one.locate(before.postures[min(row + 1, len(before.postures) - 1)])
            sent.append(one.path.postures[one.row])
            if one.is_over:
                one.stand()
    joints = np.array(sent)[:, op3().servo_columns]
    limits = servo_limits(op3())
    rows = [op3().body.dof_index(joint) for joint in op3().joint_map.joints]
    moved = np.diff(joints, axis=0)
    assert (np.abs(moved) <= limits.max_velocity[rows] * dt() + 1e-9).all()
    assert (np.abs(np.diff(moved, axis=0)) <= limits.max_acceleration[rows] * dt() ** 2 + 1e-9).all()
    assert one.path is None
