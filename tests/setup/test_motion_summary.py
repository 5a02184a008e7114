"""Summaries of recordings: jumps, heights, speeds, lengths."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from followers import DT, op3
from observed import ZONE, Done, act, human, raised, robot, scene_of, sphere, without_observers
from retarget import rotations
from retarget.frames import SensorFrames
from retarget.report.motion_metrics import jerk_p95, observer_activity
from retarget.schema.priorities import load_priorities
from retarget.setup.motion_summary import find_jumps, summarise
from retarget.sources.asf_amc import read_amc
from sim.performer import synthetic_performer


@pytest.fixture(scope="module")
def performer() -> SensorFrames:
    return synthetic_performer()


def test_a_smooth_motion_has_no_jumps(performer: SensorFrames) -> None:
    summary = summarise(performer)
    assert summary.jumps == () and summary.frames == len(performer)
    wrist = summary.sensors[performer.index("r_wrist")]
    assert wrist.valid == wrist.oriented == 1.0 and wrist.jumps == 0
    assert 1.8 < wrist.highest_m < 1.9 and 2.0 < wrist.max_speed_m_s < 4.0
    assert summary.stature_m == pytest.approx(1.65, abs=0.1)
    assert summary.lengths_m["thigh"] == pytest.approx(0.42) and summary.lengths_m["hip width"] == pytest.approx(0.18)
    assert summary.travel_m < 0.3


def test_a_moved_sensor_is_a_jump_there_and_back(performer: SensorFrames) -> None:
    position = performer.position.copy()
    position[500, performer.index("pelvis")] += [0.0, 0.2, 0.0]
    jumps = find_jumps(replace(performer, position=position))
    assert [(jump.frame, jump.sensor) for jump in jumps] == [(499, "pelvis"), (500, "pelvis")]
    assert jumps[0].distance_m == pytest.approx(0.2, abs=0.01)
    assert jumps[0].time_s == performer.time[499]


def test_a_flipped_orientation_is_a_jump_and_a_negated_quaternion_is_none(performer: SensorFrames) -> None:
    orientation = performer.orientation.copy()
    head = performer.index("head")
    orientation[300:, head] *= -1.0
    assert find_jumps(replace(performer, orientation=orientation)) == ()
    flip = rotations.from_axis_angle([0.0, 0.0, 1.0], np.pi)
    orientation[300:, head] = rotations.multiply(orientation[300:, head], flip)
    (jump,) = find_jumps(replace(performer, orientation=orientation))
    assert jump.frame == 299 and jump.turn_deg == pytest.approx(180.0, abs=3.0)


def test_lost_sensors_neither_jump_nor_spoil_the_numbers(performer: SensorFrames) -> None:
    position, valid = performer.position.copy(), performer.valid.copy()
    head = performer.index("head")
    position[100:200, head], valid[100:200, head] = np.nan, False
    summary = summarise(replace(performer, position=position, valid=valid))
    assert summary.jumps == ()
    assert summary.sensors[head].valid == pytest.approx(1 - 100 / len(performer))
    assert np.isfinite([summary.sensors[head].highest_m, summary.sensors[head].max_speed_m_s]).all()


def test_a_sensor_that_is_never_seen_and_a_single_frame_are_summarised(performer: SensorFrames) -> None:
    nowhere, never = np.full_like(performer.position, np.nan), np.zeros_like(performer.valid)
    summary = summarise(replace(performer, position=nowhere, valid=never, skeleton=None, joints=None))
    assert np.isnan(summary.sensors[0].highest_m) and summary.travel_m == 0.0 and summary.stature_m is None
    single = summarise(performer.cut(0.0, 0.0))
    assert single.frames == 1 and np.isnan(single.sensors[0].max_speed_m_s)


def test_the_known_fault_of_a_recording_is_found(shared: Path) -> None:
    jumps = find_jumps(read_amc(shared / "mocap/cmu_asfamc/01_07.amc"))
    pelvis = [jump for jump in jumps if jump.sensor == "pelvis"]
    assert [jump.frame + 1 for jump in pelvis] == [3364] and pelvis[0].distance_m == pytest.approx(0.205, abs=0.001)
    for name in ("02_05", "49_18"):
        assert find_jumps(read_amc(shared / f"mocap/cmu_asfamc/{name}.amc")) == ()


# Calm: modes do not come and go, observers add no jerk, and a hand that rests against something rests.


@cache
def performed() -> Done:
    """The whole of the synthetic performer."""
    return act(robot(None), None, human())


@pytest.mark.long
def test_modes_seldom_change() -> None:
    modes = np.array([posture.observer_modes for posture in performed().postures])
    names = robot(None).observers.names
    found = observer_activity(modes, names, dt=DT)
    assert found is not None and np.count_nonzero(modes) > 10
    assert found[0].worst <= 2.0, found[0].name


@pytest.mark.long
def test_observers_add_little_jerk() -> None:
    """Upright next to none; where it folds onto its thighs, a twentieth of what it would be if joints chattered."""
    upright = human()[:50]
    bare = act(robot(None, without_observers(load_priorities("servo"))), None, upright)
    watched, without = act(robot(None), None, upright), jerk_p95(bare.joints, DT)
    alone, whole = jerk_p95(watched.joints, DT), jerk_p95(performed().joints, DT)
    assert alone is not None and whole is not None and without is not None
    assert alone <= 1.3 * without
    assert whole <= 0.05 * float(op3().limits.max_acceleration.min()) / DT


def test_no_shaking_at_switch_on() -> None:
    """The first second: away from standing, slowly, to where the performer stands still."""
    done = act(robot(None), None, [human()[0]] * 375)
    assert done.swing() < 1e-4


@pytest.mark.long
@pytest.mark.parametrize("tick", [150, 250])
def test_a_hand_that_rests_against_a_sphere_rests(tick: int) -> None:
    motion = raised()[:tick]
    at = act(robot(None), None, motion).reached("r_hand")[-1]
    done = act(state_of := robot(state := scene_of(ball=sphere(at))), state, [*motion, *[motion[-1]] * 500])
    assert state_of.observers.names and done.distance[-1].min() == pytest.approx(ZONE["margin"], abs=1e-4)
    assert done.swing() < 1e-4
