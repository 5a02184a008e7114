"""Swept clearance: the collision check of the gate along a path of goals, and contact at the start of a motion."""

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from retarget import _solver
from retarget.errors import Problem, UsageError
from retarget.ik.hierarchy import SceneObstacles
from retarget.ik.whole_body_stop import StopPath
from retarget.model.observers import Contact, Observers, contacts
from retarget.model.robot import RobotBody
from retarget.model.scene_state import SceneState
from retarget.types import FloatArray

REMEMBERED_S = 0.25
"""[s] A servo at a goal of this last period lags; one elsewhere has left its trajectory."""
ROUNDING_TICKS = 2.0
"""[encoder steps] Error of a good servo."""


class FollowingError:
    """The servo errors that goals of the last REMEMBERED_S do not explain."""

    def __init__(self, tick_rad: FloatArray, *, dt: float) -> None:
        """tick_rad (n,): rad per encoder step."""
        self._slack = ROUNDING_TICKS * np.abs(tick_rad)
        self._goals = np.zeros((max(2, round(REMEMBERED_S / dt)), tick_rad.size))
        self._row = 0

    def seed(self, position: FloatArray) -> None:
        """Use `position` (n,) rad for all earlier goals."""
        self._goals[:] = position

    def sent(self, goal: FloatArray) -> None:
        """Remember a goal (n,) rad."""
        self._row = (self._row + 1) % len(self._goals)
        self._goals[self._row] = goal

    def unexplained(self, measured: FloatArray) -> FloatArray:
        """Signed distance (n,) rad of `measured` (n,) from the range of the last goals; 0 within."""
        lo, hi = self._goals.min(axis=0) - self._slack, self._goals.max(axis=0) + self._slack
        off: FloatArray = measured - np.minimum(np.maximum(measured, lo), hi)
        return off


KEPT_SHARE = 0.25
"""Share of each pair's margin that the gate requires; at the whole margin, which observers control, it would refuse
their rounding."""
SERVOS_SHARE = 0.25
"""The same for measured positions: the straight line to the goal cuts corners of the servos' real path."""

WALK_SAMPLES = 600  # postures at most in one step of a walk, in which the shins pass each other closely
TIGHTEN = "fit their observers closer (retarget fit-observers), or put the pair into ignore_pairs if it cannot meet"
"""Advice about two links for which the gate refuses goals."""

Pair = tuple[int, int | None, int | None]  # an observer, and another observer or an obstacle


