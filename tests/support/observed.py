"""Small bodies with observers, and an independent look at how near their shapes are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

import followers
from followers import DT, op3, performer, settled
from retarget import _solver, rotations
from retarget.model.body import BodyModel, load_body_text
from retarget.model.observers import Observers, placed, robot_observers
from retarget.model.scene_state import SceneState
from retarget.report.clearance import place_body
from retarget.robot.follower import Follower
from retarget.schema.priorities import Priorities, load_priorities
from retarget.schema.profile import RobotProfile
from retarget.schema.scene import Scene
from retarget.types import FloatArray, HumanPosture, RobotPosture

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


# OP3 among obstacles, judged on its observers and on its body's own geoms.

ZONE = {"influence": 0.06, "margin": 0.004}


@cache
def human() -> list[HumanPosture]:
    return followers.postures(performer())


def raised() -> list[HumanPosture]:
    """From a crouch up to the reach of the right hand, half as fast as performed, which is then held."""
    slow = followers.postures(performer(), speed=0.5)
    return slow[250:600] + [slow[600]] * 150


def robot(scene: SceneState | None, priorities: Priorities | None = None) -> Follower:
    size = followers.dimensions(performer())
    return Follower(op3(), priorities or load_priorities("servo"), size, scene=scene)


@dataclass(frozen=True, eq=False)
class Done:
    """What it did after it had arrived: postures, and how near its observers came to each obstacle (T, k) m."""

    postures: list[RobotPosture]
    distance: FloatArray
    state: SceneState | None
    times: FloatArray

    @property
    def q(self) -> FloatArray:
        return np.array([posture.q for posture in self.postures])

    @property
    def joints(self) -> FloatArray:
        return np.array([posture.joint_positions for posture in self.postures])

    def error(self, name: str) -> FloatArray:
        """Distance (T,) m of a landmark from where it was asked to be."""
        column = self.postures[0].landmark_names.index(name)
        off = [posture.landmarks_reached[column] - posture.landmarks_asked[column] for posture in self.postures]
        return np.asarray(np.linalg.norm(off, axis=1))

    def geoms_apart(self) -> float:
        """Smallest distance (m) of the body's own geoms to the scene, by MuJoCo."""
        assert self.state is not None
        path = op3().profile.body_path
        found = place_body(path, self.q, root="free").to_scene(self.state, self.times).smallest
        assert found is not None
        return found

    def reached(self, name: str) -> FloatArray:
        """Where a landmark was (T, 3) m."""
        column = self.postures[0].landmark_names.index(name)
        return np.array([posture.landmarks_reached[column] for posture in self.postures])

    def self_apart(self) -> float:
        """Smallest distance (m) of the body's own geoms to each other, by MuJoCo."""
        neutral = op3().posture(op3().profile.postures.neutral)
        found = place_body(op3().profile.body_path, self.q, root="free").to_itself(neutral=neutral).smallest
        assert found is not None
        return found

    def swing(self, ticks: int = 125) -> float:
        """Most that a joint went to and fro in the last second, rad: its path beyond the way that it made."""
        last = self.joints[-ticks:]
        return float((np.abs(np.diff(last, axis=0)).sum(axis=0) - np.abs(last[-1] - last[0])).max())


def scene_of(**obstacles: Any) -> SceneState:
    return SceneState(Scene.model_validate({"name": "a", "description": "b", "obstacles": obstacles}))


def sphere(at: FloatArray | Sequence[float], radius: float = 0.03, **more: Any) -> dict[str, Any]:
    return {"shape": {"sphere": {"radius": radius}}, "at": {"pos": tuple(at)}, **ZONE, **more}


@cache
def own() -> Observers:
    return robot_observers(op3())


def nearest(body: BodyModel, observers: Observers, q: FloatArray, state: SceneState, time: float) -> FloatArray:
    """Smallest distance (k,) m of the observers of a body to each obstacle at a time."""
    return np.asarray(distances(body, observers, q, state, time).min(axis=1))


def distances(body: BodyModel, observers: Observers, q: FloatArray, state: SceneState, time: float) -> FloatArray:
    """Distances (k, n) m of the n observers of a body to each of k obstacles at a time."""
    position, quat = placed(body, observers, q)
    poses, shapes = state.at(time), state.shapes
    n, k = len(observers.names), len(shapes.names)
    mine, theirs = np.tile(np.arange(n), k), np.repeat(np.arange(k), n)
    found = _solver.shape_distances(
        *(observers.kinds[mine], observers.sizes[mine], position[mine], quat[mine]),
        *(shapes.kinds[theirs], shapes.sizes[theirs], poses.position[theirs], poses.quat[theirs]),
    )[0]
    return np.asarray(found.reshape(k, n))


def observed(q: FloatArray, state: SceneState, time: float) -> FloatArray:
    """Smallest distance (k,) m of the robot's observers to each obstacle at a time."""
    return nearest(op3().body, own(), q, state, time)


def depth(q: FloatArray, state: SceneState, time: float) -> float:
    """Root of the sum of squares (m) of how deep the robot's observers are in obstacles at a time."""
    return float(np.linalg.norm(distances(op3().body, own(), q, state, time).clip(max=0.0)))


