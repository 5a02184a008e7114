"""PlaCo: two levels, hard and soft, in C++; with its self-collision avoidance where observers are given."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import placo

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import Motion
from benchmarks.observed_body import Watched
from benchmarks.observed_shapes import urdf_names, urdf_shapes
from benchmarks.side import DT, LEADING_WEIGHT, N_IK, POSTURE_GAIN, POSTURE_WEIGHT
from benchmarks.urdf import write_urdf
from retarget import rotations

TINY = 1e-6  # regularization that PlaCo's own examples use


class Placo:
    """PlaCo. leading: how centre of mass and ankles are asked: `soft`, by weight, or `hard`, as equality constraints.

    watched: with these observers; its trigger is their influence, its margin theirs. It knows no obstacles.
    """

    def __init__(
        self, body: BenchBody, motion: Motion, *, leading: str = "soft", watched: Watched | None = None
    ) -> None:
        self.failures, self.body, self.leading, self.name = 0, body, leading, f"PlaCo {leading}"
        self.robot = _robot(body) if watched is None else self._watching_robot(body, watched)
        self.joints = [name for name in body.model.joint_names[1:] if name not in set(body.locked_joints)]
        self.root = body.model.body_names[1]
        self.start_from(motion.start)
        solver = self.solver = placo.KinematicsSolver(self.robot)
        solver.dt = DT / N_IK
        solver.enable_joint_limits(True)
        solver.enable_velocity_limits(True)
        self.com = solver.add_com_task(np.zeros(3))
        self.com.mask.set_axises("".join(a for a, w in zip("xyz", motion.com_rows, strict=True) if w > 0.0), "task")
        self.com.configure("com", self.leading, LEADING_WEIGHT)
        self.points = [self.add_point(point.name) for point in body.points]
        self.add_posture(body.attractor)
        if watched is not None:
            constraint = solver.add_avoid_self_collisions_constraint()
            constraint.self_collisions_margin = float(watched.observers.margin.max())
            constraint.self_collisions_trigger = float(watched.observers.influence.max())
            constraint.configure("self collision", "hard")

    def _watching_robot(self, body: BenchBody, watched: Watched) -> Any:
        """The body with our shapes, and our pairs, by number among its shapes."""
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "robot.urdf").write_text(write_urdf(body, urdf_shapes(watched)), encoding="utf-8")
            pairs = Path(folder, "collisions.json")
            pairs.write_text("[]", encoding="utf-8")  # without this file it looks at all pairs, and warns
            robot = placo.RobotWrapper(folder)
            shapes = [robot.collision_model.getGeometryId(name) for name in urdf_names(watched)]
            self.pairs = [(shapes[a], shapes[b]) for a, b in watched.observers.pairs.tolist()]
            pairs.write_text(json.dumps(self.pairs), encoding="utf-8")
            robot.load_collision_pairs(str(pairs))
        return robot

    def start_from(self, q: Floats) -> None:
        """Put the robot into a posture (nq,)."""
        T_world_root = np.eye(4)
        T_world_root[:3, 3], T_world_root[:3, :3] = q[:3], rotations.to_matrix(q[3:7])
        self.robot.set_T_world_frame(self.root, T_world_root)
        for name in self.joints:
            self.robot.set_joint(name, q[self.address(name)])
        self.robot.update_kinematics()

    def address(self, joint: str) -> int:
        """Place of a joint in q."""
        return int(self.body.model.joint_qpos[self.body.model.joint_index(joint)])

    def add_point(self, name: str) -> Any:
        """A position task on a tracked point."""
        task = self.solver.add_position_task(f"bench_{name}", np.zeros(3))
        ankle = "ankle" in name
        task.configure(name, self.leading if ankle else "soft", LEADING_WEIGHT if ankle else 1.0)
        return task

    def add_posture(self, q: Floats) -> None:
        """The attractor, soft. Tasks here have no gain; under 5e-5 the hard variant finds no solution."""
        task = self.solver.add_joints_task()
        task.set_joints({name: q[self.address(name)] for name in self.joints})
        task.configure("posture", "soft", POSTURE_WEIGHT * POSTURE_GAIN)
        self.solver.add_regularization_task(TINY)

    def aim(self, com: Floats, points: Floats) -> None:
        """See `Side`."""
        self.com.target_world = com
        for task, point in zip(self.points, points, strict=True):
            task.target_world = point

    def solve(self) -> None:
        """See `Side`."""
        for _ in range(N_IK):
            try:
                self.solver.solve(True)
            except RuntimeError:  # its QPError: no solution
                self.failures += 1
            self.robot.update_kinematics()

    def posture(self) -> Floats:
        """See `Side`."""
        q = self.body.model.qpos0.copy()
        T_world_root = self.robot.get_T_world_frame(self.root)
        q[:3], q[3:7] = T_world_root[:3, 3], rotations.from_matrix(T_world_root[:3, :3])
        for name in self.joints:
            q[self.address(name)] = self.robot.get_joint(name)
        return q

    def distances(self) -> Floats:
        """What it finds for every pair (p,) m where it stands; NaN for what it does not look at."""
        found = {frozenset((one.objA, one.objB)): one.min_distance for one in self.robot.distances()}
        return np.array([found.pop(frozenset(pair), np.nan) for pair in self.pairs])


def _robot(body: BenchBody) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "robot.urdf").write_text(write_urdf(body), encoding="utf-8")
        return placo.RobotWrapper(folder, placo.Flags.ignore_collisions)
