"""Posture reader: where a robot's landmarks, trunk and eyes are in a posture; and names of its parts in priorities."""

import numpy as np

from retarget._solver import Probe
from retarget.ik.hierarchy import Hierarchy, body_frames
from retarget.ik.support_polygon import Stance
from retarget.model.body import Frame
from retarget.model.robot import HEAD, TRUNK, RobotBody
from retarget.robot.reference_governor import Reached
from retarget.rotations import Quat, inverse, product, rotated
from retarget.types import BoolArray, FloatArray

FORWARD = (1.0, 0.0, 0.0)


class RobotReader:
    """Reads postures of one robot that stands in one stance."""

    def __init__(self, robot: RobotBody, stance: Stance) -> None:
        places = [robot.frame(landmark.frame) for landmark in robot.profile.landmarks.values()]
        local = np.array([place.position for place in places]).reshape(-1, 3)
        trunk, head = robot.frame(TRUNK), robot.frame(HEAD)
        body = robot.body.solver_body()
        self._probe = Probe(body, [place.body for place in places], local, [trunk.body, head.body])
        self._head = _quat(head.quat.tolist())
        self.trunk_at_stance = _quat(robot.orientations(stance.q[None], (TRUNK,))[0, 0].tolist())
        """Orientation wxyz of the trunk's frame in the stance: where the performer's trunk is upright."""
        self._trunk = product(_quat(trunk.quat.tolist()), inverse(self.trunk_at_stance))

    def read(self, q: FloatArray) -> Reached:
        """What posture q (nq,) reaches."""
        points, oriented, centre_of_mass = self._probe.read(q)
        trunk, head = oriented.tolist()
        return Reached(
            points,
            points.tolist(),
            product(_quat(trunk), self._trunk),
            rotated(product(_quat(head), self._head), FORWARD),
            centre_of_mass,
        )


def robot_frames(robot: RobotBody) -> dict[str, Frame]:
    """What names in a priority file stand for: landmarks, frames of the profile, links and sites of the body."""
    frames = body_frames(robot.body) | {name: robot.frame(name) for name in robot.profile.frames}
    return frames | {name: robot.frame(entry.frame) for name, entry in robot.profile.landmarks.items()}


def robot_postures(robot: RobotBody, stance: Stance) -> dict[str, FloatArray]:
    """The postures (nq,) of the profile, by name, with the root where the robot stands."""
    postures = {}
    for name, angles in robot.profile.postures.model_dump(exclude={"to_rest"}).items():
        q = robot.posture(angles)
        free = 7 if robot.profile.root == "free" else 0
        q[:free] = stance.q[:free]
        postures[name] = q
    return postures


def standing_targets(hierarchy: Hierarchy, stance: Stance) -> FloatArray:
    """Targets of a hierarchy for a robot that faces forward on its soles; nothing else is asked."""
    targets = hierarchy.blank()
    hierarchy.set_heading(targets, (1.0, 0.0))
    for sole in stance.soles:
        hierarchy.set_position(targets, sole.frame.name, sole.position)
        hierarchy.set_orientation(targets, sole.frame.name, sole.orientation)
    return targets


def standing_dofs(robot: RobotBody, *frames: str) -> BoolArray:
    """Which DoFs (nv,) carry the robot: a free root, and every joint between it and a sole, or one of these frames."""
    ends = [robot.frame(name).body for name in (*(foot.frame for foot in robot.profile.feet.values()), *frames)]
    return np.isin(_dof_links(robot), [link for end in ends for link in robot.body.chain_to_root(end)])


def _dof_links(robot: RobotBody) -> FloatArray:
    """Link (nv,) that each DoF moves."""
    body = robot.body
    ends = [*body.joint_dof[1:].tolist(), body.nv]
    return np.repeat(body.joint_body, np.array(ends) - body.joint_dof).astype(float)


def _quat(values: list[float]) -> Quat:
    w, x, y, z = values
    return w, x, y, z
