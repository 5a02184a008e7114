"""Sensors that are lost, come back or jump: the goals of the body stay continuous."""

import re

import numpy as np
import pytest

from messages import refuses
from retarget import rotations
from retarget.errors import UsageError
from retarget.frames import SensorFrames
from retarget.human.samples import LOOP_LIMIT_S, SEAM_S, Clip, Playback, lay_on_ticks
from retarget.human.sensor_intake import DOUBT_S, SLOW_INTAKE, IntakeTimes, Reach, SensorIntake, without_spikes
from retarget.model.human_dimensions import proportional_dimensions
from retarget.rotations import from_axis_angle
from retarget.schema.performer import load_performer
from retarget.types import BoolArray, FloatArray
from sim.performer import synthetic_performer

NAMES = ("head", "l_wrist", "l_ankle")


def test_far_sensors_come_back_along_their_line_to_the_head() -> None:
    reach = Reach(NAMES, NAMES, proportional_dimensions(1.75))
    position = np.array([[0.0, 0.0, 1.6], [3.0, 0.0, 1.6], [0.0, 0.1, 0.1]])
    reach.clamp(position, np.ones(3, dtype=bool))
    assert 0.7 < position[1, 0] < 1.1 and position[1, 1:] == pytest.approx([0.0, 1.6])
    assert position[2] == pytest.approx([0.0, 0.1, 0.1])


DT = 1.0 / 120.0
HERE = np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0]])
SIDE_JUMP = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]])
NOWHERE = np.full((2, 3), np.nan)
UNTURNED = np.full((2, 4), np.nan)
TIMES = IntakeTimes()


def valid(*flags: bool) -> BoolArray:
    return np.array(flags)


def started(turns: FloatArray = UNTURNED, times: IntakeTimes = TIMES) -> SensorIntake:
    intake = SensorIntake(2, times)
    intake.start(HERE, turns, valid(True, True))
    return intake


def resumed(times: IntakeTimes = SLOW_INTAKE, *, turns: FloatArray = UNTURNED, speed: float = 1.0) -> SensorIntake:
    """After a hold."""
    intake = started(turns, times)
    intake.resume(speed)
    return intake


def test_ordinary_motion_passes_unchanged() -> None:
    intake = started()
    for k in range(50):
        position = HERE + 0.02 * k  # 4 m/s
        intake.step(position, UNTURNED, valid(True, True), reached=HERE, dt=DT)
        assert (intake.position == position).all()


def test_a_jump_that_stays_is_followed_slowly() -> None:
    intake, there = started(), HERE + SIDE_JUMP
    steps, before = [], intake.position.copy()
    for _ in range(round((DOUBT_S + 8 * TIMES.fade) / DT)):
        intake.step(there, UNTURNED, valid(True, True), reached=HERE, dt=DT)
        steps.append(np.abs(intake.position - before).max())
        before = intake.position.copy()
    assert max(steps) <= 0.5 * DT / TIMES.fade + 1e-9
    assert intake.position == pytest.approx(there, abs=1e-3)
    assert intake.measured == pytest.approx(there)


@pytest.mark.parametrize("ticks", [1, 3, 12])
def test_a_jump_that_comes_back_is_not_followed(ticks: int) -> None:
    intake = started()
    for k in range(60):
        at = HERE + np.array([1.5 * DT * k, 0.0, 0.0])  # [m] 1.5 m/s
        intake.step(at + SIDE_JUMP * (10 <= k < 10 + ticks), UNTURNED, valid(True, True), reached=HERE, dt=DT)
        assert np.abs(intake.position - at).max() <= 1.5 * DT * (ticks + 1) + 1e-9
    assert intake.position == pytest.approx(at, abs=1e-3)


@pytest.mark.parametrize("lost", [9, 12], ids=["before it", "in it"])
def test_a_jump_beside_a_lost_sample_is_not_followed(lost: int) -> None:
    """As an optical system loses a marker, and then takes another for it."""
    intake = started()
    for k in range(60):
        at = HERE + SIDE_JUMP * (10 <= k < 22)
        known = k != lost
        intake.step(np.where([[True], [known]], at, NOWHERE), UNTURNED, valid(True, known), reached=HERE, dt=DT)
        assert np.abs(intake.position - HERE).max() < 0.01


