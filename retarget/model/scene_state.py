"""Scene state: poses and velocities of obstacles, by the motions of the file or by live updates."""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from math import fmod, inf, isfinite, sqrt

import numpy as np

from retarget.errors import UsageError, suggest
from retarget.model.meshes import Mesh, shape_mesh
from retarget.model.scene_shapes import SceneShapes, canonical, scene_shapes
from retarget.rotations import Vector, inverse, length, minus, plus, product, rotation_vector, turn
from retarget.schema.scene import FLOOR, HERE, NO_MOTION, MovingPose, Obstacle, Pose, Scene, carried_by, on_body, unit
from retarget.schema.shapes import MAX_COORDINATE
from retarget.schema.strict_models import listed
from retarget.types import FloatArray


@dataclass(frozen=True, slots=True)
class ObstacleMotion:
    """A motion of constant velocities. times (m): rising starts, s; pieces (m): pose and velocity from each start on.
    loop: it repeats from the last time on."""

    times: tuple[float, ...]
    pieces: tuple[MovingPose, ...]
    loop: bool = False

    @property
    def moves(self) -> bool:
        """True if it ever moves."""
        return any(not _rests(piece) for piece in self.pieces)

    def at(self, time: float) -> MovingPose:
        """Pose and velocities at a time, s; the later ones at a jump."""
        first, last = self.times[0], self.times[-1]
        if time < first:
            return MovingPose(self.pieces[0].pose)
        if self.loop:
            time = first + fmod(time - first, last - first)
        index = bisect_right(self.times, time) - 1
        if self.loop:
            index = min(index, len(self.times) - 2)  # rounding may give the last time
        piece = self.pieces[index]
        return piece if _rests(piece) else _moved(piece, time - self.times[index])


def motion_of(obstacle: Obstacle) -> ObstacleMotion:
    """Motion of an obstacle by its file."""
    if obstacle.path is not None:
        poses = [Pose(point.pos, unit(point.quat)) for point in obstacle.path]
        times = tuple(point.time for point in obstacle.path)
        pieces = []
        for (before, after), (earlier, later) in zip(pairwise(poses), pairwise(times), strict=True):
            angular = rotation_vector(product(after.quat, inverse(before.quat)))
            moved, share = minus(after.position, before.position), 1.0 / (later - earlier)
            pieces.append(MovingPose(before, _scaled(moved, share), _scaled(angular, share)))
        return ObstacleMotion(times, (*pieces, MovingPose(poses[-1])), obstacle.loop)
    pose = Pose(obstacle.at.pos, unit(obstacle.at.quat))
    moving = MovingPose(pose, obstacle.velocity or NO_MOTION, obstacle.angular_velocity or NO_MOTION)
    return _until(moving, obstacle.start, inf if obstacle.until is None else obstacle.until)


def _until(moving: MovingPose, start: float, end: float) -> ObstacleMotion:
    if end == inf:
        return ObstacleMotion((start,), (moving,))
    return ObstacleMotion((start, end), (moving, MovingPose(_moved(moving, end - start).pose)))


def _rests(moving: MovingPose) -> bool:
    return moving.linear == NO_MOTION and moving.angular == NO_MOTION


def _moved(moving: MovingPose, duration: float) -> MovingPose:
    """Pose after some time at constant velocities: p + v t, exp(w t) q."""
    quat = unit(product(turn(_scaled(moving.angular, duration)), moving.pose.quat))
    position = plus(moving.pose.position, _scaled(moving.linear, duration))
    return MovingPose(Pose(position, quat), moving.linear, moving.angular)


def _scaled(vector: Vector, factor: float) -> Vector:
    return (factor * vector[0], factor * vector[1], factor * vector[2])


LIVE_SPEED = 10.0
"""Bound of live velocities, m/s, against jumps of the tracker."""
LIVE_TURN = 20.0
"""Bound of live angular velocities, rad/s."""
VELOCITY_HOLDS = 0.2
"""Time for which a silent obstacle keeps its velocity, s."""

Numbers = Iterable[float]


@dataclass(frozen=True, slots=True)
class _Seen:
    """A valid update; None for velocities that were not sent."""

    time: float
    pose: Pose
    linear: Vector | None
    angular: Vector | None


@dataclass(frozen=True, slots=True)
class _Held:
    last: _Seen
    before: _Seen | None
    motion: ObstacleMotion


class LivePose:
    """The last valid pose of an obstacle, atomic for another thread. dropped: number of invalid updates."""

    def __init__(self) -> None:
        self.dropped = 0
        self._held: _Held | None = None

    def update(
        self,
        position: Numbers,
        quat: Numbers,
        *,
        time: float,
        velocity: Numbers | None = None,
        angular_velocity: Numbers | None = None,
    ) -> bool:
        """Take a pose; True if it is valid.

        Numbers must be finite, within 1000 m, in rising time. The default velocity is that between the last two poses.
        """
        seen = _read(position, quat, time, velocity, angular_velocity)
        held = self._held
        if seen is None or (held is not None and seen.time < held.last.time):
            self.dropped += 1
            return False
        before = None if held is None else held.last if held.last.time < seen.time else held.before
        motion = _until(_moving(seen, before), seen.time, seen.time + VELOCITY_HOLDS)
        self._held = _Held(seen, before, motion)
        return True

    def restart(self) -> None:
        """Delete all poses."""
        self._held = None

    def at(self, time: float) -> MovingPose | None:
        """Last valid pose (m, wxyz) and its velocities, which end after VELOCITY_HOLDS; None before the first."""
        held = self._held
        return None if held is None else held.motion.at(max(time, held.last.time))

    def age(self, now: float) -> float:
        """Age of the last valid pose, s; infinite before the first."""
        held = self._held
        return inf if held is None else max(0.0, now - held.last.time)


