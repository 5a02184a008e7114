"""Whether the last part of the rest trajectory is safe: from a stand, arms aside, straight to `rest`.

That part is always the same (see `rest_trajectory`), so it can be checked before anything moves.
"""

from dataclasses import dataclass

import numpy as np

from retarget import _solver
from retarget.ik.support_polygon import plant, support_distance
from retarget.model.observers import contacts, placed, robot_observers
from retarget.model.robot import TRUNK, RobotBody
from retarget.model.scene_state import SceneState
from retarget.report.clearance import MovingShapes
from retarget.robot.follower import stance_angles
from retarget.safety.clearance import KEPT_SHARE
from retarget.schema.scene import FLOOR, on_floor
from retarget.types import MM

ROWS = 41
"""Postures of the trajectory that are checked."""


@dataclass(frozen=True)
class PathToRest:
    """margin: least distance, m, of the centre of mass to the edge of the soles, from inside. first, second: observers
    that come nearest to what the gate keeps; distance: between them, m; kept: by the gate, m."""

    margin: float
    first: str
    second: str
    distance: float
    kept: float

    @property
    def safe(self) -> bool:
        """Whether the robot neither falls over nor is stopped by the gate on it."""
        return self.margin > 0.0 and self.distance >= self.kept

    def __str__(self) -> str:
        balance = f"centre of mass {abs(MM * self.margin):.0f} mm {'inside' if self.margin > 0.0 else 'outside'}"
        near = f"{self.first} and {self.second} {MM * self.distance:.1f} mm, the gate keeps {MM * self.kept:.1f} mm"
        text = f"{balance} the edge of the soles at worst; nearest {near}"
        if self.safe:
            return text
        return f"not straight, as {'limbs meet' if self.margin > 0.0 else 'it would tip'}: {text}"


def path_to_rest(robot: RobotBody) -> PathToRest | None:
    """The check of a robot that stands on soles; None for another, and for one without observers or frame `neck`."""
    observers = robot_observers(robot)
    if not robot.stands or not len(observers.pairs) or TRUNK not in robot.profile.frames:
        return None
    trajectory = _trajectory(robot)
    stances = [plant(robot, posture) for posture in trajectory]
    coms = robot.kinematics.centre_of_mass(np.array([stance.q for stance in stances]))
    margin = min(float(support_distance(com, at.edges(0.0))) for com, at in zip(coms, stances, strict=True))

    first, second = observers.pairs.T
    shapes = MovingShapes(
        observers.kinds, observers.sizes, *placed(robot.body, observers, np.array([stance.q for stance in stances]))
    )
    rows, which = np.indices((len(trajectory), len(first))).reshape(2, -1)
    found = shapes.measured(_solver.shape_distances, rows, observers.pairs[which])[0]
    distance = found.reshape(len(trajectory), -1).min(axis=0)
    margins = np.maximum(observers.margin[first], observers.margin[second])
    kept = KEPT_SHARE * np.minimum(margins, observers.pair_margin)
    worst = int((distance - kept).argmin())
    names = observers.names[first[worst]], observers.names[second[worst]]
    return PathToRest(margin, *names, float(distance[worst]), float(kept[worst]))


def at_rest(robot: RobotBody) -> str:
    """How a robot on its soles is in its posture `rest`, in words: its balance, its lowest part without a sole, and
    what to do where it may topple; "" for another robot."""
    if not robot.stands:
        return ""
    stance = plant(robot, robot.profile.postures.rest)
    com = robot.kinematics.centre_of_mass(stance.q[None])[0]
    margin = MM * float(support_distance(com, stance.edges(0.0)))
    text = f"centre of mass {abs(margin):.0f} mm {'inside' if margin > 0.0 else 'outside'} the edge of the soles"
    floor = SceneState(on_floor(None))
    near = contacts(robot.body, robot_observers(robot), floor, stance.q, deeper_than=-np.inf)
    lowest = next((contact for contact in near if contact.other == FLOOR), None)
    if lowest is not None:
        where = "in" if lowest.depth > 0.0 else "above"
        text += f"; lowest: {lowest.part}, {abs(MM * lowest.depth):.0f} mm {where} the floor"
    if margin <= 0.0 or (lowest is not None and lowest.depth >= 0.0):
        text += "; it may topple when torque goes off: crouch less, or lean it over its soles, in postures.rest"
    return text


def _trajectory(robot: RobotBody) -> list[dict[str, float]]:
    """Postures, by joint, from where the return to stance ends to `rest`."""
    start, rest = stance_angles(robot), robot.profile.postures.rest
    return [
        {joint: (1.0 - share) * start.get(joint, 0.0) + share * rest.get(joint, 0.0) for joint in start | rest}
        for share in np.linspace(0.0, 1.0, ROWS).tolist()
    ]
