"""Before the clip begins the robot goes to where the performer is, on its soles, and can be stopped on the way."""

from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followers import DT, balance_margin, dimensions, follower, op3, performer, postures, settled
from hardware.clock import VirtualClock
from hardware.servo_health import RAMP_S
from messages import shows
from operators import Asks
from retarget.human.samples import Playback
from retarget.ik.support_polygon import plant
from retarget.model.observers import robot_observers
from retarget.model.robot import HEAD, TRUNK, RobotBody, load_robot
from retarget.report import motion_metrics
from retarget.report.motion_metrics import LimitViolations, limit_violations
from retarget.robot.crouch_envelope import Envelope, measure_envelope, robot_envelope
from retarget.robot.follower import (
    RESTING_SPEED,
    RESTS_S,
    SETTLING_S,
    Follower,
    StanceTrajectory,
    stance_angles,
)
from retarget.robot.following_limits import following_limits
from retarget.robot.landmarks import DesiredLandmarks, standing_dofs
from retarget.rotations import plus
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.safety.gate import Gate
from retarget.schema.priorities import load_priorities
from retarget.schema.profile_parts import Observer
from retarget.sources.open import open_source
from retarget.types import FloatArray, HumanPosture, IntArray
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer


def run_from(source: Path, start: float, operator: Operator | None = None) -> RunResult:
    """The OP3 from standing, following 0.2 s of a recording."""
    options = RunOptions(robot="op3", playback=Playback(start=start, end=start + 0.2))
    with prepare(lambda: open_source(source), options, clock=VirtualClock(), make_bus=mock_bus) as ready:
        return ready.run(operator)


def assert_well(run: RunResult) -> None:
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    assert not sent.gated.any()
    positions = np.vstack([sent.start, sent.q[:, robot.servo_columns]])
    assert limit_violations(np.vstack([positions, positions[-1:]]), robot.limits, run.clip.dt) == LimitViolations(
        0, 0, 0
    )
    for corners in motion_metrics.standing_of(robot, sent.q).soles:
        assert np.linalg.norm(corners - corners[0], axis=-1).max() < 0.003


@pytest.mark.long
@pytest.mark.parametrize(("trial", "start"), [("02_06", 5.0), ("49_18", 0.0)])
def test_a_raised_hand_is_raised_when_following_begins(trial: str, start: float, shared: Path) -> None:
    """A hand that follows from below while the clip runs stays 0.3 m behind for seconds."""
    run = run_from(shared / "mocap" / "cmu_asfamc" / f"{trial}.amc", start)
    sent = run.record.robot
    assert sent is not None and run.landmarks_reached is not None
    first = run.record.following.start
    off = np.linalg.norm(run.landmarks_reached[first] - sent.landmarks_asked[first], axis=-1)
    hands = [sent.landmark_names.index(name) for name in ("l_hand", "r_hand")]
    assert first > 50 and off[hands].max() < 0.06
    assert_well(run)


@pytest.mark.parametrize("tick", [20, 110, 160])
def test_a_stop_on_the_way(tick: int, shared: Path) -> None:
    asked = count()
    run = run_from(shared / "mocap" / "cmu_asfamc" / "02_06.amc", 2.0, Asks(lambda: next(asked) >= tick))
    assert run.state == "off"
    phases = run.record.phase
    assert phases[0] == Phase.APPROACH and phases[-1] == Phase.BRAKE and not (phases == Phase.FOLLOW).any()
    assert_well(run)


def test_it_rests_where_it_arrives_and_takes_no_longer_than_it_may() -> None:
    human = postures(synthetic_performer())[250]
    robot = follower()
    robot.start(human)
    way = settled(robot, human)
    q = np.array([posture.q for posture in way])
    assert 10 < len(way) <= SETTLING_S / DT
    assert np.abs(np.diff(q[-5:], axis=0)).max() < RESTING_SPEED * DT


PELVIS = list(op3().profile.landmarks).index("pelvis")
STEADY = {"op3": "balanced", "toddlerbot": "balanced_sustained", "wolfgang": "balanced"}


def crouched(name: str = "op3", ticks: int = 250) -> Follower:
    """Stopped in the midst of what the performer does."""
    robot = Follower(load_robot(name), load_priorities(STEADY[name]), dimensions(performer()))
    motion = postures(performer())
    robot.start(motion[0])
    settled(robot, motion[0])
    for human in motion[1:ticks]:
        robot.step(human, DT)
    robot.begin_return_to_stance(stop_of(robot)[-1], DT)
    return robot


