"""The log: sums and rows."""

from dataclasses import replace

import numpy as np
import pytest

from hardware.arrays import FloatArray
from physics_rig import PhysicsRig
from sim.physics.log import BLOCK_ROWS, SLIP_RESOLUTION_M, PhysicsLog
from sim.physics.state import PhysicsState

STATE = PhysicsRig().bus.witness.state


def log() -> PhysicsLog:
    return PhysicsLog(servos=20, soles=2, nq=STATE.q.size, loaded=lambda load: np.asarray(load > 1.0))


def at(x: float, load: tuple[float, float] = (15.0, 15.0), tilt: float = 0.0) -> PhysicsState:
    sole: FloatArray = STATE.sole.copy()
    sole[:, 0] += x
    return replace(STATE, sole=sole, load=np.array(load), tilt=np.array([tilt, 0.0]))


def test_slip_is_the_way_of_a_sole_that_carries() -> None:
    one = log()
    for x in np.linspace(0.0, 0.01, 101):
        one.add(at(float(x), load=(15.0, 0.0)))
    assert one.slip_m[0] == pytest.approx(0.01, abs=2 * SLIP_RESOLUTION_M)
    assert one.slip_m[1] == 0.0


def test_a_creep_adds_up_and_a_tremble_does_not() -> None:
    creeping, trembling = log(), log()
    for tick in range(1000):
        creeping.add(at(1e-5 * tick))
        trembling.add(at(4e-5 * (-1) ** tick))
    assert creeping.slip_m[0] == pytest.approx(0.01, rel=0.03)
    assert trembling.slip_m[0] == 0.0


def test_a_step_is_no_slip() -> None:
    one = log()
    one.add(at(0.0))
    one.add(at(0.02, load=(0.0, 15.0), tilt=0.5))
    one.add(at(0.05, load=(15.0, 15.0)))
    assert one.slip_m[0] == 0.0 and one.slip_m[1] == pytest.approx(0.05)
    assert one.worst_tilt == 0.0  # of a sole in the air nobody asks


def test_extremes_are_kept() -> None:
    one = log()
    one.add(at(0.0, tilt=0.03))
    torque = np.zeros(20)
    torque[4] = -2.0
    one.add(replace(at(0.0), torque=torque, temperature=np.full(20, 40.0), self_contacts=2))
    one.add(at(0.0))
    assert one.worst_tilt == 0.03 and one.most_torque[4] == 2.0 and one.hottest[0] == 40.0
    assert one.self_contact_ticks == 1


def test_rows_hold_what_was_added_however_many() -> None:
    one = log()
    for tick in range(BLOCK_ROWS + 3):
        one.add(replace(STATE, time=float(tick)))
    assert one.rows == BLOCK_ROWS + 3
    assert one.column("time").tolist() == [float(tick) for tick in range(BLOCK_ROWS + 3)]
    assert one.column("q")[-1] == pytest.approx(STATE.q, abs=1e-6)
    assert one.column("sole").shape == (one.rows, 2, 3)
    assert one.column("sole")[7] == pytest.approx(STATE.sole, abs=1e-6)
    assert one.column("torque").shape == (one.rows, 20)


def test_a_log_without_rows_has_columns() -> None:
    one = log()
    assert one.column("time").shape == (0,) and one.column("torque").shape == (0, 20)
    assert one.column("sole").shape[0] == 0
