"""Where an obstacle is at a time, as its file says: at rest, with a velocity, or along a path."""

from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from math import fmod, inf
from typing import Protocol

from retarget.scalar_rotations import Vector, inverse, minus, plus, product, rotation_vector, turn
from retarget.scene_parts import Obstacle, PathPoint
from retarget.scene_poses import STILL, MovingPose, Pose, unit

__all__ = ["Drift", "Motion", "Path", "Rest", "motion_of"]


class Motion(Protocol):
    """How an obstacle's own frame moves in the frame that the obstacle names."""

    def at(self, time: float) -> MovingPose:
        """Pose and velocities at a time, s. Where the velocity jumps, the later one."""
        ...


@dataclass(frozen=True, slots=True)
class Rest:
    """An obstacle that stays."""

    pose: Pose

    def at(self, time: float) -> MovingPose:
        """Always the same."""
        return MovingPose(self.pose)


@dataclass(frozen=True, slots=True)
class Drift:
    """Constant velocity, m/s, and angular velocity, rad/s, from `start` until `until`, s; at rest before and after."""

    pose: Pose
    linear: Vector
    angular: Vector
    start: float
    until: float

    def at(self, time: float) -> MovingPose:
        """As for every motion."""
        pose = _moved(self.pose, self.linear, self.angular, min(max(time, self.start), self.until) - self.start)
        if self.start <= time < self.until:
            return MovingPose(pose, self.linear, self.angular)
        return MovingPose(pose)


@dataclass(frozen=True, slots=True)
class _Piece:
    """A stretch of a path, with constant velocities, from the pose at its beginning."""

    pose: Pose
    linear: Vector
    angular: Vector


@dataclass(frozen=True, slots=True)
class Path:
    """Poses at times: straight lines and the short arcs, each at constant speed; at rest before and after.

    times (m): rising, s. pieces (m): the last one rests. loop: after the last time it begins anew.
    """

    times: tuple[float, ...]
    pieces: tuple[_Piece, ...]
    loop: bool

    @classmethod
    def through(cls, points: tuple[PathPoint, ...], *, loop: bool) -> "Path":
        """The path through the points of a file."""
        poses = [Pose(point.pos, unit(point.quat)) for point in points]
        times = tuple(point.time for point in points)
        pieces = [
            _piece(before, after, later - earlier)
            for (before, after), (earlier, later) in zip(pairwise(poses), pairwise(times), strict=True)
        ]
        return cls(times, (*pieces, _Piece(poses[-1], STILL, STILL)), loop)

    def at(self, time: float) -> MovingPose:
        """As for every motion."""
        first, last = self.times[0], self.times[-1]
        if time < first:
            return MovingPose(self.pieces[0].pose)
        if self.loop:
            time = first + fmod(time - first, last - first)
        index = bisect_right(self.times, time) - 1
        if self.loop:
            index = min(index, len(self.times) - 2)  # rounding may reach the last time; a loop never rests there
        piece = self.pieces[index]
        pose = _moved(piece.pose, piece.linear, piece.angular, time - self.times[index])
        return MovingPose(pose, piece.linear, piece.angular)


def motion_of(obstacle: Obstacle) -> Motion:
    """The motion that the file gives to an obstacle."""
    if obstacle.path is not None:
        return Path.through(obstacle.path, loop=obstacle.loop)
    pose = Pose(obstacle.at.pos, unit(obstacle.at.quat))
    if obstacle.velocity is None and obstacle.angular_velocity is None:
        return Rest(pose)
    until = inf if obstacle.until is None else obstacle.until
    return Drift(pose, obstacle.velocity or STILL, obstacle.angular_velocity or STILL, obstacle.start, until)


def _piece(before: Pose, after: Pose, duration: float) -> _Piece:
    angular = rotation_vector(product(after.quat, inverse(before.quat)))
    return _Piece(
        before, _scaled(minus(after.position, before.position), 1.0 / duration), _scaled(angular, 1.0 / duration)
    )


def _moved(pose: Pose, linear: Vector, angular: Vector, duration: float) -> Pose:
    """After some time at constant velocities: p + v t, exp(w t) q."""
    return Pose(
        plus(pose.position, _scaled(linear, duration)), unit(product(turn(_scaled(angular, duration)), pose.quat))
    )


def _scaled(vector: Vector, factor: float) -> Vector:
    return (factor * vector[0], factor * vector[1], factor * vector[2])