def test_the_return_of_a_jump_that_was_followed_is_followed_at_once() -> None:
    intake, there = started(), HERE + SIDE_JUMP
    for at in [HERE] + 60 * [there] + 24 * [HERE] + 60 * [there]:
        intake.step(at, UNTURNED, valid(True, True), reached=HERE, dt=DT)
        if at is HERE:
            assert (intake.measured == HERE).all()
    assert (intake.measured == there).all()


def test_a_short_loss_is_bridged_and_a_long_one_frees_the_body() -> None:
    intake = started()
    lost = np.where([[False], [True]], NOWHERE, HERE)
    ticks = 0
    while intake.present[1]:
        intake.step(lost, UNTURNED, valid(True, False), reached=HERE, dt=DT)
        assert intake.present[0] and np.isfinite(intake.position).all()
        ticks += 1
    assert ticks * DT == pytest.approx(TIMES.hold, abs=2 * DT)
    sunk = HERE + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.3]])
    intake.step(HERE, UNTURNED, valid(True, True), reached=sunk, dt=DT)
    assert intake.present.all()
    assert np.abs(intake.position[1] - sunk[1]).max() < 0.3 * DT / TIMES.fade + 1e-9


def test_a_sensor_missing_from_the_start_comes_in_from_where_the_body_has_it() -> None:
    intake = SensorIntake(2)
    intake.start(np.where([[False], [True]], NOWHERE, HERE), UNTURNED, valid(True, False))
    assert list(intake.present) == [True, False] and np.isfinite(intake.position).all()
    intake.step(HERE, UNTURNED, valid(True, True), reached=HERE - 0.2, dt=DT)
    assert np.abs(intake.position[1] - (HERE[1] - 0.2)).max() < 0.2 * DT / TIMES.fade + 1e-9


def came_back(times: IntakeTimes, *, far: float, hold: bool = False) -> FloatArray:
    """Lost, while the body lets it sink by `far` m, and back; or all of them after a hold: its goals."""
    intake, sunk, goals = started(times=times), HERE - np.array([[0.0, 0.0, 0.0], [0.0, 0.0, far]]), []
    lost = np.where([[False], [True]], NOWHERE, HERE)
    for _ in range(0 if hold else 100):
        intake.step(lost, UNTURNED, valid(True, False), reached=sunk, dt=DT)
    if hold:
        intake.resume()
    for _ in range(1400):
        intake.step(HERE, UNTURNED, valid(True, True), reached=sunk, dt=DT)
        goals.append(intake.position[1, 2])
        assert (intake.position[0] == HERE[0]).all() and intake.present.all()
        assert intake.away == pytest.approx(HERE[1, 2] - goals[-1], abs=1e-5)
    assert intake.away == 0.0
    return np.array(goals)


@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize(("times", "far"), [(SLOW_INTAKE, 0.05), (SLOW_INTAKE, 0.2), (SLOW_INTAKE, 1.0), (TIMES, 0.2)])
def test_a_sensor_that_comes_back_starts_where_the_body_has_it_and_is_slow(
    times: IntakeTimes, far: float, hold: bool
) -> None:
    goals, times = came_back(times, far=far, hold=hold), SLOW_INTAKE if hold else times
    fastest = min(times.speed, far / times.fade) * DT + 1e-9
    steps = np.diff(goals)
    assert goals[0] == pytest.approx(HERE[1, 2] - far, abs=fastest)
    assert (steps >= 0.0).all() and steps.max() <= fastest
    elapsed = np.count_nonzero(goals < HERE[1, 2] - 0.01) * DT
    assert far / times.speed <= elapsed + times.fade <= far / times.speed + 5.0 * times.fade


def about_z(angle: float) -> FloatArray:
    return np.tile(from_axis_angle([0.0, 0.0, 1.0], angle), (2, 1))


