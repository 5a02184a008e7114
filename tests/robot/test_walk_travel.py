"""How fast a robot is to walk: from performers who are made up, whose feet and facing are known."""

from dataclasses import dataclass

import numpy as np
import pytest

from followers import op3, stance
from retarget.robot.walking.gait import fastest, gait_of
from retarget.robot.walking.pattern import Gait, Request
from retarget.robot.walking.travel import Travel
from retarget.types import Carrying, FloatArray, HumanPosture

DT = 0.008
GAIT: Gait = gait_of(op3(), stance(), dt=DT)
MOST = fastest(GAIT)
SCALE = 0.25
STEP_S = 0.6


@dataclass
class Stroller:
    """A performer whose feet go by turns, STEP_S each, at a velocity (3,) forward, left m/s and turn rad/s of their
    own, whose pelvis swings by 0.15 rad; while `walks`."""

    velocity: FloatArray
    t: float = 0.0

    def __post_init__(self) -> None:
        self.at, self.yaw = np.zeros(2), 0.3
        self.feet = [np.array([0.0, 0.1]), np.array([0.0, -0.1])]

    def step(self, *, walks: bool) -> HumanPosture:
        """The posture a tick later."""
        swing, carrying = 0.0, Carrying.BOTH
        if walks:
            self.t += DT
            foot = int(self.t / STEP_S) % 2
            carrying = Carrying.RIGHT if foot == 0 else Carrying.LEFT
            c, s = np.cos(self.yaw), np.sin(self.yaw)
            x, y, turn = self.velocity
            way = np.array([c * x - s * y, s * x + c * y]) * DT
            self.at, self.yaw = self.at + way, self.yaw + float(turn) * DT
            self.feet[foot] = self.feet[foot] + 2.0 * way
            swing = 0.15 * np.sin(np.pi * self.t / STEP_S)
        joints = np.array([[*self.feet[0], 0.08], [*self.feet[1], 0.08]])
        facing = float(np.cos(self.yaw + swing)), float(np.sin(self.yaw + swing))
        names, turns, nothing = ("l_ankle", "r_ankle"), np.zeros((3, 4)), np.zeros(0)
        return HumanPosture(nothing, names, joints, turns, np.zeros(3), nothing, 0.0, facing, carrying=carrying)


def velocity_of(request: Request) -> FloatArray:
    return np.array([request.forward, request.left, request.turn])


def within(request: Request | None) -> Request:
    """What a robot does that gets this request."""
    most = velocity_of(MOST)
    return Request() if request is None else Request(*np.clip(velocity_of(request), -most, most).tolist())


def driven(
    velocity: tuple[float, float, float], *, walk_s: float, stand_s: float = 4.0
) -> tuple[list[Request | None], Travel]:
    """What is request tick by tick of a robot that does at once what it is request, within what it can."""
    travel, performer, robot = Travel(GAIT, MOST, scale=SCALE), Stroller(np.array(velocity)), Request()
    found = list[Request | None]()
    for tick in range(round((1.0 + walk_s + stand_s) / DT)):
        request = travel.step(performer.step(walks=1.0 < tick * DT < 1.0 + walk_s), robot)
        found.append(request)
        robot = within(request)
    return found, travel


def middle(request: list[Request | None]) -> FloatArray:
    """The mean of what is request in the middle of a walk (3,), and how it varies (3,)."""
    rows = np.array([velocity_of(one) for one in request[600:1000] if one is not None])
    assert len(rows) == 400
    return np.array([rows.mean(axis=0), np.ptp(rows, axis=0)])


@pytest.mark.parametrize("velocity", [(0.3, 0.0, 0.0), (-0.2, 0.0, 0.0), (0.0, 0.12, 0.0), (0.2, 0.0, 0.25)])
def test_a_robot_that_can_walks_as_the_performer_scaled(velocity: tuple[float, float, float]) -> None:
    """Its pelvis swings from step to step, and is not followed in that."""
    request, travel = driven(velocity, walk_s=10.0)
    wanted = np.array([SCALE, SCALE, 1.0]) * velocity
    mean, varies = middle(request)
    np.testing.assert_allclose(mean, wanted, atol=0.012)
    assert varies[2] < 0.1, "a swing of 0.15 rad at its speed would be 1.5 rad/s"
    (walked, turned), (gone, around) = travel.walked, travel.desired
    assert walked == pytest.approx(10.0 * np.hypot(*wanted[:2]), rel=0.15) and gone == pytest.approx(walked, rel=0.2)
    assert turned == pytest.approx(10.0 * abs(wanted[2]), abs=0.4) and around >= 0.0


def test_steps_on_the_spot_stay_there_and_a_stand_and_one_lifted_foot_are_no_walk() -> None:
    assert np.abs(middle(driven((0.0, 0.0, 0.0), walk_s=8.0)[0])[0]).max() < 0.01
    assert not any(driven((0.3, 0.0, 0.0), walk_s=0.0)[0])
    travel, performer = Travel(GAIT, MOST, scale=SCALE), Stroller(np.zeros(3))
    assert not any(travel.step(performer.step(walks=0.5 < tick * DT < 0.9), Request()) for tick in range(400))


@pytest.mark.parametrize("velocity", [(0.3, 0.0, 0.0), (1.2, 0.0, 0.0), (0.0, 0.0, 1.5)])
def test_it_begins_and_ends_with_the_performer(velocity: tuple[float, float, float]) -> None:
    """Within two steps of the robot, however far a fast performer has gone."""
    request, _ = driven(velocity, walk_s=6.0)
    walks = np.array([one is not None for one in request])
    begins, ends = np.flatnonzero(np.diff(walks.astype(int)) == 1), np.flatnonzero(np.diff(walks.astype(int)) == -1)
    assert len(begins) == len(ends) == 1
    assert 0.0 <= begins[0] * DT - 1.0 < 2.0 * STEP_S
    assert -0.1 < ends[0] * DT - 7.0 < 0.8 + 2.0 * GAIT.period
    if velocity[0] > 1.0:  # what it is behind is bounded
        greatest = max(one.forward for one in request if one is not None)
        assert greatest <= SCALE * velocity[0] + 2.0 * GAIT.period * MOST.forward / 1.5 + 0.02


def test_a_performer_on_one_leg_does_not_walk() -> None:
    """A performer stops in the middle of a step, one foot in the air."""
    travel, performer = Travel(GAIT, MOST, scale=SCALE), Stroller(np.array([0.2, 0.0, 0.0]))
    request = [travel.step(performer.step(walks=True), Request()) for _ in range(600)]
    still = performer.step(walks=True)
    for _ in range(800):
        request.append(travel.step(still, within(request[-1])))
    assert request[600] is not None and request[-1] is None


def test_a_new_walk_has_nothing_of_the_one_before() -> None:
    """Foot, phase and duration of steps are those of the new one."""
    travel, performer = Travel(GAIT, MOST, scale=SCALE), Stroller(np.array([0.2, 0.0, 0.0]))
    for tick in range(round(14.0 / DT)):
        travel.step(performer.step(walks=not 3.0 < tick * DT < 13.0), Request())
        if 12.0 < tick * DT < 13.0:
            assert travel.swing is None
    assert travel.swing is not None
    assert abs(travel.swing.since) < 1.0 and 0.4 < travel.swing.period < 0.9