def _read(
    position: Numbers, quat: Numbers, time: float, velocity: Numbers | None, angular_velocity: Numbers | None
) -> _Seen | None:
    try:
        x, y, z = map(float, position)
        w, i, j, k = map(float, quat)
        linear = None if velocity is None else _vector(velocity)
        angular = None if angular_velocity is None else _vector(angular_velocity)
        seconds = float(time)
    except (TypeError, ValueError, OverflowError):
        return None
    numbers = (seconds, x, y, z, w, i, j, k, *(linear or ()), *(angular or ()))
    norm = sqrt(w * w + i * i + j * j + k * k)
    if not all(map(isfinite, numbers)) or max(abs(x), abs(y), abs(z)) > MAX_COORDINATE or not 1e-6 < norm < 1e6:
        return None
    return _Seen(seconds, Pose((x, y, z), unit((w, i, j, k))), linear, angular)


def _vector(numbers: Numbers) -> Vector:
    x, y, z = map(float, numbers)
    return (x, y, z)


def _moving(seen: _Seen, before: _Seen | None) -> MovingPose:
    """The pose with velocities, sent or from the last update, within bounds."""
    linear, angular = seen.linear or NO_MOTION, seen.angular or NO_MOTION
    if before is not None:
        step = seen.time - before.time
        if seen.linear is None:
            linear = _rate(minus(seen.pose.position, before.pose.position), step, LIVE_SPEED)
        if seen.angular is None:
            angular = _rate(rotation_vector(product(seen.pose.quat, inverse(before.pose.quat))), step, LIVE_TURN)
    return MovingPose(seen.pose, _rate(linear, 1.0, LIVE_SPEED), _rate(angular, 1.0, LIVE_TURN))


def _rate(moved: Vector, step: float, bound: float) -> Vector:
    far = length(moved)
    if far > bound * step:
        return (bound / far * moved[0], bound / far * moved[1], bound / far * moved[2])
    return (moved[0] / step, moved[1] / step, moved[2] / step)


@dataclass(frozen=True, eq=False)
class ObstaclePoses:
    """Canonical frames of k shapes in the world: position (k, 3) m, quat (k, 4) wxyz, linear_velocity (k, 3) m/s,
    angular_velocity (k, 3) rad/s."""

    position: FloatArray
    quat: FloatArray
    linear_velocity: FloatArray
    angular_velocity: FloatArray


@dataclass(frozen=True, slots=True)
class _Track:
    """One obstacle: T_world_frame, T_obstacle_shape, motion by the file, and live pose."""

    frame: Pose
    shape: Pose
    motion: ObstacleMotion
    moves: bool
    live: LivePose

    def at(self, time: float) -> MovingPose:
        """Its canonical shape frame in the world."""
        moving = self.live.at(time) or self.motion.at(time)
        if self.frame is not HERE:
            moving = carried_by(self.frame, moving)
        return moving if self.shape == HERE else on_body(moving, self.shape)


class SceneState:
    """The obstacles of a scene over time, s, from 0. stand: T_world_stand."""

    def __init__(self, scene: Scene, *, stand: Pose = HERE) -> None:
        self.shapes: SceneShapes = scene_shapes(scene)
        self._tracks: dict[str, _Track] = {}
        for name, obstacle in scene.obstacles.items():
            frame, motion = stand if obstacle.frame == "stand" else HERE, motion_of(obstacle)
            self._tracks[name] = _Track(frame, canonical(obstacle.shape)[2], motion, motion.moves, LivePose())
        self._rows = np.zeros((len(self._tracks), 13))
        for row, track in enumerate(self._tracks.values()):
            _write(self._rows[row], track.at(0.0))

    def at(self, time: float) -> ObstaclePoses:
        """Poses and velocities at a time, s."""
        rows = self._rows.copy()
        for row, track in zip(rows, self._tracks.values(), strict=True):
            if track.moves or track.live.age(time) < np.inf:
                _write(row, track.at(time))
        parts = (slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13))
        return ObstaclePoses(*[np.ascontiguousarray(rows[:, part]) for part in parts])

    def restart(self) -> None:
        """Start time anew, without live poses."""
        for track in self._tracks.values():
            track.live.restart()

    def at_rest(self, time: float) -> ObstaclePoses:
        """Poses at a time, s, with zero velocities."""
        poses = self.at(time)
        still = np.zeros_like(poses.linear_velocity)
        return ObstaclePoses(poses.position, poses.quat, still, still)

    def live(self, name: str) -> LivePose:
        """Live pose of an obstacle in the frame that it names; its updates replace the file's motion. Raises
        UsageError."""
        track = self._tracks.get(name)
        if track is None:
            known = self.shapes.names
            raise UsageError(
                "unknown obstacle",
                found=repr(name[:80]),
                allowed=listed(known),
                next_step=suggest(name, known) or "Name an obstacle of the scene file",
            )
        return track.live


def _write(row: FloatArray, moving: MovingPose) -> None:
    row[:] = (*moving.pose.position, *moving.pose.quat, *moving.linear, *moving.angular)


def obstacle_meshes(shapes: SceneShapes) -> list[Mesh]:
    """Obstacles of a scene without the floor, each in its own frame."""
    solid = zip(shapes.names, shapes.kinds, shapes.sizes, strict=True)
    return [shape_mesh(int(kind), size) for name, kind, size in solid if name != FLOOR]


def obstacle_poses(shapes: SceneShapes, poses: ObstaclePoses) -> FloatArray:
    """Their poses (o, 7): position, m, and quaternion."""
    return np.column_stack([poses.position, poses.quat])[[name != FLOOR for name in shapes.names]]
