"""Sensors that are lost, come back or jump: what is asked of the body stays continuous."""

import numpy as np
import pytest

from retarget.frames import BoolArray
from retarget.sensor_intake import IntakeTimes, SensorIntake

DT = 1.0 / 120.0
HERE = np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0]])
NOWHERE = np.full((2, 3), np.nan)
TIMES = IntakeTimes()


def valid(*flags: bool) -> BoolArray:
    return np.array(flags)


def started() -> SensorIntake:
    intake = SensorIntake(2)
    intake.start(HERE, valid(True, True))
    return intake


def test_ordinary_motion_passes_unchanged() -> None:
    intake = started()
    for k in range(50):
        position = HERE + 0.02 * k  # 4 m/s
        intake.step(position, valid(True, True), reached=HERE, dt=DT)
        assert (intake.position == position).all()


def test_a_leap_becomes_an_offset_that_fades() -> None:
    intake = started()
    there = HERE + np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]])
    steps, before = [], intake.position.copy()
    for _ in range(round(8 * TIMES.fade / DT)):
        intake.step(there, valid(True, True), reached=HERE, dt=DT)
        steps.append(np.abs(intake.position - before).max())
        before = intake.position.copy()
    assert max(steps) <= 0.5 * DT / TIMES.fade + 1e-9
    assert intake.position == pytest.approx(there, abs=1e-3)
    assert intake.measured == pytest.approx(there)


def test_a_short_loss_is_bridged_and_a_long_one_frees_the_body() -> None:
    intake = started()
    lost = np.where([[False], [True]], NOWHERE, HERE)
    ticks = 0
    while intake.present[1]:
        intake.step(lost, valid(True, False), reached=HERE, dt=DT)
        assert intake.present[0] and np.isfinite(intake.position).all()
        ticks += 1
    assert ticks * DT == pytest.approx(TIMES.hold, abs=2 * DT)
    reached = HERE + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.3]])  # the free hand sank
    intake.step(HERE, valid(True, True), reached=reached, dt=DT)
    assert intake.present.all()
    assert np.abs(intake.position[1] - reached[1]).max() < 0.3 * DT / TIMES.fade + 1e-9


def test_a_sensor_missing_from_the_start_comes_in_from_where_the_body_has_it() -> None:
    intake = SensorIntake(2)
    intake.start(np.where([[False], [True]], NOWHERE, HERE), valid(True, False))
    assert list(intake.present) == [True, False] and np.isfinite(intake.position).all()
    reached = HERE - 0.2
    intake.step(HERE, valid(True, True), reached=reached, dt=DT)
    assert np.abs(intake.position[1] - reached[1]).max() < 0.02
