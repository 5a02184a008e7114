"""A robot that balances stands, upright over its soles, its arms aside, before it is parked."""

import numpy as np
import pytest

from followers import DT, dimensions, op3, performer, postures
from retarget.body import IntArray
from retarget.follow import Follower
from retarget.landing import LED_SPEED, RESTING_SPEED, RESTS_S, Landing, landing_of
from retarget.landmarks import AskedLandmarks
from retarget.parking import LONGEST_LANDING_S, PACE
from retarget.priorities import load_priorities
from retarget.robot_body import HEAD, TRUNK, RobotBody, load_robot
from retarget.robot_reader import RobotReader, standing_dofs
from retarget.rotations import FloatArray
from retarget.scalar_rotations import plus
from retarget.stance import plant
from retarget.standing_balance import StandingBalance

PELVIS = list(op3().profile.landmarks).index("pelvis")
STEADY = {"op3": "steady", "toddlerbot": "lasting", "wolfgang": "steady"}


def crouched(name: str = "op3", ticks: int = 300) -> Follower:
    """Stopped in the midst of what the performer does."""
    robot = Follower(load_robot(name), load_priorities(STEADY[name]), dimensions(performer()))
    motion = postures(performer())
    robot.start(motion[0])
    robot.arrive(motion[0], DT)
    for human in motion[1:ticks]:
        robot.step(human, DT)
    for _ in range(100):
        robot.halt(DT)
    robot.begin_landing(robot._q.copy())
    return robot


def test_it_stands_upright_on_its_soles_with_legs_more_alike() -> None:
    robot = crouched(ticks=200)
    reader = RobotReader(op3(), robot.stance)
    start = reader.read(robot._q)
    way: list[FloatArray] = []
    while (q := robot.land(DT)) is not None:
        way.append(q.copy())
        assert len(way) * DT < LONGEST_LANDING_S
    now = reader.read(way[-1])
    lean = [2.0 * np.arccos(min(abs(there.trunk[0]), 1.0)) for there in (start, now)]
    assert lean[0] > 0.3 and lean[1] < 0.1
    assert robot._balance is not None
    x, y, _ = now.centre_of_mass
    assert all(nx * x + ny * y < offset + 1e-3 for nx, ny, offset in robot._balance._wide)
    soles = op3().points(np.array(way), ("l_sole", "r_sole"))
    assert np.abs(soles - [sole.position for sole in robot.stance.soles]).max() < 1e-3


@pytest.mark.parametrize("name", list(STEADY))
def test_legs_and_trunk_end_as_in_the_stance_and_arms_aside(name: str) -> None:
    """Hands that stay, with arms that are drawn elsewhere, would hold a waist aside, and two planted soles cannot go
    straight to `rest` from there."""
    follower = crouched(name)
    robot, start = load_robot(name), follower._q.copy()
    while (q := follower.land(DT)) is not None:
        last = q.copy()
    carrying, arms = joints_of(robot)
    stand = follower.stance.q
    assert np.abs(start - stand)[carrying].max() > 0.3
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
        robot._advance(AskedLandmarks(aside, turned, standing.gaze), DT, haste=1.0)
    return robot


def test_from_the_edge_of_its_room_it_comes_upright_at_once() -> None:
    """With the room in which it follows, its mass would crawl along that edge, and the robot be parked from there."""
    robot = leaning()

    def away() -> float:
        return float(
            np.linalg.norm(np.subtract(robot._reached.landmarks[PELVIS], robot.landmark_map.standing.landmarks[PELVIS]))
        )

    assert away() > 0.01
    ticks = 0
    while away() > 2e-3:
        assert robot.land(DT) is not None
        ticks += 1
    assert ticks * DT < 2.0


def test_joints_are_led_straight_from_where_they_are() -> None:
    follower = crouched()
    landing = landing_of(op3(), follower.stance, follower.landmark_map.standing, follower._balance)
    assert landing is not None
    start = follower._q.copy()
    landing.begin(start)
    way = [landing.lead(DT)[7:].copy()]
    while not landing.arrived:
        way.append(landing.lead(DT)[7:].copy())
    steps = np.diff(np.array([start[7:], *way]), axis=0)
    assert np.abs(steps).max() <= LED_SPEED * DT + 1e-9
    assert np.linalg.matrix_rank(steps, tol=1e-6) == 1
    landing.begin(follower.stance.q)
    assert np.abs(landing.lead(DT) - follower.stance.q)[7:].max() <= LED_SPEED * DT + 1e-9, "and again, from there"


def test_one_tick_that_stands_still_is_no_stand() -> None:
    """Where limbs meet, all stand still for a tick."""
    follower = Follower(op3(), load_priorities("steady"), dimensions(performer()))
    landing = Landing(op3(), follower.stance, follower.landmark_map.standing)
    landing.begin(follower.stance.q)
    moving, still = np.ones(op3().body.nv), np.zeros(op3().body.nv)
    assert all(landing.goes_on(still, DT, stands=True) for _ in range(100)), "joints are still led"
    while not landing.arrived:
        landing.lead(DT)
    for velocity in [moving] * 100 + [still] + [moving] * 10 + [still] * round((RESTS_S - 0.5 * DT) / DT):
        assert landing.goes_on(velocity, DT, stands=True)
    assert not landing.goes_on(still, DT, stands=True)
    landing.begin(follower.stance.q)
    assert landing.goes_on(still, DT, stands=True), "and once more from the beginning"


def test_it_lands_at_half_of_its_speeds_and_ends_at_rest() -> None:
    robot = crouched()
    robot.keep_pace(PACE)
    way = [robot._q.copy()]
    while (q := robot.land(DT)) is not None:
        way.append(q.copy())
    speeds = np.abs(np.diff(np.array(way)[:, op3().servo_columns], axis=0)) / DT
    most = robot._limits.max_velocity[[op3().body.dof_index(joint) for joint in op3().joint_map.joints]]
    assert 0.45 < (speeds / most).max() < 0.5 + 1e-6
    assert speeds[-10:].max() < RESTING_SPEED


def test_hands_that_do_not_get_there_do_not_draw_the_body() -> None:
    robot = crouched("toddlerbot")
    standing = robot.landmark_map.standing
    away = [
        plus(place, (0.3, 0.0, 0.3)) if "hand" in name else place
        for name, place in zip(robot.landmark_map.names, standing.landmarks, strict=True)
    ]
    hands = frozenset(row for row, name in enumerate(robot.landmark_map.names) if "hand" in name)
    drawn = []
    for anywhere in (hands, frozenset[int]()):
        for _ in range(200):
            robot._advance(AskedLandmarks(away, standing.trunk, standing.gaze, open=anywhere), DT, haste=1.0)
        pelvis = robot.landmark_map.names.index("pelvis")
        drawn.append(float(np.linalg.norm(np.subtract(robot._reached.landmarks[pelvis], standing.landmarks[pelvis]))))
    assert drawn[0] < 0.005 < drawn[1]


def test_priorities_that_look_at_no_motion_know_no_landing() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    servo = Follower(op3(), load_priorities("servo"), dimensions(performer()))
    servo.start(postures(performer())[0])
    assert servo.land(DT) is None
    standing = servo.landmark_map.standing
    assert landing_of(op3(), stance, standing, StandingBalance(load_priorities("servo"), stance)) is None
    assert landing_of(op3(), stance, standing, None) is None
