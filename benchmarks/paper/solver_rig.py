"""Small bodies for the compiled solver alone, to show what observers do: points that slide, and chains in a plane."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retarget import _solver
from retarget.model.body import BodyModel, load_body_text
from retarget.types import FloatArray

LINK = 0.1
"""Length of a link of a chain, m."""


@dataclass(frozen=True)
class Ball:
    """A spherical obstacle with its zone of influence; m, m/s."""

    centre: tuple[float, float, float]
    radius: float
    influence: float
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def after(self, time: float) -> FloatArray:
        """Centre (3,) at a time, s."""
        return np.array(self.centre) + time * np.array(self.velocity)


def sliding_point() -> BodyModel:
    """A point that moves freely along the axes of the world."""
    slides = "".join(f'<joint name="{axis}" type="slide" axis="{way}"/>' for axis, way in _AXES)
    body = f'<body name="point">{slides}<geom type="sphere" size="0.001" mass="1"/></body>'
    return load_body_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>", source="a sliding point")


def planar_chain(links: int) -> BodyModel:
    """Links of LINK m one on the other, upright at zero, each on a hinge about y; the first stands on the origin."""
    opening = ""
    for k in range(links):
        opening += (
            f'<body name="link_{k}" pos="0 0 {LINK if k else 0.0}">'
            f'<joint name="hinge_{k}" axis="0 1 0" range="-2.4 2.4"/>'
            f'<geom type="capsule" fromto="0 0 0 0 0 {LINK}" size="0.01" mass="1"/>'
        )
    tip = f'<site name="tip" pos="0 0 {LINK}"/>'
    text = f'<mujoco><compiler angle="radian"/><worldbody>{opening}{tip}{"</body>" * links}</worldbody></mujoco>'
    return load_body_text(text, source=f"a chain of {links} links")


def chain_points(body: BodyModel, q: FloatArray) -> FloatArray:
    """Hinges and tip (T, links + 1, 3) of a chain in postures (T, nq)."""
    links = [*range(1, len(body.body_names)), len(body.body_names) - 1]
    local = np.zeros((len(links), 3))
    local[-1, 2] = LINK
    return body.solver_body().points(np.ascontiguousarray(q), links, local)


def watching(body: BodyModel, length: float, balls: Sequence[Ball]) -> _solver.Observers:
    """Every link watches with a line of this length (m; 0: a point) along its z, from its origin."""
    count, obstacles = len(body.body_names) - 1, len(balls)
    quat = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    return _solver.Observers(
        body.solver_body(),
        links=np.arange(1, count + 1),
        kinds=np.zeros(count, dtype=np.int64),
        sizes=np.tile([0.0, 0.5 * length, 0.0], (count, 1)),
        positions=np.tile([0.0, 0.0, 0.5 * length], (count, 1)),
        quats=quat,
        influence=np.full(count, 1e-6),
        margin=np.zeros(count),
        pairs=np.zeros((0, 2), dtype=np.int64),
        obstacle_kinds=np.zeros(obstacles, dtype=np.int64),
        obstacle_sizes=np.array([[ball.radius, 0.0, 0.0] for ball in balls]).reshape(-1, 3),
        obstacle_influence=np.array([ball.influence for ball in balls]),
        obstacle_margin=np.zeros(obstacles),
    )


def make_solver(
    body: BodyModel, levels: list[list[_solver.Task]], observers: _solver.Observers, *, n_ik: int, speed: float = np.inf
) -> _solver.Solver:
    """A solver without damping and early stop; the closest observer to each obstacle acts. speed: of joints, per s."""
    return _solver.Solver(
        body.solver_body(),
        levels,
        lower=body.lower,
        upper=body.upper,
        max_velocity=np.full(body.nv, speed),
        max_acceleration=np.full(body.nv, np.inf),
        locked=np.zeros(body.nv, dtype=bool),
        n_ik=n_ik,
        early_stop=False,
        max_step=10.0,
        damping=0.0,
        observers=observers,
        activation="closest",
    )


def place_balls(solver: _solver.Solver, balls: Sequence[Ball], time: float = 0.0) -> None:
    """Set where the balls of a solver are, and how they move."""
    solver.set_obstacles(
        np.array([ball.after(time) for ball in balls]),
        np.tile([1.0, 0.0, 0.0, 0.0], (len(balls), 1)),
        np.array([ball.velocity for ball in balls]),
        np.zeros((len(balls), 3)),
    )


_AXES = (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
