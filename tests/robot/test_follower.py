"""Before the clip begins the robot goes to where the performer is, on its soles, and can be stopped on the way."""

from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followers import DT, balance_margin, dimensions, follower, op3, performer, postures, settled, shipped, stance
from hardware.clock import VirtualClock
from hardware.servo_health import RAMP_S
from messages import shows
from operators import Asks
from retarget.human.samples import Playback
from retarget.model.body import JointLimits
from retarget.model.observers import Observers, robot_observers
from retarget.model.robot import HEAD, TRUNK, RobotBody, load_robot
from retarget.report import motion_metrics
from retarget.report.motion_metrics import LimitViolations, limit_violations
from retarget.robot.crouch_envelope import Envelope, measure_envelope, robot_envelope
from retarget.robot.follower import RESTING_SPEED, RESTS_S, SETTLING_S, Follower, StanceTrajectory, stance_angles
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
from retarget.types import FloatArray, HumanPosture
from sim.mock_bus import mock_bus


def run_from(source: Path, start: float, operator: Operator | None = None) -> RunResult:
    """The OP3 from standing, following 0.2 s of a recording."""
    options = RunOptions(robot="op3", playback=Playback(start=start, end=start + 0.2))
    with prepare(lambda: open_source(source), options, clock=VirtualClock(), make_bus=mock_bus) as ready:
        return ready.run(operator)


def assert_well(run: RunResult) -> None:
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    assert not sent.gated.any()
    positions = np.vstack([sent.start, sent.q[:, robot.servo_columns], sent.q[-1:, robot.servo_columns]])
    assert limit_violations(positions, robot.limits, run.clip.dt) == LimitViolations(0, 0, 0)
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
    one, robot = postures(performer())[250], follower()
    robot.start(one)
    q = np.array([posture.q for posture in settled(robot, one)])
    assert 10 < len(q) <= SETTLING_S / DT
    assert np.abs(np.diff(q[-5:], axis=0)).max() < RESTING_SPEED * DT


PELVIS = list(op3().profile.landmarks).index("pelvis")
STEADY = {"op3": "balanced", "toddlerbot": "balanced_sustained", "wolfgang": "balanced"}


def following(robot: RobotBody, priorities: str) -> Follower:
    return Follower(robot, load_priorities(priorities), dimensions(performer()))


