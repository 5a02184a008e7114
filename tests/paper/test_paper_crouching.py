"""Experiments 1 to 3 on a shortened synthetic performer, and on the recording of the paper where there is one."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmarks.paper.chain_runs import ONE, TWO, ChainRun, reaching_chain, yielding_chain
from benchmarks.paper.crouching import PENETRATION, Outcome, crouching
from benchmarks.paper.damping_law import DampedPoint, damped_points
from benchmarks.paper.observed_distances import observed_distances
from benchmarks.paper.outlines import scene_outlines
from benchmarks.paper.placement import HINDERED, START_CLEAR, crouch_cycles
from benchmarks.paper.run import CROUCH, read_trial
from benchmarks.paper.table import as_data, show_outcomes
from retarget.frames import SensorFrames
from retarget.model.observers import human_observers
from retarget.schema.priorities import ObserverSettings
from retarget.schema.scene import Scene
from retarget.types import FloatArray
from sim.performer import CYCLES, synthetic_performer

Outcomes = dict[tuple[int, str], Outcome]

pytestmark = pytest.mark.long


def run(frames: SensorFrames) -> Outcomes:
    outcomes = crouching(frames)
    return {(outcome.experiment.number, outcome.priorities): outcome for outcome in outcomes}


@pytest.fixture(scope="module")
def short() -> SensorFrames:
    """Two cycles and a half at 60 Hz."""
    frames = synthetic_performer()
    return frames.resample(frames.time[:840:2])


@pytest.fixture(scope="module")
def made(short: SensorFrames) -> Outcomes:
    return run(short)


def check_placement(outcomes: Outcomes) -> None:
    """Without observers 5 cm deep in two cycles or more, and the start clear of the whole body."""
    for number in (2, 3):
        outcome = outcomes[number, "paper"]
        assert outcome.cycles >= 2
        assert outcome.free_distances.min() <= -HINDERED
        capsules = human_observers(outcome.free.human, ObserverSettings(human="capsules"))
        assert capsules is not None
        scene = outcome.experiment.scene
        start = observed_distances(outcome.free.human.body, capsules, outcome.free.q[:1], scene).least_scene
        assert start[0] >= START_CLEAR - 1e-9


def test_observers_keep_clear(made: Outcomes) -> None:
    for outcome in made.values():
        assert outcome.on_observers.scene_frames == 0 and outcome.on_observers.own_frames == 0
        if outcome.experiment.scene is not None:
            assert outcome.free_on_observers.scene_frames > 5
            assert (outcome.replay.modes > 0).any()
    for number in (1, 2, 3):
        assert made[number, "human_clear"].on_capsules.own_frames == 0


def test_sensors_are_followed_where_nothing_hinders(made: Outcomes) -> None:
    for outcome in made.values():
        errors = outcome.replay.errors_mm
        assert np.nanmean(errors[:, outcome.replay.sensors.index("l_ankle")]) < 1.0
    assert np.nanmax(made[1, "paper"].replay.errors_mm) < 1.0
    np.testing.assert_array_less(
        made[2, "paper"].replay.errors_mm[:20], 1.0, err_msg="the start is out of every influence"
    )


def test_table_and_data(made: Outcomes, capsys: pytest.CaptureFixture[str]) -> None:
    show_outcomes(list(made.values()), docs=False)
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert len(rows) == 10 and {line.count(" | ") for line in rows if "---" not in line} == {6}
    data = as_data(made[3, "paper"])
    assert data["paper_frames_per_s"] == 40.6 and data["on_observers"]["penetrating_frames"]["scene"] == 0
    assert data["cycles_hindered_without_observers"] >= 2
    assert as_data(made[1, "paper"])["scene"] is None


def test_the_recording_of_the_paper(shared: Path) -> None:
    frames = read_trial(shared / "mocap", CROUCH)
    assert frames is not None and len(frames) == 2235
    outcomes = run(frames)
    check_placement(outcomes)
    for (number, name), outcome in outcomes.items():
        assert outcome.on_observers.scene_frames == 0, f"experiment {number}, {name}"
        assert outcome.on_observers.own_frames == 0, f"experiment {number}, {name}"
        assert outcome.replay.frames_per_s > outcome.experiment.paper_fps
        if name == "human_clear":
            assert outcome.on_capsules.own_clearance > -PENETRATION
            assert outcome.on_capsules.scene_clearance > -PENETRATION


# Figures 5 and 6: a still chain yields before it is touched; of a chain that reaches, the right links act.

TOUCH = -1e-5
"""m: exact touching is allowed (margin 0), rounding of a step is not penetration."""


@pytest.fixture(scope="module")
def one() -> ChainRun:
    return reaching_chain(ONE)


@pytest.fixture(scope="module")
def two() -> ChainRun:
    return reaching_chain(TWO)


def test_a_still_chain_bends_away_before_it_is_touched() -> None:
    run = yielding_chain()
    assert run.clearance.min() > TOUCH
    assert not (run.modes == 2).any()
    still = run.points[0]
    first = int(np.argmax(run.within.any(axis=(1, 2))))
    assert first > 20
    np.testing.assert_allclose(run.points[:first], still[None].repeat(first, axis=0), atol=1e-9)
    # A chain that stayed would have been hit.
    ball = run.balls[0]
    assert np.abs(run.centres[:, 0, 0]).min() < 0.5 * ball.radius
    moved = np.linalg.norm(run.points[-1] - still, axis=1)
    assert moved.max() > 0.1
    yielded = int(np.argmax(np.linalg.norm(run.points - still, axis=2).max(axis=1) > 1e-6))
    assert first <= yielded + 1 and run.clearance[yielded].min() > 0.5 * ball.influence


def test_of_the_links_in_one_zone_only_the_closest_acts(one: ChainRun) -> None:
    acting = one.modes == 1
    assert one.clearance.min() > TOUCH
    assert acting.sum(axis=1).max() == 1
    assert one.within.any(axis=2).sum(axis=1).max() >= 3
    for k in np.flatnonzero(acting.any(axis=1)).tolist():
        before, link = one.clearance[k - 1, :, 0], int(np.argmax(acting[k]))  # modes are of the way from there to k
        assert one.within[k - 1, link, 0]
        nearer = (before < before[link] - 1e-9) & (one.clearance[k, :, 0] < before - 1e-4)
        assert not nearer.any(), "a nearer link approached, and did not act"


def test_two_obstacles_each_have_their_own(two: ChainRun) -> None:
    acting = two.modes == 1
    assert two.clearance.min() > TOUCH
    both = np.flatnonzero(acting.sum(axis=1) == 2)
    assert acting.sum(axis=1).max() == 2 and len(both) > 0
    for k in both.tolist():
        links = np.flatnonzero(acting[k])
        zones = two.within[k - 1][links]
        assert zones.any(axis=0).all(), "one of them is in the zone of each obstacle"


def test_the_goal_is_reached(one: ChainRun, two: ChainRun) -> None:
    for run in (one, two):
        assert run.goal is not None
        np.testing.assert_allclose(run.points[-1, -1], run.goal, atol=1e-3)


# Parts of the paper's experiments: recordings, outlines, cycles, and the law of damping.

# Outlines: a sphere is a circle, a cylinder along its axis too, and zones are wider by the influence.


def scene(shape: dict[str, object]) -> Scene:
    obstacle = {"shape": shape, "influence": 0.2, "margin": 0.0}
    return Scene.model_validate({"name": "one", "description": "one", "obstacles": {"thing": obstacle}})


def along_y(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return points[:, 0], points[:, 2], -points[:, 1]


@pytest.mark.parametrize(
    "shape",
    [
        {"sphere": {"at": (1.0, 2.0, 3.0), "radius": 0.5}},
        {"cylinder": {"from": (1.0, 1.0, 3.0), "to": (1.0, 3.0, 3.0), "radius": 0.5}},
    ],
)
def test_seen_along_the_axis_both_are_circles(shape: dict[str, object]) -> None:
    (outline,) = scene_outlines(scene(shape), along_y)
    for corners, radius in ((outline.solid, 0.5), (outline.zone, 0.7)):
        np.testing.assert_allclose(np.linalg.norm(corners - [1.0, 3.0], axis=1), radius, atol=2e-3)
    assert outline.near == pytest.approx(-2.0)


# Crouch cycles are found by the head alone.


def test_the_synthetic_performer_crouches_so_often() -> None:
    frames = synthetic_performer()
    head = frames.position[:, frames.index("head"), 2]
    cycles = crouch_cycles(head)
    assert len(cycles) == CYCLES
    assert cycles[0].start == 0 and cycles[-1].stop == len(frames)
    assert all(a.stop == b.start for a, b in pairwise(cycles))
    assert all(head[cycle].min() < 0.7 * head[0] for cycle in cycles)


def test_who_only_stands_has_no_cycle() -> None:
    assert crouch_cycles(np.full(100, 1.6)) == []


# Figure 4: what the compiled solver leaves of four displacements beside a sphere, against the law written out.


LEFT = 1.1e-6
"""The share of a step that the least damping of a stage keeps back: the square of LEAST_DAMPING, 1e-3."""


@pytest.fixture(scope="module")
def points() -> dict[str, DampedPoint]:
    return {point.name: point for point in damped_points()}


def test_outside_and_moving_away_nothing_is_altered(points: dict[str, DampedPoint]) -> None:
    for name in ("e1", "e4"):
        assert not points[name].acted
        np.testing.assert_allclose(points[name].got, points[name].asked, atol=1e-9, rtol=LEFT)


def test_only_the_normal_motion_is_damped_by_alpha(points: dict[str, DampedPoint]) -> None:
    for name in ("e2", "e3"):
        point = points[name]
        asked, got = point.asked @ point.normal, point.got @ point.normal
        assert point.acted and asked < 0.0
        assert got == pytest.approx(point.share * asked, rel=LEFT)
        np.testing.assert_allclose(
            point.got - got * point.normal, point.asked - asked * point.normal, atol=1e-9, rtol=LEFT
        )
