"""The tick loop: rows, timing, gating, stops. Stages are stand-ins; bus, guard and gate are real."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from faulty_bus import FaultKind, MockFault
from followers import DT, follower, op3
from gates import DrivenGate, displacement, sent
from hardware.clock import VirtualClock
from hardware.errors import BusError
from hardware.guard import CheckedGoal
from hardware.servo_health import ServoWarnings
from live_rig import LiveRig
from messages import refuses, shows, shows_lines
from operators import ENOUGH, Asks
from planted import failing
from retarget.errors import UsageError
from retarget.human.samples import Playback
from retarget.ik.whole_body_stop import StopPath
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.model.robot import load_robot
from retarget.report.measure import measure
from retarget.report.motion_metrics import LimitViolations, limit_violations
from retarget.run.controllers import rest_joints
from retarget.run.loop import Ending, RowObserver
from retarget.run.options import PhysicsOptions, RunOptions, name_with_mass, priority_names
from retarget.run.prepare import limbs_of, make_gate, prepare
from retarget.run.record import Phase, Record, RecordRows, TickRecorder
from retarget.run.supervisor import FORCED_STOP
from retarget.safety.gate import Gate
from retarget.safety.standing import StandingCheck
from retarget.schema.priorities import load_priorities
from retarget.types import FloatArray, HumanPosture, RobotPosture, RunState
from rig import Rig, StubReconstructor, gentle_stop, person, play, short_clip
from sim.faults.sender import FakeSender
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer

TICKS = 51


@pytest.mark.parametrize(("name", "count"), [("op3", 8), ("poppy", 10), ("toddlerbot", 16), ("wolfgang", 8)])
def test_arms_and_head_are_limbs_and_legs_and_trunk_are_none(name: str, count: int) -> None:
    robot = load_robot(name)
    limbs = [servo.joint for servo, is_limb in zip(robot.joint_map.servos, limbs_of(robot), strict=True) if is_limb]
    assert len(limbs) == count
    carries = ("hip", "knee", "ank", "waist", "abs", "bust")
    assert not [joint for joint in limbs if any(part in joint.lower() for part in carries)]
    assert [joint for joint in limbs if "head" in joint.lower() or "neck" in joint]


def test_a_robot_that_does_not_stand_has_no_limbs_to_lose() -> None:
    assert limbs_of(load_robot("op3", root="suspended")) == ()


def still() -> FloatArray:
    return np.zeros((TICKS, 20))


def swing(size: float) -> FloatArray:
    """Joint 0 goes there and back smoothly."""
    script = still()
    script[:, 0] = size * 0.5 * (1.0 - np.cos(2.0 * np.pi * np.arange(TICKS) / (TICKS - 1)))
    return script


def ramp() -> FloatArray:
    """Joint 0 sets off smoothly and is moving when the clip ends."""
    script = still()
    script[:, 0] = 4.0 * (np.arange(TICKS) / 125.0) ** 2
    return script


def assert_within_limits(rig: Rig, record: Record) -> FloatArray:
    """The joints (T, n) rad that were sent, the first ones included, from rest to rest."""
    sent = np.vstack([record.start, record.q[:, rig.robot.servo_columns]])
    assert limit_violations(sent, rig.robot.limits, rig.dt) == LimitViolations(0, 0, 0)
    return sent


def test_every_tick_has_a_row() -> None:
    """From rest to rest within all limits."""
    rig = Rig(ramp())
    ending = play(rig)
    record = ending.record
    assert (ending.state, ending.reason) == (RunState.OFF, None) and not rig.bus.torque_on
    assert len(record) == len(record.q) == len(record.human_q)
    np.testing.assert_array_equal(record.goal_ticks, rig.bus.written[1:])
    phases = record.phase.tolist()
    assert phases == sorted(phases) and phases.count(Phase.FOLLOW) == TICKS
    assert phases.count(Phase.APPROACH) > 0 and phases.count(Phase.BRAKE) > 0
    assert all(np.isfinite(values).all() for values in (record.q, record.human_joints, record.present))
    assert record.time == pytest.approx((np.arange(len(record)) - phases.count(Phase.APPROACH)) / 125.0)
    assert not record.gated.any()
    sent = assert_within_limits(rig, record)
    last = np.abs(np.diff(sent[-2:], axis=0)[0])
    assert (last <= rig.robot.limits.max_acceleration * rig.dt**2 * (1.0 + 1e-9)).all()


def test_a_jump_is_gated_and_the_follower_is_reseeded() -> None:
    script = still()
    script[10:, 3] = 1.0
    rig = Rig(script)
    record = play(rig).record
    first, joints = record.following.start, record.q[:, rig.robot.servo_columns]
    assert record.gated[first + 10 : record.following.stop].all() and not record.gated[: first + 10].any()
    assert len(rig.follower.reseeded) >= np.count_nonzero(record.gated)
    np.testing.assert_array_equal(rig.follower.reseeded[-1], joints[-1])
    assert np.abs(np.diff(joints, axis=0)).max() < 0.01


def test_a_goal_that_is_not_finite_stops_nothing_and_is_not_sent() -> None:
    script = still()
    script[20] = np.nan
    record = play(Rig(script)).record
    assert np.flatnonzero(record.no_command[record.following]).tolist() == [20]
    assert np.isfinite(record.q).all() and not record.gated.any()


def test_a_lost_bus_stops() -> None:
    rig = Rig(still(), faults=(MockFault(FaultKind.READ_FAILS, first=20, cycles=1000),))
    ending = play(rig)
    assert ending.state is RunState.FAULT and len(ending.record) == 19  # read cycle 0 was for arming
    shows(ending.reason)


@pytest.mark.parametrize("after", [0, 1, 60])
def test_a_stop_asked_for_during_the_approach_is_carried_out(after: int) -> None:
    asked = iter([False] * after + [True])
    rig = Rig(still() + np.linspace(-0.4, 0.4, 20))
    ending = play(rig, Asks(lambda: next(asked)))
    record = ending.record
    assert (ending.state, ending.reason) == (RunState.OFF, ENOUGH)
    assert np.count_nonzero(record.phase == Phase.APPROACH) == after
    assert set(record.phase.tolist()) <= {Phase.APPROACH, Phase.BRAKE}
    np.testing.assert_array_equal(record.goal_ticks, rig.bus.written[1:])
    assert not record.gated.any() and record.following == slice(0, 0) and not np.isfinite(record.landmarks_asked).any()
    if after == 60:
        path = assert_within_limits(rig, record)[1:] - record.start
        line = path[-1] / np.linalg.norm(path[-1])
        assert np.linalg.norm(path - np.outer(path @ line, line), axis=1).max() < 1e-12, "it stops on its line"
        assert len(record) - after > 1


def test_a_tick_that_fails_after_its_goal_sends_no_second_one(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, sent = Rig(swing(0.1)), []
    write = rig.guard.write

    def written(goal: CheckedGoal) -> None:
        sent.append(rig.clock.now())
        write(goal)

    rig.guard.write = written  # type: ignore[method-assign]
    monkeypatch.setattr(TickRecorder, "keep_costs", Mock(side_effect=OSError("no terminal")))
    assert play(rig).reason == "no terminal"
    assert len(sent) == len(set(sent)) > 20 and not displacement(rig.guard).any() and not rig.bus.torque_on


@pytest.mark.parametrize("error", [BusError("no answer"), OSError("no such device")])
def test_torque_that_cannot_be_switched_off_is_said(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(still())
    monkeypatch.setattr(rig.bus, "torque", failing(rig.bus.torque, error, range(2, 100)))  # on, then off
    ending = play(rig)
    assert ending.state is RunState.FAULT and len(ending.record) > 50
    shows(ending.reason)


# What fails in a tick, and what is asked for.

MOVING = 130
"""A tick of `swing` in which the robot moves."""


def test_the_tick_that_fails_brakes_too(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(swing(0.3))
    broken = failing(rig.follower.step, ArithmeticError("the stage broke"), [13])
    monkeypatch.setattr(rig.follower, "step", broken)
    ending = play(rig)
    assert (ending.state, ending.reason) == (RunState.OFF, "the stage broke")
    assert len(rig.bus.written) == len(rig.bus.read_at) - 1, "one in every tick but the last, in which torque goes off"


def test_the_check_of_collisions_knows_the_servos_and_the_goals() -> None:
    rig, noted = Rig(swing(0.1)), Mock()
    rig.gate.clearance = noted
    record = play(rig).record
    measured, goals = zip(*(call.args for call in noted.measure.call_args_list), strict=True)
    np.testing.assert_array_equal([call.args[0] for call in noted.begin.call_args_list], [record.start])
    np.testing.assert_array_equal(measured[:-1], record.present)
    np.testing.assert_array_equal(goals, [record.start, *record.q[:, rig.robot.servo_columns]])
    standing = [call.args[2] for call in noted.call_args_list]
    np.testing.assert_array_equal(standing[MOVING + 1 : MOVING + 11], record.q[MOVING : MOVING + 10])  # on its soles


def test_a_stop_leads_to_rest() -> None:
    rig = Rig(ramp(), goes_to_rest=True)
    ending = play(rig)
    assert (ending.state, ending.reason) == (RunState.OFF, None) and len(rig.follower.returns) == 1
    np.testing.assert_array_equal(sent(rig.guard), rest_joints(rig.robot))


def test_a_second_stop_switches_torque_off_at_once() -> None:
    asked = iter([False] * MOVING + [True])
    rig = Rig(swing(0.3))
    ending = play(rig, Asks(lambda: next(asked), lambda: True))
    assert ending.state is RunState.FAULT and ending.reason is not None and FORCED_STOP in ending.reason
    assert np.count_nonzero(ending.record.phase == Phase.BRAKE) == 1 and not rig.bus.torque_on


def test_a_second_interrupt_switches_torque_off_at_once() -> None:
    asked = iter([False] * MOVING)
    rig, interrupt = Rig(swing(0.3)), Mock(side_effect=KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        play(rig, Asks(lambda: next(asked, None) is None and interrupt(), interrupt))
    assert not rig.bus.torque_on and displacement(rig.guard).any()


def test_a_silent_bus_is_held_and_followed_again() -> None:
    silent = range(MOVING, MOVING + 3)
    faults = [MockFault(FaultKind.MISSING, first=silent[0], cycles=3, servo=servo) for servo in range(20)]
    rig, states = Rig(still(), faults=faults), list[RunState]()
    ending = play(rig, None, RowObserver(lambda record, row: states.append(rig.supervisor.state)))
    assert (ending.state, ending.reason) == (RunState.OFF, None)
    held = [tick + 1 for tick, state in enumerate(states) if state is RunState.HOLD]
    assert held == [*silent] and states[silent[-1]] is RunState.FOLLOW, "the first is read to arm"


def test_on_its_way_to_rest_a_robot_gets_there_though_the_bus_is_silent_again_and_again() -> None:
    """It brakes on its line each time, and goes on."""
    silent = [(first, servo) for first in range(200, 800, 25) for servo in range(20)]
    faults = [MockFault(FaultKind.MISSING, first=first, cycles=2, servo=servo) for first, servo in silent]
    rig, rows = Rig(still(), goes_to_rest=True, faults=faults), list[RunState]()
    ending = play(rig, None, RowObserver(lambda record, row: rows.append(rig.supervisor.state)))
    assert (ending.state, ending.reason) == (RunState.OFF, None)
    way = ending.record.goals[rows.index(RunState.GO_TO_REST) - 1 :]
    assert len(way) * rig.dt < 3.0
    assert np.linalg.matrix_rank(way - way[-1], tol=1e-6) == 1


def test_a_warm_robot_follows_more_slowly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ServoWarnings, "look", lambda warnings, seen, now: None)
    rig = Rig(still())
    rig.guard.health.warnings.speed_override = 0.05
    play(rig)
    assert set(rig.follower.overrides[-TICKS:]) == {0.05}


def test_a_late_tick_is_skipped_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(swing(0.1))
    follow = rig.follower.step

    def slow(human: HumanPosture, dt: float) -> RobotPosture:
        rig.clock.advance(2.5 * rig.dt if rig.follower.tick == 12 else 0.0)
        return follow(human, dt)

    monkeypatch.setattr(rig.follower, "step", slow)
    ending = play(rig)
    between = np.diff(rig.bus.read_at[1:]) / rig.dt
    assert ending.late_ticks == 1 and between.max() == pytest.approx(2.5) and between.min() == pytest.approx(1.0)


def refused_from_12() -> FloatArray:
    script = swing(0.3)
    script[12:, 3] = 1.0
    return script


def test_from_a_refused_goal_on_the_robot_goes_along_the_stop_that_was_planned_with_the_last_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig(refused_from_12())
    follower = rig.follower

    def planned(dt: float) -> StopPath:
        before, q = (follower._made(max(tick, 0)).q for tick in (follower.tick - 2, follower.tick - 1))
        return gentle_stop(rig.robot, before, q, dt)

    monkeypatch.setattr(follower, "stop", planned)
    rig.gate.standing = StandingCheck(rig.robot, follower.stance, dt=rig.dt)
    ending = play(rig)
    record = ending.record
    assert (ending.state, ending.reason) == (RunState.OFF, None)
    follower.tick = 12
    stop = planned(rig.dt).postures
    assert 5 < len(stop) < TICKS - 12
    columns, last = rig.robot.servo_columns, record.following.start + 11
    assert not record.gated[: last + 1].any() and record.gated[last + 1 : record.following.stop].all()
    np.testing.assert_allclose(record.q[last : last + len(stop), columns], stop[:, columns], rtol=0.0, atol=1e-12)


def test_after_a_refused_goal_the_follower_goes_on_from_what_was_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, recalled = Rig(refused_from_12()), list[list[FloatArray]]()
    step = rig.follower.step

    def noted(human: HumanPosture, dt: float) -> RobotPosture:
        recalled.append(rig.follower.reseeded[-1:])
        return step(human, dt)

    monkeypatch.setattr(rig.follower, "step", noted)
    record = play(rig).record
    sent = record.q[record.following][:, rig.robot.servo_columns]
    assert np.abs(sent[13] - sent[12]).max() > 1e-4, "it still brakes"
    np.testing.assert_array_equal(recalled[13:17], sent[12:16, None])


# The gate of a robot: what it compensates, and what it checks; which runs have deadlines.


def standing() -> FloatArray:
    """Joints of the OP3 in its posture `stand`, rad (20,)."""
    return op3().posture(op3().profile.postures.stand)[op3().servo_columns]


def driven_gate(priorities: str) -> DrivenGate:
    """The gate of OP3 with mass, driven from `stand`."""
    options = RunOptions(robot="op3", bus="physics")
    gate = make_gate(op3(), follower(priorities=priorities), load_priorities(priorities), options, dt=DT)
    assert type(gate) is Gate and gate.clearance is not None
    gate.clearance.begin(standing())
    return DrivenGate(gate, standing(), op3().posture(op3().profile.postures.stand))


@pytest.mark.parametrize(("name", "compensates"), [("servo", False), ("balanced", True)])
def test_priorities_say_whether_goals_are_compensated(name: str, compensates: bool) -> None:
    driven, present = driven_gate(name), standing()
    for _ in range(200):
        goal = driven.check(present)
        assert goal is not None and np.array_equal(goal.posture, present)
    assert np.any(driven.goal.joints != present) == compensates
    assert driven.check(present + 1.0) is None


def test_compensated_goals_are_checked_for_collision() -> None:
    """An arm that is lowered into the hip is refused before it is there."""
    driven, present, joints = driven_gate("balanced"), standing(), op3().joint_map
    shoulder, elbow = joints.joints.index("l_sho_roll"), joints.joints.index("l_el")
    passed = []
    for _ in range(400):
        target = present.copy()
        target[shoulder] = min(target[shoulder] + 0.002, joints.upper[shoulder])
        target[elbow] = max(target[elbow] - 0.003, joints.lower[elbow])
        passed.append(driven.check(target) is not None)
        present = (driven.goal if passed[-1] else driven.brake()).posture
    assert passed[0] and not passed[-1]


@pytest.mark.parametrize(("bus", "reason"), [("mock", None), ("profile", "no tick for 0.3 s, allowed 0.08 s")])
def test_a_slow_host_stops_real_servos_and_no_simulated_robot(bus: str, reason: str | None) -> None:
    clock = VirtualClock()
    options = RunOptions(robot="op3", bus=bus, priorities="servo", playback=Playback(end=0.3))
    with prepare(synthetic_performer, options, clock=clock, make_bus=mock_bus) as prepared:
        late = RowObserver(lambda record, row: clock.advance(0.3) if row == 50 else None)
        run = prepared.run(observers=[late])
    assert (run.state, run.reason) == ("off", reason) and (run.ticks_followed > 1) == (reason is None)


# Runs that last longer than there is room for: what is kept has no gap.


def filled(approach: int, follow: int, brake: int, *, close_at: int | None = None) -> Record:
    """The times of so many ticks of each phase, with room for 4, 3 and 2 of them."""
    rows = RecordRows(approach=4, follow=3, brake=2)
    record = Record.empty(rows.room, {}, ("time",), human_joint_names=())
    for tick in range(approach + follow + brake):
        if close_at == tick:
            rows.close()
        record.time[rows.row] = tick
        rows.filled(approaches=tick + 1 < approach)
    return rows.of(record)


def test_a_stage_has_a_time_in_the_ticks_in_which_it_was_kept() -> None:
    clip, stages = short_clip(), StubReconstructor(person())
    first = clip.sample(0)
    assert first is not None
    seen: list[float] = []
    recorder = TickRecorder(clip, stages.start(first), len(first.names))
    for tick in range(5):
        if tick == 3:
            recorder.close()  # from now on all ticks fill one row
        recorder.begin()
        if tick % 2:
            recorder.keep_times({"time_human": 0.25 * tick})
        recorder.keep(Phase.FOLLOW, lambda record, row: seen.append(float(record.time_human[row])))
    record, _ = recorder.finish()
    np.testing.assert_array_equal(seen, [np.nan, 0.25, np.nan, 0.75, np.nan])
    np.testing.assert_array_equal(record.time_human, seen[:3])
    assert np.isnan(record.time_gate).all()


def test_what_comes_after_the_last_room_is_not_kept() -> None:
    record = filled(2, 9, 0, close_at=5)
    assert record.time.tolist() == [0, 1, 2, 3, 4] and record.from_start and not record.to_end
    full = filled(2, 9, 0)
    assert full.time.tolist() == list(range(9)) and not full.to_end  # no more than there are rows
    late = filled(9, 3, 0, close_at=10)
    assert late.time.tolist() == [6, 7, 8, 9] and not (late.from_start or late.to_end)


@pytest.mark.long
def test_an_approach_that_is_held_up_misses_no_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its ticks came in time, and the robot kept its limits."""
    monkeypatch.setattr("retarget.run.record.LONGEST_APPROACH_S", 2.2)
    rig, ticks = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0)), iter(range(10**6))
    with rig.prepared() as prepared:
        samples = prepared.samples
        assert isinstance(samples, LivePerformer)

        def pauses() -> bool:
            samples.clutch(engaged=next(ticks) not in range(40, 400))
            return False

        run = prepared.run(Asks(pauses))
    report = measure(run)
    assert report.bus is not None and not run.record.from_start
    assert report.bus.missed_ticks == 0 and report.bus.longest_period_ms == pytest.approx(8.0)
    assert report.limit_violations == LimitViolations(0, 0, 0)
    assert {*run.record.phase.tolist()} == {Phase.APPROACH, Phase.FOLLOW, Phase.BRAKE}
    shows(report.notes)


