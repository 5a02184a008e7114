"""How a live run begins: options out of range are refused before a port is opened; the help names every performer."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.clock import VirtualClock
from live_rig import WHERE, five, live_stream
from messages import Facts, refuses, shows
from retarget.errors import ConfigError, InputError, UsageError
from retarget.human.performer_calibration import person_of, person_path, read_person, write_person
from retarget.human.samples import Performance
from retarget.human.side_check import FRONT_M, RAISED, REFUSED, RISE_M, SURE_S, SideCheck
from retarget.live.admission import SECOND_SOURCE
from retarget.live.begin import Beginning, LiveOptions, begin_live
from retarget.live.performer import LivePerformer
from retarget.live.rest_capture import CAPTURE_S, KNOWN_CAPTURE_S
from retarget.live.stream import LiveStream
from retarget.model.human_dimensions import proportional_dimensions
from retarget.rotations import from_axis_angle, rotate
from retarget.schema.performer import Performer, load_performer
from retarget.types import FloatArray
from sim.faults.sender import FakeSender, Poses, SenderFault, lost, silent


@pytest.mark.parametrize("countdown", [-5.0, -1e-9, 600.1, float("inf"), float("nan"), float("-inf")])
def test_a_countdown_out_of_range_is_refused(countdown: float) -> None:
    with refuses(UsageError, "--countdown", allowed=(0, 600)):
        LiveOptions(countdown=countdown)


BEGINS_S = 3.0
"""By then a performer who stands still from 0.5 s on has been measured."""


def raising(name: str, by: float, *, forward: float = 0.45, begins: float = BEGINS_S) -> SenderFault:
    """One wrist goes up and forward by so much within a second."""

    def fault(time: float, poses: dict[str, FloatArray]) -> dict[str, FloatArray]:
        share = float(np.clip(time - begins, 0.0, 1.0))
        return poses | {name: poses[name] + np.array([forward, 0.1, by]) * share}

    return fault


def reflected(axis: int) -> SenderFault:
    """One axis of the sender's world has the wrong sign."""
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda time, poses: {name: point * signs for name, point in poses.items()}


def standing() -> FakeSender:
    """A performer who stands still and does nothing else."""
    frames = FakeSender().frames
    return FakeSender(frames=frames.resample(np.linspace(0.0, 0.01, 4)))


def begins(
    stream: LiveStream, options: LiveOptions, *, clock: VirtualClock | None = None, said: list[str] | None = None
) -> Performance:
    """A live run begins. said: takes its messages."""
    notify = list[str]().append if said is None else said.append
    return begin_live(stream, options, clock=clock or VirtualClock(), rate_hz=100.0, where=WHERE, notify=notify)


SIDES = LiveOptions(countdown=0.5, check_sides=True)


def begun(*faults: SenderFault) -> None:
    sender, clock = standing(), VirtualClock()
    sender.faults = list(faults)
    begins(live_stream(sender, five()), SIDES, clock=clock)
    assert clock.now() < BEGINS_S + 1.5


@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirrored_world_is_refused(axis: int) -> None:
    with refuses(InputError):
        begun(raising("l_wrist", 0.5), reflected(axis))


@pytest.mark.parametrize("axis", [None, 0, 1])
def test_an_arm_to_the_side_is_asked_again_and_never_enough(axis: int | None) -> None:
    faults = [raising("l_wrist", 0.5, forward=0.0)] + ([] if axis is None else [reflected(axis)])
    with refuses(InputError, "wrist", 50):
        begun(*faults)


def test_a_wrist_that_is_lost_meanwhile_is_named_and_the_check_not_left_out() -> None:
    with refuses(InputError, found="l_wrist") as refusal:
        begun(lost("l_wrist", BEGINS_S, 1e9))
    assert "--no-check-sides" not in str(refusal.value)


def test_a_stream_that_falls_silent_meanwhile_is_reported_at_once_and_is_the_reason() -> None:
    said: list[str] = []
    sender = standing()
    sender.faults = [silent(BEGINS_S, 1e9)]
    with refuses(InputError) as refusal:
        begins(live_stream(sender, five()), SIDES, said=said)
    assert said[-1].startswith("nothing has arrived for 1.0 s") and "--no-check-sides" not in str(refusal.value)


