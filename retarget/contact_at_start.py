"""What touches where a motion begins: parts of the body with each other, and with what is around it."""

from dataclasses import dataclass

import numpy as np

from retarget import _solver
from retarget.body import BodyModel
from retarget.errors import Problem, UsageError
from retarget.observer_pairs import placed
from retarget.observers import Observers
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.scene_motion import SceneState

__all__ = ["CONTACT_M", "Contact", "contacts", "refuse_contact", "refuse_floor"]

CONTACT_M = 1e-4
"""Deeper than this (m) is contact, as for the solver: rounding is not."""


NEAR_SOLE_M = 1e-3
"""What is so near (m) to a sole that stands carries it."""


@dataclass(frozen=True)
class Contact:
    """An observer and what it touches (another, or an obstacle), and how deep, m."""

    part: str
    other: str
    depth: float


def contacts(
    body: BodyModel, observers: Observers, scene: SceneState | None, q: FloatArray, *, deeper_than: float = CONTACT_M
) -> tuple[Contact, ...]:
    """What touches in posture q (nq,) at the scene's time 0: pairs that are looked at, and obstacles; deepest first."""
    position, quat = placed(body, observers, q)
    n, pairs = len(observers.names), observers.pairs
    kinds, sizes, others = observers.kinds, observers.sizes, observers.names
    if scene is not None:
        poses, shapes = scene.at_rest(0.0), scene.shapes
        kinds, sizes = np.concatenate([kinds, shapes.kinds]), np.concatenate([sizes, shapes.sizes])
        position, quat = np.concatenate([position, poses.position]), np.concatenate([quat, poses.quat])
        around, _ = observers.around(shapes)
        pairs, others = np.concatenate([pairs, around + np.array([0, n])]), others + shapes.names
    a, b = pairs[:, 0], pairs[:, 1]
    depths = -_solver.shape_distances(
        kinds[a], sizes[a], position[a], quat[a], kinds[b], sizes[b], position[b], quat[b]
    )[0]
    order = np.argsort(-depths)
    touching = [row for row in order.tolist() if depths[row] > deeper_than]
    return tuple(Contact(others[pairs[row, 0]], others[pairs[row, 1]], float(depths[row])) for row in touching)


def refuse_contact(found: tuple[Contact, ...], *, where: str) -> None:
    """Raise UsageError that names all of them, if there are any. where: what begins, for the message."""
    if found:
        raise UsageError.from_problems([_problem(contact, where) for contact in found])


def refuse_floor(robot: RobotBody, observers: Observers, scene: SceneState, q: FloatArray) -> None:
    """Raise UsageError if a robot that stands in posture q (nq,) has an obstacle under its soles: it would keep off
    it."""
    soles = {robot.frame(foot.frame).body for foot in robot.profile.feet.values()}
    feet = {name for name, link in zip(observers.names, observers.links.tolist(), strict=True) if link in soles}
    for contact in contacts(robot.body, observers, scene, q, deeper_than=-NEAR_SOLE_M):
        if contact.part in feet and contact.other in scene.shapes.names:
            raise UsageError(
                f"{contact.part} stands on {contact.other}",
                where="--scene",
                allowed="what the robot stands on is ground",
                next_step=f"Write `ground: true` for {contact.other}, or leave it out: there is always a floor",
            )


def _problem(contact: Contact, where: str) -> Problem:
    return Problem(
        f"{contact.part} touches {contact.other} at the start",
        where=where,
        found=f"{1e3 * contact.depth:.1f} mm deep",
        allowed="a start clear of contact",
        next_step="Move the obstacle or the start, or give --allow-contact: then what touches is only let out",
    )
