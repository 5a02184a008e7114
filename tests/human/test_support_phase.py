"""Which feet carry, from two ankles: made steps, jumps and noise, and what people did in recordings."""

from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import people
from people import reconstruct
from retarget.human.support_phase import LIFT_DWELL_S, SHARE_SETTLE_S, CarryingFeet, PhaseShares
from retarget.model.human_dimensions import POINTS
from retarget.schema.priorities import Phased, load_priorities
from retarget.sources.open import open_source
from retarget.types import Carrying, FloatArray

RATE = 125.0
ANKLE_M = 0.08
BOTH, LEFT, RIGHT, FLIGHT = Carrying.BOTH, Carrying.LEFT, Carrying.RIGHT, Carrying.FLIGHT
MIRRORED = {BOTH: BOTH, LEFT: RIGHT, RIGHT: LEFT, FLIGHT: FLIGHT}

Height = Callable[[FloatArray], FloatArray]


def phases(ankles: FloatArray, rate: float = RATE) -> list[Carrying]:
    """Of ankles (T, 2, 3) m."""
    feet, rows = CarryingFeet(), ankles.tolist()
    return [feet.start(rows[0]), *(feet.step(row, 1.0 / rate) for row in rows[1:])]


def changes(phases_found: Sequence[Carrying]) -> list[Carrying]:
    return [one for one, _ in groupby(phases_found)]


def standing(
    seconds: float, *, rate: float = RATE, left: Height | None = None, right: Height | None = None
) -> FloatArray:
    """Ankles (T, 2, 3) of who stands, with heights (T,) above that over time (T,) s."""
    time = np.arange(round(seconds * rate)) / rate
    ankles = np.zeros((time.size, 2, 3))
    ankles[:, 0, 1], ankles[:, 1, 1] = 0.1, -0.1
    for foot, height in ((0, left), (1, right)):
        ankles[:, foot, 2] = ANKLE_M + (0.0 if height is None else height(time))
    return ankles


def lifted(high: float, start: float, end: float, *, ramp: float = 0.2) -> Height:
    """A foot that is `high` m up from `start` to `end` s."""
    return lambda time: high * np.clip(np.minimum((time - start) / ramp, (end - time) / ramp), 0.0, 1.0)


@settings(max_examples=10)
@given(seed=st.integers(0, 1000), noise=st.floats(0.0, 0.003), drift=st.floats(-0.02, 0.02))
def test_a_person_on_a_noisy_floor_that_drifts_stands_on_both(seed: int, noise: float, drift: float) -> None:
    ankles = standing(4.0)
    ankles += np.random.default_rng(seed).normal(0.0, noise, ankles.shape)
    ankles[..., 2] += drift * np.arange(len(ankles))[:, None] / RATE
    assert changes(phases(ankles)) == [BOTH]


@settings(max_examples=10)
@given(high=st.floats(0.1, 0.5), lasts=st.floats(0.8, 5.0), rate=st.sampled_from([40.0, 60.0, 125.0, 240.0]))
def test_a_foot_that_is_lifted_leaves_and_comes_back(high: float, lasts: float, rate: float) -> None:
    up = lifted(high, 1.0, 1.0 + lasts)
    phases_found = phases(standing(2.5 + lasts, rate=rate, right=up), rate)
    assert changes(phases_found) == [BOTH, LEFT, BOTH]
    alone = np.flatnonzero(np.array([one is LEFT for one in phases_found])) / rate
    assert 1.0 <= alone[0] < 1.2 + 2 * LIFT_DWELL_S + 1.0 / rate
    assert alone[-1] < 1.0 + lasts + 0.2


@settings(max_examples=10)
@given(seed=st.integers(0, 1000))
def test_left_and_right_are_alike(seed: int) -> None:
    """Whatever feet do."""
    random = np.random.default_rng(seed)
    way = np.cumsum(np.cumsum(random.normal(0.0, 4e-4, (400, 2, 3)), axis=0), axis=0)
    way[..., 2] = np.abs(way[..., 2])
    mirrored = way[:, ::-1] * np.array([1.0, -1.0, 1.0])
    phases_found, other = phases(way), phases(np.ascontiguousarray(mirrored))
    same = [MIRRORED[a] is b for a, b in zip(phases_found, other, strict=True)]
    assert np.mean(same) > 0.99  # feet that leave in one tick leave one after the other


def test_a_lift_of_less_than_the_dwell_time_is_no_phase() -> None:
    """Higher than a lifted foot for 48 ms, and no faster than a planted one."""

    def bump(time: FloatArray) -> FloatArray:
        return np.asarray(0.062 * np.sin(np.pi * np.clip((time - 1.0) / 0.3, 0.0, 1.0)))

    ankles = standing(2.0, right=bump)
    assert 0.04 < (ankles[:, 1, 2] - ankles[:, 0, 2] > 0.06).sum() / RATE < LIFT_DWELL_S
    assert changes(phases(ankles)) == [BOTH]