@pytest.mark.parametrize("hold", [False, True])
def test_an_orientation_that_comes_back_begins_where_it_was_last(hold: bool) -> None:
    intake = started(about_z(0.3), SLOW_INTAKE)
    intake.step(HERE, about_z(0.3), valid(True, True), reached=HERE, dt=DT)
    assert (intake.orientation == about_z(0.3)).all()
    if hold:
        intake.resume()
    for _ in range(0 if hold else 30):
        intake.step(HERE, about_z(0.3), valid(False, True), reached=HERE, dt=DT)
        assert np.isnan(intake.orientation[0]).all() and (intake.orientation[1] == about_z(0.3)[1]).all()
    angles = [0.3]
    for _ in range(600):
        intake.step(HERE, about_z(1.3), valid(True, True), reached=HERE, dt=DT)
        angles.append(float(rotations.angle_between(about_z(0.0), intake.orientation)[0]))
    steps = np.diff(angles)
    assert (steps >= -1e-12).all() and steps.max() <= SLOW_INTAKE.turn * DT + 1e-9
    assert (intake.orientation == about_z(1.3)).all(), "it ends where the sensor is, to the bit"


def test_after_a_hold_no_distance_is_a_jump() -> None:
    """The performer has walked away meanwhile."""
    intake, there = resumed(), HERE + 3.0
    for tick in range(1, 3200):
        intake.step(there, UNTURNED, valid(True, True), reached=HERE, dt=DT)
        assert np.linalg.norm(intake.position - HERE, axis=1).max() <= SLOW_INTAKE.speed * DT * tick + 1e-9
    assert (intake.position == there).all()


def test_a_goal_waits_for_a_sensor_that_comes_to_it() -> None:
    """The body holds upright, and the performer rises from a squat: no goal is above either of them."""
    intake, low = resumed(), HERE - np.array([0.0, 0.0, 0.5])
    before = HERE
    for tick in range(300):
        risen = np.minimum(low + np.array([0.0, 0.0, 0.8 * DT * tick]), HERE)
        intake.step(risen, UNTURNED, valid(True, True), reached=HERE, dt=DT)
        assert (intake.position >= risen - 0.8 * DT).all() and (intake.position <= HERE + 0.8 * DT).all()
        assert np.abs(intake.position - before).max() <= (SLOW_INTAKE.speed + 0.8) * DT + 1e-9
        before = intake.position.copy()
    assert (before == HERE).all()


def test_goals_come_in_together() -> None:
    """One sensor is twice as far from its goal as the other, at all times."""
    intake = resumed()
    there = HERE + np.array([[0.2, 0.0, 0.0], [0.0, 0.4, 0.0]])
    for _ in range(60):
        intake.step(there, UNTURNED, valid(True, True), reached=HERE, dt=DT)
        near, far = np.linalg.norm(there - intake.position, axis=1)
        assert 2.0 * near == pytest.approx(far)
    assert far == pytest.approx(0.4 - 60 * SLOW_INTAKE.speed * DT)


def test_a_sensor_that_flickers_is_followed() -> None:
    """Every other frame is lost, as of a marker that is hidden now and then."""
    time = DT * np.arange(480)
    track = 0.3 * np.sin(np.pi * time)
    intake, away = started(), []
    for k, x in enumerate(track):
        at = HERE + np.array([[x, 0.0, 0.0], [0.0, 0.0, 0.0]])
        seen = k % 2 == 0
        sent = at if seen else np.where([[True], [False]], NOWHERE, at)
        intake.step(sent, UNTURNED, valid(seen, True), reached=intake.position, dt=DT)
        away.append(np.abs(intake.position[0] - at[0]).max())
    assert np.mean(away) < 0.15 * 0.3


# A recording on ticks: frames kept bit for bit where they fall on one, cuts, speed, loops, mirror, refusals.

FIVE = load_performer("five")


@pytest.fixture(scope="module")
def frames() -> SensorFrames:
    return synthetic_performer()


def lay(frames: SensorFrames, rate_hz: float | None = None, **playback: float | bool) -> Clip:
    return lay_on_ticks(frames, performer=FIVE, playback=Playback(**playback), rate_hz=rate_hz)  # type: ignore[arg-type]


