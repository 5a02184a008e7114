"""One number per degree of freedom, by name."""

from retarget.errors import ConfigError
from retarget.human import build_human
from retarget.human_dimensions import proportional_dimensions
from retarget.joint_weights import joint_weights
from support.messages import refuses


def test_from_the_whole_body_to_one_axis() -> None:
    body = build_human(proportional_dimensions(1.7)).body
    values = [("hip", 2.0), ("l_hip", 3.0), ("hip_rotation", 4.0), ("r_hip_rotation", 5.0)]
    by_name = dict(zip(body.dof_names, joint_weights(body, values, default=1.0), strict=True))
    assert by_name["l_hip_flexion"] == 3.0 and by_name["r_hip_flexion"] == 2.0
    assert by_name["l_hip_rotation"] == 4.0 and by_name["r_hip_rotation"] == 5.0
    assert by_name["l_knee_flexion"] == 1.0
    assert [by_name[f"root_{axis}"] for axis in ("x", "y", "z", "rx", "ry", "rz")] == [0.0] * 6


def test_a_free_root_counts_only_when_named() -> None:
    body = build_human(proportional_dimensions(1.7)).body
    assert list(joint_weights(body, [("root", 7.0), ("root_z", 8.0)], default=1.0)[:6]) == [7, 7, 8, 7, 7, 7]


def test_unknown_names_are_refused() -> None:
    with refuses(ConfigError):
        joint_weights(build_human(proportional_dimensions(1.7)).body, [("l_nkee", 1.0)], default=1.0)
