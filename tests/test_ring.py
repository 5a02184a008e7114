"""The queue between the tick and the disk: in order, bounded, never waiting unless it may."""

import threading

import numpy as np

from retarget.recording.cycles import Cycles, Done, Shape
from retarget.recording.ring import Ring

SHAPE = Shape(sensors=2, servos=3, rest=7, human=5, joints=4, landmarks=2, observers=1, human_observers=0)


def fill(ring: Ring, count: int) -> None:
    for _ in range(count):
        ring.rows.goal[ring.at] = ring.index
        ring.rows.written[ring.at] = Done.WELL
        ring.turn()


def test_rows_come_out_in_order_and_once() -> None:
    ring = Ring(SHAPE, rows=8)
    seen: list[int] = []
    for count in (3, 0, 5, 7, 1, 6):
        fill(ring, count)
        taken = ring.take()
        assert len(taken) == count
        np.testing.assert_array_equal(taken.goal[:, 0], taken.index)
        seen += taken.index.tolist()
    assert seen == list(range(22)) and ring.lost == 0


def test_what_there_is_no_room_for_is_counted_and_missing() -> None:
    ring = Ring(SHAPE, rows=8)
    fill(ring, 20)
    assert ring.take().index.tolist() == list(range(7)) and ring.lost == 13
    fill(ring, 2)
    assert ring.take().index.tolist() == [20, 21]


def test_a_new_row_is_as_if_nothing_had_happened() -> None:
    ring = Ring(SHAPE, rows=4)
    for _ in range(9):
        ring.rows.kept[ring.at], ring.rows.read[ring.at] = True, Done.FAILED
        ring.rows.asked[ring.at] = 63
        ring.turn()
        ring.take()
        at = ring.at
        assert not ring.rows.kept[at] and ring.rows.read[at] == ring.rows.asked[at] == 0


def test_rows_that_were_taken_do_not_change() -> None:
    ring = Ring(SHAPE, rows=4)
    fill(ring, 2)
    taken = ring.take()
    fill(ring, 2)
    ring.take()
    assert taken.goal[:, 0].tolist() == [0, 1]


def test_who_may_wait_loses_nothing() -> None:
    ring = Ring(SHAPE, patient=True, rows=8)
    seen: list[int] = []

    def takes() -> None:
        while len(seen) < 500:
            ring.wanted.wait(5.0)
            ring.wanted.clear()
            seen.extend(ring.take().index.tolist())

    taker = threading.Thread(target=takes, daemon=True)
    taker.start()
    fill(ring, 500)
    ring.wanted.set()
    taker.join(10.0)
    assert seen == list(range(500)) and ring.lost == 0


def test_nobody_waits_for_a_disk_that_is_gone() -> None:
    ring = Ring(SHAPE, patient=True, rows=4)
    ring.close()
    fill(ring, 10)
    assert ring.lost == 7


def test_every_array_has_a_row_per_cycle() -> None:
    cycles = Cycles.empty(5, SHAPE)
    assert len(cycles) == 5 and cycles.sensor_orientation.shape == (5, 2, 4) and cycles.cost.shape == (5, 3)
    assert len(cycles.taken(np.array([1, 3]))) == 2
    assert cycles.valid.dtype == np.bool_ and cycles.goal.dtype == np.int64 and cycles.phase.dtype == np.int8
