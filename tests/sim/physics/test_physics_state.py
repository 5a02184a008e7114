"""States: what contacts and ground truth say of a robot that stands, hangs and is pushed."""

import numpy as np
import pytest

from physics_rig import PhysicsRig, op3
from sim.physics.ground import sole_corners
from sim.physics.perturbation import Perturbation, Push


def settled(**options: object) -> PhysicsRig:
    rig = PhysicsRig(**options)  # type: ignore[arg-type]
    rig.arm()
    rig.run(1.5)
    return rig


def test_a_standing_robot_bears_on_its_corners_below_its_mass_and_a_lying_one_touches_the_floor() -> None:
    rig = settled()
    state = rig.bus.witness.state
    assert state.zmp.tolist() == pytest.approx(state.com[:2].tolist(), abs=1.5e-3)
    assert state.com[2] == pytest.approx(0.257, abs=0.005)
    assert state.tilt.max() < 2e-3 and not state.touching and not state.fixture_contacts
    assert state.sole[:, 2].tolist() == pytest.approx([0.0, 0.0], abs=5e-4)
    soles = np.array(rig.bus.witness._reader.corner_soles)
    assert soles.tolist() == [0] * 6 + [1] * 6
    for sole, foot in enumerate(op3().profile.feet.values()):
        corners = state.corner[soles == sole] - state.sole[sole, :2]
        outline = sole_corners(np.array(foot.polygon))
        assert np.abs(np.sort(corners, axis=0) - np.sort(outline, axis=0)).max() < 2e-3
        assert state.pressed[soles == sole].sum() == pytest.approx(state.load[sole])
    assert (state.pressed >= 0.0).all() and state.load.sum() == pytest.approx(30.9, rel=0.02)
    rig.bus.torque(False)
    rig.run(1.5)
    assert rig.bus.witness.state.touching in op3().body.body_names


def test_pushed_the_pressure_moves_against() -> None:
    rig = settled(perturbation=Perturbation(pushes=(Push((4.0, 0.0, 0.0), 1.5, 0.1),)))
    before = rig.bus.witness.state.zmp[0]
    rig.run(0.1)
    assert rig.bus.witness.state.zmp[0] > before + 0.005  # a push forward loads the toes
    assert rig.bus.witness.log.column("com")[-1, 0] > rig.bus.witness.log.column("com")[-12, 0]


def test_a_foot_that_rocks_on_its_edge_does_not_slip() -> None:
    push = Push((0.0, 5.5, 0.0), 1.5, 0.12, "neck")
    rig = settled(perturbation=Perturbation(friction=1.5, pushes=(push,)))
    rig.run(0.4)
    log = rig.bus.witness.log
    assert log.worst_tilt > np.radians(1.0)
    assert log.slip_m.max() < 3e-4
    rocked = log.column("sole")[:, :, 2].max()
    assert rocked > 5e-4  # [m] a foot came up