def test_a_jump_is_flight_and_tiptoe_is_not() -> None:
    jump = lambda time: np.maximum(0.3 - 4.905 * (time - 1.25) ** 2, 0.0)  # noqa: E731
    phases_found = changes(phases(standing(3.0, left=jump, right=jump)))
    assert FLIGHT in phases_found and phases_found[0] is phases_found[-1] is BOTH
    toes = lifted(0.08, 1.0, 3.0, ramp=0.3)
    assert changes(phases(standing(4.0, left=toes, right=toes))) == [BOTH]


def recorded(path: Path) -> list[Carrying]:
    frames = open_source(path)
    frames = frames.resample(np.arange(0.0, frames.duration_s, 1.0 / RATE))
    return phases(np.ascontiguousarray(frames.position[:, [frames.index("l_ankle"), frames.index("r_ankle")]]))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("02_05", [BOTH]),
        ("02_10", [BOTH]),
        ("49_18", [LEFT]),
        ("02_06", [BOTH, LEFT, BOTH]),
        ("02_01", [BOTH, LEFT, BOTH, RIGHT, BOTH, LEFT, BOTH, RIGHT, BOTH, LEFT]),
    ],
)
def test_recorded_people_stay_in_place_or_walk_without_flight(
    shared: Path, name: str, expected: list[Carrying]
) -> None:
    assert changes(recorded(shared / "mocap" / "cmu_asfamc" / f"{name}.amc")) == expected


def test_a_vertical_jump_is_one_flight(shared: Path) -> None:
    phases_found = changes(recorded(shared / "mocap" / "cmu_asfamc" / "02_04.amc"))
    assert phases_found.count(FLIGHT) == 1


@settings(max_examples=30)
@given(
    spells=st.lists(st.tuples(st.sampled_from(Carrying), st.floats(0.0, 0.3)), min_size=1, max_size=12),
    rate=st.sampled_from((50.0, 125.0, 500.0)),
)
def test_shares_of_phases_sum_to_one_and_neither_they_nor_their_speed_jump(
    spells: list[tuple[Carrying, float]], rate: float
) -> None:
    shares, dt = PhaseShares(), 1.0 / rate
    found = [dict(shares.now)]
    for carrying, seconds in spells:
        found += [dict(shares.step(carrying, dt)) for _ in range(round(seconds * rate))]
    rows = np.array([list(one.values()) for one in found])
    assert rows.min() >= 0.0
    np.testing.assert_allclose(rows.sum(axis=1), 1.0, atol=1e-12)
    # Two low-passes of one step: its speed is at most 1 / (e T), its acceleration 1 / T^2; products of two feet add.
    assert np.abs(np.diff(rows, axis=0)).max(initial=0.0) <= 2.0 * dt / (np.e * SHARE_SETTLE_S)
    speeds = np.diff(rows, axis=0) / dt
    assert np.abs(np.diff(speeds, axis=0)).max(initial=0.0) <= 2.0 * (1.0 + 2.0 / np.e**2) * dt / SHARE_SETTLE_S**2


@pytest.mark.parametrize("carrying", list(Carrying))
def test_a_phase_that_stays_is_soon_all_there_is(carrying: Carrying) -> None:
    shares = PhaseShares()
    for _ in range(round(0.5 * RATE)):
        shares.step(carrying, 1.0 / RATE)
    name = {BOTH: "double"}.get(carrying, carrying.value)
    assert dict(shares.now)[name] > 0.999  # type: ignore[index]


def test_toes_hang_in_a_jog_and_no_joint_centre_jumps_where_feet_land_or_leave(shared: Path) -> None:
    """Beside the same priorities whose tasks act in all phases."""
    frames, phased = people.trial(shared, "02_03"), load_priorities("human")
    levels = tuple(
        level.model_copy(
            update={
                "tasks": tuple(
                    task.model_copy(update={"when": None}) if isinstance(task, Phased) else task for task in level.tasks
                )
            }
        )
        for level in phased.levels
    )
    fixed = phased.model_copy(update={"levels": levels})
    assert frames.joints is not None
    toes = [POINTS.index("l_toe"), POINTS.index("r_toe")]
    truth = np.stack([frames.joints.of("l_toe"), frames.joints.of("r_toe")], axis=1)
    off, largest = [], []
    for priorities in (phased, fixed):
        run = reconstruct(frames, priorities)
        off.append(np.linalg.norm(run.joints[:, toes] - truth, axis=-1).mean())
        largest.append(np.linalg.norm(np.diff(run.joints, 2, axis=0), axis=-1).max())
    assert off[0] < 0.75 * off[1]
    assert largest[0] < largest[1] + 0.002
