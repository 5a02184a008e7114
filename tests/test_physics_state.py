"""States: what contacts, IMU and ground truth say of a robot that stands, hangs and is pushed."""

import numpy as np
import pytest

from physics_rig import PhysicsRig
from sim.physics.mount import Mount, Support
from sim.physics.perturbation import Perturbation, Push


def settled(**options: object) -> PhysicsRig:
    rig = PhysicsRig(**options)  # type: ignore[arg-type]
    rig.arm()
    rig.run(1.5)
    return rig


def test_at_rest_the_imu_feels_gravity_and_the_pressure_is_below_the_mass() -> None:
    rig = settled()
    state = rig.bus.witness.state
    assert np.linalg.norm(state.accelerometer) == pytest.approx(9.81, rel=1e-2)
    assert state.accelerometer[2] == pytest.approx(9.81, rel=1e-2)
    assert np.abs(state.gyro).max() < 0.02
    assert state.zmp.tolist() == pytest.approx(state.com[:2].tolist(), abs=1.5e-3)
    assert state.com[2] == pytest.approx(0.257, abs=0.005)
    assert state.tilt.max() < 2e-3 and not state.touching and not state.fixture_contacts
    assert state.sole[:, 2].tolist() == pytest.approx([0.0, 0.0], abs=5e-4)


def test_pushed_the_pressure_moves_against_and_the_gyro_turns() -> None:
    rig = settled(perturbation=Perturbation(pushes=(Push((4.0, 0.0, 0.0), 1.5, 0.1),)))
    before = rig.bus.witness.state.zmp[0]
    rig.run(0.1)
    assert rig.bus.witness.state.zmp[0] > before + 0.005  # a push forward loads the toes
    assert rig.bus.witness.log.column("com")[-1, 0] > rig.bus.witness.log.column("com")[-12, 0]


def test_in_free_fall_the_imu_feels_nothing_and_looking_twice_changes_nothing() -> None:
    rig = settled(mount=Mount(Support.GANTRY, hook="neck", rope=0.3))
    rig.bus.simulation._model.tendon_range[:, 1] = 9.0  # the rope is cut
    rig.run(0.08)
    once = rig.bus.witness.state.accelerometer
    assert np.linalg.norm(once) < 1.0  # straps and air
    rig.bus.read()
    assert rig.bus.witness.state.accelerometer.tolist() == once.tolist()


def test_before_it_is_let_go_nobody_knows_its_pressure() -> None:
    rig = PhysicsRig()
    rig.arm()
    rig.run(0.1)
    assert np.isnan(rig.bus.witness.state.zmp).all()


def test_on_a_stand_nothing_carries_and_the_imu_still_feels_gravity() -> None:
    rig = settled(mount=Mount(Support.STAND))
    state = rig.bus.witness.state
    assert np.isnan(state.zmp).all() and not state.load.any()
    assert np.linalg.norm(state.accelerometer) == pytest.approx(9.81)


def test_what_lies_touches_the_floor() -> None:
    rig = settled()
    rig.bus.torque(False)
    rig.run(1.5)
    assert rig.bus.witness.state.touching
