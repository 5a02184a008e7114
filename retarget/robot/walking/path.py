"""Paths of a walking robot: postures of root and legs for a step pattern, tick by tick, until it stands on both feet.

Soles have priority over the centre of mass, and that over an upright pelvis. Other joints keep their angles.
"""

from dataclasses import dataclass, replace

import numpy as np

from retarget._solver import Solver, Task
from retarget.ik.support_polygon import Stance
from retarget.model.body import JointLimits
from retarget.model.robot import RobotBody
from retarget.robot.walking.pattern import Foothold, Gait, Pattern, Request, Step, modified_sine
from retarget.rotations import Quat, as_quat, as_vector, inverse, product, rotated, rotation_vector, turn
from retarget.types import BoolArray, FloatArray

ROOT = 1
"""The link from which the legs hang."""


@dataclass(frozen=True, eq=False)
class WalkPath:
    """A path to a stand. postures (k, nq): world; pattern: of as many rows. step: the first; None: the robot comes to
    rest. touchdown: last row of the step; speed: its mean velocity. since: row of the path before."""

    postures: FloatArray
    pattern: Pattern
    step: Step | None
    touchdown: int
    speed: Request
    since: int

    @property
    def feet(self) -> tuple[Foothold, Foothold]:
        """Both footholds at the end."""
        return self.pattern.feet(-1)


@dataclass(frozen=True, eq=False)
class Sketch:
    """A path in the making. postures: so far. velocity (nv,): in the first. offset (3,) m, turned (3,) rad: of mass and
    root from the pattern, which fade in `ease` ticks."""

    path: WalkPath
    postures: list[FloatArray]
    velocity: FloatArray
    offset: FloatArray
    turned: FloatArray
    ease: int


class PathPlanner:
    """Makes the paths of one robot, a few postures in each tick."""

    def __init__(self, robot: RobotBody, stance: Stance, limits: JointLimits, carrying: BoolArray, gait: Gait) -> None:
        """limits (nv,): for the postures. carrying (nv,): root and joints of the legs."""
        self._body, self._gait = robot.body.solver_body(), gait
        self._soles = stance.soles
        upright = self._body.orientations(stance.q[None], [ROOT])[0, 0]
        self._upright = as_quat(upright)
        self._middles = [sole.outline.mean(axis=0) - sole.position[:2] for sole in stance.soles]
        frames = [sole.frame for sole in stance.soles]
        soles = [Task.position(frame.body, as_vector(frame.position)) for frame in frames]
        soles += [Task.orientation(frame.body, as_quat(frame.quat)) for frame in frames]
        self._solver = Solver(
            self._body,
            [soles, [Task.centre_of_mass(weight=(1.0, 1.0, 1.0))], [Task.orientation(ROOT)]],
            lower=limits.lower,
            upper=limits.upper,
            max_velocity=limits.max_velocity,
            max_acceleration=limits.max_acceleration,
            locked=~carrying,
            n_ik=2,
            damping=0.0,
        )
        self._targets = np.zeros(self._solver.target_size)
        self._places = [slice(*self._solver.target_slice(0, k)) for k in range(4)]
        self._mass, self._root = slice(*self._solver.target_slice(1, 0)), slice(*self._solver.target_slice(2, 0))

    def mass(self, q: FloatArray) -> FloatArray:
        """Centre of mass (3,) m of a posture (nq,)."""
        mass: FloatArray = self._body.centre_of_mass(q[None])[0]
        return mass

    def velocity(self, before: FloatArray, now: FloatArray) -> FloatArray:
        """Velocity (nv,) between two postures (nq,) of consecutive ticks."""
        return self._body.difference(before, now) / self._gait.dt

    def off(self, q: FloatArray, mass: FloatArray, yaw: float) -> tuple[FloatArray, FloatArray]:
        """Offset (3,) m of a posture's mass from a place, and turn (3,) rad of its root from upright."""
        root = as_quat(self._body.orientations(q[None], [ROOT])[0, 0])
        return self.mass(q) - mass, np.array(rotation_vector(product(root, inverse(self._pelvis(yaw)))))

    def advance(self, sketch: Sketch, rows: int) -> WalkPath | None:
        """Make some more rows. Returns the path once it is whole, else None."""
        solver, pattern, done = self._solver, sketch.path.pattern, len(sketch.postures)
        if done == 1:
            solver.reset(sketch.postures[0], sketch.velocity)
        mass, yaws, whole = pattern.mass, pattern.yaws.tolist(), len(pattern.zmp)
        for row in range(done, min(done + rows, whole)):
            left = 1.0 - modified_sine(row / sketch.ease)
            self._aim(pattern.soles[row], mass[row] + left * sketch.offset, yaws[row], left * sketch.turned)
            sketch.postures.append(solver.frame(self._targets, self._gait.dt, 1.0))
        if len(sketch.postures) < whole:
            return None
        return replace(sketch.path, postures=np.array(sketch.postures))

    def _aim(self, soles: FloatArray, mass: FloatArray, yaw: float, turned: FloatArray) -> None:
        targets = self._targets
        for k, (sole, middle, pose) in enumerate(zip(self._soles, self._middles, soles, strict=True)):
            about = turn((0.0, 0.0, float(pose[3])))
            place = pose[:3] - np.array(rotated(about, (float(middle[0]), float(middle[1]), 0.0)))
            targets[self._places[k]] = (1.0, *place)
            targets[self._places[2 + k]] = (1.0, *product(about, as_quat(sole.orientation)))
        targets[self._mass] = (1.0, *mass)
        targets[self._root] = (1.0, *product(turn(as_vector(turned)), self._pelvis(yaw)))

    def _pelvis(self, yaw: float) -> Quat:
        return product(turn((0.0, 0.0, yaw)), self._upright)
