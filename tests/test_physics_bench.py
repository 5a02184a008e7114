"""`--bus physics` from the command line: it stands or falls, says so, and refuses what has no physics."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from hardware.clock import VirtualClock
from hardware.guard_state import StopCause
from retarget.cli import main
from retarget.cli.boundary import DONE, REFUSED, STOPPED
from retarget.cli.follow_clip import finished, follow_clip
from retarget.cli.outputs import Outputs
from retarget.cli.physics_bench import AFTER_FALL_S, PhysicsBench
from retarget.clip import Playback
from retarget.errors import ConfigError, UsageError
from retarget.frames import SensorFrames
from retarget.metrics.measure import limits_broken, measure
from retarget.metrics.motion import LimitViolations
from retarget.options import RunOptions
from retarget.parking import Parking
from retarget.physics_options import PhysicsOptions
from retarget.pipeline import Watch
from retarget.prepare import prepare
from retarget.recording.reading import read_recording
from retarget.recording.topics import TRUTH
from retarget.robot_body import load_robot
from retarget.run_result import RunResult
from retarget.sources.asf_amc import read_amc
from sim.mock_bus import MockBus
from sim.performer import synthetic_performer
from sim.physics.fall import Fall
from sim.physics.mount import Mount, Support
from sim.physics.perturbation import Push
from support.messages import refuses, shows, shows_lines
from test_check import copy_of_op3


def options(bus: str = "physics", *, robot: str = "op3", seconds: float = 0.6, **physics: object) -> RunOptions:
    asked = PhysicsOptions(**physics)  # type: ignore[arg-type]
    return RunOptions(robot=robot, bus=bus, physics=asked, playback=Playback(speed=0.5, end=seconds))


def play(asked: RunOptions, push: Push | None = None) -> RunResult:
    """As `follow_clip` plays it, with a push of our own."""
    bench = PhysicsBench(asked, lambda text: None)
    with prepare(
        synthetic_performer, asked, clock=VirtualClock(), make_bus=bench.make_bus, parks=asked.has_physics
    ) as prepared:
        if push is not None:
            assert bench._bus is not None
            bench._bus.witness.simulation.push(push)
        run = prepared.run(Watch(stop_asked=bench.watching(lambda: False, prepared)))
    return bench.seen(run)


def test_a_run_stands_reports_and_ends_parked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def still() -> SensorFrames:
        return synthetic_performer().cut(0.0, 0.3)

    report, recording = tmp_path / "r.json", tmp_path / "r.mcap"
    code = follow_clip(still, options(seconds=0.3), Outputs(report=report, record=recording))
    data = json.loads(report.read_text())
    assert data["fallen"] is data["physics"]["fallen"] is False
    assert code == DONE and data["stop"]["reason"] is None
    assert data["physics"]["mount"] == "floor" and data["physics"]["foot_slip_mm"]["total"] < 5.0
    shows_lines(capsys.readouterr().out, re.compile(r"^physics\b"))
    recorded = read_recording(recording)
    assert recorded.session.parks and np.isfinite(recorded.topic(TRUTH).rows["q"]).any()


def test_a_fall_ends_the_run_a_second_later_and_says_how() -> None:
    run = play(options(seconds=6.0), Push((20.0, 0.0, 0.0), 1.5, 0.3))
    assert run.physics is not None and run.physics.fall is not None
    assert run.stop is not None and run.reason is not None
    if run.stop.cause is StopCause.FALLEN:  # else the guard saw a servo that could not follow, before that
        assert run.reason == f"the robot has fallen: {run.physics.fall.how}"
    left = run.physics.time[-1] - run.physics.fall.time
    assert left < AFTER_FALL_S + 0.6 and run.record.time[-1] < 11.0


def test_a_fall_that_no_servo_notices_stops_the_run_by_itself() -> None:
    asked = options(seconds=6.0)
    bench = PhysicsBench(asked, lambda text: None)
    with prepare(synthetic_performer, asked, clock=VirtualClock(), make_bus=bench.make_bus) as prepared:
        assert bench._bus is not None and prepared.side is not None
        witness, side = bench._bus.witness, prepared.side
        watching = bench.watching(lambda: False, prepared)
        side.guard.arm()
        assert witness._watch is not None
        for ago, goes_on in ((0.0, True), (0.5 * AFTER_FALL_S, True), (AFTER_FALL_S, False)):
            witness._watch.fall = Fall(witness.simulation.time - ago, "it lies", powered=True)
            assert not watching() and side.following is goes_on
        stop = side.guard.stop_reason
        assert stop is not None and stop.reason == "the robot has fallen: it lies"
        assert stop.cause is StopCause.FALLEN and not side.guard.may_go_home


def test_a_fall_at_the_very_end_is_a_stop_too() -> None:
    asked = options(seconds=0.3)
    bench = PhysicsBench(asked, lambda text: None)
    with prepare(synthetic_performer, asked, clock=VirtualClock(), make_bus=bench.make_bus, parks=False) as prepared:
        run = prepared.run()
    run = bench.seen(run)  # torque went off while it stood, bent
    assert run.reason is None and run.physics is not None and run.physics.fall is not None
    shows(run.physics.fall.how)
    assert finished(run, Outputs()) == STOPPED


def test_a_robot_that_finds_no_way_to_where_it_is_parked_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    shows(play(options(seconds=0.1)).notes)
    monkeypatch.setattr(Parking, "next", lambda self, q, **known: None)
    run = play(options(seconds=0.1))
    shows(run.notes)


def test_limits_are_those_of_the_goals_that_were_sent_not_of_postures_beside_them() -> None:
    run = play(options(seconds=0.1))
    sent = run.record.robot
    assert sent is not None and run.robot is not None
    goals = run.robot.joint_map.to_ticks(sent.goals)
    assert np.array_equal(goals, sent.goal_ticks)
    assert np.abs(sent.goals - sent.q[:, run.robot.servo_columns]).max() > 0.005, "the load is held beside the posture"
    assert limits_broken(run) == LimitViolations(0, 0, 0)
    sent.q[5] += 0.1
    assert limits_broken(run) == LimitViolations(0, 0, 0)
    sent.goals[5, 3] += 0.1
    assert limits_broken(run).velocity and limits_broken(run).acceleration


def test_the_same_seed_gives_the_same_bits() -> None:
    first, again, other = (play(options(seconds=0.1, seed=seed)) for seed in (3, 3, 4))
    for run in (first, again, other):
        assert run.physics is not None and run.record.robot is not None
    assert np.array_equal(first.physics.com, again.physics.com)  # type: ignore[union-attr]
    assert np.array_equal(first.record.robot.present, again.record.robot.present)  # type: ignore[union-attr]
    rows = slice(0, min(len(first.physics.com), len(other.physics.com)))  # type: ignore[union-attr]
    assert not np.array_equal(first.physics.com[rows], other.physics.com[rows])  # type: ignore[union-attr]


def test_through_the_wire_as_well() -> None:
    run = play(options("physics+wire", seconds=0.05))
    assert run.physics is not None and run.physics.fall is None and run.reason is None
    assert len(run.physics.time) >= len(run.record)


@pytest.mark.parametrize(("mount", "hook"), [("stand", None), ("gantry", "neck")])
def test_held_robots_follow_with_the_whole_body(mount: str, hook: str | None) -> None:
    run = play(options(mount=mount, hook=hook, seconds=1.6))
    assert run.physics is not None and run.physics.fall is None and run.physics.least_margin is None
    assert run.robot is not None and not run.robot.stands
    assert run.reason is None and run.physics.mount == mount


@pytest.mark.parametrize(("mount", "hook"), [("stand", None), ("gantry", "neck")])
def test_a_held_robot_walks_with_the_performer(mount: str, hook: str | None, shared: Path) -> None:
    """Landmarks, feet that would cross among them, on average 20 mm off at most: where it was sent and where it is."""
    asked = RunOptions(robot="op3", bus="physics", physics=PhysicsOptions(mount=mount, hook=hook))
    bench = PhysicsBench(asked, lambda text: None)

    def walk() -> SensorFrames:
        return read_amc(shared / "mocap" / "cmu_asfamc" / "02_01.amc")

    with prepare(walk, asked, clock=VirtualClock(), make_bus=bench.make_bus, parks=True) as prepared:
        run = bench.seen(prepared.run())
    assert [priorities.name for priorities in run.priorities] == ["human", "held"]
    report = measure(run)
    assert report.servo_tracking_mm is not None and report.fallen is False
    for tracks in (report.tracking_mm, report.servo_tracking_mm):
        assert np.mean([spread.mean for spread in tracks.values()]) <= 20.0


def test_trouble_is_drawn_by_the_seed_and_a_push_comes_while_it_follows() -> None:
    asked = options(seconds=0.4, trouble=("mass", "friction", "push"), seed=5)
    bench = PhysicsBench(asked, lambda text: None)
    with prepare(synthetic_performer, asked, clock=VirtualClock(), make_bus=bench.make_bus, parks=True) as prepared:
        assert bench._bus is not None
        simulation = bench._bus.witness.simulation
        assert simulation.perturbation.mass_scale != 1.0 and simulation.perturbation.friction != 0.8
        assert simulation._pushes == []
        run = bench.seen(prepared.run(Watch(stop_asked=bench.watching(lambda: False, prepared))))
    assert len(simulation._pushes) == 1
    assert run.physics is not None and run.physics.trouble == ("mass", "friction", "push")
    following = run.record.time[run.record.following]
    begun = simulation._pushes[0][0] * simulation.world.step + run.physics.time[0]
    assert following[0] < begun < following[-1] + 0.1


def test_without_physics_the_bench_only_makes_the_bus() -> None:
    asked = options("mock", seconds=0.2)
    bench = PhysicsBench(asked, lambda text: None)
    assert isinstance(bench.make_bus(load_robot("op3"), VirtualClock()), MockBus)
    run = play(asked)
    assert run.physics is None


def refusal(path: Path, physics: PhysicsOptions) -> str:
    asked = RunOptions(robot=str(path), bus="physics", physics=physics, playback=Playback(end=0.2))
    bench = PhysicsBench(asked, lambda text: None)
    with (
        pytest.raises(ConfigError) as caught,
        prepare(synthetic_performer, asked, clock=VirtualClock(), make_bus=bench.make_bus),
    ):
        pass
    return str(caught.value)


def test_a_hanging_robot_needs_a_hook(tmp_path: Path) -> None:
    said = refusal(copy_of_op3(tmp_path / "op3"), PhysicsOptions(mount="gantry"))
    shows(said)
    said = refusal(copy_of_op3(tmp_path / "hangs", ("root: free", "root: suspended")), PhysicsOptions())
    shows(said)


def test_a_robot_on_a_stand_does_not_go_to_the_floor(tmp_path: Path) -> None:
    said = refusal(copy_of_op3(tmp_path / "op3", ("root: free", "root: fixed")), PhysicsOptions(mount="floor"))
    shows(said)


def test_servos_without_gains_are_refused(tmp_path: Path) -> None:
    path = copy_of_op3(tmp_path / "op3")
    text = path.read_text(encoding="utf-8")
    path.write_text(re.sub(r",? *gains: \{[^}]*\}", "", text), encoding="utf-8")
    assert "without a P gain" in refusal(path, PhysicsOptions())


def test_a_posture_that_cannot_stand_is_refused_with_centre_of_mass_and_polygon(tmp_path: Path) -> None:
    path = copy_of_op3(tmp_path / "op3")
    text = path.read_text(encoding="utf-8")
    stand = yaml.safe_load(text)["postures"]["stand"]
    assert "l_ank_pitch" in stand
    data = yaml.safe_load(text)
    for joint in ("l_ank_pitch", "r_ank_pitch"):
        low, high = data["servos"][joint]["limits"]
        data["postures"]["stand"][joint] = 0.95 * (high if stand[joint] > 0 else low)
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    said = refusal(path, PhysicsOptions())
    shows(said)


def test_without_mujoco_nothing_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot("op3")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with refuses(ConfigError, "mujoco"):
        PhysicsBench(options(), lambda text: None).make_bus(robot, VirtualClock())


def test_only_what_hangs_has_a_hook() -> None:
    bench = PhysicsBench(options(hook="neck"), lambda text: None)
    with refuses(UsageError):
        bench.make_bus(load_robot("op3"), VirtualClock())


def test_a_mount_of_the_profile_takes_the_hook(tmp_path: Path) -> None:
    path = copy_of_op3(tmp_path / "op3", ("root: free", "root: suspended"))
    robot = load_robot(path)
    asked = RunOptions(robot=str(path), bus="physics", physics=PhysicsOptions(hook="neck"))
    assert PhysicsBench(asked, lambda text: None)._mount(robot) == Mount(Support.GANTRY, hook="neck")


def test_a_live_run_is_watched_too(shared: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = f"replay://{shared}/streams/slimevr/full12_vmc_50hz.udprec.gz?kind=vmc"
    with pytest.raises(SystemExit) as left:
        main(["run", "--robot", "op3", "--source", source, "--countdown", "0", "--end", "0.1", "--bus", "physics"])
    assert left.value.code == DONE
    shows_lines(capsys.readouterr().out, re.compile(r"^physics\b"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--bus", "physics", "--mount", "gantry"), "no hook point"),
        (("--bus", "physics", "--mount", "wall"), "unknown mount"),
        (("--bus", "mock", "--trouble", "push"), "only a robot with mass"),
    ],
)
def test_what_cannot_be_simulated_is_refused(
    words: tuple[str, ...], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def short(*_: object, **__: object) -> SensorFrames:
        return synthetic_performer().cut(0.0, 0.2)

    monkeypatch.setattr("retarget.sources.open.open_source", short)
    with pytest.raises(SystemExit) as left:
        main(["run", "--robot", "op3", "--source", "a.amc", *words])
    assert left.value.code == REFUSED and said in capsys.readouterr().err
