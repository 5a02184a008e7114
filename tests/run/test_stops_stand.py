"""From every tick of a run the robot can stop: the stop of each goal that is sent keeps the limits of the servos, its
soles, its balance and its distance, judged by geometry of the tests' own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.golden.matrix import CLIP, ROBOTS
from benchmarks.physics_runs import play
from retarget.frames import SensorFrames
from retarget.human.samples import Playback
from retarget.ik.support_polygon import plant
from retarget.model.robot import load_robot
from retarget.model.scene_state import SceneState
from retarget.run.options import RunOptions
from retarget.schema.scene import load_scene, on_floor
from retarget.sources.open import open_source
from sim.faults.judge import When, run_row
from sim.faults.rows import ROWS
from sim.performer import synthetic_performer
from stops import failures, witnessed

SHARED = Path(__file__).resolve().parents[3] / "shared"


def jumping(frames: SensorFrames, seed: int) -> SensorFrames:
    """Wrists and head displaced together by about 0.35 m an axis, for 0.1 to 0.6 s, about each 1.2 s."""
    random, position = np.random.default_rng(seed), frames.position.copy()
    rows = [frames.index(name) for name in ("head", "l_wrist", "r_wrist")]
    time = 1.0
    while time < frames.time[-1]:
        ends = time + random.uniform(0.1, 0.6)
        leap, there = random.normal(0.0, 0.35, 3), (frames.time >= time) & (frames.time < ends)
        for row in rows:
            position[there, row] += leap
        time = ends + random.exponential(1.2)
    return replace(frames, position=position)


def assert_stops_stand(frames: SensorFrames, options: RunOptions, *, every: int = 1) -> int:
    """Follow the stops of a run. Returns how many goals were sent."""
    robot = load_robot(options.robot)
    with witnessed() as sent:
        play(frames, options)
    scene = None if options.scene is None else SceneState(on_floor(load_scene(options.scene)))
    stance = plant(robot, robot.profile.postures.stand)
    wrong = failures(robot, stance, sent, dt=1.0 / robot.profile.safety.rate_hz, scene=scene, every=every)
    assert not wrong, f"{len(wrong)} of {len(sent)}: {wrong[:3]}"
    return len(sent)


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_goal_has_a_stop_that_stands_and_is_clear(robot: str) -> None:
    options = RunOptions(robot=robot, playback=Playback(speed=2.0, start=4.0, end=7.0))
    assert assert_stops_stand(synthetic_performer(), options, every=5) > 150


def test_also_of_sensors_that_jump() -> None:
    options = RunOptions(robot="op3", playback=Playback(end=4.0))
    assert assert_stops_stand(jumping(synthetic_performer(), 3), options, every=5) > 400


@pytest.mark.long
@pytest.mark.skipif(not (SHARED / CLIP).is_file(), reason=f"no {CLIP} in ../shared")
@pytest.mark.parametrize("bus", ["mock", "physics"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_also_in_a_recording_with_and_without_mass(robot: str, bus: str) -> None:
    frames = open_source(str(SHARED / CLIP))
    assert assert_stops_stand(frames, RunOptions(robot=robot, bus=bus, playback=Playback(end=8.0))) > 300
    assert_stops_stand(jumping(frames, 5), RunOptions(robot=robot, bus=bus, playback=Playback(end=8.0)))


@pytest.mark.long
def test_from_500_random_ticks_of_runs_with_live_faults_the_stop_stands() -> None:
    robot, random = load_robot("op3"), np.random.default_rng(51)
    stance, looked = plant(robot, robot.profile.postures.stand), 0
    for row in random.permutation(np.array(list(ROWS), dtype=object)):
        with witnessed() as sent:
            run_row(row, when=When.MOVING)
        ticks = random.choice(len(sent), size=min(25, len(sent)), replace=False)
        wrong = failures(robot, stance, [sent[tick] for tick in ticks], dt=1.0 / robot.profile.safety.rate_hz)
        assert not wrong, f"{row.name}: {wrong[:3]}"
        looked += len(ticks)
        if looked >= 500:
            break
    assert looked >= 500
