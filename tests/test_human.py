"""The virtual human: degrees of freedom, mass, symmetry, frames, postures and weights."""

import time

import numpy as np
import pytest
from numpy.testing import assert_allclose

from people import place
from retarget.errors import ConfigError
from retarget.frames import JOINTS, SENSORS
from retarget.human import Human, build_human
from retarget.human_dimensions import POINTS, proportional_dimensions
from support.messages import refuses


@pytest.fixture(scope="module")
def human() -> Human:
    return build_human(proportional_dimensions(1.75))


def test_two_readings_share_one_body(human: Human) -> None:
    other = build_human(proportional_dimensions(1.75), reading="A")
    assert human.mjcf == other.mjcf and human.body.nv == 57 and human.body.root == "free"
    assert (human.degrees_of_freedom, other.degrees_of_freedom) == (51, 57)
    assert human.locked.sum() == 6 and not human.locked[:6].any()


def test_the_rest_posture_has_the_dimensions(human: Human) -> None:
    points = place(human, human.body.qpos0, POINTS)
    assert_allclose(points - points[0], human.dimensions.standing(), atol=1e-9)
    soles = place(human, human.body.qpos0, ["l_sole", "r_sole"])
    assert_allclose(soles[:, 2], 0.0, atol=1e-9)


def test_every_canonical_name_is_a_frame(human: Human) -> None:
    for name in (*SENSORS, *JOINTS, "l_sole", "r_sole"):
        assert human.body.frame(name).name == name


def test_mass_and_centre_of_mass(human: Human) -> None:
    assert human.body.total_mass == pytest.approx(human.dimensions.mass, abs=1e-5)
    com = human.body.solver_body().centre_of_mass(human.body.qpos0[None])[0]
    assert com[1] == pytest.approx(0.0, abs=1e-9)
    # Standing people have it near 0.55 to 0.58 of stature.
    assert 0.55 < com[2] / 1.75 < 0.585


def test_the_body_is_symmetric(human: Human) -> None:
    rng = np.random.default_rng(5)
    left, right = human.body.qpos0.copy(), human.body.qpos0.copy()
    for i, name in enumerate(human.body.dof_names[6:], start=7):
        if name.startswith("l_"):
            angle = rng.uniform(-0.3, 0.3)
            left[i] = angle
            right[7 + human.body.dof_names[6:].index("r_" + name[2:])] = angle
    one, other = place(human, left, POINTS), place(human, right, POINTS)
    swap = [POINTS.index({"l_": "r_", "r_": "l_"}.get(n[:2], n[:2]) + n[2:]) for n in POINTS]
    assert_allclose(one, other[swap] * [1, -1, 1], atol=1e-9)
    for name in human.body.dof_names:
        if name.startswith("l_"):
            pair = [human.body.dof_index(name), human.body.dof_index("r_" + name[2:])]
            assert human.body.lower[pair[0]] == human.body.lower[pair[1]]
            assert human.body.upper[pair[0]] == human.body.upper[pair[1]]


def test_postures_are_named_in_errors(human: Human) -> None:
    with refuses(ConfigError):
        human.posture("atractor")
    with refuses(ConfigError, "l_knee_flexion"):
        human.posture_from([("l_knee_flexin", 3.0)])
    with refuses(ConfigError, 0, 135):
        human.posture_from([("knee_flexion", -5.0)])


def test_weights_by_dof_motion_joint_and_pair(human: Human) -> None:
    weights = human.weights(
        [("spine", 20.0), ("collar", 10.0), ("knee_flexion", 0.5), ("l_knee_flexion", 0.7), ("root", 0.0)], default=1.0
    )
    by_name = dict(zip(human.body.dof_names, weights, strict=True))
    assert by_name["spine_lateral"] == 20.0 and by_name["r_collar_tilt"] == 10.0
    assert by_name["r_knee_flexion"] == 0.5 and by_name["l_knee_flexion"] == 0.7 and by_name["root_rx"] == 0.0
    assert by_name["neck_rotation"] == 1.0
    with refuses(ConfigError, "collar"):
        human.weights([("colar", 1.0)], default=1.0)


def test_building_is_quick(human: Human) -> None:
    start = time.process_time()
    build_human(human.dimensions)
    assert time.process_time() - start < 0.2
