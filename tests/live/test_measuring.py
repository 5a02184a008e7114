"""A person measured once is known from then on: half a second for floor and heading; another person is refused."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from hardware.clock import VirtualClock
from live_rig import WHERE, five, live_stream
from messages import refuses, shows
from retarget.errors import ConfigError, InputError
from retarget.human.performer_calibration import person_of, person_path, read_person, write_person
from retarget.human.samples import Performance
from retarget.live.begin import Beginning, LiveOptions, begin_live
from retarget.live.performer import LivePerformer
from retarget.live.rest_capture import CAPTURE_S, KNOWN_CAPTURE_S
from retarget.model.human_dimensions import proportional_dimensions
from retarget.rotations import from_axis_angle, rotate
from retarget.schema.performer import Performer, load_performer
from retarget.types import FloatArray
from sim.faults.sender import FakeSender, Poses, SenderFault, lost, silent

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


def begun(
    *faults: SenderFault,
    person: str | None = "anna",
    recalibrate: bool = False,
    performer: Performer | None = None,
) -> tuple[Performance, list[str], float]:
    """The performance, the messages, and how long it took, s."""
    said: list[str] = []
    clock, stream = VirtualClock(), live_stream(FakeSender(faults=list(faults)), performer or five())
    options = LiveOptions(patience=1.0, countdown=COUNTDOWN_S, person=person, recalibrate=recalibrate)
    found = begin_live(stream, options, clock=clock, rate_hz=100.0, where=WHERE, notify=said.append)
    return found, said, clock.now()


def alone(*names: str) -> SenderFault:
    def fault(time: float, poses: Poses) -> Poses:
        return {name: poses[name] for name in names}

    return fault


def origin(performance: Performance) -> FloatArray:
    assert isinstance(performance.samples, LivePerformer)
    return performance.samples.alignment.origin


def test_a_person_measured_once_is_known_in_another_place() -> None:
    first, said, took = begun()
    assert said[-1] == f"kept for --person anna: {person_path('anna')}"
    kept = read_person("anna")
    assert kept is not None and kept.sensors == tuple(five().sensors)
    again, known, faster = begun(placed(1.2, (3.0, -2.0, 0.4)))
    np.testing.assert_allclose(again.dimensions.offset, first.dimensions.offset, atol=5.1e-5)
    assert "anna, measured on" in known[-1] and faster < took - 0.9 * (CAPTURE_S - KNOWN_CAPTURE_S)
    assert isinstance(again.samples, LivePerformer) and isinstance(first.samples, LivePerformer)
    one, other = (found.samples.sample(0) for found in (first, again))
    assert one is not None and other is not None
    np.testing.assert_allclose(one.position, other.position, atol=0.005)
    assert origin(again)[2] - origin(first)[2] == pytest.approx(0.4, abs=0.003)


def test_a_size_without_a_name_is_not_kept() -> None:
    begun(person=None)
    assert not person_path("anna").parent.exists()


def test_measured_anew_where_it_is_asked() -> None:
    write_person(person_of("anna", proportional_dimensions(1.72), sensors=("head",), date="2020-01-01"))
    found, said, _ = begun(recalibrate=True)
    kept = read_person("anna")
    assert kept is not None and kept.date > "2020-01-01" and any(text.startswith("measured: ") for text in said)
    assert kept.stature == pytest.approx(found.dimensions.stature, abs=1e-4)
    assert person_path("anna").with_suffix(".previous.yaml").exists()


@pytest.mark.parametrize("stature", [1.4, 2.1])
def test_another_person_is_refused(stature: float) -> None:
    write_person(person_of("anna", proportional_dimensions(stature), sensors=("head",), date="2020-01-01"))
    with refuses(InputError, "--recalibrate"):
        begun()


def test_an_invalid_file_is_refused_before_the_stream_is_waited_for() -> None:
    path = write_person(person_of("anna", proportional_dimensions(1.7), sensors=("head",), date="2020-01-01"))
    path.write_text(path.read_text().replace("layout: 1", "layout: 7"))
    clock = VirtualClock()
    with refuses(ConfigError):
        begin_live(
            live_stream(FakeSender(), five()),
            LiveOptions(person="anna"),
            clock=clock,
            rate_hz=100.0,
            where=WHERE,
            notify=lambda text: None,
        )
    assert clock.now() == 0.0


def test_without_ankles_the_floor_is_as_far_below_the_head_as_the_person_is_tall() -> None:
    three, worn = load_performer("three"), alone("head", "l_wrist", "r_wrist")
    begun(worn, performer=three)
    found, _, _ = begun(worn, placed(0.0, (0.0, 0.0, 0.06)), performer=three)
    assert origin(found)[2] == pytest.approx(0.06, abs=0.004)
    with refuses(InputError):
        begun(worn, placed(0.0, (0.0, 0.0, 0.5)), performer=three)


def test_a_known_size_is_reported_as_such() -> None:
    said: list[str] = []
    clock, stream = VirtualClock(), live_stream(FakeSender(), five())
    size = proportional_dimensions(1.72)
    options = LiveOptions(patience=1.0, countdown=COUNTDOWN_S)
    found = Beginning(stream=stream, options=options, clock=clock, where=WHERE, notify=said.append).measure(size)
    assert found.dimensions is size
    assert said[-1] == f"known: 1.72 m tall ({size.origin})"


def test_a_stream_that_falls_silent_is_the_reason_and_no_tracker_is() -> None:
    said: list[str] = []
    clock, stream = VirtualClock(), live_stream(FakeSender(faults=[silent(0.5, 99.0)]), five())
    for tick in range(40):
        stream.poll(0.01 * tick, moving=False)
    clock.advance(0.4)
    options = LiveOptions(patience=2.0, countdown=COUNTDOWN_S)
    with refuses(InputError):
        Beginning(stream=stream, options=options, clock=clock, where=WHERE, notify=said.append).measure(None)
    assert sum("nothing has arrived for 1.0 s" in text for text in said) == 1


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


def test_no_performer_waits_for_a_sensor_that_is_never_sent() -> None:
    """A partial performer begins at once; a sensor that was sent and is lost is waited for."""

    took = [begun(lost("l_toe", since, 1e9), person=None, performer=load_performer("all"))[2] for since in (0.0, 0.1)]
    assert took[0] < begun(person=None, performer=load_performer("all"))[2] + 0.1
    assert took[1] > took[0] + 0.5