def stop_of(robot: Follower) -> FloatArray:
    """The postures (k, nq) of the stop from where it is."""
    stop = robot.stop(DT)
    assert stop is not None and np.array_equal(stop.postures[0], robot._q)
    return stop.postures


@pytest.mark.long
@pytest.mark.parametrize("name", list(STEADY))
def test_legs_and_trunk_end_as_in_the_stance_and_arms_aside(name: str) -> None:
    """Hands that stay, with arms that are drawn elsewhere, would hold a waist aside, and two planted soles cannot go
    straight to `rest` from there."""
    follower = crouched(name)
    robot, start = load_robot(name), follower._q.copy()
    while (q := follower.return_to_stance(DT)) is not None:
        last = q.copy()
    carrying, arms = joints_of(robot)
    stand = follower.stance.q
    assert np.abs(start - stand)[carrying].max() > 0.15
    assert np.abs(last - stand)[carrying].max() < 0.06
    aside = robot.posture(robot.profile.postures.attractor)
    assert np.abs(start - aside)[arms].max() > 0.3
    assert np.abs(last - aside)[arms].max() < 0.1


def joints_of(robot: RobotBody) -> tuple[IntArray, IntArray]:
    """Where legs and trunk, and where arms are in q; a head looks straight ahead, wherever it was."""
    single, address = robot.body.scalar_joints()
    carrying = standing_dofs(robot, TRUNK)
    head = standing_dofs(robot, HEAD) & ~carrying
    return address[single & carrying], address[single & ~carrying & ~head]


def leaning() -> Follower:
    """Asked aside, forward and round, as far as its room goes."""
    robot = crouched(ticks=200)
    standing = robot.landmark_map.standing
    aside = [plus(place, (0.05, 0.05, 0.0)) for place in standing.landmarks]
    turned = (np.cos(0.3), 0.0, 0.0, np.sin(0.3))
    for _ in range(300):
        robot._advance(DesiredLandmarks(aside, standing.limbs, turned, standing.gaze), DT)
    robot.begin_return_to_stance(robot._q.copy(), DT)
    return robot


def test_from_the_edge_of_its_room_it_comes_upright_at_once() -> None:
    """With the room in which it follows, its mass would crawl along that edge, and the rest trajectory begin there."""
    robot = leaning()

    def away() -> float:
        return float(
            np.linalg.norm(np.subtract(robot._reached.landmarks[PELVIS], robot.landmark_map.standing.landmarks[PELVIS]))
        )

    assert away() > 0.01
    ticks = 0
    while away() > 2e-3:
        assert robot.return_to_stance(DT) is not None
        ticks += 1
    assert ticks * DT < 2.0


def test_one_tick_that_stands_still_is_no_stand() -> None:
    """Where limbs meet, all stand still for a tick."""
    follower = Follower(op3(), load_priorities("balanced"), dimensions(performer()))
    to_stance = StanceTrajectory(op3(), follower.stance)
    to_stance.begin(follower.stance.q, DT)
    moving, still = np.ones(op3().body.nv), np.zeros(op3().body.nv)
    assert all(to_stance.goes_on(still, DT) for _ in range(100)), "joints are still led"
    for _ in range(2000):
        to_stance.step(1.0)
    for velocity in [moving] * 100 + [still] + [moving] * 10 + [still] * round((RESTS_S - 0.5 * DT) / DT):
        assert to_stance.goes_on(velocity, DT)
    assert not to_stance.goes_on(still, DT)
    to_stance.begin(follower.stance.q, DT)
    assert to_stance.goes_on(still, DT), "and once more from the beginning"


def test_a_return_to_stance_that_was_refused_goes_on_from_where_the_robot_is() -> None:
    """Joints that were led on meanwhile would count as there, or be far ahead of a robot that may go on at last."""
    robot = crouched()
    stood, still = robot._q.copy(), np.zeros(op3().body.nv)
    for _ in range(500):
        assert robot.return_to_stance(DT) is not None, "it is not there"
        robot.reseed(stood, still)
    way = [stood]
    while (q := robot.return_to_stance(DT)) is not None:
        way.append(q)
    found = limit_violations(np.array(way)[:, op3().servo_columns], op3().limits, DT)
    assert (found.velocity, found.acceleration) == (0, 0)
    assert np.abs(way[10] - way[0])[op3().servo_columns].max() < 0.01, "it begins gently"
    aside = op3().posture(stance_angles(op3()))
    assert np.abs(way[-1] - aside)[op3().servo_columns].max() < 0.1


