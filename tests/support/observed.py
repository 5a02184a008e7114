"""Small bodies with observers, and an independent look at how near their shapes are."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from retarget import _solver, rotations
from retarget.model.body import BodyModel, load_body_text
from retarget.types import FloatArray

CAPSULE, CYLINDER, BOX, HALF_SPACE = range(4)
Vector = tuple[float, float, float]

POINT = """<mujoco><worldbody><body name="p"><joint name="x" type="slide" axis="1 0 0"/>
  <joint name="y" type="slide" axis="0 1 0"/><joint name="z" type="slide" axis="0 0 1"/><geom size="0.01" mass="1"/>
</body></worldbody></mujoco>"""
"""One part on three slides."""

CARTS = """<mujoco><worldbody>
  <body name="a"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><geom size="0.01" mass="1"/></body>
  <body name="b"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><geom size="0.01" mass="1"/></body>
</worldbody></mujoco>"""
"""Two parts, each on two slides."""


def chain(links: int, length: float = 0.2) -> str:
    """Links of this length (m) in the x-y plane, each on a hinge about z at its near end."""
    inner = f'<geom type="capsule" fromto="0 0 0 {length} 0 0" size="0.01" mass="1"/>'
    opened = "".join(
        f'<body name="l{k}" pos="{length if k else 0} 0 0"><joint axis="0 0 1"/>{inner}' for k in range(links)
    )
    return f"<mujoco><worldbody>{opened}{'</body>' * links}</worldbody></mujoco>"


@dataclass(frozen=True)
class Shape:
    """An observer on a link, or an obstacle (link 0). size as in `shape_distances`; at: on its link, m."""

    kind: int
    size: Vector
    link: int = 0
    at: Vector = (0.0, 0.0, 0.0)
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    influence: float = 0.1
    margin: float = 0.0


def ball(link: int = 0, radius: float = 0.05, **more: Any) -> Shape:
    return Shape(CAPSULE, (radius, 0.0, 0.0), link, **more)


def rod(link: int, half: float = 0.1, radius: float = 0.01, **more: Any) -> Shape:
    """A capsule along its link's x axis, in the middle of a link of `chain`."""
    return Shape(CAPSULE, (radius, half, 0.0), link, (half, 0.0, 0.0), (0.5**0.5, 0.0, 0.5**0.5, 0.0), **more)


def wall(**more: Any) -> Shape:
    """A half-space; its frame's z points out of it."""
    return Shape(HALF_SPACE, (0.0, 0.0, 0.0), **more)


def binding(
    body: _solver.Body,
    shapes: Sequence[Shape],
    looking: Sequence[tuple[int, int]] = (),
    obstacles: Sequence[Shape] = (),
    **instead: Any,
) -> _solver.Observers:
    """The compiled observers; looking: pairs of them. `instead` replaces arguments."""
    arguments: dict[str, Any] = {
        "links": np.array([shape.link for shape in shapes], dtype=np.int64),
        "kinds": np.array([shape.kind for shape in shapes], dtype=np.int64),
        "sizes": np.array([shape.size for shape in shapes]).reshape(-1, 3),
        "positions": np.array([shape.at for shape in shapes]).reshape(-1, 3),
        "quats": np.array([shape.quat for shape in shapes]).reshape(-1, 4),
        "influence": np.array([shape.influence for shape in shapes]),
        "margin": np.array([shape.margin for shape in shapes]),
        "pairs": np.array(looking, dtype=np.int64).reshape(-1, 2),
        "obstacle_kinds": np.array([shape.kind for shape in obstacles], dtype=np.int64),
        "obstacle_sizes": np.array([shape.size for shape in obstacles]).reshape(-1, 3),
        "obstacle_influence": np.array([shape.influence for shape in obstacles]),
        "obstacle_margin": np.array([shape.margin for shape in obstacles]),
    }
    return _solver.Observers(body, **(arguments | instead))


@dataclass(frozen=True, eq=False)
class Near:
    """An observer and what it looks at, m pairs: distance (m,) m, nearest points (m, 3), normal (m, 3) to the
    observer."""

    distance: FloatArray
    point: FloatArray
    other_point: FloatArray
    normal: FloatArray


