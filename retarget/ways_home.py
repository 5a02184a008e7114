"""The ways of a robot that stands to where it is parked: straight, and around what is in the way."""

from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np

from hardware.guard_state import Stop
from hardware.stop_latch import GOING_HOME
from retarget.approach import approach
from retarget.frames import BoolArray
from retarget.robot_body import RobotBody
from retarget.robot_reader import standing_dofs
from retarget.rotations import FloatArray

__all__ = ["ALONE_RAD", "HOME_S", "LONGEST_HOME_S", "NEAR_REST", "Way", "not_parked", "ways_home"]

Way = Iterator[FloatArray]
"""Goals (n,) rad, a tick from one to the next."""
HOME_S = 2.5
"""So long the straight way takes at most, and each part of one around something; it goes as fast as that asks."""
ALONE_RAD = 0.3
"""So far a joint goes aside alone, before all the arm does."""
LONGEST_HOME_S = 45.0
"""So long all of it takes at most, s; then its torque goes off where it is."""
NEAR_REST = 0.2
"""A robot is parked when no joint is farther than this from posture `rest`, rad."""


def ways_home(robot: RobotBody, *, dt: float) -> Iterator[Callable[[FloatArray], Way]]:
    """Ways to the profile's rest posture, one after the other, each from where the robot stands then, (n,) rad.

    First straight there. Then the arms aside, legs still; the whole robot to `stand`, and straight down from there.
    Arms are aside as in `attractor`; if that is not to be had either, as in `stand`, then as in `neutral`. Then joint
    by joint, the outermost first: one joint of an arm alone goes aside, then the rest as before - what keeps a hand off
    its own forearm may be a wrist that goes first.
    """
    columns, postures = robot.servo_columns, robot.profile.postures
    attractor, stand, neutral, rest = (
        robot.posture(posture)[columns]
        for posture in (postures.attractor, postures.stand, postures.neutral, postures.rest)
    )
    joints = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
    carrying = standing_dofs(robot)[joints]

    def through(here: FloatArray, places: Iterable[FloatArray]) -> Way:
        speed, within = robot.profile.safety.speed_caps.approach, HOME_S - dt
        for place in places:
            yield from approach(here, place, robot.joint_map, speed=speed, dt=dt, within=within)
            here = place

    def by(aside: FloatArray, alone: int | None, here: FloatArray) -> Way:
        first = here.copy()
        if alone is not None:
            first[alone] += float(np.clip(aside[alone] - here[alone], -ALONE_RAD, ALONE_RAD))
        return through(here, (first, np.where(carrying, here, aside), stand, rest))

    yield lambda here: through(here, (rest,))
    for aside in (attractor, stand, neutral):
        yield partial(by, aside, None)
    for joint in _outermost(robot, carrying):
        yield partial(by, attractor, joint)


def not_parked(robot: RobotBody, joints: FloatArray, stop: Stop | None) -> tuple[str, ...]:
    """What is to be told of a robot on its soles whose torque went off with `joints` (n,) rad, servo order, though it
    was to be parked and nothing else stopped it."""
    if not robot.stands or (stop is not None and (stop.cause not in GOING_HOME or stop.then is not None)):
        return ()
    off = np.abs(joints - robot.posture(robot.profile.postures.rest)[robot.servo_columns])
    worst = int(off.argmax())
    if off[worst] <= NEAR_REST:
        return ()
    where = f"{robot.joint_map.joints[worst]} {off[worst]:.2f} rad from it"
    return (f"not parked: no way to posture rest was found in time; torque went off with {where}",)


def _outermost(robot: RobotBody, carrying: BoolArray) -> list[int]:
    """Columns, in servo order, of the joints that do not carry the robot, those farthest from the root first."""
    body, joints = robot.body, robot.joint_map.joints
    depths = [len(body.chain_to_root(body.joint_body[body.joint_index(joint)])) for joint in joints]
    return sorted(np.flatnonzero(~carrying).tolist(), key=lambda column: -depths[column])