@pytest.mark.parametrize(("override", "longest"), [(1.0, 1.0), (0.5, 2.0)])
def test_the_return_to_stance_is_soon_over_and_ends_at_rest(override: float, longest: float) -> None:
    robot = crouched()
    robot.set_speed_override(override)
    way = [robot._q.copy()]
    while (q := robot.return_to_stance(DT)) is not None:
        way.append(q.copy())
    assert robot._soles.to_stance is not None
    assert len(way) * DT < longest * (robot._soles.to_stance.duration + 0.6)
    speeds = np.abs(np.diff(np.array(way)[:, op3().servo_columns], axis=0)) / DT
    limits = following_limits(op3(), robot.stance, load_priorities("balanced").deflection_compensation)
    most = limits.max_velocity[[op3().body.dof_index(joint) for joint in op3().joint_map.joints]]
    assert (speeds / most).max() < override + 1e-6
    assert speeds[-10:].max() < RESTING_SPEED


def test_a_robot_whose_legs_stay_still_has_no_return_to_stance() -> None:
    robot = follower(parts="upper")
    robot.begin_return_to_stance(robot.start(human()[0]).q, DT)
    assert robot.return_to_stance(DT) is None


TICKS = 900
WARM = range(250, 550)


@cache
def human() -> list[HumanPosture]:
    return postures(performer(), speed=2.0)[:TICKS]


def asked(tick: int) -> float:
    """The share of the speed that the guard would ask for."""
    step = 0.5 * DT / RAMP_S
    return max(0.5, 1.0 - step * (tick - WARM.start)) if tick < WARM.stop else min(1.0, 0.5 + step * (tick - WARM.stop))


def begun() -> Follower:
    robot = follower()
    robot.start(human()[0])
    last = settled(robot, human()[0])[-1]
    robot.reseed(last.q, np.zeros(op3().body.nv))
    return robot


def followed(*, warm: bool) -> tuple[FloatArray, FloatArray]:
    """Servo angles (T, n) that a gate lets pass, and how far the robot is behind (T,) m."""
    robot, gate, goal = begun(), Gate(op3().joint_map, dt=DT), None
    rows: list[FloatArray] = []
    behind: list[float] = []
    for tick, posture in enumerate(human()):
        if warm and tick >= WARM.start:
            robot.set_speed_override(asked(tick))
        reached = robot.step(posture, DT)
        rows.append(reached.joint_positions)
        goal = gate.check(goal or gate.begin(rows[0]), rows[-1])
        assert goal is not None, tick
        behind.append(float(np.linalg.norm(reached.landmarks_asked - reached.landmarks_reached, axis=1).max()))
    return np.array(rows), np.array(behind)


@pytest.fixture(scope="module")
def both() -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    return followed(warm=True), followed(warm=False)


def test_half_of_the_speed_in_time_and_every_limit_kept(both: tuple[tuple[FloatArray, ...], ...]) -> None:
    speeds = np.abs(np.diff(both[0][0], axis=0)) / DT
    most = op3().joint_map.max_velocity
    slow = slice(WARM.start + round(0.7 / DT), WARM.stop - 1)
    assert (speeds[slow] <= 0.5 * most + 1e-9).all()
    assert np.abs(np.diff(both[1][0], axis=0)[slow]).max() / DT > 0.6 * most.max()  # it would have been faster
    changes = np.abs(np.diff(both[0][0], n=2, axis=0)) / DT**2
    assert (changes <= op3().joint_map.max_acceleration + 1e-6).all()


@pytest.mark.long
def test_a_stop_at_half_speed_goes_on_smoothly_on_the_soles() -> None:
    """The way to a stop is one from the speed that the robot has, not from twice or half of it."""
    robot = begun()
    for tick, posture in enumerate(human()[: WARM.start + 120]):
        if tick >= WARM.start:
            robot.set_speed_override(asked(tick))
        reached = robot.step(posture, DT)
        if tick == WARM.start + 118:
            rows = [reached.joint_positions]
    rows.append(reached.joint_positions)
    stop = stop_of(robot)
    rows.extend([*stop[1:, op3().servo_columns], stop[-1, op3().servo_columns]])
    steps = np.diff(np.array(rows), axis=0)
    assert np.abs(steps[0]).max() / DT > 0.2
    assert (np.abs(np.diff(steps, axis=0)) <= op3().joint_map.max_acceleration * DT**2 + 1e-9).all()
    assert len(stop) * DT <= 0.35


