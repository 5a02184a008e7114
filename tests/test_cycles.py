"""Room for cycles: every array has a row per cycle, of the width that a run has."""

from dataclasses import fields

import numpy as np

from retarget.recording.cycles import READINGS, Asked, Cycles, Shape

SHAPE = Shape(sensors=2, servos=3, rest=7, human=5, joints=4, landmarks=6, observers=1, human_observers=0)


def test_every_array_has_a_row_per_cycle() -> None:
    cycles = Cycles.empty(9, SHAPE)
    assert len(cycles) == 9
    assert {len(getattr(cycles, one.name)) for one in fields(cycles)} == {9}
    assert cycles.position.shape == cycles.goal.shape == cycles.q.shape == (9, 3)
    assert cycles.rest.shape == (9, 7) and cycles.landmarks.shape == (9, 6, 3) and cycles.clock.shape == (9, READINGS)
    assert cycles.sensor_orientation.shape == (9, 2, 4) and cycles.human_observer_modes.shape == (9, 0)


def test_kinds_are_those_that_are_declared() -> None:
    cycles = Cycles.empty(1, SHAPE)
    assert cycles.goal.dtype == np.int64 and cycles.kept.dtype == np.bool_ and cycles.readings.dtype == np.uint8
    assert cycles.clock.dtype == np.float64 and cycles.phase.dtype == np.int8


def test_rows_that_are_taken_are_copies() -> None:
    cycles = Cycles.empty(4, SHAPE)
    cycles.index[:] = [0, 1, 2, 3]
    taken = cycles.taken(np.array([2, 0]))
    cycles.index[:] = 9
    assert taken.index.tolist() == [2, 0] and len(taken) == 2


def test_what_is_asked_is_a_bit_each() -> None:
    bits = [int(one) for one in Asked]
    assert sorted(bits) == [1 << place for place in range(len(bits))]
