"""Joint ranges wider than the body allows, as in body files without limits or with wrong ones."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from retarget import _solver
from retarget.model.observers import Observers, placed
from retarget.model.robot import RobotBody
from retarget.types import BoolArray, FloatArray, IntArray

WHOLE = 0.97  # share of a servo's turn that counts as all of it
STEP_RAD = 0.05  # [rad] step in which a range is sampled
ROOM_RAD = 1.0
"""[rad] Excess of a range over the free motion that is reported; a little is usual."""
DEEP_M = 0.01  # [m] shapes stand out of the parts around which they are


def questioned_ranges(robot: RobotBody, observers: Observers) -> Iterator[str]:
    """Describe the joints whose range is their servo's whole turn, or goes far beyond self-contact in posture
    `stand`."""
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
    """Mask (t, p) of pairs (p, 2) that touch in postures (t, nq)."""
    position, quat = placed(robot.body, observers, postures)
    deep = np.zeros((len(postures), len(pairs)), dtype=np.bool_)
    for time in range(len(postures)) if pairs.size else ():
        sides: list[Any] = []
        for half in map(np.ascontiguousarray, pairs.T):
            sides += [observers.kinds[half], observers.sizes[half], position[time, half], quat[time, half]]
        deep[time] = _solver.shape_distances(*sides)[0] < -DEEP_M
    return deep