@pytest.mark.parametrize("halts", [False, True])
def test_a_jump_of_the_speed_override_is_no_jump_of_the_robot(halts: bool) -> None:
    """What moves goes on at its speed, and brakes from there: in following, and on the way to a stop."""
    robot, share = begun(), []
    rows = [robot.step(posture, DT).joint_positions for posture in human()[:150]]
    for tick in range(150, 250, 10):
        rows += [robot.step(posture, DT).joint_positions for posture in human()[tick : tick + 10]]
        steps = np.diff(rows[-2:], axis=0)
        robot.set_speed_override(0.7)
        q = stop_of(robot)[:2][-1] if halts else robot.step(human()[tick + 10], DT).q
        steps = np.vstack([steps, q[op3().servo_columns] - rows[-1]])
        robot.set_speed_override(1.0)
        rows.append(q[op3().servo_columns])
        change = np.abs(steps[1] - steps[0]) / (op3().joint_map.max_acceleration * DT**2)
        assert change.max() <= 1.0 + 1e-9
        share.append(float(change.max()) if np.abs(steps[0]).max() / DT > 1.0 else np.nan)
    assert np.count_nonzero(np.isfinite(share)) > 5
    assert halts or np.nanmin(share) <= 0.7**2 + 1e-9  # a slower robot is gentler


def test_reseeding_takes_velocities_per_real_second() -> None:
    robot = begun()
    for posture in human()[:100]:
        before, q = robot.step(posture, DT), robot.step(posture, DT).q
    robot.set_speed_override(0.5)
    body = op3().body.solver_body()
    moved = body.difference(before.q, q)
    robot.reseed(q, moved / DT)
    after = robot.step(human()[100], DT).q
    change = np.abs(body.difference(q, after) - moved)[-len(op3().joint_map) :]
    assert np.abs(moved[-len(op3().joint_map) :]).max() / DT > 0.5
    assert change.max() <= 0.25 * op3().joint_map.max_acceleration.max() * DT**2 + 1e-9


# How low and how far a robot gets on its soles.


@cache
def envelope() -> Envelope:
    stance = plant(op3(), op3().profile.postures.stand)
    return measure_envelope(op3(), following_limits(op3(), stance), stance, edges=stance.edges(0.01))


def test_the_op3_crouches_to_bent_knees_and_stands_on_nearly_straight_ones() -> None:
    # Sole to ankle 0.0305, shin and thigh 0.22 straight; knees bend from 11 to 148 degrees.
    assert 0.08 < envelope().lowest < 0.10
    assert 0.24 < envelope().highest < 0.2507


def test_no_height_is_asked_at_which_the_robot_touches_itself() -> None:
    stance, robot = plant(op3(), op3().profile.postures.stand), op3()
    apart = robot_observers(robot).for_solver(robot.body)
    limits = following_limits(robot, stance)
    kept = measure_envelope(robot, limits, stance, edges=stance.edges(0.01), observers=apart)
    assert kept.lowest > envelope().lowest + 0.02 and kept.highest == envelope().highest


def test_a_crouch_that_margins_take_away_is_said_and_one_that_is_none() -> None:
    """From 8 mm on OP3's shins are nearer to its feet in any deep crouch: that is no fault of the search."""
    stance, robot = plant(op3(), op3().profile.postures.stand), op3()
    limits, observers = following_limits(robot, stance), robot_observers(robot)
    wide = replace(observers.with_margin(0.012), influence=observers.influence + 0.1)
    said = [
        measure_envelope(robot, limits, stance, edges=stance.edges(0.01), observers=apart.for_solver(robot.body)).note
        for apart in (observers, wide)
    ]
    assert not said[0] and not envelope().note
    shows(said[1], "39 mm", "161 mm", "margins")
    stiff = limits.lower.copy()
    stiff[6:] = stance.q[7:]
    kept = replace(limits, lower=stiff, upper=np.r_[limits.upper[:6], stiff[6:]])
    none = measure_envelope(robot, kept, stance, edges=stance.edges(0.01))
    shows(none.note, "cannot crouch")


