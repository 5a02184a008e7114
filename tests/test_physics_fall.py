"""When a robot has fallen, and when it only sits."""

from dataclasses import replace

import numpy as np
import pytest

from physics_rig import PhysicsRig, op3
from retarget import rotations
from sim.physics.fall import FallWatch
from sim.physics.state import PhysicsState

STANDING = PhysicsRig().bus.witness.state


def judged(state: PhysicsState) -> str | None:
    watch = FallWatch(op3())
    watch.look(state, powered=True)
    return None if watch.fall is None else watch.fall.how


def tilted(degrees: float, axis: tuple[float, float, float]) -> PhysicsState:
    root = STANDING.root.copy()
    turn = rotations.from_axis_angle(np.array(axis), np.array(np.radians(degrees)))
    root[3:7] = rotations.multiply(turn, root[3:7])
    root[2] = 0.4
    return replace(STANDING, root=root)


def test_it_stands_at_first() -> None:
    assert judged(STANDING) is None


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, 0.8, 0.0), (0.0, -1.0, 0.0)])
def test_tilt_fells_beyond_sixty_degrees(axis: tuple[float, float, float]) -> None:
    assert judged(tilted(58.0, axis)) is None
    how = judged(tilted(62.0, axis))
    assert how is not None and "62 degrees" in how


def test_turning_about_the_vertical_is_no_fall() -> None:
    assert judged(tilted(170.0, (0.0, 0.0, 1.0))) is None


def test_a_low_pelvis_is_a_fall_and_a_squat_is_none() -> None:
    watch = FallWatch(op3())
    root = STANDING.root.copy()
    assert 0.06 < watch.lowest < 0.13
    root[2] = watch.lowest + 0.0285 + 1e-3  # the pelvis frame is 28.5 mm below the root
    assert judged(replace(STANDING, root=root)) is None
    root[2] -= 2e-3
    how = judged(replace(STANDING, root=root))
    assert how is not None and "pelvis" in how


def test_touching_the_floor_with_more_than_soles_is_a_fall_unless_it_is_parked() -> None:
    how = judged(replace(STANDING, touching=True))
    assert how is not None and "soles" in how
    parked = op3().posture(op3().profile.postures.rest)
    assert judged(replace(STANDING, touching=True, q=parked)) is None


def test_the_first_fall_stays() -> None:
    watch = FallWatch(op3())
    watch.look(replace(STANDING, time=1.0, touching=True), powered=True)
    watch.look(replace(STANDING, time=2.0, touching=True), powered=False)
    assert watch.fall is not None and watch.fall.time == 1.0 and watch.fall.powered
