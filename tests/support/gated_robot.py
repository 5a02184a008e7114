"""OP3 behind a gate that looks at collision, without servos: what the tests of the gate's collision part share."""

from itertools import pairwise

import numpy as np

from followers import DT, op3, stance
from gates import DrivenGate, admit
from observed import scene_of as scene_of
from observed import sphere as sphere
from retarget import _solver
from retarget.ik.hierarchy import SceneObstacles
from retarget.model.observers import Observers, placed, robot_observers
from retarget.model.robot import plant_roots
from retarget.model.scene_state import SceneState
from retarget.safety.clearance import KEPT_SHARE, PathClearance
from retarget.safety.gate import Gate
from retarget.types import FloatArray

SUBSTEPS = 20


class GatedRobot:
    """Stands in its stance, at rest. `sent` (n,) is where it was sent last, `q` (nq,) the same with its root."""

    def __init__(self, state: SceneState | None = None, *, watched: bool = True) -> None:
        self.robot, self.state = op3(), state
        self.observers: Observers = robot_observers(self.robot)
        self.obstacles = SceneObstacles(state)
        compiled = self.observers.for_solver(self.robot.body, self.obstacles.shapes)
        self.clearance = PathClearance(self.robot, compiled, self.obstacles, dt=DT)
        self.q = stance().q
        gate = Gate(self.robot.joint_map, dt=DT, clearance=self.clearance if watched else None)
        self.gate = DrivenGate(gate, self.sent, self.q)
        self.clearance.begin(self.sent)

    @property
    def sent(self) -> FloatArray:
        return self.q[self.robot.servo_columns]

    def ask(self, goal: FloatArray) -> bool:
        """One tick. Returns whether the goal is what was sent."""
        sent = admit(self.gate, goal)
        self.q = self.gate.standing = self.standing(sent[None])[0]
        return bool(np.array_equal(sent, goal))

    def way_through(self, goal: FloatArray) -> FloatArray:
        """Servo angles (k, n), tick by tick, to a goal (n,) and on to rest, as fast as the slowest joint can."""
        step, change = goal - self.sent, self.robot.joint_map.max_acceleration * DT**2
        ticks = max(1.0, float((np.abs(step) / change).max()))
        left = np.maximum(1.0 - np.arange(60) / ticks, 0.0)
        assert left[-1] == 0.0
        return np.asarray(self.sent + np.multiply.outer(np.cumsum(left), step))

    def standing(self, rows: FloatArray) -> FloatArray:
        """Postures (T, nq) with these servo angles (T, n), on the sole that is planted now."""
        q = np.repeat(self.q[None], len(rows), axis=0)
        q[:, self.robot.servo_columns] = rows
        plant_roots(self.robot, np.repeat(self.q[None], len(rows), axis=0), q)
        return q

    def between(self, rows: FloatArray, substeps: int = SUBSTEPS) -> FloatArray:
        """Servo angles on straight lines from row to row."""
        share = np.arange(1, substeps + 1)[:, None] / substeps
        parts = [before + share * (after - before) for before, after in pairwise(rows)]
        return np.concatenate([rows[:1], *parts])

    def distances(self, rows: FloatArray) -> FloatArray:
        """Distance (T, pairs) m of all pairs that the gate looks at, the scene as it is now, for angles (T, n)."""
        found = [self._distances(q) for q in self.standing(rows)]
        return np.array(found)

    def kept(self) -> FloatArray:
        """What the gate keeps of each pair, m."""
        n, margin = len(self.observers.names), self.observers.margin
        own = margin[self.observers.pairs].max(axis=1)
        scene = self.obstacles.shapes.margin
        return KEPT_SHARE * np.concatenate([own, np.maximum(np.repeat(scene, n), np.tile(margin, len(scene)))])

    def _distances(self, q: FloatArray) -> FloatArray:
        obs, shapes, now = self.observers, self.obstacles.shapes, self.obstacles.now
        position, quat = placed(self.robot.body, obs, q)
        n, k = len(obs.names), len(shapes.names)
        kinds, sizes = np.concatenate([obs.kinds, shapes.kinds]), np.concatenate([obs.sizes, shapes.sizes])
        if now is not None:
            position, quat = np.concatenate([position, now.position]), np.concatenate([quat, now.quat])
        scene_pairs = np.array([(a, n + b) for b in range(k) for a in range(n)], dtype=np.int64).reshape(-1, 2)
        pairs = np.concatenate([obs.pairs, scene_pairs])
        sides = [np.ascontiguousarray(x[pairs[:, s]]) for s in (0, 1) for x in (kinds, sizes, position, quat)]
        return _solver.shape_distances(*sides)[0]
