"""What touches where a motion begins: parts of the body with each other, and with what is around it."""

from dataclasses import dataclass

import numpy as np

from retarget import _solver
from retarget.body import BodyModel
from retarget.errors import Problem, UsageError
from retarget.observer_pairs import placed
from retarget.observers import Observers
from retarget.rotations import FloatArray
from retarget.scene_motion import SceneState

__all__ = ["CONTACT_M", "Contact", "contacts", "refuse_contact"]

CONTACT_M = 1e-4
"""Deeper than this (m) is contact, as for the solver: rounding is not."""


@dataclass(frozen=True)
class Contact:
    """An observer and what it touches (another, or an obstacle), and how deep, m."""

    part: str
    other: str
    depth: float


def contacts(body: BodyModel, observers: Observers, scene: SceneState | None, q: FloatArray) -> tuple[Contact, ...]:
    """What touches in posture q (nq,) at the scene's time 0: pairs that are looked at, and obstacles; deepest first."""
    position, quat = placed(body, observers, q)
    n, pairs = len(observers.names), observers.pairs
    kinds, sizes, others = observers.kinds, observers.sizes, observers.names
    if scene is not None:
        poses, shapes = scene.at_rest(0.0), scene.shapes
        k = len(shapes.names)
        kinds, sizes = np.concatenate([kinds, shapes.kinds]), np.concatenate([sizes, shapes.sizes])
        position, quat = np.concatenate([position, poses.position]), np.concatenate([quat, poses.quat])
        around = np.stack(np.meshgrid(np.arange(n), n + np.arange(k), indexing="ij"), axis=-1).reshape(-1, 2)
        pairs, others = np.concatenate([pairs, around]), others + shapes.names
    a, b = pairs[:, 0], pairs[:, 1]
    depths = -_solver.shape_distances(
        kinds[a], sizes[a], position[a], quat[a], kinds[b], sizes[b], position[b], quat[b]
    )[0]
    order = np.argsort(-depths)
    touching = [row for row in order.tolist() if depths[row] > CONTACT_M]
    return tuple(Contact(others[pairs[row, 0]], others[pairs[row, 1]], float(depths[row])) for row in touching)


def refuse_contact(found: tuple[Contact, ...], *, where: str) -> None:
    """Raise UsageError that names all of them, if there are any. where: what begins, for the message."""
    if found:
        raise UsageError.from_problems([_problem(contact, where) for contact in found])


def _problem(contact: Contact, where: str) -> Problem:
    return Problem(
        f"{contact.part} touches {contact.other} at the start",
        where=where,
        found=f"{1e3 * contact.depth:.1f} mm deep",
        allowed="a start clear of contact",
        next_step="Move the obstacle or the start, or give --allow-contact: then what touches is only let out",
    )
