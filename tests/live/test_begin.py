"""How a live run begins: options, sensors that are waited for, the size of the performer, the side check."""

import runpy
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
from sim.faults.sender import FakeSender, Poses, SenderFault, lost, silent

BEGINS_S = 3.0
"""By then a performer who stands still from 0.5 s on has been measured."""
SIDES = LiveOptions(countdown=0.5, check_sides=True)
COUNTDOWN_S = 0.2


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's configuration folder, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path


def begins(
    stream: LiveStream,
    options: LiveOptions,
    *,
    clock: VirtualClock | None = None,
    said: list[str] | None = None,
    where: str = WHERE,
    has_deadlines: bool = True,
) -> tuple[Performance, LivePerformer]:
    """A live run begins. said: takes its messages."""
    notify, clock = list[str]().append if said is None else said.append, clock or VirtualClock()
    found = begin_live(
        stream, options, clock=clock, rate_hz=100.0, where=where, notify=notify, has_deadlines=has_deadlines
    )
    assert isinstance(found.samples, LivePerformer)
    return found, found.samples


def started(
    *faults: SenderFault, performer: Performer | None = None, person: str | None = "anna"
) -> tuple[Performance, LivePerformer, list[str], VirtualClock]:
    """The performance, its performer, the messages, and the clock, which began at 0."""
    said, clock = list[str](), VirtualClock()
    stream = live_stream(FakeSender(faults=list(faults)), performer or five())
    options = LiveOptions(patience=1.0, countdown=COUNTDOWN_S, person=person)
    return *begins(stream, options, clock=clock, said=said), said, clock


def alone(*names: str) -> SenderFault:
    return lambda time, poses: {name: poses[name] for name in names}


FIVE = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")


def standing() -> FakeSender:
    """A performer who stands still and does nothing else."""
    return FakeSender(frames=FakeSender().frames.resample(np.linspace(0.0, 0.01, 4)))


@pytest.mark.parametrize("countdown", [-5.0, -1e-9, 600.1, float("inf"), float("nan"), float("-inf")])
def test_a_countdown_out_of_range_is_refused(countdown: float) -> None:
    with refuses(UsageError, "--countdown", allowed=(0, 600)):
        LiveOptions(countdown=countdown)


@pytest.mark.parametrize(
    ("name", "sent", "missing", "step"),
    [
        ("six", FIVE, "pelvis", "--performer"),
        ("ten", FIVE, "l_knee", "--performer"),
        ("six", ("pelvis", *FIVE[:3], "r_ankle"), "l_ankle", ()),
    ],
)
def test_sensors_of_the_performers_file_are_waited_for(
    name: str, sent: tuple[str, ...], missing: str, step: Facts
) -> None:
    with refuses(InputError, step, found=missing):
        started(alone(*sent), performer=load_performer(name), person=None)


def test_a_partial_performer_moves_with_the_sensors_that_there_are_and_wrists_have_to_be_in_the_file() -> None:
    _, performer, _, clock = started(alone(*FIVE), performer=load_performer("all"), person=None)
    followed = 0
    for tick in range(300):
        clock.advance(0.01)
        performer.poll()
        followed += performer.sample(tick) is not None
    assert followed > 150
    without = {name: five().sensors[name] for name in ("head", "l_ankle")}
    with refuses(UsageError, "l_wrist", "r_wrist"):
        started(performer=five().model_copy(update={"sensors": without}))


@pytest.mark.parametrize(
    ("where", "deadlines", "waits"), [("web://", False, True), ("web://", True, False), (WHERE, False, False)]
)
def test_a_page_is_waited_for_without_limit_where_nothing_has_torque(where: str, deadlines: bool, waits: bool) -> None:
    stream, options = live_stream(FakeSender(), five()), LiveOptions(countdown=COUNTDOWN_S)
    _, performer = begins(stream, options, where=where, has_deadlines=deadlines)
    assert performer.paused is waits
    performer.clutch(engaged=False)
    assert performer.paused