def crouched(name: str = "op3", ticks: int = 250) -> Follower:
    """Stopped in the midst of what the performer does."""
    robot, motion = following(shipped(name), STEADY[name]), postures(performer())
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
    straight to `rest` from there. A head looks straight ahead, wherever it was."""
    follower, robot = crouched(name), shipped(name)
    start = follower._q.copy()
    while (q := follower.return_to_stance(DT)) is not None:
        last = q.copy()
    single, address = robot.body.scalar_joints()
    trunk = standing_dofs(robot, TRUNK)
    carrying, arms = address[single & trunk], address[single & ~trunk & ~standing_dofs(robot, HEAD)]
    assert np.abs(start - follower.stance.q)[carrying].max() > 0.15
    assert np.abs(last - follower.stance.q)[carrying].max() < 0.06
    aside = robot.posture(robot.profile.postures.attractor)
    assert np.abs(start - aside)[arms].max() > 0.3
    assert np.abs(last - aside)[arms].max() < 0.1


def test_from_the_edge_of_its_room_it_comes_upright_at_once() -> None:
    """With the room in which it follows, its mass would crawl along that edge, and the rest trajectory begin there."""
    robot = crouched(ticks=200)
    standing = robot.landmark_map.standing
    turned = (np.cos(0.3), 0.0, 0.0, np.sin(0.3))
    aside = DesiredLandmarks(
        [plus(place, (0.05, 0.05, 0.0)) for place in standing.landmarks], standing.limbs, turned, standing.gaze
    )
    for _ in range(300):
        robot._advance(aside, DT)
    robot.begin_return_to_stance(robot._q.copy(), DT)

    def away() -> float:
        return float(np.linalg.norm(np.subtract(robot._reached.landmarks[PELVIS], standing.landmarks[PELVIS])))

    assert away() > 0.01
    ticks = 0
    while away() > 2e-3:
        assert robot.return_to_stance(DT) is not None
        ticks += 1
    assert ticks * DT < 2.0


def test_one_tick_that_stands_still_is_no_stand() -> None:
    """Where limbs meet, all stand still for a tick."""
    to_stance = StanceTrajectory(op3(), stance())
    to_stance.begin(stance().q, DT)
    moving, still = np.ones(op3().body.nv), np.zeros(op3().body.nv)
    assert all(to_stance.goes_on(still, DT) for _ in range(100)), "joints are still driven"
    for _ in range(2000):
        to_stance.step(1.0)
    for velocity in [moving] * 100 + [still] + [moving] * 10 + [still] * round((RESTS_S - 0.5 * DT) / DT):
        assert to_stance.goes_on(velocity, DT)
    assert not to_stance.goes_on(still, DT)
    to_stance.begin(stance().q, DT)
    assert to_stance.goes_on(still, DT), "and once more from the beginning"


def test_a_return_to_stance_that_was_refused_goes_on_from_where_the_robot_is() -> None:
    """Joints that went on meanwhile would count as there, or be far ahead of a robot that may go on at last."""
    robot, columns = crouched(), op3().servo_columns
    stood, still = robot._q.copy(), np.zeros(op3().body.nv)
    for _ in range(500):
        assert robot.return_to_stance(DT) is not None, "it is not there"
        robot.reseed(stood, still)
    path = [stood]
    while (q := robot.return_to_stance(DT)) is not None:
        path.append(q)
    found = limit_violations(np.array(path)[:, columns], op3().limits, DT)
    assert (found.velocity, found.acceleration) == (0, 0)
    assert np.abs(path[10] - path[0])[columns].max() < 0.01, "it begins gently"
    assert np.abs(path[-1] - op3().posture(stance_angles(op3())))[columns].max() < 0.1
    upper = follower(parts="upper")  # legs that stay still
    upper.begin_return_to_stance(upper.start(human()[0]).q, DT)
    assert upper.return_to_stance(DT) is None


@pytest.mark.parametrize(("override", "longest"), [(1.0, 1.0), (0.5, 2.0)])
def test_the_return_to_stance_is_soon_over_and_ends_at_rest(override: float, longest: float) -> None:
    robot = crouched()
    robot.set_speed_override(override)
    path = [robot._q.copy()]
    while (q := robot.return_to_stance(DT)) is not None:
        path.append(q.copy())
    assert robot._soles.to_stance is not None
    assert len(path) * DT < longest * (robot._soles.to_stance.duration + 0.6)
    speeds = np.abs(np.diff(np.array(path)[:, op3().servo_columns], axis=0)) / DT
    limits = following_limits(op3(), robot.stance, load_priorities("balanced").deflection_compensation)
    most = limits.max_velocity[[op3().body.dof_index(joint) for joint in op3().joint_map.joints]]
    assert (speeds / most).max() < override + 1e-6
    assert speeds[-10:].max() < RESTING_SPEED


TICKS = 900
WARM = range(250, 550)


@cache
def human() -> list[HumanPosture]:
    return postures(performer(), speed=2.0)[:TICKS]


class Warm:
    """A robot that follows, at half of its speed while servos are warm as the guard has it."""

    def __init__(self) -> None:
        self.robot = follower()
        self.robot.start(human()[0])
        last = settled(self.robot, human()[0])[-1]
        self.robot.reseed(last.q, np.zeros(op3().body.nv))

    def follow(self, ticks: int, *, warm: bool) -> FloatArray:
        """Servo angles (ticks, n)."""
        step, rows = 0.5 * DT / RAMP_S, list[FloatArray]()
        for tick in range(ticks):
            if warm and tick >= WARM.start:
                cools = 0.5 + step * (tick - WARM.stop)
                heats = max(0.5, 1.0 - step * (tick - WARM.start))
                self.robot.set_speed_override(heats if tick < WARM.stop else min(1.0, cools))
            rows.append(self.robot.step(human()[tick], DT).joint_positions)
        return np.array(rows)


def test_half_of_the_speed_in_time_and_every_limit_kept() -> None:
    """A gate lets all of it pass."""
    warm, usual = (Warm().follow(TICKS, warm=warm) for warm in (True, False))
    for rows in (warm, usual):
        gate = Gate(op3().joint_map, dt=DT)
        goal = gate.begin(rows[0])
        for tick, row in enumerate(rows):
            checked = gate.check(goal, row)
            assert checked is not None, tick
            goal = checked
    speeds, most = np.abs(np.diff(warm, axis=0)) / DT, op3().joint_map.max_velocity
    slow = slice(WARM.start + round(0.7 / DT), WARM.stop - 1)
    assert (speeds[slow] <= 0.5 * most + 1e-9).all()
    assert np.abs(np.diff(usual, axis=0)[slow]).max() / DT > 0.6 * most.max()  # it would have been faster
    changes = np.abs(np.diff(warm, n=2, axis=0)) / DT**2
    assert (changes <= op3().joint_map.max_acceleration + 1e-6).all()


@pytest.mark.long
def test_a_stop_at_half_speed_goes_on_smoothly_on_the_soles() -> None:
    """A stop begins at the speed that the robot has, not at twice or half of it."""
    run = Warm()
    rows = run.follow(WARM.start + 120, warm=True)[-2:]
    stop = stop_of(run.robot)[:, op3().servo_columns]
    steps = np.diff(np.vstack([rows, stop[1:], stop[-1:]]), axis=0)
    assert np.abs(steps[0]).max() / DT > 0.2
    assert (np.abs(np.diff(steps, axis=0)) <= op3().joint_map.max_acceleration * DT**2 + 1e-9).all()
    assert len(stop) * DT <= 0.35


@pytest.mark.parametrize("halts", [False, True])
def test_a_jump_of_the_speed_override_is_no_jump_of_the_robot(halts: bool) -> None:
    """What moves goes on at its speed, and brakes from there: in following, and as it stops."""
    run, share, columns = Warm(), list[float](), op3().servo_columns
    robot, rows = run.robot, [*run.follow(150, warm=False)]
    for tick in range(150, 250, 10):
        rows += [robot.step(posture, DT).joint_positions for posture in human()[tick : tick + 10]]
        step = rows[-1] - rows[-2]
        robot.set_speed_override(0.7)
        q = stop_of(robot)[:2][-1] if halts else robot.step(human()[tick + 10], DT).q
        robot.set_speed_override(1.0)
        rows.append(q[columns])
        change = np.abs(rows[-1] - rows[-2] - step) / (op3().joint_map.max_acceleration * DT**2)
        assert change.max() <= 1.0 + 1e-9
        share.append(float(change.max()) if np.abs(step).max() / DT > 1.0 else np.nan)
    assert np.count_nonzero(np.isfinite(share)) > 5
    assert halts or np.nanmin(share) <= 0.7**2 + 1e-9  # a slower robot is gentler


def test_reseeding_takes_velocities_per_real_second() -> None:
    robot, body, servos = Warm().robot, op3().kinematics, slice(-len(op3().joint_map), None)
    for posture in human()[:100]:
        before, q = robot.step(posture, DT), robot.step(posture, DT).q
    robot.set_speed_override(0.5)
    moved = body.difference(before.q, q)
    robot.reseed(q, moved / DT)
    change = np.abs(body.difference(q, robot.step(human()[100], DT).q) - moved)[servos]
    assert np.abs(moved[servos]).max() / DT > 0.5
    assert change.max() <= 0.25 * op3().joint_map.max_acceleration.max() * DT**2 + 1e-9


# How low and how far a robot gets on its soles.


@cache
def envelope() -> Envelope:
    return measured()


def measured(limits: JointLimits | None = None, observers: Observers | None = None) -> Envelope:
    """The envelope of the OP3 with these limits; without observers: as if it could pass through itself."""
    seen = None if observers is None else observers.for_solver(op3().body)
    edges = stance().edges(0.01)
    return measure_envelope(op3(), limits or following_limits(op3(), stance()), stance(), edges=edges, observers=seen)


def test_the_op3_crouches_to_bent_knees_and_stands_on_nearly_straight_ones() -> None:
    """At no height of its envelope it touches itself. From 8 mm on OP3's shins are nearer to its feet in any deep
    crouch: that margins take a crouch away is noted, and that there is none."""
    # Sole to ankle 0.0305, shin and thigh 0.22 straight; knees bend from 11 to 148 degrees.
    assert 0.08 < envelope().lowest < 0.10
    assert 0.24 < envelope().highest < 0.2507
    observers, limits = robot_observers(op3()), following_limits(op3(), stance())
    kept = measured(observers=observers)
    assert kept.lowest > envelope().lowest + 0.02 and kept.highest == envelope().highest
    assert not kept.note and not envelope().note
    wide = replace(observers.with_margin(0.012), influence=observers.influence + 0.1)
    shows(measured(observers=wide).note, "39 mm", "161 mm", "margins")
    stiff = np.r_[limits.lower[:6], stance().q[7:]]
    shows(measured(replace(limits, lower=stiff, upper=np.r_[limits.upper[:6], stiff[6:]])).note, "cannot crouch")


def test_an_envelope_is_measured_once_for_a_robot_and_anew_for_other_limits() -> None:
    robot, limits, edges = op3(), following_limits(op3(), stance()), stance().edges(0.01)
    found, again = robot_envelope(robot, limits, edges=edges, margin=None), measured(observers=robot_observers(robot))
    assert np.array_equal(found.heights, again.heights) and np.array_equal(found.lean, again.lean)
    assert robot_envelope(robot, limits, edges=edges.copy(), margin=None) is found
    knee = robot.body.dof_index("l_knee")
    shallow = replace(limits, upper=np.where(np.arange(robot.body.nv) == knee, 0.5, limits.upper))
    assert robot_envelope(robot, shallow, edges=edges, margin=None).lowest > found.lowest + 0.02
    assert robot_envelope(robot, limits, edges=stance().edges(0.02), margin=None) is not found
    # The same robot, loaded again; and others, one of which differs in a shape, one in a posture, one in its body.
    assert robot_envelope(load_robot("op3"), limits, edges=edges, margin=None) is found
    postures = robot.profile.postures.model_copy(update={"stand": robot.profile.postures.stand | {"l_knee": 0.5}})
    others = (
        with_a_belly(),
        replace(robot, profile=robot.profile.model_copy(update={"postures": postures})),
        replace(robot, body=replace(robot.body, mass=1.01 * robot.body.mass)),
    )
    assert len({one.content for one in (robot, load_robot("op3"), load_robot("wolfgang"), *others)}) == 5


def with_a_belly() -> RobotBody:
    """OP3 with a box ahead of its hips, which its thighs meet when they fold by half of what servos allow."""
    box = {"box": {"pos": [0.06, 0.0, 0.0], "size": [0.02, 0.05, 0.02]}}
    belly = Observer.model_validate({"link": "body_link", "shape": box, "influence": 0.04, "margin": 0.005})
    observers = {**op3().profile.observers, "belly": belly}
    return replace(op3(), profile=op3().profile.model_copy(update={"observers": observers}))


@pytest.mark.long
def test_a_robot_whose_hips_fold_little_stays_down_while_the_performer_squats() -> None:
    """Lean and crouch want the same hips. It stood up again, as a lean counted for more than a crouch on small legs."""
    motion = postures(performer())
    heights = [human.joints[human.joint_names.index("pelvis"), 2] for human in motion[:TICKS]]
    low = int(np.argmin(heights[:300]))
    robot = following(with_a_belly(), "servo")
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
    """A robot that cannot crouch has one lean."""
    if np.hypot(x, y) > 1e-3:
        most = envelope().most_lean(height, x, y)
        assert envelope().lean.min() - 1e-9 <= most <= envelope().lean.max() + 1e-9
        stiff = Envelope(np.full(9, 0.4), np.full((9, 4), 0.2))
        assert stiff.most_lean(height, x, y) == pytest.approx(0.2)


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot"])
def test_a_difference_of_rounding_stays_one(name: str) -> None:
    """Two robots begin 1e-12 rad from each other, and follow a crouch and a reach: no joint is ever more than 1e-7 rad
    off, so that no branch is decided by a last bit."""
    robot, human = shipped(name), postures(performer())[: round(3.5 / DT)]
    rng, paths = np.random.default_rng(46), []
    for size in (0.0, 1e-12):
        one = following(robot, "balanced")
        one.start(human[0])
        q = one.stance.q.copy()
        q[robot.servo_columns] += size * rng.choice([-1.0, 1.0], len(robot.servo_columns))
        one.reseed(q, np.zeros(robot.body.nv))
        paths.append(np.array([one.step(posture, DT).joint_positions for posture in human]))
    assert np.abs(paths[1] - paths[0]).max() < 1e-7