def test_of_a_long_motion_the_beginning_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.human.samples.MAX_KEPT", 100)
    rows = list[int]()
    options = RunOptions(robot="op3", playback=Playback(end=2.0))
    with prepare(synthetic_performer, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        run = prepared.run(observers=[RowObserver(lambda record, row: rows.append(row))])
    report = measure(run)
    assert run.ticks_followed == 100 and not run.record.to_end and len(run.record) < len(rows) - 150
    assert report.duration_s == pytest.approx(99 / 125) and report.frames < report.frames_per_s * run.wall_s + 1.0
    shows_lines([note for note in report.notes if "recorded" in note], 1)
    assert report.limit_violations == LimitViolations(0, 0, 0)


@pytest.mark.parametrize("option", ["faults", "gate"])
@pytest.mark.parametrize("bus", ["mock", "none", "profile", "/dev/ttyUSB0", "./link"])
def test_faults_are_the_emulator_s_and_real_servos_are_never_moved_without_the_gate(bus: str, option: str) -> None:
    real = bus not in ("mock", "none")
    assert RunOptions(robot="op3", bus=bus).simulated is not real
    if option == "faults" or real:
        with refuses(UsageError):
            RunOptions(robot="op3", bus=bus, **{option: {"faults": Path("faults.yaml"), "gate": False}[option]})  # type: ignore[arg-type]
    assert RunOptions(robot="op3", bus="emulator", faults=Path("faults.yaml")).simulated


# What a run is asked to be, about its bus.


@pytest.mark.parametrize(
    ("bus", "has_mass"),
    [("mock", False), ("emulator", False), ("physics", True), ("profile", True), ("/dev/ttyUSB0", True)],
)
def test_a_robot_with_mass_goes_to_rest_before_torque_goes_off(bus: str, has_mass: bool) -> None:
    assert RunOptions(robot="op3", bus=bus).has_mass is has_mass


@pytest.mark.parametrize(
    ("values", "option", "hint"),
    [
        ({"mount": "gantri"}, "--mount", "gantry"),
        ({"perturbations": ("pusch",)}, "--perturb", "push"),
        ({"perturbations": ("mass", "mass=1.1")}, "--perturb", "Name each once"),
        ({"perturbations": ("push=3",)}, "--perturb", "push alone"),
        ({"perturbations": ("stiffness=0",)}, "--perturb", "stiffness=0.1"),
        ({"perturbations": ("stiffness=nan",)}, "--perturb", "stiffness=0.1"),
        ({"perturbations": ("stiffness=",)}, "--perturb", "stiffness=0.1"),
        ({"seed": -1}, "--seed", "0 to 4294967295"),
        ({"mount": "floor", "hook": "neck"}, "--hook", "only a gantry"),
    ],
)
def test_what_cannot_be_meant(values: dict[str, object], option: str, hint: str) -> None:
    with pytest.raises(UsageError) as caught:
        PhysicsOptions(**values)  # type: ignore[arg-type]
    assert option in str(caught.value) and hint in str(caught.value)


@pytest.mark.parametrize("bus", ["mock", "emulator", "none", "profile"])
@pytest.mark.parametrize(
    "physics", [PhysicsOptions(mount="stand"), PhysicsOptions(seed=1), PhysicsOptions(perturbations=("mass",))]
)
def test_they_are_refused_where_nothing_has_mass(bus: str, physics: PhysicsOptions) -> None:
    with refuses(UsageError, "--bus", "physics"):
        RunOptions(robot="op3", bus=bus, physics=physics)
    for simulated in ("physics", "physics+wire"):
        options = RunOptions(robot="op3", bus=simulated, physics=physics)
        assert options.has_physics and options.simulated


@pytest.mark.parametrize(("name", "usual"), [("toddlerbot", "balanced_sustained"), ("op3", "balanced")])
def test_a_profile_names_the_priorities_of_a_robot_with_mass(name: str, usual: str) -> None:
    robot = load_robot(name)
    for bus in ("physics", "physics+wire", "profile", "/dev/ttyUSB0"):
        assert priority_names(robot, RunOptions(robot=name, bus=bus))[-1] == usual
        assert priority_names(robot, RunOptions(robot=name, bus=bus, priorities="paper"))[-1] == "paper"
    for bus in ("mock", "emulator"):
        assert priority_names(robot, RunOptions(robot=name, bus=bus))[-1] == "servo"


def test_only_the_priorities_that_look_at_no_motion_are_replaced() -> None:
    def named(retarget: str, *, standing: str | None, hangs: bool) -> str:
        robot = load_robot("op3", root="suspended" if hangs else "free")
        profile = robot.profile.model_copy(update={"retarget": retarget, "standing": standing})
        return name_with_mass(replace(robot, profile=profile))

    assert named("servo", standing=None, hangs=False) == "balanced"
    assert named("servo", standing=None, hangs=True) == "fixed_base"
    assert named("mine", standing=None, hangs=False) == named("mine", standing=None, hangs=True) == "mine"
    assert named("mine", standing="balanced_sustained", hangs=False) == "balanced_sustained"
    assert named("mine", standing="balanced_sustained", hangs=True) == "mine"


def test_solves_that_took_too_many_steps_are_counted() -> None:
    options = RunOptions(robot="op3", priorities="servo", playback=Playback(end=0.1))
    with prepare(synthetic_performer, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        run = prepared.run()
        solver: Any = SimpleNamespace(hierarchy=SimpleNamespace(solver=SimpleNamespace(capped=3)))
        counted = replace(prepared, reconstructor=solver).result(Ending(run.record, 1.0, None, None))
    added = [note for note in counted.notes if note not in run.notes]
    assert [note.split()[0] for note in added] == ["3"]
