"""Roles of senders: complete, unambiguous, and right in the T-pose and with an offset."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from retarget.errors import UsageError
from retarget.frames import SENSORS, mirrored_name
from retarget.rotations import from_axis_angle, multiply, rotate
from retarget.sources.vmc_names import BONES
from retarget.sources.vmc_roles import ROLE_SETS, Role, RoleSet, canonical_orientation, joint_position, role_set
from support.messages import refuses


@pytest.mark.parametrize("roles", ROLE_SETS.values(), ids=ROLE_SETS)
def test_each_sensor_has_one_source(roles: RoleSet) -> None:
    names = [role.name for role in roles.roles]
    assert len(set(names)) == len(names) and all(roles.role(name) is not None for name in names)
    for told in ([r.point for r in roles.roles if r.point], [r.segment for r in roles.roles if r.segment]):
        assert len(set(told)) == len(told) and set(told) <= set(SENSORS)
        assert {mirrored_name(sensor) for sensor in told} == set(told)
    assert roles.role("nobody") is None


def test_sides_are_where_names_say() -> None:
    checked = 0
    for role in (*role_set("slimevr").roles, *role_set("unity_bones").roles):
        for word, side in (("left", "l_"), ("right", "r_")):
            if word in role.name.lower():
                assert role.point.startswith(side) and role.segment.startswith(side)
                checked += 1
    assert checked == 22


def test_ids_of_slimevr_over_vrchat() -> None:
    points = {role.name.removeprefix("tracker://"): role.point for role in role_set("slimevr_vrchat").roles}
    middle = {"head": "head", "6": "chest", "1": "pelvis"}
    left = {"2": "l_ankle", "4": "l_knee", "7": "l_elbow"}
    assert points == {**middle, **left, "3": "r_ankle", "5": "r_knee", "8": "r_elbow"}


def test_all_slimevr_roles_are_there() -> None:
    paired = {f"human://{s}_{p}" for s in ("LEFT", "RIGHT") for p in ("KNEE", "FOOT", "ELBOW", "HAND")}
    assert {r.name for r in role_set("slimevr").roles} == paired | {"human://HEAD", "human://CHEST", "human://WAIST"}
    knee = role_set("slimevr").role("human://LEFT_KNEE")
    assert knee is not None and (knee.point, knee.segment) == ("l_knee", "l_hip")


def test_bones_are_unitys() -> None:
    bones = role_set("unity_bones")
    assert bones.local and {role.name.removeprefix("bone://") for role in bones.roles} <= set(BONES)
    assert {role.segment for role in bones.roles} - {""} == set(SENSORS)


def test_a_hanging_arm_is_turned_from_the_t_pose() -> None:
    """Told the identity, the left arm hangs: its canonical orientation takes sideward (the T-pose) to down."""
    for name, side in (("human://LEFT_ELBOW", 1.0), ("human://RIGHT_HAND", -1.0)):
        role = role_set("slimevr").role(name)
        assert role is not None
        hanging = canonical_orientation(role, np.array([1.0, 0.0, 0.0, 0.0]))
        assert_allclose(rotate(hanging, [0.0, side, 0.0]), [0.0, 0.0, -1.0], atol=1e-12)
        assert_allclose(canonical_orientation(role, np.array(role.rest)), [1.0, 0.0, 0.0, 0.0], atol=1e-12)


def test_a_turn_of_the_body_stays_on_the_left() -> None:
    role = role_set("slimevr").role("human://LEFT_ELBOW")
    assert role is not None
    yaw = from_axis_angle((0.0, 0.0, 1.0), 0.7)
    assert_allclose(canonical_orientation(role, multiply(yaw, role.rest)), yaw, atol=1e-12)


def test_an_offset_turns_with_the_sender() -> None:
    role = Role("a", "l_wrist", "l_wrist", offset=(0.13, 0.0, 0.0))
    raised = from_axis_angle((0.0, 1.0, 0.0), -0.5 * np.pi)  # forward becomes up
    assert_allclose(joint_position(role, np.array([1.0, 2.0, 3.0]), raised), [1.0, 2.0, 2.87])
    bare = Role("a", "head", "")
    assert_allclose(joint_position(bare, np.ones(3), np.full(4, np.nan)), np.ones(3))


def test_unknown_roles_name_the_nearest() -> None:
    with refuses(UsageError, "slimevr_vrchat"):
        role_set("slimevr_vrchatt", where="performer.yaml")