@pytest.mark.parametrize("second", [0.0, 4.0, 9.0])
def test_a_run_begins_with_the_sender_example_whenever_it_is_started(root: Path, second: float) -> None:
    message = runpy.run_path(str(root / "examples/send_poses.py"), run_name="sender")["message"]

    class Example(FakeSender):
        def encoded(self, time: float) -> bytes:
            return bytes(message(round(self.rate_hz * (second + time))))

    said: list[str] = []
    begins(live_stream(Example(rate_hz=60.0), five()), LiveOptions(check_sides=True), said=said)
    assert said[-1].startswith("left is left, up is up")


# The side check: the left arm is raised.


def raising(name: str, by: float, *, forward: float = 0.45, begins: float = BEGINS_S) -> SenderFault:
    """One wrist goes up and forward by so much within a second."""

    def fault(time: float, poses: Poses) -> Poses:
        share = float(np.clip(time - begins, 0.0, 1.0))
        return poses | {name: poses[name] + np.array([forward, 0.1, by]) * share}

    return fault


def reflected(axis: int) -> SenderFault:
    """One axis of the sender's world has the wrong sign."""
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda time, poses: {name: point * signs for name, point in poses.items()}


def checked(*faults: SenderFault, said: list[str] | None = None) -> None:
    sender, clock = standing(), VirtualClock()
    sender.faults = list(faults)
    begins(live_stream(sender, five()), SIDES, clock=clock, said=said)
    assert clock.now() < BEGINS_S + 1.5


UP, ASIDE = raising("l_wrist", 0.5), raising("l_wrist", 0.5, forward=0.0)


@pytest.mark.parametrize(
    ("faults", "facts"),
    [
        pytest.param([UP, reflected(0)], (), id="x is mirrored"),
        pytest.param([UP, reflected(1)], (), id="y is mirrored"),
        pytest.param([ASIDE], ("wrist", 50), id="to the side"),
        pytest.param([ASIDE, reflected(0)], ("wrist", 50), id="to the side, x is mirrored"),
        pytest.param([ASIDE, reflected(1)], ("wrist", 50), id="to the side, y is mirrored"),
        pytest.param([raising("r_wrist", 0.5)], (), id="the right arm"),
        pytest.param([raising("l_wrist", -0.5)], (), id="down"),
        pytest.param([raising("r_wrist", -0.5)], (), id="the right arm down"),
        pytest.param([raising("l_wrist", 0.2)], (20, 45), id="too little"),
    ],
)
def test_any_other_motion_than_a_left_arm_that_is_raised_in_front_is_refused(
    faults: list[SenderFault], facts: Facts
) -> None:
    with refuses(InputError, facts):
        checked(*faults)


def test_a_wrist_or_a_stream_that_is_lost_meanwhile_is_the_reason_and_the_check_is_not_left_out() -> None:
    said: list[str] = []
    with refuses(InputError, found="l_wrist") as wrist:
        checked(lost("l_wrist", BEGINS_S))
    with refuses(InputError) as stream:
        checked(silent(BEGINS_S), said=said)
    assert said[-1].startswith("nothing has arrived for 1.0 s")
    assert not any("--no-check-sides" in str(refusal.value) for refusal in (wrist, stream))


def test_a_measured_performer_keeps_the_stream_though_silent() -> None:
    """No other sender can raise the arm with its size when the owner is silent for 6 s after the calibration."""
    sender, other = standing(), standing()
    sender.faults = [silent(BEGINS_S, 60.0)]
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
        if check.seen == RAISED or check.seen in REFUSED:
            return


# The size of a performer: known, given or measured.


def placed(yaw: float, by: tuple[float, float, float]) -> SenderFault:
    """The stream's world lies elsewhere."""
    turn = from_axis_angle([0.0, 0.0, 1.0], yaw)
    return lambda time, poses: {name: rotate(turn, at) + np.array(by) for name, at in poses.items()}


