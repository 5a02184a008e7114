"""When a robot has fallen, and when it only sits."""

from dataclasses import replace

import numpy as np

from physics_rig import PhysicsRig, op3
from sim.physics.fall import FallWatch
from sim.physics.state import PhysicsState
from support.messages import shows

STANDING = PhysicsRig().bus.witness.state


def judged(state: PhysicsState) -> str | None:
    watch = FallWatch(op3())
    watch.look(state, powered=True)
    return None if watch.fall is None else watch.fall.how


def tipped(*degrees: float) -> PhysicsState:
    """Standing, each sole tipped by so much."""
    return replace(STANDING, tilt=np.radians(degrees))


def test_it_stands_at_first() -> None:
    assert judged(STANDING) is None


def test_soles_that_all_tip_beyond_thirty_degrees_are_a_fall() -> None:
    assert judged(tipped(28.0, 28.0)) is None
    how = judged(tipped(32.0, 35.0))
    assert how is not None
    shows(how, 32)


def test_a_sole_that_is_flat_carries_however_low_the_torso_bends() -> None:
    assert judged(tipped(0.0, 80.0)) is None


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