@dataclass(eq=False)
class Rig:
    """A body with observers and obstacles, whose poses and velocities are known here too."""

    model: BodyModel
    shapes: Sequence[Shape] = ()
    obstacles: Sequence[Shape] = ()
    pairs: Sequence[tuple[int, int]] = ()
    at: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    velocity: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        self.body = self.model.solver_body()
        self.quat = np.array([shape.quat for shape in self.obstacles]).reshape(-1, 4)
        self.at = np.array([shape.at for shape in self.obstacles]).reshape(-1, 3)
        self.velocity = np.zeros_like(self.at)

    def solver(
        self,
        levels: Sequence[Sequence[_solver.Task]],
        *,
        observed: bool = True,
        speed: float = 100.0,
        acceleration: float = np.inf,
        **more: Any,
    ) -> _solver.Solver:
        """Levels without limits but this speed, undamped; `observed`: with the observers."""
        nv = self.body.nv
        arguments: dict[str, Any] = {
            "lower": np.full(nv, -np.inf),
            "upper": np.full(nv, np.inf),
            "max_velocity": np.full(nv, speed),
            "max_acceleration": np.full(nv, acceleration),
            "locked": np.zeros(nv, dtype=bool),
            "n_ik": 1,
            "damping": 0.0,
            "early_stop": False,
        }
        if observed:
            arguments["observers"] = binding(self.body, self.shapes, self.pairs, self.obstacles)
        made = _solver.Solver(self.body, [list(level) for level in levels], **(arguments | more))
        made.reset(self.body.rest())
        if observed:
            self.show(made)
        return made

    def show(self, solver: _solver.Solver) -> None:
        """Set where the obstacles of a solver are."""
        solver.set_obstacles(self.at, self.quat, self.velocity)

    def near(self, q: FloatArray, *, later: float = 0.0) -> Near:
        """Distances of `pairs`, then of every obstacle to every observer, after obstacles moved on for some s."""
        position, quat = self.body.forward(q)
        links = [shape.link for shape in self.shapes]
        at = position[links] + rotations.rotate(quat[links], np.array([shape.at for shape in self.shapes]))
        turned = rotations.multiply(quat[links], np.array([shape.quat for shape in self.shapes]))
        own = [(k, at[k], turned[k]) for k in range(len(self.shapes))]
        sides = [
            *(((self.shapes[a], *own[a][1:]), (self.shapes[b], *own[b][1:])) for a, b in self.pairs),
            *(
                ((self.shapes[k], place, turn), (obstacle, self.at[o] + later * self.velocity[o], self.quat[o]))
                for o, obstacle in enumerate(self.obstacles)
                for k, place, turn in own
            ),
        ]
        kinds, sizes, places, turns = (
            [np.array([part(pair[side]) for pair in sides]) for side in (0, 1)]
            for part in (_kind, _size, lambda end: end[1], lambda end: end[2])
        )
        return Near(
            *_solver.shape_distances(kinds[0], sizes[0], places[0], turns[0], kinds[1], sizes[1], places[1], turns[1])
        )

    def rows(self, q: FloatArray, near: Near) -> FloatArray:
        """n . J (m, nv) of observers against obstacles; of `pairs` both sides move."""
        links = [*((self.shapes[a].link, self.shapes[b].link) for a, b in self.pairs)]
        links += [(shape.link, 0) for _ in self.obstacles for shape in self.shapes]
        ends = zip(links, near.normal, near.point, near.other_point, strict=True)
        return np.array([n @ (self._jacobian(q, a, p) - self._jacobian(q, b, o)) for (a, b), n, p, o in ends])

    def _jacobian(self, q: FloatArray, link: int, point: FloatArray) -> FloatArray:
        if link == 0:
            return np.zeros((3, self.body.nv))
        position, quat = self.body.forward(q)
        x, y, z = rotations.rotate(rotations.conjugate(quat[link]), point - position[link]).tolist()
        return np.asarray(self.body.frame_jacobian(q, link, (x, y, z))[:3])


def _kind(end: tuple[Shape, FloatArray, FloatArray]) -> int:
    return end[0].kind


def _size(end: tuple[Shape, FloatArray, FloatArray]) -> Vector:
    return end[0].size


def rig(
    mjcf: str, shapes: Sequence[Shape], obstacles: Sequence[Shape] = (), pairs: Sequence[tuple[int, int]] = ()
) -> Rig:
    return Rig(load_body_text(mjcf, source="tiny body"), shapes, obstacles, pairs)


def aim(solver: _solver.Solver, **asked: Any) -> FloatArray:
    """Targets of a solver: all tasks of observers on, and `l2_0=(x, y, z)` for task 0 of level 2; others absent."""
    targets = np.zeros(solver.target_size)
    level = 0
    while True:
        task = 0
        try:
            while True:
                start, stop = solver.target_slice(level, task)
                if stop - start == 1:
                    targets[start] = 1.0
                value = asked.pop(f"l{level}_{task}", None)
                if value is not None:
                    targets[start], targets[start + 1 : stop] = 1.0, value
                task += 1
        except ValueError:
            if task == 0:
                break
        level += 1
    assert not asked, f"no such task: {', '.join(asked)}"
    return targets
