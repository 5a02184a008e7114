"""Postures stay inside the ranges, reach their corners, and a profile's limits come before the body's."""

import numpy as np

from retarget.body import load_body_text
from retarget.errors import ConfigError
from retarget.fitting.ranges import joint_ranges
from support.messages import refuses

BODY = load_body_text(
    """<mujoco><compiler angle="radian"/><worldbody><body name="base"><freejoint/><geom size="1"/>
    <body name="a"><joint name="a" range="-1 2"/><geom size="1"/>
    <body name="b"><joint name="b"/><geom size="1"/>
    <body name="c"><joint name="c" type="ball"/><geom size="1"/>
    <body name="d"><joint name="d" type="slide" range="0.1 0.2"/><geom size="1"/></body></body></body></body>
    </body></worldbody></mujoco>""",
    source="test",
)


def test_samples_stay_inside_and_reach_the_corners() -> None:
    ranges = joint_ranges(BODY, {})
    q = ranges.sample(np.random.default_rng(0), 400)
    scalar = q[:, ranges.address]
    assert (scalar >= ranges.lower).all() and (scalar <= ranges.upper).all()
    corner = np.isin(scalar, [*ranges.lower, *ranges.upper]).all(axis=1)
    assert corner.sum() >= 100
    assert len(np.unique(scalar[:, 0])) > 200
    assert np.allclose(np.linalg.norm(q[:, 9:13], axis=1), 1.0)
    assert (q[:, :7] == BODY.qpos0[:7]).all()


def test_limits_of_the_servos_come_first() -> None:
    ranges = joint_ranges(BODY, {"a": (0.0, 0.5)})
    assert (ranges.lower[0], ranges.upper[0]) == (0.0, 0.5)
    assert ranges.clipped(np.full(BODY.nq, 9.0))[7] == 0.5
    with refuses(ConfigError):
        joint_ranges(BODY, {"z": (0.0, 1.0)})


def test_a_joint_without_limits_is_told() -> None:
    ranges = joint_ranges(BODY, {})
    assert ranges.notes == ("joint b has no limits, -3.14 to 3.14 rad was looked at",)
    assert not joint_ranges(BODY, {"b": (0.0, 1.0)}).notes
