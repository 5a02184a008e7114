"""The first stage on recordings and on the synthetic performer: tracking, limits, symmetry, faults, any rate."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import people
from benchmarks.paper.replay import replay
from people import Run, close_passes, reconstruct, thinned, turned
from retarget import rotations
from retarget.frames import SensorFrames, SensorSample
from retarget.human.reconstruction import SensorLayout
from retarget.human.sensor_intake import IntakeTimes
from retarget.model.human import build_human, human_limits
from retarget.model.human_dimensions import POINTS, proportional_dimensions
from retarget.schema.performer import Performer, PerformerSensor
from retarget.schema.priorities import load_priorities
from retarget.types import Carrying
from sim.performer import synthetic_performer

FILES = ("human", "paper")


def displaced(name: str, ticks: range, by: list[float]) -> Callable[[int, SensorSample], SensorSample]:
    """A change of samples: a sensor is elsewhere during these ticks."""

    def change(k: int, sample: SensorSample) -> SensorSample:
        rows = np.array([one == name and k in ticks for one in sample.names])
        return replace(sample, position=sample.position + np.where(rows[:, None], by, 0.0))

    return change


@pytest.fixture(scope="module")
def reaching(shared: Path) -> SensorFrames:
    """02_06 from standing over the first crouch to the first reach, 120 Hz."""
    return people.trial(shared, "02_06").cut(0.0, 2.8)


@cache
def synthetic(priorities: str) -> Run:
    return reconstruct(thinned(synthetic_performer().cut(0.0, 5.0), 2), priorities)


@pytest.mark.parametrize("priorities", FILES)
def test_sensors_are_tracked_to_the_required_accuracy(reaching: SensorFrames, priorities: str) -> None:
    """At most 0.5 mm at the ankles, 2 mm at hands and head, 1 mm at a centre of mass that ranks first."""
    errors = (run := reconstruct(reaching, priorities)).errors_mm.mean(axis=0)
    assert (errors[:3] < 2.0).all() and (errors[3:] < 0.5).all()
    if priorities == "paper":
        assert run.balance_mm.max() < 1.0


@pytest.mark.parametrize("priorities", FILES)
def test_no_limit_is_violated(priorities: str) -> None:
    run = synthetic(priorities)
    body, limits = run.human.body, human_limits(run.human.body)
    single, address = body.scalar_joints()
    angles = run.q[:, address[single]]
    assert (angles >= limits.lower[single] - 1e-12).all() and (angles <= limits.upper[single] + 1e-12).all()
    solver_body = body.solver_body()
    for before, after in pairwise(run.q):
        assert (np.abs(solver_body.difference(before, after)) / run.dt <= limits.max_velocity + 1e-6).all()
    assert (run.q[:, address[run.human.locked & single]] == 0.0).all()


def test_early_levels_converge_first(reaching: SensorFrames) -> None:
    """Hands are asked 0.3 m forward at once, one iteration per frame: balance and ankles hold with hands far off."""

    def reach(k: int, sample: SensorSample) -> SensorSample:
        first = reaching.sample(0.0)
        hands = np.isin(first.names, ("l_wrist", "r_wrist"))[:, None] & (k > 0)
        return replace(first, position=first.position + np.where(hands, [0.3, 0.0, 0.3], 0.0))

    run = reconstruct(reaching.resample(0.01 * np.arange(60)), "paper", iterations=1, change=reach)
    on_the_way = np.array(run.errors_mm[:, 1:3].max(axis=1) > 20.0)
    assert on_the_way.sum() >= 5 and run.errors_mm[-1].max() < 1.0
    assert run.balance_mm[on_the_way].max() < 1.0
    assert run.errors_mm[on_the_way, 3:].max() < 0.1 * run.errors_mm[on_the_way, 1:3].max()


def test_head_and_hands_alone_stand_on_their_feet() -> None:
    frames = thinned(synthetic_performer().cut(0.0, 4.0), 4)
    run = reconstruct(frames, "human", performer="three")
    assert (run.errors_mm.mean(axis=0) < 2.0).all()
    feet = run.joints[:, [run.postures[0].joint_names.index(name) for name in ("l_ankle", "r_ankle")]]
    assert (feet[..., 2] > 0.0).all() and (feet[..., 2] < 0.2).all()
    assert np.linalg.norm(np.diff(feet, axis=0), axis=-1).max() < 0.05


@pytest.mark.parametrize("priorities", FILES)
@pytest.mark.parametrize("angle", [np.pi / 2, np.pi, 2.5])
def test_a_turned_world_gives_a_turned_posture(priorities: str, angle: float) -> None:
    """Also: whichever way a performer faces at the start."""
    frames = thinned(synthetic_performer().cut(0.0, 1.5), 4)
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(angle))
    straight = rotations.rotate(turn, reconstruct(frames, priorities).joints)
    assert reconstruct(turned(frames, angle), priorities).joints == pytest.approx(straight, abs=1e-3)


def test_a_mirrored_performer_gives_a_mirrored_posture_and_the_same_one_the_same_bits() -> None:
    frames = thinned(synthetic_performer().cut(0.0, 1.5), 4)
    run, mirrored = reconstruct(frames, "human"), reconstruct(frames.mirror(), "human")
    names = run.postures[0].joint_names
    other = [names.index({"l_": "r_", "r_": "l_"}.get(name[:2], name[:2]) + name[2:]) for name in names]
    assert mirrored.joints == pytest.approx(run.joints[:, other] * [1.0, -1.0, 1.0], abs=2e-3)
    assert (reconstruct(frames, "human").q == run.q).all(), "the same input gives the same bits"


def test_a_lost_and_a_jumping_sensor_make_no_jump() -> None:
    """The left wrist is gone for 0.5 s, the right one is 0.4 m off for 0.1 s."""

    def faults(k: int, sample: SensorSample) -> SensorSample:
        position, valid = sample.position.copy(), sample.valid.copy()
        left, right = sample.names.index("l_wrist"), sample.names.index("r_wrist")
        if 60 <= k < 120:
            position[left], valid[left] = np.nan, False
        if 150 <= k < 162:
            position[right] += 0.4
        return SensorSample(sample.names, position, sample.orientation, valid)

    frames = synthetic_performer().cut(0.0, 2.0)
    run = reconstruct(frames, "human", change=faults)
    assert np.isfinite(run.joints).all()
    speed = np.linalg.norm(np.diff(run.joints, axis=0), axis=-1).max() * frames.rate_hz
    clean = np.linalg.norm(np.diff(reconstruct(frames, "human").joints, axis=0), axis=-1).max() * frames.rate_hz
    assert speed < clean + 0.4 * np.sqrt(3.0) / IntakeTimes().fade + 1.0  # the fastest that an offset fades
    assert run.errors_mm[-1] == pytest.approx(np.zeros(5), abs=1.0)


@pytest.mark.parametrize("name", ["head", "l_wrist", "r_ankle"])
def test_a_jump_that_comes_back_leaves_no_trace(name: str) -> None:
    """A sensor is 0.5 m off for 0.1 s: 0.3 s later every joint is where it is without that."""
    jump = displaced(name, range(36, 42), [-0.3, 0.0, 0.4])
    frames = thinned(synthetic_performer().cut(0.0, 1.5), 2)
    away = reconstruct(frames, "human", change=jump).joints - reconstruct(frames, "human").joints
    assert np.linalg.norm(away, axis=-1)[42 + round(0.3 * frames.rate_hz)].max() < 0.007


def test_nothing_valid_at_the_start_stands_still() -> None:
    frames = thinned(synthetic_performer().cut(0.0, 1.0), 4)

    def delayed(k: int, sample: SensorSample) -> SensorSample:
        lost = replace(sample, position=np.full_like(sample.position, np.nan), valid=np.zeros_like(sample.valid))
        return sample if k >= 5 else lost

    run = reconstruct(frames, "human", change=delayed)
    assert np.isfinite(run.q).all() and np.isnan(run.errors_mm[:5]).all()


def test_which_feet_carry_is_found_from_five_sensors(shared: Path) -> None:
    frames = thinned(people.trial(shared, "49_18"), 8).cut(0.0, 4.0)
    assert {posture.carrying for posture in reconstruct(frames, "human").postures} == {Carrying.LEFT}
    assert {posture.carrying for posture in reconstruct(frames, "human", performer="three").postures} == {Carrying.BOTH}


HUMAN = build_human(proportional_dimensions(1.75))
PERFORMER = Performer(
    name="p",
    description="p",
    sensors={
        "head": PerformerSensor(joint="head", orientation=True),
        "l_wrist": PerformerSensor(joint="l_wrist", orientation=True),
        "pelvis": PerformerSensor(joint="pelvis"),
    },
)
TURN = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(0.5))


def test_positions_that_are_no_numbers_are_not_valid_and_orientations_are_those_of_the_links() -> None:
    layout, position = SensorLayout(PERFORMER), np.arange(6.0).reshape(2, 3)
    position[1, 2] = np.nan
    _, orientation, valid = layout.read(
        SensorSample(("l_wrist", "head"), position, np.stack([TURN, TURN]), np.array([True, True]))
    )
    assert list(valid) == [False, True, False]
    head, hand = layout.turns(orientation)
    assert (head.sensor, hand.sensor) == ("head", "l_wrist")
    assert head.link == pytest.approx(TURN) and head.forward == pytest.approx((np.cos(0.5), np.sin(0.5)))
    assert hand.link == pytest.approx(TURN)


def test_a_body_that_is_upside_down_is_found() -> None:
    """The sensors of a performer who stands are turned upside down from one sample to the next, as after a flip that
    was not seen. Half a second later the body has them."""
    frames = thinned(synthetic_performer().cut(0.0, 1.5), 2)
    turned, middle = rotations.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.pi), np.array([0.0, 0.0, 0.9])

    def flip(k: int, sample: SensorSample) -> SensorSample:
        position = frames.position[0] if k < 30 else rotations.rotate(turned, frames.position[0] - middle) + middle
        return replace(sample, position=position)

    errors = reconstruct(frames, "human", change=flip).errors_mm
    assert errors[30 + round(0.5 * frames.rate_hz) :].max() < 5.0


@pytest.mark.parametrize("name", ["l_ankle", "r_wrist"])
def test_a_spike_of_one_frame_does_not_pass(name: str) -> None:
    """A sensor is 70 mm too high in one frame of 120 Hz: no joint is more than 10 mm from where it is without that."""
    spike = displaced(name, range(60, 61), [0.0, 0.0, 0.07])
    frames = synthetic_performer().cut(2.0, 3.0)
    away = reconstruct(frames, "human", change=spike).joints - reconstruct(frames, "human").joints
    assert np.linalg.norm(away, axis=-1).max() < 0.01


def test_ankles_that_pass_close_and_crossed_arms_throw_no_pelvis() -> None:
    """A performer strides with ankles that pass at 80 mm, and crosses the arms over the chest: its own shapes ask for
    nothing."""
    frames = close_passes()
    run, blind = (replay(frames, load_priorities("human"), observed=observed) for observed in ("capsules", "none"))
    assert (run.joints == blind.joints).all()
    pelvis = run.joints[:, POINTS.index("pelvis")]
    assert 1e3 * np.linalg.norm(np.diff(pelvis, axis=0), axis=1).max() < 15.0
    assert run.errors_mm.max() < 10.0
