"""When a robot has fallen, and when it only sits."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hardware.arrays import FloatArray
from messages import shows
from physics_rig import PhysicsRig, op3
from sim.physics.log import BLOCK_ROWS, SLIP_RESOLUTION_M, FallWatch, PhysicsLog
from sim.physics.state import PhysicsState

STANDING = PhysicsRig().bus.witness.state
LOWEST = FallWatch(op3()).lowest + 0.0285  # m; the pelvis frame is 28.5 mm below the root
AT_REST = op3().posture(op3().profile.postures.rest)


def low(height: float) -> FloatArray:
    """The standing root at another height, m."""
    return np.array([*STANDING.root[:2], height, *STANDING.root[3:]])


@pytest.mark.parametrize(
    ("change", "fallen"),
    [
        ({}, False),
        ({"tilt": np.radians([28.0, 28.0])}, False),
        ({"tilt": np.radians([32.0, 35.0])}, True),
        ({"tilt": np.radians([0.0, 80.0])}, False),  # a flat sole carries, however low the torso bends
        ({"root": low(LOWEST + 1e-3)}, False),
        ({"root": low(LOWEST - 1e-3)}, True),
        ({"touching": "l_shin"}, True),
        ({"touching": "l_shin", "q": AT_REST}, False),
    ],
)
def test_what_is_a_fall(change: dict[str, Any], fallen: bool) -> None:
    how = FallWatch(op3()).look(replace(STANDING, **change))
    assert (how is not None) is fallen
    if how is not None:
        shows(how)
    assert 0.06 < LOWEST - 0.0285 < 0.13


CORNERS = np.array([[0.06, 0.04], [-0.06, 0.04], [-0.06, -0.04], [0.06, -0.04]])
"""Of a sole, m."""
BESIDE = np.array([0.0, 0.05])
"""From the middle to the left sole, m."""


def log() -> PhysicsLog:
    return PhysicsLog(
        servos=20, soles=2, corners=[0] * 4 + [1] * 4, nq=STANDING.q.size, loaded=lambda load: np.asarray(load > 1.0)
    )


def at(
    x: float,
    load: tuple[float, float] = (15.0, 15.0),
    tilt: float = 0.0,
    turn: float = 0.0,
    on: tuple[float, float, float, float] = (0.25, 0.25, 0.25, 0.25),
) -> PhysicsState:
    """Both soles x m ahead, turned on their spots by `turn` rad, with these shares of their load on their corners."""
    cos, sin = np.cos(turn), np.sin(turn)
    corners = CORNERS @ np.array([[cos, sin], [-sin, cos]]) + [x, 0.0]
    pressed = np.concatenate([share * np.array(on) for share in load])
    return replace(
        STANDING,
        corner=np.concatenate([corners + BESIDE, corners - BESIDE]),
        pressed=pressed,
        load=np.array(load),
        tilt=np.array([tilt, 0.0]),
    )


def test_slip_is_the_way_of_a_sole_that_carries_to_and_fro() -> None:
    one, two = log(), log()
    for x in np.linspace(0.0, 0.01, 101):
        one.add(at(float(x), load=(15.0, 0.0)))
    for x in (*np.linspace(0.0, 0.01, 51), *np.linspace(0.01, 0.0, 51)):
        two.add(at(float(x)))
    assert one.slip_m.tolist() == pytest.approx([0.01, 0.0], abs=2 * SLIP_RESOLUTION_M)
    assert two.slip_m.tolist() == pytest.approx([0.02, 0.02], abs=4 * SLIP_RESOLUTION_M)


def test_a_creep_adds_up_and_a_tremble_does_not() -> None:
    creeping, trembling = log(), log()
    for tick in range(1000):
        creeping.add(at(1e-5 * tick))
        trembling.add(at(4e-5 * (-1) ** tick))
    assert creeping.slip_m[0] == pytest.approx(0.01, rel=0.03)
    assert trembling.slip_m[0] == 0.0


def test_rows_hold_what_was_added_however_many() -> None:
    one = log()
    for tick in range(BLOCK_ROWS + 3):
        one.add(replace(STANDING, time=float(tick)))
    assert one.rows == BLOCK_ROWS + 3
    assert one.column("time").tolist() == [float(tick) for tick in range(BLOCK_ROWS + 3)]
    assert one.column("q")[-1] == pytest.approx(STANDING.q, abs=1e-6)
    assert one.column("sole").shape == (one.rows, 2, 3)
    assert one.column("sole")[7] == pytest.approx(STANDING.sole, abs=1e-6)
    assert one.column("torque").shape == (one.rows, 20)
    empty = log()
    assert [empty.column(name).shape for name in ("time", "torque", "sole")] == [(0,), (0, 20), (0, 2, 3)]
