"""From the name of a bus to the bus."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

from command_line import copy_of_op3
from hardware.clock import VirtualClock
from hardware.dynamixel.bus import DynamixelBus
from hardware.errors import BusError
from hardware.guard_state import StopCause
from hardware.no_bus import NoBus
from hardware.servo import loop_stiffness
from messages import mentions, refuses, shows
from retarget.cli.buses import AFTER_FALL_S, PhysicsBench, make_bus, posture_ticks
from retarget.cli.exit import DONE, STOPPED, StopRequest
from retarget.cli.operator import HOLD_IT, RunOperator
from retarget.cli.run import finished, follow_clip
from retarget.errors import ConfigError, UsageError
from retarget.frames import SensorFrames
from retarget.human.samples import Playback
from retarget.model.robot import RobotBody, load_robot
from retarget.pictures.outputs import Outputs
from retarget.recording.reading import read_recording
from retarget.recording.topics import TRUTH
from retarget.report.measure import limits_broken, measure
from retarget.report.motion_metrics import LimitViolations
from retarget.run.controllers import GoToRest
from retarget.run.options import PhysicsOptions, RunOptions
from retarget.run.prepare import Prepared, prepare, stage_priorities
from retarget.run.run_result import RunResult
from retarget.sources.asf_amc import read_amc
from sim.mock_bus import MockBus
from sim.performer import synthetic_performer
from sim.physics.perturbation import Push
from sim.physics.witness import Fall


@pytest.fixture(scope="module")
def robot() -> RobotBody:
    return load_robot("op3")


@pytest.fixture
def divided(robot: RobotBody) -> RobotBody:
    """The same with its head on a second bus."""
    main = robot.profile.buses["main"]
    buses = {"main": main, "head": main.model_copy(update={"port": "/dev/head", "ids": (19, 20), "power": None})}
    servos = {
        joint: servo.model_copy(update={"bus": "head" if servo.id in (19, 20) else "main"})
        for joint, servo in robot.profile.servos.items()
    }
    return replace(robot, profile=robot.profile.model_copy(update={"buses": buses, "servos": servos}))


@pytest.mark.parametrize(("name", "kind"), [("mock", MockBus), ("none", NoBus), ("emulator", DynamixelBus)])
def test_simulated_servos_begin_where_the_robot_stands(name: str, kind: type, robot: RobotBody) -> None:
    bus = make_bus(name, robot, VirtualClock())
    assert isinstance(bus, kind)
    bus.open()
    assert np.array_equal(bus.read().position, posture_ticks(robot))
    bus.close()


@pytest.mark.parametrize(
    ("bus", "priorities", "is_noted"),
    [("physics", "servo", True), ("physics", None, False), ("mock", "servo", False), ("mock", "unbalanced.yaml", True)],
)
def test_priorities_under_which_a_robot_may_fall_are_noted(
    bus: str, priorities: str, is_noted: bool, robot: RobotBody, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    levels = "[self collision, soles, likeness, posture]"
    text = f"name: unbalanced\ndescription: without balance\nextends: servo\nlevels: {levels}\n"
    Path("unbalanced.yaml").write_text(text, encoding="utf-8")
    *_, notes = stage_priorities(robot, RunOptions(robot="op3", bus=bus, priorities=priorities))
    assert bool(notes) == is_noted
    if notes:
        shows(notes)


@pytest.mark.parametrize(("name", "port"), [("profile", "/dev/ttyUSB0"), ("/dev/ttyUSB7", "/dev/ttyUSB7")])
def test_a_real_bus_is_on_the_profile_s_port_or_on_the_named_one(name: str, port: str, robot: RobotBody) -> None:
    bus = make_bus(name, robot, VirtualClock())
    assert isinstance(bus, DynamixelBus)
    assert [(line.port.name, line.spec.port) for line in bus.lines] == [(port, port)]


def test_no_port_is_touched_before_it_is_opened_and_one_for_several_buses_is_refused(
    robot: RobotBody, divided: RobotBody
) -> None:
    bus = make_bus("/dev/no-such-port", robot, VirtualClock())
    with refuses(BusError):
        bus.open()
    with refuses(UsageError, "--bus", "/dev/ttyUSB7", "main, head", "into the profile"):
        make_bus("/dev/ttyUSB7", divided, VirtualClock())
    bus = make_bus("profile", divided, VirtualClock())
    assert isinstance(bus, DynamixelBus) and bus.lines[0].port.name == "/dev/ttyUSB0"


def options(bus: str = "physics", *, robot: str = "op3", seconds: float = 0.6, **physics: object) -> RunOptions:
    asked = PhysicsOptions(**physics)  # type: ignore[arg-type]
    return RunOptions(robot=robot, bus=bus, physics=asked, playback=Playback(speed=0.5, end=seconds))


@contextmanager
def on_bench(
    asked: RunOptions, read: Callable[[], SensorFrames] = synthetic_performer, *, goes_to_rest: bool = True
) -> Iterator[tuple[PhysicsBench, Prepared]]:
    """A run on its bench that can start."""
    bench = PhysicsBench(asked, lambda text: None)
    with prepare(read, asked, clock=VirtualClock(), make_bus=bench.make_bus, goes_to_rest=goes_to_rest) as prepared:
        yield bench, prepared


def play(asked: RunOptions, push: Push | None = None) -> RunResult:
    """As `follow_clip` plays it, with a push of our own."""
    with on_bench(asked) as (bench, prepared):
        if push is not None:
            assert bench._bus is not None
            bench._bus.witness.simulation.push(push)
        run = prepared.run(RunOperator(prepared, StopRequest(), bench=bench))
    return bench.seen(run)


@pytest.mark.long
@pytest.mark.parametrize("robot", ["op3", "toddlerbot"])
def test_before_torque_goes_off_a_run_says_to_hold_who_cannot_stay(
    robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = replace(options(robot=robot, seconds=0.3), torque_off_at_end=True)
    report = follow_clip(lambda: synthetic_performer().cut(0.0, 0.3), asked, Outputs())
    assert report == DONE and (HOLD_IT in capsys.readouterr().err) is (robot == "toddlerbot")


def test_a_run_stands_reports_and_ends_at_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report, recording = tmp_path / "r.json", tmp_path / "r.mcap"
    outputs = Outputs(report=report, record=recording)
    code = follow_clip(lambda: synthetic_performer().cut(0.0, 0.3), options(seconds=0.3), outputs)
    data = json.loads(report.read_text())
    assert data["fallen"] is data["physics"]["fallen"] is False
    assert code == DONE and data["stop"]["reason"] is None
    assert not any(note.startswith("not at rest") for note in data["notes"])
    assert data["physics"]["mount"] == "floor" and data["physics"]["foot_slip_mm"]["total"] < 5.0
    mentions(capsys.readouterr().out, "op3 follows in part")
    recorded = read_recording(recording)
    assert recorded.session.goes_to_rest and np.isfinite(recorded.topic(TRUTH).rows["q"]).any()


@pytest.mark.long
def test_a_fall_ends_the_run_a_second_later_and_says_how() -> None:
    run = play(options(seconds=6.0), Push((20.0, 0.0, 0.0), 1.5, 0.3))
    assert run.physics is not None and run.physics.fall is not None
    assert run.stop is not None and run.reason is not None
    assert run.stop.cause is StopCause.FALLEN  # the IMU shows the fall before the robot lies
    assert run.reason.startswith("the robot falls: its soles tip by")
    left = run.physics.time[-1] - run.physics.fall.time
    assert left < AFTER_FALL_S + 0.6 and run.record.time[-1] < 11.0


def test_a_fall_that_no_servo_notices_stops_the_run_by_itself() -> None:
    with on_bench(options(seconds=6.0), goes_to_rest=False) as (bench, prepared):
        assert bench._bus is not None and prepared.machine is not None
        witness, machine = bench._bus.witness, prepared.machine
        machine.guard.arm(machine.gate.begin(machine.guard.present()))
        for ago, goes_on in ((0.0, True), (0.5 * AFTER_FALL_S, True), (AFTER_FALL_S, False)):
            witness.fall = Fall(witness.simulation.time - ago, "it lies", powered=True)
            fault = bench.look(machine, prepared.samples)
            assert (fault is None) is goes_on
        assert fault == (StopCause.FALLEN, "the robot has fallen: it lies")
        machine.guard.latch(*fault)
        assert bench.look(machine, prepared.samples) is None and not machine.guard.may_go_to_rest


@pytest.mark.long
def test_a_fall_at_the_very_end_is_a_stop_too() -> None:
    with on_bench(options(seconds=0.3), goes_to_rest=False) as (bench, prepared):
        run = prepared.run()
    run = bench.seen(run)  # torque went off while it stood, bent
    assert run.reason is None and run.physics is not None and run.physics.fall is not None
    shows(run.physics.fall.how)
    assert finished(run, Outputs()) == STOPPED


@pytest.mark.long
def test_a_robot_that_does_not_come_to_rest_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    with on_bench(options(seconds=0.05)) as (bench, prepared):  # which plans its way to rest
        monkeypatch.setattr(GoToRest, "target", lambda self, commanded, sample, **known: None)
        run = bench.seen(prepared.run(RunOperator(prepared, StopRequest(), bench=bench)))
    assert run.stop is not None and run.stop.cause is StopCause.FILTER
    shows(run.stop.reason)


@pytest.mark.long
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


@pytest.mark.long
@pytest.mark.parametrize(("mount", "hook"), [("stand", None), ("gantry", "neck")])
def test_a_held_robot_walks_with_the_performer(mount: str, hook: str | None, shared: Path) -> None:
    """Head, pelvis and feet that would cross on average 20 mm off at most: where it was sent and where it is."""
    asked = RunOptions(robot="op3", bus="physics", physics=PhysicsOptions(mount=mount, hook=hook))
    walk = partial(read_amc, shared / "mocap" / "cmu_asfamc" / "02_01.amc")
    with on_bench(asked, walk) as (bench, prepared):
        run = bench.seen(prepared.run())
    assert run.physics is not None and run.physics.least_margin is None and run.physics.mount == mount
    assert run.reason is None and run.robot is not None and not run.robot.stands
    assert [priorities.name for priorities in run.setup.priorities] == ["human", "fixed_base"]
    report = measure(run)
    assert report.servo_tracking_mm is not None and report.fallen is False
    for tracks in (report.tracking_mm, report.servo_tracking_mm):
        assert np.mean([tracks[name].mean for name in ("head", "pelvis", "l_sole", "r_sole")]) <= 20.0


@pytest.mark.long
def test_trouble_is_drawn_by_the_seed_and_a_push_comes_while_it_follows() -> None:
    asked = options(seconds=0.4, perturbations=("mass", "friction", "push", "stiffness=0.8"), seed=5)
    with on_bench(asked) as (bench, prepared):
        assert bench._bus is not None
        simulation = bench._bus.witness.simulation
        assert simulation.perturbation.mass_scale != 1.0 and simulation.perturbation.friction != 0.8
        stiffness = [drive.stiffness for drive in simulation.world.drives]
        assert stiffness == pytest.approx([0.8 * loop_stiffness(drive.servo) for drive in simulation.world.drives])
        assert simulation._pushes == []
        run = bench.seen(prepared.run(RunOperator(prepared, StopRequest(), bench=bench)))
    assert len(simulation._pushes) == 1
    assert run.physics is not None and run.physics.perturbations == ("mass", "friction", "push", "stiffness=0.8")
    following = run.record.time[run.record.following]
    begun = simulation._pushes[0][0] * simulation.world.step + run.physics.time[0]
    assert following[0] < begun < following[-1] + 0.1


def test_a_posture_that_cannot_stand_is_refused_with_centre_of_mass_and_polygon(tmp_path: Path) -> None:
    path = copy_of_op3(tmp_path / "op3")
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    stand = data["postures"]["stand"]
    for joint in ("l_ank_pitch", "r_ank_pitch"):
        low, high = data["servos"][joint]["limits"]
        stand[joint] = 0.95 * (high if stand[joint] > 0 else low)
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(ConfigError) as caught, on_bench(options(robot=str(path), seconds=0.2), goes_to_rest=False):
        pass
    shows(str(caught.value))


def test_without_mujoco_nothing_starts(robot: RobotBody, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with refuses(ConfigError, "mujoco"):
        PhysicsBench(options(), lambda text: None).make_bus(robot, VirtualClock())
