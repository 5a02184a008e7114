"""A second of standing still: size, floor, heading; and what is refused, by name."""

import numpy as np
import pytest

from people import at_rest
from retarget.errors import InputError
from retarget.frames import SensorSample
from retarget.human_dimensions import proportional_dimensions
from retarget.live.rest_capture import CAPTURE_S, Calibrated, RestCapture
from retarget.rotations import FloatArray
from support.messages import refuses

NAMES = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle", "pelvis")
PERSON = proportional_dimensions(1.75)
STANDING = at_rest(PERSON, 0.1, turn=0.9)
WHERE = "vmc://:39539"


def sample(position: FloatArray, *, lost: tuple[str, ...] = ()) -> SensorSample:
    valid = np.array([name not in lost for name in NAMES])
    return SensorSample(NAMES, np.where(valid[:, None], position, np.nan), np.full((len(NAMES), 4), np.nan), valid)


def captured(*, lost: tuple[str, ...] = (), sway: float = 0.004, wave: float = 0.0) -> Calibrated:
    noise = np.random.default_rng(5)
    capture = RestCapture(where=WHERE)
    base = np.array([STANDING[name] for name in NAMES])
    for tick in range(150):
        if capture.done:
            break
        position = base + noise.normal(0.0, sway / 3, base.shape)
        position[1, 2] += wave * tick / 150
        capture.take(0.01 * tick, sample(position, lost=lost))
    assert capture.done and 0.01 * tick == pytest.approx(CAPTURE_S, abs=0.02)
    return capture.result()


def test_whoever_stands_still_is_measured_and_faces_x() -> None:
    found = captured()
    assert found.dimensions.stature == pytest.approx(1.75, abs=0.03)
    assert found.missing == ()
    at = dict(zip(found.sensors, found.position, strict=True))
    across = at["l_wrist"] - at["r_wrist"]
    assert across[1] > 0.3 and abs(across[0]) < 0.02
    assert at["l_ankle"][2] == pytest.approx(STANDING["l_ankle"][2], abs=0.015)
    np.testing.assert_allclose(np.mean([at["l_ankle"], at["r_ankle"]], axis=0)[:2], 0.0, atol=1e-6)


def test_a_sensor_that_is_not_fresh_is_named_and_missing_where_it_can_be() -> None:
    assert captured(lost=("pelvis",)).missing == ("pelvis",)
    with refuses(InputError, found="l_wrist"):
        captured(lost=("l_wrist",))


def test_whoever_moves_is_told_with_what() -> None:
    with refuses(InputError, found="l_wrist"):
        captured(wave=0.5)


def test_without_data_there_is_nothing_to_calibrate() -> None:
    with refuses(InputError, WHERE):
        RestCapture(where=WHERE).result()


def test_whoever_lies_down_is_refused() -> None:
    capture = RestCapture(where=WHERE)
    base = np.array([STANDING[name] for name in NAMES])[:, [2, 1, 0]]
    for tick in range(150):
        capture.take(0.01 * tick, sample(base))
    with refuses(InputError):
        capture.result()


def taken(standing: dict[str, FloatArray]) -> Calibrated:
    capture = RestCapture(where=WHERE)
    base = np.array([standing[name] for name in NAMES])
    for tick in range(150):
        capture.take(0.01 * tick, sample(base))
    return capture.result()


@pytest.mark.parametrize("raised", ["l_wrist", "r_wrist"])
def test_one_arm_out_and_the_other_hanging_is_no_rest_pose(raised: str) -> None:
    out = at_rest(PERSON, np.pi / 2, turn=0.9)
    with refuses(InputError):
        taken(STANDING | {raised: out[raised]})
    assert taken(out).dimensions.stature == pytest.approx(1.75, abs=0.04)


@pytest.mark.parametrize(("stature", "fits"), [(1.05, False), (1.3, True), (2.1, True), (2.4, False)])
def test_a_stature_of_nobody_who_stands_is_refused(stature: float, fits: bool) -> None:
    standing = at_rest(proportional_dimensions(stature), 0.1, turn=0.9)
    if fits:
        assert taken(standing).dimensions.stature == pytest.approx(stature, abs=0.04)
        return
    with refuses(InputError, allowed=("1.2", "2.2")):
        taken(standing)
