"""The contacts of a simulated robot: floor, soles, fixtures; and the pairs of shapes that collide.

A sole touches the floor with small balls whose lowest points are the corners of its polygon: exact when it stands or
tips, and cheap. The foot's own shapes do not collide with the floor.
"""

from collections.abc import Container, Iterable
from itertools import combinations
from typing import Any

import numpy as np

from retarget import rotations
from retarget.model.body_file import engine
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import ShapeKind, mujoco_geom
from retarget.model.scene_state import SceneState, motion_of
from retarget.schema.scene import Pose, Scene
from retarget.types import FloatArray

FLOOR, SOLE, FIXTURE = "physics_floor", "physics_sole", "physics_fixture"
"""Prefixes of the names of shapes that are not the robot's own."""

MAX_CORNERS = 6
"""Most corners of a sole; of a polygon with more, those that keep most of its area."""
BALL_M = 0.003
"""Radius of the ball in a corner of a sole."""
CONTACT_SOLREF = (0.006, 1.0)
"""Time constant s and damping ratio of contacts: three steps, and no bounce."""
SOLIMP = (0.95, 0.99, 0.0005, 0.5, 2.0)
"""Impedance of contacts (MuJoCo, dmin, dmax, width m, midpoint, power): nearly hard."""
TORSION, ROLLING = 0.005, 0.0001  # [m] defaults of MuJoCo, without effect in contacts of three rows
# Bits of contype and conaffinity: two shapes collide if one's contype has a bit of the other's conaffinity.
ROBOT_BIT, GROUND_BIT, FIXTURE_BIT = 1, 2, 4


def add_floor(spec: Any, friction: float) -> None:
    """Add the ground plane z = 0, whose friction counts in all its contacts."""
    mujoco = engine()
    spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 1.0],
        contype=GROUND_BIT,
        conaffinity=0,
        condim=3,
        friction=[friction, TORSION, ROLLING],
        priority=1,
        solref=CONTACT_SOLREF,
        solimp=SOLIMP,
    )


def add_soles(spec: Any, robot: RobotBody) -> None:
    """Add massless balls in the corners of the soles."""
    mujoco = engine()
    for name, foot in robot.profile.feet.items():
        frame = robot.frame(foot.frame)
        corners = sole_corners(np.array(foot.polygon))
        local = np.column_stack([corners, np.full(len(corners), BALL_M)])
        places = frame.position + rotations.rotate(frame.quat, local)
        link = spec.body(robot.body.body_names[frame.body])
        for index, place in enumerate(places):
            link.add_geom(
                name=f"{SOLE}_{name}_{index}",
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[BALL_M, 0.0, 0.0],
                pos=place,
                mass=0.0,
                contype=0,
                conaffinity=GROUND_BIT,
                condim=3,
                group=3,
            )


def sole_corners(polygon: FloatArray) -> FloatArray:
    """Return at most MAX_CORNERS corners (c, 2) m that keep most of the area of a convex polygon (n, 2)."""
    if len(polygon) <= MAX_CORNERS:
        return polygon

    def area(corners: Iterable[int]) -> float:  # shoelace formula, counter-clockwise
        x, y = polygon[list(corners)].T
        return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0

    return np.asarray(polygon[list(max(combinations(range(len(polygon)), MAX_CORNERS), key=area))])


def add_fixtures(spec: Any, scene: Scene, stand: Pose) -> tuple[str, ...]:
    """Add the obstacles of a scene that do not move; return the names of the others."""
    state = SceneState(scene, stand=stand)
    poses, shapes = state.at_rest(0.0), state.shapes
    moving = []
    for row, (name, obstacle) in enumerate(scene.obstacles.items()):
        if motion_of(obstacle).moves:
            moving.append(name)
            continue
        kind, size = mujoco_geom(ShapeKind(int(shapes.kinds[row])), shapes.sizes[row], thinnest=1e-4)
        spec.worldbody.add_geom(
            name=f"{FIXTURE}_{name}",
            type=kind,
            size=size,
            pos=poses.position[row],
            quat=poses.quat[row],
            contype=GROUND_BIT | FIXTURE_BIT,
            conaffinity=0,
            condim=3,
            solref=CONTACT_SOLREF,
            solimp=SOLIMP,
        )
    return tuple(moving)


def sort_shapes(spec: Any, feet: Container[str]) -> None:
    """Set the collisions of the robot's own shapes that have any. feet: links of its feet."""
    for geom in spec.geoms:
        if geom.name.startswith((FLOOR, SOLE, FIXTURE)) or not (geom.contype or geom.conaffinity):
            continue
        geom.contype = ROBOT_BIT
        geom.conaffinity = ROBOT_BIT | (FIXTURE_BIT if geom.parent.name in feet else GROUND_BIT)