@pytest.mark.parametrize(
    ("name", "by", "facts"),
    [("r_wrist", 0.5, ()), ("l_wrist", -0.5, ()), ("r_wrist", -0.5, ()), ("l_wrist", 0.2, (20, 45))],
)
def test_any_other_motion_is_refused_by_name(name: str, by: float, facts: Facts) -> None:
    with refuses(InputError, facts):
        begun(raising(name, by))


def test_a_measured_performer_keeps_the_stream_though_silent() -> None:
    """No other sender can raise the arm with its size when the owner is silent for 6 s after the calibration."""
    sender = standing()
    sender.faults = [silent(BEGINS_S, 60.0)]
    other = standing()
    other.source, other.faults = ("127.0.0.1", 40001), [raising("l_wrist", 0.5, begins=BEGINS_S + 6.0)]
    sender.others = [lambda since, until: other.poll(until)]
    stream = live_stream(sender, five())
    with refuses(InputError):
        begins(stream, SIDES)
    assert stream.admission.owner == sender.source and stream.admission.refused.reasons[SECOND_SOURCE] > 900


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), max_size=30),
    st.floats(0.5, 1.5),
    st.booleans(),
)
def test_only_a_left_wrist_that_stays_up_in_front_passes(
    moves: list[tuple[float, float, float]], rest: float, forgotten: bool
) -> None:
    hung = np.array([[0.0, 0.2, rest], [0.0, -0.2, rest]])
    check, shown = SideCheck(hung), 0.0
    for tick, (forward, up, right_up) in enumerate(moves):
        left = [np.nan] * 3 if forgotten else [forward, 0.0, up]
        check.take(0.05 * tick, hung + np.array([left, [0.0, 0.0, right_up]]))
        shown = shown + 0.05 if up > RISE_M and forward > FRONT_M and not forgotten else 0.0
        if check.seen == RAISED:
            assert shown >= SURE_S
            return
        if check.seen in REFUSED:
            return


COUNTDOWN_S = 0.2


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's configuration folder, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path


def placed(yaw: float, by: tuple[float, float, float]) -> SenderFault:
    """The stream's world lies elsewhere."""
    turn = from_axis_angle([0.0, 0.0, 1.0], yaw)
    return lambda time, poses: {name: rotate(turn, at) + np.array(by) for name, at in poses.items()}


def started(
    *faults: SenderFault,
    person: str | None = "anna",
    recalibrate: bool = False,
    performer: Performer | None = None,
) -> tuple[Performance, list[str], float]:
    """The performance, the messages, and how long it took, s."""
    said: list[str] = []
    clock, stream = VirtualClock(), live_stream(FakeSender(faults=list(faults)), performer or five())
    options = LiveOptions(patience=1.0, countdown=COUNTDOWN_S, person=person, recalibrate=recalibrate)
    return begins(stream, options, clock=clock, said=said), said, clock.now()


def alone(*names: str) -> SenderFault:
    def fault(time: float, poses: Poses) -> Poses:
        return {name: poses[name] for name in names}

    return fault


def origin(performance: Performance) -> FloatArray:
    assert isinstance(performance.samples, LivePerformer)
    return performance.samples.alignment.origin


def test_a_person_measured_once_is_known_in_another_place() -> None:
    first, said, took = started()
    assert said[-1] == f"kept for --person anna: {person_path('anna')}"
    kept = read_person("anna")
    assert kept is not None and kept.sensors == tuple(five().sensors)
    again, known, faster = started(placed(1.2, (3.0, -2.0, 0.4)))
    np.testing.assert_allclose(again.dimensions.offset, first.dimensions.offset, atol=5.1e-5)
    assert "anna, measured on" in known[-1] and faster < took - 0.9 * (CAPTURE_S - KNOWN_CAPTURE_S)
    assert isinstance(again.samples, LivePerformer) and isinstance(first.samples, LivePerformer)
    one, other = (found.samples.sample(0) for found in (first, again))
    assert one is not None and other is not None
    np.testing.assert_allclose(one.position, other.position, atol=0.005)
    assert origin(again)[2] - origin(first)[2] == pytest.approx(0.4, abs=0.003)


