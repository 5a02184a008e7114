"""The summary of a run: margins of the pressure, and the sums of the log."""

import numpy as np
import pytest

from physics_rig import PhysicsRig, op3
from retarget.stance import plant
from retarget.support import support_distance
from sim.physics.mount import Mount, Support
from sim.physics.perturbation import Perturbation, Push
from sim.physics.summary import physics_summary, zmp_margins


def test_a_standing_robot_has_the_margin_of_its_centre_of_mass() -> None:
    rig = PhysicsRig()
    rig.arm()
    rig.run(1.5)
    witness = rig.bus.witness
    summary = physics_summary(witness)
    margins = zmp_margins(op3(), witness.log, least_load=1.0)
    assert np.isnan(margins[0]) and len(margins) == witness.log.rows  # the hand
    edges = plant(op3(), op3().profile.postures.stand).edges(0.0)
    assert margins[-1] == pytest.approx(float(support_distance(witness.state.com, edges)), abs=4e-3)
    assert 0.02 < summary.zmp_margin <= margins[-1] + 1e-3
    assert summary.fall is None and summary.slip_m < 5e-4 and summary.tilt < 0.01
    assert summary.torque[op3().joint_map.joints.index("l_knee")] > 0.3
    assert summary.temperature.min() >= 25.0 and summary.self_contacts == 0


def test_a_push_costs_margin_and_a_fall_is_told() -> None:
    rig = PhysicsRig(perturbation=Perturbation(pushes=(Push((12.0, 0.0, 0.0), 1.2, 0.2),)))
    rig.arm()
    rig.run(2.2)
    summary = physics_summary(rig.bus.witness)
    assert summary.zmp_margin < 0.01
    assert summary.fall is not None and summary.tilt > 0.1


def test_what_hangs_has_no_margin() -> None:
    rig = PhysicsRig(mount=Mount(Support.STAND))
    rig.arm()
    rig.run(0.1)
    summary = physics_summary(rig.bus.witness)
    assert np.isnan(summary.zmp_margin) and summary.slip_m == 0.0