class PathClearance:
    """The collision check of one robot along two paths: that of the goals, from the posture sent last to the goal and
    on to rest; and from the measured positions to the goal, and on to rest with any error that lag does not explain
    (deflection, play, slip). Servos that only lag pass the same places later."""

    def __init__(
        self, robot: RobotBody, observers: _solver.Observers, scene_obstacles: SceneObstacles, *, dt: float
    ) -> None:
        feet = [robot.frame(foot.frame) for foot in robot.profile.feet.values()] if robot.stands else []
        self._checker = _solver.PathChecker(
            robot.body.solver_body(),
            observers,
            columns=robot.servo_columns,
            sole_links=[foot.body for foot in feet],
            sole_points=np.array([foot.position for foot in feet]).reshape(-1, 3),
        )
        self._obstacles = scene_obstacles
        self._dt = dt
        self._following = FollowingError(robot.joint_map.tick_rad, dt=dt)
        self._measured: FloatArray | None = None
        self._refused: Pair | None = None  # on the last path
        self._first: Pair | None = None  # on the first refused path of this tick
        self.refusals = Counter[Pair]()
        """Earlier ticks in which each pair was the first to be refused."""

    def begin(self, position: FloatArray) -> None:
        """Begin with the servos at `position` (n,) rad."""
        self._checker.restart()
        self._following.seed(position)
        self._measured = None

    def measure(self, position: FloatArray, sent: FloatArray) -> None:
        """Begin a tick with the measured joint positions (n,) rad. sent (n,): the posture commanded in the last tick,
        rad."""
        self._following.sent(sent)
        self._measured = position
        if self._first is not None:
            self.refusals[self._first] += 1
            self._first = None

    def limiting_pair(self, names: Sequence[str]) -> str:
        """The two parts for which the last path was refused, or ""."""
        if self._refused is None:
            return ""
        return " and ".join(self.names_of(self._refused, names))

    def names_of(self, pair: Pair, names: Sequence[str]) -> tuple[str, str]:
        """Names of a pair. names: of observers, or of their links."""
        one, other, obstacle = pair
        return names[one], names[other] if other is not None else self._obstacles.shapes.names[obstacle or 0]

    def __call__(
        self, path: FloatArray, instead: FloatArray, standing: FloatArray, *, walk: StopPath | None = None
    ) -> bool:
        """True if a path of postures (k, n) rad is clear, a row per tick from the present posture to rest.

        instead (k, n): the path after a refusal. standing (nq,): the present posture. walk: its stance.
        """
        self._obstacles.look()
        poses = self._obstacles.now
        if poses is not None:
            self._checker.set_obstacles(poses.position, poses.quat, poses.linear_velocity, poses.angular_velocity)
        clear = self._is_clear(path, instead, standing, walk, share=KEPT_SHARE)
        measured = self._measured
        clear = clear and (measured is None or self._servos_are_clear(path, instead, standing, measured, walk))
        self._refused = None if clear else self._checker.refused
        self._first = self._first or self._refused
        return clear

    def _is_clear(
        self,
        path: FloatArray,
        instead: FloatArray,
        standing: FloatArray,
        walk: StopPath | None,
        *,
        share: float,
        remember: bool = True,
    ) -> bool:
        checker, dt = self._checker, self._dt
        if walk is None or walk.carries is None:
            return checker.is_clear(standing, path, dt=dt, share=share, instead=instead, remember=remember)
        # Obstacles are placed from the carrying sole: the path is cut where another one carries alone.
        alone, end = np.logical_not(walk.carries.all(axis=1)), len(path) - 1
        cuts = 3 + np.flatnonzero(alone[1:] & ~alone[:-1])
        for first, last in pairwise([0, *cuts[cuts < end].tolist(), end]):
            stands = walk.postures[first - 1] if first else standing
            rows, other = path[first : last + 1], instead[min(first, len(instead) - 1) : last + 1]
            kept = remember and not first
            if not checker.is_clear(stands, rows, dt=dt, share=share, instead=other, remember=kept, looks=WALK_SAMPLES):
                return False
        return True

    def _servos_are_clear(
        self,
        path: FloatArray,
        instead: FloatArray,
        standing: FloatArray,
        measured: FloatArray,
        walk: StopPath | None,
    ) -> bool:
        off = self._following.unexplained(measured)
        rows = len(path) if off.any() else 2  # without an error, the rest is the checked path of goals
        measured_path, other = path[:rows] + off, instead[:rows] + off
        measured_path[0] = other[0] = measured
        return self._is_clear(measured_path, other, standing, walk, share=SERVOS_SHARE, remember=False)


NEAR_SOLE_M = 1e-3
"""[m] An obstacle this near to a sole carries it."""


def refuse_contact(found: tuple[Contact, ...], *, where: str) -> None:
    """Raise UsageError that names all contacts. where: for the message."""
    if found:
        raise UsageError.from_problems(
            [
                Problem(
                    f"{contact.part} touches {contact.other} at the start",
                    where=where,
                    found=f"{1e3 * contact.depth:.1f} mm deep",
                    allowed="a start clear of contact",
                    next_step="Move the obstacle or the start, or give --allow-contact: then links that touch may only "
                    "move apart",
                )
                for contact in found
            ]
        )


def refuse_floor(robot: RobotBody, observers: Observers, scene: SceneState, q: FloatArray) -> None:
    """Raise UsageError if an obstacle is under the soles in posture q (nq,)."""
    feet = {name for name, stands in zip(observers.names, observers.stands.tolist(), strict=True) if stands}
    for contact in contacts(robot.body, observers, scene, q, deeper_than=-NEAR_SOLE_M):
        if contact.part in feet and contact.other in scene.shapes.names:
            raise UsageError(
                f"{contact.part} stands on {contact.other}",
                where="--scene",
                allowed="what the robot stands on is ground",
                next_step=f"Write `ground: true` for {contact.other}, or leave it out: there is always a floor",
            )
