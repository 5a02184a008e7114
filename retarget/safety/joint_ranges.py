"""Joint ranges that are wider than what a robot can do, as they come from a body file without limits, or wrong ones."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from retarget import _solver
from retarget.model.observers import Observers, placed
from retarget.model.robot import RobotBody
from retarget.types import BoolArray, FloatArray, IntArray

WHOLE = 0.97
"""Share of a servo's turn that is all of it."""
STEP_RAD = 0.05
"""[rad] Steps in which the range of a joint is looked at."""
ROOM_RAD = 1.0
"""[rad] A joint that is free to turn so far less than its range to either side is questioned: a little beyond what the
body can do is usual, and left to the gate."""
DEEP_M = 0.01
"""[m] Shapes stand out of the parts that they are around: so deep is a touch of the parts themselves."""


def questioned_ranges(robot: RobotBody, observers: Observers) -> Iterator[str]:
    """The joints, in words, whose range is all of their servo's turn, or goes far beyond where the body touches itself,
    all others in posture `stand`; each with what touches first."""
    body, stand = robot.body, robot.posture(robot.profile.postures.stand)
    pairs = observers.pairs
    for servo, column in zip(robot.joint_map.servos, robot.servo_columns, strict=True):
        joint, low, high = servo.joint, servo.lower, servo.upper
        link = int(body.joint_body[body.joint_index(joint)])
        moved = np.array([link in body.chain_to_root(int(one)) for one in observers.links], dtype=np.bool_)
        looked = pairs[moved[pairs[:, 0]] != moved[pairs[:, 1]]] if len(pairs) else pairs
        free, touched = [low, high], ""
        for place, end in enumerate((low, high)):
            begin = float(stand[column])
            count = int(np.ceil(abs(end - begin) / STEP_RAD)) + 1
            postures = np.repeat(stand[None], count, axis=0)
            postures[:, column] = np.linspace(begin, end, count)
            deep = _deep(robot, observers, looked, postures)
            if deep.any():
                first, which = (int(axis[0]) for axis in np.nonzero(deep))
                free[place] = float(postures[max(first - 1, 0), column])
                if abs(end - free[place]) > ROOM_RAD:
                    touched = " and ".join(observers.names[one] for one in looked[which].tolist())
        if touched:
            yield f"{joint} {low:.2f} to {high:.2f}, free from {free[0]:.2f} to {free[1]:.2f} ({touched} touch)"
        elif (high - low) * abs(servo.gear) > WHOLE * servo.model.travel:
            yield f"{joint} {low:.2f} to {high:.2f}, all of its servo's turn"


def _deep(robot: RobotBody, observers: Observers, pairs: IntArray, postures: FloatArray) -> BoolArray:
    """Whether pairs (p, 2) touch in postures (t, nq): (t, p)."""
    position, quat = placed(robot.body, observers, postures)
    deep = np.zeros((len(postures), len(pairs)), dtype=np.bool_)
    for time in range(len(postures)) if pairs.size else ():
        sides: list[Any] = []
        for half in map(np.ascontiguousarray, pairs.T):
            sides += [observers.kinds[half], observers.sizes[half], position[time, half], quat[time, half]]
        deep[time] = _solver.shape_distances(*sides)[0] < -DEEP_M
    return deep
