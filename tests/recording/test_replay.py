"""Replay: what differs from a recording is counted, goals in ticks and postures of a human to the bit."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import retarget
from faulty_bus import FaultKind, MockFault
from hardware.arrays import TickArray
from hardware.bus import ServoGoals
from hardware.guard_state import StopCause
from live_rig import LiveRig
from messages import mentions, refuses, shows
from operators import ENOUGH, Asks
from recordings import Recorded, record, with_cycles
from retarget.errors import InputError
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.recording.configs import as_recorded
from retarget.recording.cycles import Done, InputFlag
from retarget.recording.reading import Recording, read_recording
from retarget.recording.recorder import Recorder
from retarget.recording.replay import (
    Difference,
    RecordedInputs,
    RecordedSamples,
    Replayed,
    environment_changes,
    goal_difference,
    posture_difference,
    replay,
)
from retarget.recording.topics import IMU, STICK
from retarget.robot.walking.pattern import Request
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.run_result import RunResult
from retarget.run.supervisor import OperatorInput
from retarget.run.table import OF_IMU
from retarget.types import RunState
from sim.faults.sender import FakeSender, lost, silent


def test_one_tick_of_one_joint_is_located(plain: Recorded) -> None:
    cycles, robot = plain.read().cycles, plain.result.robot
    assert robot is not None
    row = int(np.flatnonzero(cycles.written != Done.NOT)[30])

    def off(goals: Goals) -> Goals:
        goals[30][1][4] -= 2
        return goals

    found = compared(plain, off)
    assert (found.differ, found.ticks, found.first) == (1, 2, int(cycles.index[row]))
    assert found.most == pytest.approx(2 * 360.0 / 4096.0, rel=1e-6)
    assert found.where == f"of {robot.joint_map.joints[4]} in cycle {found.first}"
    assert found.time_s == pytest.approx(0.008 * (int(cycles.index[row]) - 1), abs=0.02)
    assert found.lines()[0].startswith(
        f"1 of {found.compared} goals differ from those recorded, from cycle {found.first}"
    )


def test_goals_that_are_missing_or_more(plain: Recorded) -> None:
    found = compared(plain, lambda goals: [*goals[:-3], (-1, goals[0][1]), goals[5]])
    assert (found.differ, found.absent, found.extra) == (0, 3, 2) and not found.none
    assert found.lines() == ["3 goals were recorded and are not sent now", "2 goals are sent now and were not recorded"]
    # What comes after a recording that was cut off is not more.
    cut = compared(plain, lambda goals: [*goals, (-1, goals[0][1])], damage="it ends early")
    assert cut.none and not cut.whole
    mentions(cut.lines(), "it holds", cut.compared - 1)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("replay") / "run.mcap")


Goals = list[tuple[int, TickArray]]


def compared(run: Recorded, change: Callable[[Goals], Goals], *, damage: str = "") -> Difference:
    """The goals that were recorded against them as they are changed."""
    found = replace(run.read(), damage=damage)
    rows = np.flatnonzero(found.cycles.written != Done.NOT).tolist()
    assert run.result.robot is not None
    return goal_difference(
        found, change([(row, found.cycles.goal_ticks[row].copy()) for row in rows]), run.result.robot
    )


def same(again: Replayed, result: RunResult) -> None:
    """To the tick, and to the bit before rounding."""
    assert again.difference.none and again.difference.differ == 0, again.difference.lines()
    now, then = again.result.record, result.record
    assert len(now) == len(then)
    for name in ("goal_ticks", "q", "human_q", "phase", *OF_IMU):
        np.testing.assert_array_equal(getattr(now, name), getattr(then, name), name)
    assert again.result.state == result.state


def test_a_run_is_reproduced_to_the_bit(plain: Recorded) -> None:
    again, cycles = replay(plain.read()), plain.read().cycles
    same(again, plain.result)
    assert again.changed == () and again.difference.compared == len(plain.result.record) + 1
    mentions(again.difference.lines(), len(plain.result.record))
    assert cycles.imu_valid[cycles.read == Done.WELL].all()
    w, x, y, _ = plain.result.record.imu_orientation[-1].tolist()
    assert w > 0.99 and abs(y) > 0.01 and abs(x) < 1e-3  # at rest OP3 leans forward over flat soles


def without(found: Recording, topic: str) -> Recording:
    return replace(found, topics={name: rows for name, rows in found.topics.items() if name != topic})


def test_a_recording_of_before_robots_had_an_imu_has_none(plain: Recorded) -> None:
    again = replay(without(plain.read(), IMU))
    assert again.difference.none and np.isnan(again.result.record.imu_time).all()


class Polled(Operator):
    """Asks in some of its ticks, counted from 0 while `states` last, for one thing, or fails in them."""

    def __init__(self, asked: OperatorInput | None, ticks: range, *states: RunState) -> None:
        self._asked, self._ticks, self._states, self._tick = asked, ticks, states or tuple(RunState), -1

    def poll(self, state: RunState | None) -> OperatorInput:
        self._tick += state in self._states
        if self._tick not in self._ticks or state not in self._states:
            return OperatorInput()
        if self._asked is None:
            raise RuntimeError("no terminal")
        return self._asked


@pytest.mark.long
def test_a_walk_that_a_stick_asked_for_is_walked_again(tmp_path: Path) -> None:
    """Without what was asked, as a recording of before has it, the robot stays where its performer stays."""
    options = RunOptions(robot="op3", steps="walk")
    curve = Polled(OperatorInput(velocity=Request(0.07, -0.0123, 0.1)), range(300), RunState.FOLLOW)
    run = record(tmp_path / "run.mcap", options=options, seconds=4.5, operator=curve)
    found, walk = run.read(), run.result.tally.walk
    assert walk is not None and walk.steps >= 3 and walk.walked_m > 0.03
    assert walk.asked_m == pytest.approx(300 * 0.008 * np.hypot(0.07, 0.0123)), "asked by the stick"
    again = replay(found)
    same(again, run.result)
    assert again.result.tally.walk == walk
    stands = replay(without(found, STICK))
    assert stands.result.tally.walk is not None and stands.result.tally.walk.steps == 0
    assert stands.difference.differ > 0


FALLEN = "the robot has fallen: over a wire"


@pytest.mark.long
@pytest.mark.parametrize(
    ("asked", "tick", "reason"),
    [
        (OperatorInput(fault=(StopCause.FALLEN, FALLEN)), 70, FALLEN),
        (None, 70, "no terminal"),
        (OperatorInput(stop=ENOUGH), 180, ENOUGH),
    ],
)
def test_what_the_operator_asked_for_is_asked_for_again(
    asked: OperatorInput | None, tick: int, reason: str, tmp_path: Path
) -> None:
    run = record(tmp_path / "run.mcap", operator=Polled(asked, range(tick, tick + 1)))
    again = replay(run.read())
    same(again, run.result)
    assert run.result.reason == reason
    assert reason == ENOUGH or again.result.reason == reason


@pytest.mark.parametrize(
    "fault",
    [
        MockFault(FaultKind.READ_FAILS, first=90, cycles=1000),
        MockFault(FaultKind.WRITE_FAILS, first=90, cycles=1000),
        MockFault(FaultKind.ALERT, first=90, cycles=1, servo=4, alert=0x04),
    ],
)
def test_what_went_wrong_goes_wrong_again(fault: MockFault, tmp_path: Path) -> None:
    run = record(tmp_path / "run.mcap", faults=(fault,))
    again = replay(run.read())
    same(again, run.result)
    assert again.result.reason == run.result.reason


@pytest.mark.long
def test_a_live_run_with_a_hold_is_reproduced(tmp_path: Path) -> None:
    """Sensors are those that were followed: what the stream, its clocks and the validity checks made of it is over."""
    faults, looks = [silent(6.2, 6.6), lost("l_wrist", 5.6, 5.8)], iter(range(10_000))
    rig = LiveRig(FakeSender(faults=faults), options=LiveOptions(countdown=0.5, duration=2.5))
    recorder = Recorder(tmp_path / "run.mcap", rig.run_options, clock=rig.clock, notify=rig.said.append)
    with rig.prepared() as prepared, recorder.recording(prepared, source="json://") as recorded:
        samples = prepared.samples
        assert isinstance(samples, LivePerformer)

        def pauses() -> bool:
            samples.clutch(engaged=next(looks) not in range(20, 60))
            return False

        result = recorded.run(Asks(pauses), [recorder.observer])
    found = read_recording(tmp_path / "run.mcap")
    assert (found.cycles.sampled == 2).any()
    assert np.count_nonzero(found.cycles.asked & InputFlag.PAUSED) == 40
    shows(rig.said)
    same(replay(found), result)


def test_the_human_alone_is_reproduced(tmp_path: Path) -> None:
    run = record(tmp_path / "run.mcap", options=RunOptions(robot="human", bus="none"))
    found, q = run.read(), run.result.record.human_q.copy()
    again = replay(found)
    assert again.difference.none and again.difference.compared == len(run.result.record)
    assert again.difference.lines() == [f"all {len(run.result.record)} postures are as recorded, to the bit"]
    np.testing.assert_array_equal(again.result.record.human_q, q)
    assert posture_difference(found, q).none
    q[5, 9] += 0.01
    off = posture_difference(found, q[:-2])
    assert (off.differ, off.absent, off.unit) == (1, 2, "m or rad")
    assert off.most == pytest.approx(0.01, rel=1e-4) and off.where == "of q[9] in cycle 5"


@pytest.mark.long
def test_a_changed_sensor_is_found_where_it_is(plain: Recorded) -> None:
    found = plain.read()
    where = int(np.flatnonzero(found.cycles.phase == 1)[10])
    cycles = found.cycles[np.arange(len(found.cycles))]
    cycles.sensor_position[where:, 1] += [0.0, 0.0, 0.3]
    again = replay(with_cycles(found, cycles))
    difference = again.difference
    assert not difference.none and difference.first is not None
    assert where <= difference.first <= where + 30 and 0 < difference.differ < difference.compared
    first, second, *_ = difference.lines()
    assert first.startswith(f"{difference.differ} of {difference.compared} goals differ from those recorded")
    shows(second)


@pytest.mark.parametrize("then", ["sooner", "later"])
def test_an_approach_that_lasts_longer_or_shorter_changes_nothing_after_it(then: str, plain: Recorded) -> None:
    """As where another version ends its approach earlier or later: following is compared with following."""
    found = plain.read()
    cycles, follow = found.cycles, int(np.flatnonzero(found.cycles.sampled == 1)[1])
    if then == "sooner":
        rows = np.delete(np.arange(len(cycles)), np.arange(follow - 20, follow))
    else:
        rows = np.insert(np.arange(len(cycles)), follow, [follow - 1] * 20)
    cycles = cycles[rows]
    cycles.index[:] = np.arange(len(cycles))
    cycles.clock[:] = np.maximum(np.arange(len(cycles)) * 0.008, 0.0)[:, None]
    again = replay(with_cycles(found, cycles))
    assert again.result.reason is None and again.result.state == "off"
    following = np.flatnonzero(cycles.phase == 1)
    assert (again.difference.first or 0) < following[0] and again.difference.differ == 0
    assert (again.difference.extra, again.difference.absent) == ((20, 0) if then == "sooner" else (0, 20))
    last = again.result.record.goal_ticks[again.result.record.following][-1]
    np.testing.assert_array_equal(last, cycles.goal_ticks[following[-1]])


def test_servos_are_as_far_from_their_goals_as_they_were(plain: Recorded) -> None:
    found = plain.read()
    inputs = RecordedInputs(found, RecordedSamples(found))
    inputs.read()
    inputs.write(ServoGoals(found.cycles.goal_ticks[0] + 5))
    servos = inputs.gather(0, RunState.APPROACH, approached=False).servos
    assert servos is not None
    np.testing.assert_array_equal(servos.position, found.cycles.position[1] + 5)


def test_another_version_is_named_and_another_processor_is_compared_to_the_bit(plain: Recorded) -> None:
    found = plain.read()
    assert environment_changes(found.session) == ()
    (note,) = environment_changes(found.session.model_copy(update={"version": "0.0.1"}))
    shows(note, "0.0.1", retarget.__version__, varies=retarget.__version__)
    other = found.session.model_copy(update={"machine": "aarch64 (Cortex-A76)"})
    again = replay(replace(found, session=other))
    assert again.difference.none
    mentions(again.difference.lines(), len(plain.result.record), "as recorded on aarch64 (Cortex-A76), to the bit")


def test_lost_cycles_are_not_those_before_them(plain: Recorded) -> None:
    whole = plain.read()
    cycles = whole.cycles[np.delete(np.arange(len(whole.cycles)), [3, 4])]
    cycles.asked[2] |= InputFlag.STOP
    found = with_cycles(whole, cycles)
    inputs = RecordedInputs(found, RecordedSamples(found))
    inputs.read()
    given = [inputs.gather(0, RunState.APPROACH, approached=False) for _ in range(6)]
    assert [one.operator.stop is not None for one in given] == [False, True, False, False, False, False]
    assert all(one.performer.may_go_on for one in given)
    np.testing.assert_allclose(np.diff([one.now for one in given]), whole.session.dt, atol=1e-9)


@pytest.mark.parametrize("update", [{"joints": ("head_pan",)}, {"sensors": ("head",)}])
def test_another_robot_or_performer_is_refused(update: dict[str, tuple[str, ...]], plain: Recorded) -> None:
    found = plain.read()
    other = with_cycles(replace(found, session=found.session.model_copy(update=update)), found.cycles)
    with refuses(InputError), as_recorded(other, robot="op3") as configs:
        replay(other, configs)


def test_a_run_whose_robot_still_stood_on_a_real_bus_is_over_with_its_last_cycle(tmp_path: Path) -> None:
    """As one that was killed while it waited for the operator; and it ends as was planned then."""
    run = record(tmp_path / "run.mcap", options=RunOptions(robot="toddlerbot"), goes_to_rest=True)
    found = run.read()
    session = found.session
    assert (session.end, run.result.state) == ("STANDING", RunState.STANDING.value)
    real = replace(found, session=session.model_copy(update={"bus": "/dev/ttyUSB0"}))
    again = replay(real)
    assert again.difference.none and len(again.result.record) - len(run.result.record) in (0, 1)


def test_a_recording_that_breaks_off_while_paused_is_over_with_its_last_cycle(plain: Recorded) -> None:
    found = plain.read()
    cycles = found.cycles[np.arange(60)]
    cycles.asked[-1] = InputFlag.PAUSED
    again = replay(with_cycles(found, cycles))
    assert len(again.result.record) < 200 and not again.difference.absent


def test_a_recording_of_before_ends_were_planned_goes_to_rest_untried(tmp_path: Path) -> None:
    """Its session has no plan, and its profile does not say that the robot stays at rest."""
    options = RunOptions(robot="toddlerbot", torque_off_at_end=True)
    run = record(tmp_path / "run.mcap", options=options, goes_to_rest=True)
    found = run.read()
    before = found.session.model_copy(update={"end": None, "keyframes": ()})
    again = replay(replace(found, session=before))
    assert again.result.state == run.result.state == RunState.OFF.value and again.difference.none