def test_an_envelope_is_measured_once_for_a_robot_and_anew_for_other_limits() -> None:
    robot, stance = op3(), plant(op3(), op3().profile.postures.stand)
    limits, edges = following_limits(robot, stance), stance.edges(0.01)
    found = robot_envelope(robot, limits, edges=edges, margin=None)
    apart = robot_observers(robot).for_solver(robot.body)
    measured = measure_envelope(robot, limits, stance, edges=edges, observers=apart)
    assert np.array_equal(found.heights, measured.heights) and np.array_equal(found.lean, measured.lean)
    assert robot_envelope(robot, limits, edges=edges.copy(), margin=None) is found
    knee = robot.body.dof_index("l_knee")
    shallow = replace(limits, upper=np.where(np.arange(robot.body.nv) == knee, 0.5, limits.upper))
    assert robot_envelope(robot, shallow, edges=edges, margin=None).lowest > found.lowest + 0.02
    assert robot_envelope(robot, limits, edges=stance.edges(0.02), margin=None) is not found
    # The same robot, loaded again; and others, one of which differs in a shape, one in a posture, one in its body.
    assert robot_envelope(load_robot("op3"), limits, edges=edges, margin=None) is found
    postures = robot.profile.postures.model_copy(update={"stand": robot.profile.postures.stand | {"l_knee": 0.5}})
    heavier = replace(robot.body, mass=1.01 * robot.body.mass)
    others = (
        with_a_belly(),
        replace(robot, profile=robot.profile.model_copy(update={"postures": postures})),
        replace(robot, body=heavier),
    )
    assert len({one.content for one in (robot, load_robot("op3"), load_robot("wolfgang"), *others)}) == 5


def with_a_belly() -> RobotBody:
    """OP3 with a box ahead of its hips, which its thighs meet when they fold by half of what servos allow."""
    belly = Observer.model_validate(
        {
            "link": "body_link",
            "shape": {"box": {"pos": [0.06, 0.0, 0.0], "size": [0.02, 0.05, 0.02]}},
            "influence": 0.04,
            "margin": 0.005,
        }
    )
    profile = op3().profile
    observers = {**profile.observers, "belly": belly}
    return replace(op3(), profile=profile.model_copy(update={"observers": observers}))


@pytest.mark.long
def test_a_robot_whose_hips_fold_little_stays_down_while_the_performer_squats() -> None:
    """Lean and crouch want the same hips. It stood up again, as a lean counted for more than a crouch on small legs."""
    motion = postures(performer())
    heights = [human.joints[human.joint_names.index("pelvis"), 2] for human in motion[:TICKS]]
    low = int(np.argmin(heights[:300]))
    robot = Follower(with_a_belly(), load_priorities("servo"), dimensions(performer()))
    robot.start(motion[0])
    settled(robot, motion[0])
    held = [robot.step(motion[min(tick, low)], DT) for tick in range(low + round(2.0 / DT))][low:]
    z = np.array([posture.landmarks_reached[PELVIS, 2] for posture in held])
    standing = float(robot.stance.points["pelvis"][2])
    assert float((z - np.minimum.accumulate(z)).max()) < 0.003
    assert standing - z[-1] > 0.75 * (standing - float(held[-1].landmarks_asked[PELVIS, 2]))
    assert robot.hierarchy.solver.clearance[0] > 0.0 and balance_margin(robot, held[-1].q[None]) > 0.0


@given(st.floats(0.0, 0.4), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_between_the_directions_the_lean_lies_between_theirs(height: float, x: float, y: float) -> None:
    if np.hypot(x, y) > 1e-3:
        most = envelope().most_lean(height, x, y)
        assert envelope().lean.min() - 1e-9 <= most <= envelope().lean.max() + 1e-9


def test_a_robot_that_cannot_crouch_has_one_lean() -> None:
    stiff = Envelope(np.full(9, 0.4), np.full((9, 4), 0.2))
    assert np.allclose([stiff.most_lean(0.3, 1.0, 0.0), stiff.most_lean(0.5, 0.0, 1.0)], 0.2)


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot"])
def test_a_difference_of_rounding_stays_one(name: str) -> None:
    """Two robots begin 1e-12 rad apart, and follow a crouch and a reach: no joint is ever more than 1e-7 rad apart, so
    that no branch is decided by a last bit."""
    robot, human = load_robot(name), postures(performer())[: round(3.5 / DT)]
    rng, ways = np.random.default_rng(46), []
    for size in (0.0, 1e-12):
        one = Follower(robot, load_priorities("balanced"), dimensions(performer()))
        one.start(human[0])
        q = one.stance.q.copy()
        q[robot.servo_columns] += size * rng.choice([-1.0, 1.0], len(robot.servo_columns))
        one.reseed(q, np.zeros(robot.body.nv))
        ways.append(np.array([one.step(posture, DT).joint_positions for posture in human]))
    assert np.abs(ways[1] - ways[0]).max() < 1e-7
