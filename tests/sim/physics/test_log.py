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


def test_the_first_fall_stays() -> None:
    rig = PhysicsRig()
    rig.arm()
    witness = rig.bus.witness
    for time in (1.0, 2.0):
        witness._judge(replace(STANDING, time=time, touching="l_shin"))
    assert witness.fall is not None and witness.fall.time == 1.0 and witness.fall.powered


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


def test_a_sole_that_turns_on_its_spot_slips() -> None:
    one = log()
    for turn in np.linspace(0.0, 0.3, 301):
        one.add(at(0.0, turn=float(turn)))
    assert one.slip_m[0] == pytest.approx(0.3 * float(np.hypot(0.06, 0.04)), rel=0.02)


def test_what_turns_about_a_corner_that_carries_slips_only_by_the_others() -> None:
    one, two = log(), log()
    for turn in np.linspace(0.0, 0.3, 301):
        there = CORNERS[0] @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        for each, on in ((one, (1.0, 0.0, 0.0, 0.0)), (two, (0.5, 0.5, 0.0, 0.0))):
            state = at(0.0, turn=float(turn), on=on)
            each.add(replace(state, corner=state.corner + CORNERS[0] - there))
    assert one.slip_m[0] == 0.0
    assert two.slip_m[0] == pytest.approx(0.3 * 0.12 * 0.5, rel=0.02)


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
    for tick in range(1, 11):
        one.add(replace(at(0.002 * tick, load=(0.0, 15.0), tilt=0.5), time=0.008 * tick))
    one.add(replace(at(0.05, load=(15.0, 15.0)), time=0.088))
    assert one.slip_m[0] == 0.0 and one.slip_m[1] == pytest.approx(0.05)
    assert one.worst_tilt == 0.0  # a sole in the air does not count


def test_a_sole_that_trembles_as_it_slides_has_not_been_lifted() -> None:
    one = log()
    for tick in range(101):
        load = 15.0 * (tick % 4 == 0)
        one.add(replace(at(1e-4 * tick, load=(load, load)), time=0.008 * tick))
    assert one.slip_m.tolist() == pytest.approx([0.01, 0.01], rel=0.05)


def test_extremes_are_kept() -> None:
    one = log()
    one.add(at(0.0, tilt=0.03))
    one.add(replace(at(0.0), temperature=np.full(20, 40.0), self_contacts=2))
    one.add(at(0.0))
    assert one.worst_tilt == 0.03 and one.hottest[0] == 40.0
    assert one.self_contact_ticks == 1


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