def anna(stature: float) -> Path:
    return write_person(person_of("anna", proportional_dimensions(stature), sensors=("head",), date="2020-01-01"))


def test_a_person_measured_once_is_known_in_another_place() -> None:
    first, before, said, clock = started()
    assert said[-1] == f"kept for --person anna: {person_path('anna')}"
    kept = read_person("anna")
    assert kept is not None and kept.sensors == tuple(five().sensors)
    again, after, known, faster = started(placed(1.2, (3.0, -2.0, 0.4)))
    np.testing.assert_allclose(again.dimensions.offset, first.dimensions.offset, atol=5.1e-5)
    assert "anna, measured on" in known[-1]
    assert faster.now() < clock.now() - 0.9 * (CAPTURE_S - KNOWN_CAPTURE_S)
    one, other = before.sample(0), after.sample(0)
    assert one is not None and other is not None
    np.testing.assert_allclose(one.position, other.position, atol=0.005)
    assert after.alignment.origin[2] - before.alignment.origin[2] == pytest.approx(0.4, abs=0.003)


@pytest.mark.parametrize("stature", [1.4, 2.1])
def test_another_person_is_refused_and_an_invalid_file_before_the_stream_is_waited_for(stature: float) -> None:
    path, clock = anna(stature), VirtualClock()
    with refuses(InputError, "--recalibrate"):
        started()
    path.write_text(path.read_text().replace("layout: 2", "layout: 7"))
    with refuses(ConfigError):
        begins(live_stream(FakeSender(), five()), LiveOptions(person="anna"), clock=clock)
    assert clock.now() == 0.0


def test_without_ankles_the_floor_is_as_far_below_the_head_as_the_person_is_tall() -> None:
    three, worn = load_performer("three"), alone("head", "l_wrist", "r_wrist")
    started(worn, performer=three)
    _, performer, _, _ = started(worn, placed(0.0, (0.0, 0.0, 0.06)), performer=three)
    assert performer.alignment.origin[2] == pytest.approx(0.06, abs=0.004)
    with refuses(InputError):
        started(worn, placed(0.0, (0.0, 0.0, 0.5)), performer=three)


def test_a_performer_who_leans_is_corrected_at_once_and_measured_when_upright() -> None:
    def leans(time: float, poses: Poses) -> Poses:
        return poses | {"head": poses["head"] + [0.3 if time < 4.0 else 0.0, 0.0, 0.0]}

    said, sender = list[str](), standing()
    sender.faults = [leans]
    begins(live_stream(sender, five()), LiveOptions(countdown=0.5), said=said)
    assert "0.3" in said[1] and said[-1].startswith("measured: ")
    shows(said)


def test_a_stature_is_taken_and_no_second_one() -> None:
    with refuses(UsageError, "--stature", allowed=(1.2, 2.2)):
        LiveOptions(stature=168.0)
    said, stream, clock = list[str](), live_stream(standing(), five()), VirtualClock()
    found, _ = begins(stream, LiveOptions(countdown=0.5, stature=1.7), clock=clock, said=said)
    assert found.dimensions.stature == pytest.approx(1.7, abs=0.005)
    assert said[-1] == "known: 1.70 m tall (--stature)"
    anna(1.7)
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
        super().sleep_until(time + 1.5)


def test_a_busy_machine_is_not_taken_for_a_silent_stream() -> None:
    said, clock, stream = list[str](), SlowClock(), live_stream(FakeSender(rate_hz=120.0), five())
    options = LiveOptions(patience=6.0, countdown=0.0)
    with suppress(InputError):  # so few polls are not enough to measure
        Beginning(stream=stream, options=options, clock=clock, where=WHERE, notify=said.append).measure(None)
    assert stream.arrived > 600
    shows(said)
