"""Experiments 1 to 3 on a shortened synthetic performer, and on the recording of the paper where there is one."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.paper.crouching import PENETRATION, Outcome, crouching
from benchmarks.paper.observed_distances import observed_distances
from benchmarks.paper.placement import HINDERED, START_CLEAR
from benchmarks.paper.run import CROUCH, read_trial
from benchmarks.paper.table import as_data, show_outcomes
from retarget.frames import SensorFrames
from retarget.model.observers import human_observers
from retarget.schema.priorities import ObserverSettings
from sim.performer import synthetic_performer

Outcomes = dict[tuple[int, str], Outcome]


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
        capsules = human_observers(outcome.free.human, ObserverSettings(), "capsules")
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
        assert made[number, "human"].on_capsules.own_frames == 0


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


@pytest.mark.long
def test_the_recording_of_the_paper(shared: Path) -> None:
    frames = read_trial(shared / "mocap", CROUCH)
    assert frames is not None and len(frames) == 2235
    outcomes = run(frames)
    check_placement(outcomes)
    for (number, name), outcome in outcomes.items():
        assert outcome.on_observers.scene_frames == 0, f"experiment {number}, {name}"
        assert outcome.on_observers.own_frames == 0, f"experiment {number}, {name}"
        assert outcome.replay.frames_per_s > outcome.experiment.paper_fps
        if name == "human":
            assert outcome.on_capsules.own_clearance > -PENETRATION
            assert outcome.on_capsules.scene_clearance > -PENETRATION
