"""Jump detection in samples that come at known times: what jumps is taken out, and a person's motion is untouched."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from retarget.frames import SensorFrames, SensorSample
from retarget.human.pose_validation import LIMITS, JumpDetection, without_jumps
from retarget.human.samples import Playback, lay_on_ticks
from retarget.schema.performer import load_performer
from retarget.sources.open import open_source
from sim.performer import synthetic_performer

RATE_HZ = 120.0
TOGETHER = ("head", "l_wrist", "r_wrist")
AWAY = np.array([[0.5, 0.8, 0.2], [-1.0, 0.5, 0.7], [0.8, -0.8, 0.5]])
RECORDINGS = (
    "cmu_asfamc/*.amc",
    "cmu_bvh_hahne/*.bvh",
    "cmu_bvh_daz/*.bvh",
    "cmu_c3d/*.c3d",
    "other/*.bvh",
    "other/*.c3d",
)


@cache
def sane() -> SensorFrames:
    return synthetic_performer(rate_hz=RATE_HZ).select(tuple(load_performer("five").sensors))


def jumping(first: float, last: float) -> SensorFrames:
    """Wrists and head are elsewhere together from `first` to before `last`, s."""
    frames = sane()
    position, rows = frames.position.copy(), (frames.time >= first) & (frames.time < last)
    position[:, [frames.index(name) for name in TOGETHER]] += np.where(rows[:, None, None], AWAY, 0.0)
    return replace(frames, position=position)


def test_a_sensor_that_jumps_stays_where_it_was_and_then_is_not_valid_until_it_is_back() -> None:
    found, time = without_jumps(jumping(2.0, 2.4)), sane().time
    columns = [sane().index(name) for name in TOGETHER]
    others = [column for column in range(len(sane().names)) if column not in columns]
    before, after = time < 2.0, time >= 2.4
    stays = (time >= 2.0) & (time < 2.0 + LIMITS.stale_after - 1.5 / RATE_HZ)
    gone = (time >= 2.0 + LIMITS.stale_after) & ~after
    assert found.valid[:, others].all() and np.array_equal(found.position[:, others], sane().position[:, others])
    assert np.array_equal(found.position[before | after], sane().position[before | after])
    assert found.valid[before | after | stays].all() and gone.any() and not found.valid[gone][:, columns].any()
    held = found.position[stays][:, columns]
    assert (held == sane().position[before][-1, columns]).all()


def test_a_sensor_that_stays_where_it_jumped_to_is_accepted_there() -> None:
    found, time = without_jumps(jumping(2.0, 9.0)), sane().time
    settled = (time >= 2.0 + LIMITS.settled_after + 1.5 / RATE_HZ) & (time < 9.0)
    assert found.valid[settled].all() and np.array_equal(found.position[settled], jumping(2.0, 9.0).position[settled])


def test_a_sensor_that_the_recording_has_lost_may_come_back_anywhere_later() -> None:
    frames = jumping(3.0, 20.0)
    valid = frames.valid.copy()
    valid[(frames.time >= 2.5) & (frames.time < 3.0)] = False
    position = np.where(valid[..., None], frames.position, np.nan)
    lost = replace(frames, position=position, valid=valid)
    assert without_jumps(lost) is lost


def test_turns_alone_and_any_place_are_no_jump() -> None:
    jumps, first = JumpDetection(("head",)), np.array([[500.0, -300.0, 40.0]])
    for tick in range(50):
        turn = np.array([[1.0, 0.0, 0.0, 0.0] if tick % 2 else [0.0, 1.0, 0.0, 0.0]])
        sample = SensorSample(("head",), first + 0.01 * tick, turn, np.ones(1, dtype=bool))
        assert jumps.step(0.01 * tick, sample) is sample and not jumps.jumped.any()


@pytest.mark.parametrize("speed", [0.5, 1.0])
@pytest.mark.parametrize("loop", [False, True])
def test_a_clip_says_which_sensors_have_jumped(speed: float, loop: bool) -> None:
    five = load_performer("five")
    playback = Playback(speed=speed, end=4.0, loop=loop)
    clip = lay_on_ticks(jumping(2.0, 2.4), performer=five, playback=playback, rate_hz=100.0)
    jumped = np.array([clip.jumped(tick) for tick in range(len(clip.frames))])
    assert not (jumped & clip.frames.valid).any()
    ticks = np.flatnonzero(jumped.any(axis=1)) * clip.motion_dt
    assert 2.13 <= ticks.min() <= 2.16 and 2.38 <= ticks.max() <= 2.41
    assert set(clip.names_of_jumped) == set(TOGETHER)
    unmoved = lay_on_ticks(sane(), performer=five, playback=playback, rate_hz=100.0)
    assert unmoved.with_jumps is None and unmoved.names_of_jumped == () and not unmoved.jumped(3).any()


def is_sane(path: Path) -> bool:
    frames = open_source(path)
    # Another skeleton's jump of 0.7 m in a frame (79 m/s) is in the file of 01_07 at 28 s.
    frames = frames.cut(0.0, 28.0 if path.stem == "01_07" else None)
    five = tuple(name for name in load_performer("five").sensors if name in frames.names)
    if len(five) < 5:
        return without_jumps(frames) is frames
    clips = [
        lay_on_ticks(frames, performer=load_performer("five"), playback=Playback(speed=speed)) for speed in (0.5, 1.0)
    ]
    return all(clip.with_jumps is None for clip in clips)


def test_real_motion_is_untouched(shared: Path) -> None:
    for name in ("cmu_asfamc/02_06.amc", "cmu_asfamc/05_13.amc", "cmu_bvh_hahne/49_06.bvh", "other/bvh_test1.bvh"):
        assert is_sane(shared / "mocap" / name), name


@pytest.mark.long
def test_every_recording_is_untouched(shared: Path) -> None:
    for path in sorted(path for pattern in RECORDINGS for path in (shared / "mocap").glob(pattern)):
        assert is_sane(path), path.name