@pytest.mark.parametrize("stature", [1.4, 2.1])
def test_another_person_is_refused(stature: float) -> None:
    write_person(person_of("anna", proportional_dimensions(stature), sensors=("head",), date="2020-01-01"))
    with refuses(InputError, "--recalibrate"):
        started()


def test_an_invalid_file_is_refused_before_the_stream_is_waited_for() -> None:
    path = write_person(person_of("anna", proportional_dimensions(1.7), sensors=("head",), date="2020-01-01"))
    path.write_text(path.read_text().replace("layout: 2", "layout: 7"))
    clock = VirtualClock()
    with refuses(ConfigError):
        begins(live_stream(FakeSender(), five()), LiveOptions(person="anna"), clock=clock)
    assert clock.now() == 0.0


def test_without_ankles_the_floor_is_as_far_below_the_head_as_the_person_is_tall() -> None:
    three, worn = load_performer("three"), alone("head", "l_wrist", "r_wrist")
    started(worn, performer=three)
    found, _, _ = started(worn, placed(0.0, (0.0, 0.0, 0.06)), performer=three)
    assert origin(found)[2] == pytest.approx(0.06, abs=0.004)
    with refuses(InputError):
        started(worn, placed(0.0, (0.0, 0.0, 0.5)), performer=three)


def test_who_does_not_stand_upright_is_told_why_at_once_and_measured_then() -> None:
    def leans(time: float, poses: Poses) -> Poses:
        return poses | {"head": poses["head"] + [0.3 if time < 4.0 else 0.0, 0.0, 0.0]}

    said: list[str] = []
    stream = live_stream(FakeSender(frames=standing().frames, faults=[leans]), five())
    begins(stream, LiveOptions(countdown=0.5), said=said)
    assert "0.3" in said[1] and said[-1].startswith("measured: ")
    shows(said)


def test_a_stature_is_taken_and_no_second_one() -> None:
    with refuses(UsageError, "--stature", allowed=(1.2, 2.2)):
        LiveOptions(stature=168.0)
    said: list[str] = []
    stream, clock = live_stream(standing(), five()), VirtualClock()
    found = begins(stream, LiveOptions(countdown=0.5, stature=1.7), clock=clock, said=said)
    assert found.dimensions.stature == pytest.approx(1.7, abs=0.005)
    assert said[-1] == "known: 1.70 m tall (--stature)"
    write_person(person_of("anna", proportional_dimensions(1.7), sensors=("head",), date="2020-01-01"))
    with refuses(UsageError, "--stature"):
        begins(stream, LiveOptions(countdown=0.5, stature=1.7, person="anna"), clock=clock)


def test_the_reason_is_what_was_wrong_for_longest_and_not_what_came_last() -> None:
    """The head is not sent until 3 s, and moves only then."""

    def hidden_and_moved(time: float, poses: Poses) -> Poses | None:
        if 0.15 < time < 3.0:
            return {name: at for name, at in poses.items() if name != "head"}
        aside = np.array([0.0, 0.1 * np.sin(9.0 * time), 0.0])
        return {name: at + aside for name, at in poses.items()} if time >= 3.0 else poses

    clock, stream = VirtualClock(), live_stream(FakeSender(faults=[hidden_and_moved]), five())
    options = LiveOptions(patience=3.5, countdown=COUNTDOWN_S)
    with refuses(InputError, found="head"):
        Beginning(stream=stream, options=options, clock=clock, where=WHERE, notify=lambda text: None).measure(None)
    assert clock.now() > 4.5


class SlowClock(VirtualClock):
    """A machine so busy that every sleep lasts 1.5 s."""

    def sleep_until(self, time: float) -> None:
        """Sleep, and longer."""
        super().sleep_until(time + 1.5)


def test_a_busy_machine_is_not_taken_for_a_silent_stream() -> None:
    said: list[str] = []
    clock, stream = SlowClock(), live_stream(FakeSender(rate_hz=120.0), five())
    with suppress(InputError):  # so few polls are not enough to measure
        options = LiveOptions(patience=6.0, countdown=0.0)
        Beginning(stream=stream, options=options, clock=clock, where=WHERE, notify=said.append).measure(None)
    assert stream.arrived > 600
    shows(said)
