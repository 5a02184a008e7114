"""The limits within which a robot follows."""

import numpy as np

from followers import op3
from retarget.following_limits import BENT, following_limits
from retarget.stance import plant


def test_they_are_those_of_the_servos_but_for_limbs_that_stay_bent() -> None:
    body, servos = op3().body, op3().limits
    limits = following_limits(op3(), plant(op3(), op3().profile.postures.stand))
    drawn_in = {}
    for index, joint in enumerate(op3().joint_map.joints):
        dof = body.dof_index(joint)
        assert limits.max_velocity[dof] == servos.max_velocity[index]
        assert limits.max_acceleration[dof] == servos.max_acceleration[index]
        if (limits.lower[dof], limits.upper[dof]) != (servos.lower[index], servos.upper[index]):
            drawn_in[joint] = (limits.lower[dof], limits.upper[dof])
    assert set(drawn_in) == {"l_knee", "r_knee", "l_el", "r_el"}
    assert abs(drawn_in["l_knee"][0] - BENT) < 0.06 and abs(drawn_in["r_knee"][1] + BENT) < 0.06
    assert drawn_in["l_el"][1] < -BENT / 2 and drawn_in["r_el"][0] > BENT / 2


def test_a_free_root_has_none() -> None:
    limits = following_limits(op3(), plant(op3(), op3().profile.postures.stand))
    assert np.isinf(limits.max_velocity[:6]).all() and np.isinf(limits.max_acceleration[:6]).all()


def test_the_standing_posture_is_inside() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    limits = following_limits(op3(), stance)
    single, address = op3().body.scalar_joints()
    q = stance.q[address[single]]
    assert (q >= limits.lower[single]).all() and (q <= limits.upper[single]).all()