def act(follower: Follower, state: SceneState | None, motion: Sequence[HumanPosture]) -> Done:
    """Arrive, then follow; time 0 of the scene is the arrival."""
    follower.start(motion[0])
    arrived = settled(follower, motion[0])
    done, near, times = [arrived[-1]], [], [0.0]
    for tick, posture in enumerate(motion):
        done.append(follower.step(posture, DT))
        times.append((tick + 1) * DT)
    if state is not None:
        near = [observed(posture.q, state, time) for posture, time in zip(done, times, strict=True)]
    return Done(done, np.array(near), state, np.array(times))


def without_observers(priorities: Priorities) -> Priorities:
    """The same levels, empty where observers were."""
    levels = tuple(
        level.model_copy(update={"tasks": tuple(t for t in level.tasks if t.type not in ("reactive", "preventive"))})
        for level in priorities.levels
    )
    return priorities.model_copy(update={"levels": levels})


# Small bodies that several tests read.

TWO_LINK_URDF = """<robot name="two">
<link name="base"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><!-- arm -->
<link name="tip"/>
<joint name="swing" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5" rpy="0.1 0 0"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="2" velocity="1" effort="1"/></joint>
<joint name="weld_tip" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0 0 1"/></joint>
</robot>"""

ALL_JOINTS_MJCF = """<mujoco><compiler angle="radian"/><worldbody>
<body name="base" pos="0 0 1" euler="0.2 0.1 0"><freejoint name="root"/><geom size="0.1" mass="3" pos="0.02 0 0"/>
  <site name="tool" pos="0 0.1 0" euler="0 0 1"/>
  <body name="upper" pos="0.1 0.2 0.3" quat="0.9 0.1 0.3 0.2">
    <joint name="twist" axis="1 2 0" pos="0.05 0 0" range="-1 2" ref="0.3"/>
    <joint name="rail" type="slide" axis="0 1 1" range="-0.1 0.2"/><geom size="0.1" mass="2"/>
    <body name="lower" pos="0 0 -0.4">
      <joint name="ball" type="ball" pos="0 0 0.1" range="0 1"/><geom size="0.05" mass="1" pos="0 0 -0.1"/>
      <body name="hand" pos="0 0 -0.3" euler="0 1 0"><geom size="0.05" mass="0.5"/></body></body></body>
  <body name="other" pos="0 -0.2 0"><joint axis="0 0 1"/><geom size="0.05" mass="0.5" pos="0 0 -0.1"/></body></body>
</worldbody></mujoco>"""
"""Every kind of joint, two on one link, off-centre anchors, a reference angle, a fixed link, an unnamed joint."""


# The body file of a profile in MuJoCo, posed: where frames of the profile are, the centre of mass, what touches.

Array = NDArray[np.float64]
Posture = Mapping[str, float]


class PosedBody:
    """A body in a posture; its root stays where the body file has it."""

    def __init__(self, profile: RobotProfile) -> None:
        self.profile = profile
        self.model: Any = mujoco.MjModel.from_xml_path(str(profile.body_path))
        self.data: Any = mujoco.MjData(self.model)

    def pose(self, joints: Posture) -> "PosedBody":
        self.data.qpos[:] = self.model.qpos0
        for joint, angle in joints.items():
            self.data.qpos[self.model.joint(joint).qposadr[0]] = angle
        mujoco.mj_forward(self.model, self.data)
        return self

    def frame(self, name: str) -> tuple[Array, Array]:
        """World position (3,) and rotation (3, 3) of a frame of the profile."""
        frame = self.profile.frames[name]
        link = self.data.body(frame.link)
        rotation = np.array(link.xmat).reshape(3, 3)
        own = np.zeros(9)
        mujoco.mju_quat2Mat(own, np.array(frame.quat))
        return np.array(link.xpos) + rotation @ np.array(frame.pos), rotation @ own.reshape(3, 3)

    def at(self, name: str) -> Array:
        return self.frame(name)[0]

    def anchor(self, joint: str) -> tuple[Array, Array]:
        """Anchor (3,) of a joint and its axis (3,), seen from the base's origin."""
        found = self.data.joint(joint)
        return np.array(found.xanchor) - self.data.qpos[:3], np.array(found.xaxis)

    def com_in_stand_frame(self) -> Array:
        """Centre of mass (3,) from the middle of the soles, which are made level."""
        (left, left_axes), (right, right_axes) = self.frame("l_sole"), self.frame("r_sole")
        up = left_axes[:, 2] + right_axes[:, 2]
        up /= np.linalg.norm(up)
        ahead = left_axes[:, 0] + right_axes[:, 0]
        ahead -= up * (up @ ahead)
        ahead /= np.linalg.norm(ahead)
        axes = np.stack([ahead, np.cross(up, ahead), up])
        return np.asarray(axes @ (self.data.subtree_com[1] - (left + right) / 2))

    def sole_corners(self) -> Array:
        """Corners (c, 3) of all soles."""
        corners = []
        for foot in self.profile.feet.values():
            position, axes = self.frame(foot.frame)
            corners += [position + axes @ (x, y, 0.0) for x, y in foot.polygon]
        return np.array(corners)

    def support_margin(self) -> float:
        """How far the centre of mass is inside the hull of the soles' corners, m."""
        equations = ConvexHull(self.sole_corners()[:, :2]).equations  # outward normal, offset
        return -float(np.max(equations[:, :2] @ self.data.subtree_com[1][:2] + equations[:, 2]))

    def touching(self) -> set[tuple[str, str]]:
        """Pairs of links in contact."""
        links = self.model.geom_bodyid
        return {(self.model.body(links[c.geom1]).name, self.model.body(links[c.geom2]).name) for c in self.data.contact}
