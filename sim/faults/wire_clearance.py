"""Whether goals on the wires keep a robot clear of itself: its body file in MuJoCo, nothing of what the gate asks."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from retarget.body_file import compile_body
from retarget.metrics.clearance import Clearance, PlacedBody
from retarget.metrics.moving_geoms import moving_geoms
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from sim.faults.wire_checker import Track

DEEPEST_M = 2e-4
"""As deep, m, as goals rounded to ticks may be in a touch: a tick of 1.5 mrad at an arm of 0.2 m moves it 0.3 mm."""


@cache
def _model(path: str, root: str) -> Any:
    from pathlib import Path

    return compile_body(Path(path), root=root).model  # type: ignore[arg-type]


def postures_of(robot: RobotBody, ways: Sequence[Track]) -> FloatArray:
    """Postures (T, nq) of all goals, at the times of the first servo; the root as in the body file."""
    if not ways:
        return np.zeros((0, robot.body.nq))
    times = ways[0].times
    found = np.tile(robot.body.qpos0, (len(times), 1))
    columns = dict(zip(robot.joint_map.joints, robot.servo_columns, strict=True))
    for track in ways:
        rows = np.clip(np.searchsorted(track.times, times, side="right") - 1, 0, None)
        found[:, columns[track.servo.joint]] = track.angle[rows]
    return found


def clearance_of(robot: RobotBody, postures: FloatArray) -> Clearance:
    """Of the body to itself in postures (T, nq)."""
    model = _model(str(robot.profile.body_path), robot.profile.root)
    placed = PlacedBody(model, moving_geoms(model, postures), np.arange(len(postures)))
    neutral = robot.posture(robot.profile.postures.neutral)
    return placed.to_itself(neutral=neutral, ignored=[entry.pair for entry in robot.profile.ignore_pairs])


def collisions(robot: RobotBody, ways: Sequence[Track]) -> list[str]:
    """The deepest collision of goals, in words, if there is one."""
    found = clearance_of(robot, postures_of(robot, ways))
    if found.smallest is None or found.smallest > -DEEPEST_M or found.pair is None:
        return []
    return [f"{' and '.join(found.pair)} are {1e3 * found.deepest:.1f} mm in each other"]
