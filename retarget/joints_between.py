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
    start = _to_root(robot, frame)
    between: set[int] = set()
    for other in others:
        between |= start ^ _to_root(robot, other)
    body = robot.body
    links = body.joint_body[[body.joint_index(joint) for joint in robot.joint_map.joints]]
    found = np.isin(links, sorted(between))
    return found if found.any() else np.ones_like(found)


def _to_root(robot: RobotBody, frame: str) -> set[int]:
    """Links from that of the frame to the root, both included. What two of them share lies between neither."""
    link, way = robot.frame(frame).body, set()
    while link > 0:
        way.add(link)
        link = int(robot.body.parent[link])
    return way