def test_a_run_that_ends_early_played_fewer_frames(frames: SensorFrames) -> None:
    slow, loop = lay(frames, 125.0, speed=0.5), lay(frames, 125.0, loop=True)
    assert slow.frames_played(len(slow)) == len(frames) and slow.frames_played(0) == 0
    assert slow.frames_played(len(slow) // 4) == pytest.approx(len(frames) / 4, abs=1)
    assert loop.frames_played(3 * len(loop.frames)) == 3 * len(frames)


@pytest.mark.parametrize("loop", [False, True])
def test_a_motion_of_any_length_is_played_and_its_beginning_is_kept(
    frames: SensorFrames, monkeypatch: pytest.MonkeyPatch, loop: bool
) -> None:
    whole = lay(frames, 125.0, end=1.0, loop=loop)
    assert whole.kept == len(whole)
    monkeypatch.setattr("retarget.human.samples.MAX_KEPT", 50)
    clip, rounds = lay(frames, 125.0, end=1.0, loop=loop), len(whole.frames)
    assert len(clip) == len(whole) and clip.kept == len(clip.frames) == 50 < rounds
    for tick in {*range(rounds), *range(0, min(3 * rounds, len(clip)), 7)}:
        for name in ("position", "orientation", "valid"):
            np.testing.assert_array_equal(getattr(clip.sample(tick), name), getattr(whole.sample(tick), name))
    assert clip.frames_played(40) == whole.frames_played(40)


def test_mirror_exchanges_sides(frames: SensorFrames) -> None:
    plain, mirrored = lay(frames, 60.0), lay(frames, 60.0, mirror=True)
    left, right = plain.frames.index("l_wrist"), plain.frames.index("r_wrist")
    flip = np.array([1.0, -1.0, 1.0])
    np.testing.assert_array_equal(mirrored.frames.position[:, left], plain.frames.position[:, right] * flip)
    assert mirrored.frames.names == plain.frames.names


def test_a_loop_closes_without_a_jump(frames: SensorFrames) -> None:
    clip = lay(frames, 100.0, end=1.0, loop=True)
    period = len(clip.frames)
    assert len(clip) == round(LOOP_LIMIT_S * 100.0)
    assert period == pytest.approx((1.0 + SEAM_S) * 100.0, abs=1)
    np.testing.assert_array_equal(clip.sample(period + 3).position, clip.sample(3).position)
    track = clip.frames.position
    steps = np.linalg.norm(np.diff(np.concatenate([track, track[:1]]), axis=0), axis=-1)
    assert steps.max() < 0.05


def test_truth_is_reordered_and_unknown_joints_are_nan(frames: SensorFrames) -> None:
    clip = lay(frames, 60.0)
    truth = clip.truth(("neck", "unknown", "l_knee"), range(10))
    assert truth is not None and frames.joints is not None
    np.testing.assert_array_equal(truth[0, 2], frames.joints.of("l_knee")[0])
    assert np.isnan(truth[:, 1]).all()
    assert clip.truth(("unknown",), range(10)) is None


@pytest.mark.parametrize(
    "playback",
    [
        *({"speed": speed} for speed in (0.0, -1.0, float("nan"), 1e9)),
        *({"start": start} for start in (-1.0, float("inf"))),
        {"end": float("nan")},
        *({"start": start, "end": 1.0} for start in (2.0, 1.0)),
    ],
)
def test_impossible_playback_is_refused(playback: dict[str, float]) -> None:
    with refuses(UsageError, re.compile(r"--(speed|start|end)")):
        Playback(**playback)  # type: ignore[arg-type]


def test_what_the_recording_does_not_have_is_refused(frames: SensorFrames) -> None:
    with refuses(UsageError):
        lay(frames, start=500.0)
    with refuses(UsageError, "l_wrist"):
        lay(frames.select(["head", "r_wrist", "l_ankle", "r_ankle"]))
    with refuses(UsageError):
        lay(frames, 1e6)


@pytest.mark.parametrize("rate", [100.0, 120.0])
@pytest.mark.parametrize("speed", [6.0, 9.0])
@pytest.mark.parametrize("from_rest", [True, False])
def test_a_fast_sensor_that_drops_a_frame_is_followed_on(rate: float, speed: float, from_rest: bool) -> None:
    """A sensor gets as fast as a boxer's fist in 0.1 s, or is so from the first sample on, and one sample is lost."""
    time = np.arange(60) / rate
    way = speed * (np.maximum(time - 0.1, 0.0) + 5.0 * np.minimum(time, 0.1) ** 2 if from_rest else time)
    intake, off = SensorIntake(1), []
    for k, x in enumerate(way.tolist()):
        place, there = np.array([[x, 0.0, 1.0]]), np.array([k != 30])
        if k == 0:
            intake.start(place, np.full((1, 4), np.nan), there)
            continue
        seen, turns = np.where(there[:, None], place, np.nan), np.full((1, 4), np.nan)
        intake.step(seen, turns, there, reached=intake.position, dt=1.0 / rate)
        off.append(float(np.abs(intake.position - place).max()))
    assert max(off[:28]) < 1e-9  # nothing of it is taken for a spike
    assert max(off[28:]) < 2.0 * speed / rate and off[-1] < 0.02


@pytest.mark.parametrize("spike", [0.07, 0.2])
def test_a_spike_of_one_recorded_frame_is_put_between_its_neighbours(spike: float) -> None:
    time = np.arange(60) / 120.0
    way = np.stack([np.sin(6.0 * time), np.zeros(60), 1.0 + 0.3 * np.cos(9.0 * time)], axis=1)[:, None]
    faulty = way.copy()
    faulty[30, 0, 2] += spike
    assert np.abs(without_spikes(time, faulty) - way).max() < 0.002
    assert (without_spikes(time, way) == way).all()
    assert (without_spikes(time[:2], way[:2]) == way[:2]).all()


# Orientations, and sensors that come back one by one.


def about(intake: SensorIntake, turn: float, *, known: bool = True, seen: tuple[bool, bool] = (True, True)) -> float:
    """One tick: how far the goal of the first sensor is turned, rad."""
    turns = about_z(turn)
    if not known:
        turns[0] = np.nan
    intake.step(HERE, turns, valid(*seen), reached=HERE, dt=DT)
    return float(rotations.angle_between(about_z(0.0), intake.orientation)[0])


@pytest.mark.parametrize("lost", [0, 1, 200])
def test_an_orientation_that_jumps_or_comes_back_alone_turns_slowly(lost: int) -> None:
    intake = started(about_z(0.0), SLOW_INTAKE)
    for _ in range(lost):
        about(intake, 0.0, known=False)
    angles = [0.0] + [about(intake, 2.5) for _ in range(400)]
    assert max(np.diff(angles)) <= SLOW_INTAKE.turn * DT + 1e-9 and angles[-1] == pytest.approx(2.5, abs=1e-3)


def test_all_are_slow_after_a_hold_also_those_that_come_back_later() -> None:
    intake, there = resumed(TIMES), HERE + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.3]])
    intake.step(NOWHERE, UNTURNED, valid(False, False), reached=HERE, dt=DT)
    for _ in range(200):
        intake.step(there, UNTURNED, valid(True, False), reached=HERE, dt=DT)
    before = HERE
    for tick in range(900):
        intake.step(there, UNTURNED, valid(True, True), reached=HERE, dt=DT)
        assert tick == 0 or np.abs(intake.position - before).max() <= SLOW_INTAKE.speed * DT + 1e-9
        before = intake.position.copy()
    assert (before == there).all()
    intake.step(HERE, UNTURNED, valid(True, False), reached=HERE, dt=DT)  # a loss later on is as ever
    for _ in range(60):
        intake.step(HERE, UNTURNED, valid(True, True), reached=HERE, dt=DT)
    assert intake.away < 1e-3


def test_a_sensor_that_stays_away_holds_no_other_back() -> None:
    intake = resumed(turns=about_z(0.0))
    there = HERE + 0.1
    for _ in range(600):
        intake.step(there, about_z(1.0), valid(False, True), reached=HERE, dt=DT)
    assert intake.position[1] == pytest.approx(there[1], abs=1e-5) and intake.away < 1e-5


def test_slow_is_slow_in_real_time() -> None:
    """A recording that is played four times as fast."""
    intake, there = resumed(TIMES, speed=4.0), HERE + np.array([0.0, 0.0, 0.5])
    intake.step(there, UNTURNED, valid(True, True), reached=HERE, dt=4.0 * DT)
    assert np.abs(intake.position - HERE).max() == pytest.approx(SLOW_INTAKE.speed * DT)


def test_a_new_start_forgets_the_offsets() -> None:
    intake = resumed()
    intake.step(HERE + 0.5, UNTURNED, valid(True, True), reached=HERE, dt=DT)
    intake.start(HERE, UNTURNED, valid(True, True))
    intake.step(HERE, UNTURNED, valid(True, True), reached=HERE + 1.0, dt=DT)
    assert (intake.position == HERE).all() and intake.away == 0.0
