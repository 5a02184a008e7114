"""Which servos move one frame of a robot against others: those of the joints on the way from link to link."""

from collections.abc import Iterable

import numpy as np

from retarget.frames import BoolArray
from retarget.robot_body import RobotBody

__all__ = ["joints_between"]


def joints_between(robot: RobotBody, frame: str, others: Iterable[str]) -> BoolArray:
    """Servos (n,), in servo order, of the joints between the link of `frame` and those of the frames `others`.

    All of them where no joint lies between, or there are no others.
    """
    body = robot.body
    start, between = robot.frame(frame).body, set[int]()
    for other in others:
        between |= body.links_between(start, robot.frame(other).body)
    links = body.joint_body[[body.joint_index(joint) for joint in robot.joint_map.joints]]
    found = np.isin(links, sorted(between))
    return found if found.any() else np.ones_like(found)
