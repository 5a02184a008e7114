"""Where the obstacles of a scene are now: what the file says, unless a live update said otherwise."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from retarget.errors import UsageError, suggest
from retarget.rotations import FloatArray
from retarget.scene import Scene
from retarget.scene_live import LivePose
from retarget.scene_paths import Motion, Rest, motion_of
from retarget.scene_poses import HERE, MovingPose, Pose, carried_by, on_body
from retarget.scene_shapes import SceneShapes, canonical, scene_shapes
from retarget.schema_errors import listed

__all__ = ["ObstaclePoses", "SceneState"]


@dataclass(frozen=True, eq=False)
class ObstaclePoses:
    """k canonical shape frames in the world.

    position (k, 3) m; quat (k, 4) wxyz; linear_velocity (k, 3) m/s of the frames' origins; angular_velocity (k, 3)
    rad/s. All along the world's axes.
    """

    position: FloatArray
    quat: FloatArray
    linear_velocity: FloatArray
    angular_velocity: FloatArray

    def rows(self, which: Sequence[int]) -> "ObstaclePoses":
        """Some of them, by number."""
        return ObstaclePoses(
            *(part[list(which)] for part in (self.position, self.quat, self.linear_velocity, self.angular_velocity))
        )

    def seen_at(self, pace: float) -> "ObstaclePoses":
        """The same, for somebody for whom only `pace` seconds go by in a second."""
        return ObstaclePoses(self.position, self.quat, self.linear_velocity / pace, self.angular_velocity / pace)


@dataclass(frozen=True, slots=True)
class _Track:
    """One obstacle: T_world_frame of the frame that it names, T_obstacle_shape, its motion by the file and live."""

    frame: Pose
    shape: Pose
    motion: Motion
    live: LivePose

    def at(self, time: float) -> MovingPose:
        """Its canonical shape frame in the world."""
        moving = self.live.at(time) or self.motion.at(time)
        if self.frame is not HERE:
            moving = carried_by(self.frame, moving)
        return moving if self.shape == HERE else on_body(moving, self.shape)


class SceneState:
    """The obstacles of a scene over time. stand: T_world_stand. Times are seconds, 0 where those of the file begin."""

    def __init__(self, scene: Scene, *, stand: Pose = HERE) -> None:
        self.shapes: SceneShapes = scene_shapes(scene)
        self._tracks = {
            name: _Track(
                stand if obstacle.frame == "stand" else HERE,
                canonical(obstacle.shape)[2],
                motion_of(obstacle),
                LivePose(),
            )
            for name, obstacle in scene.obstacles.items()
        }
        self._rows = np.zeros((len(self._tracks), 13))
        for row, track in enumerate(self._tracks.values()):
            _write(self._rows[row], track.at(0.0))

    def at(self, time: float) -> ObstaclePoses:
        """Poses and velocities at a time, s; arrays of their own."""
        rows = self._rows.copy()
        for row, track in zip(rows, self._tracks.values(), strict=True):
            if not isinstance(track.motion, Rest) or track.live.age(time) < np.inf:
                _write(row, track.at(time))
        position, quat, linear, angular = (np.ascontiguousarray(part) for part in np.split(rows, (3, 7, 10), axis=1))
        return ObstaclePoses(position, quat, linear, angular)

    def restart(self) -> None:
        """Time begins anew: what was told live is forgotten."""
        for track in self._tracks.values():
            track.live.restart()

    def at_rest(self, time: float) -> ObstaclePoses:
        """Poses at a time, s, without any motion."""
        poses = self.at(time)
        still = np.zeros_like(poses.linear_velocity)
        return ObstaclePoses(poses.position, poses.quat, still, still)

    def update(
        self,
        name: str,
        position: Iterable[float],
        quat: Iterable[float],
        *,
        time: float,
        velocity: Iterable[float] | None = None,
        angular_velocity: Iterable[float] | None = None,
    ) -> bool:
        """Where an obstacle is by measurement; from the first good one on, the file's motion no longer counts.

        All in the frame that the obstacle names in the file, of the obstacle's own frame (which `at` places there).
        Returns whether it was taken; what cannot be used is dropped, counted, and the last good pose stays: see
        `LivePose.update`. Raises UsageError for an unknown name.
        """
        live = self._track(name).live
        return live.update(position, quat, time=time, velocity=velocity, angular_velocity=angular_velocity)

    def dropped(self, name: str) -> int:
        """How many updates of an obstacle were not taken. Raises UsageError for an unknown name."""
        return self._track(name).live.dropped

    def age(self, name: str, now: float) -> float:
        """Age of an obstacle's last good live pose, s; infinite before the first. Raises UsageError as `update`."""
        return self._track(name).live.age(now)

    def _track(self, name: str) -> _Track:
        track = self._tracks.get(name)
        if track is None:
            known = self.shapes.names
            raise UsageError(
                "unknown obstacle",
                found=repr(name[:80]),
                allowed=listed(known),
                next_step=suggest(name, known) or "Name an obstacle of the scene file",
            )
        return track


def _write(row: FloatArray, moving: MovingPose) -> None:
    """A row (13,): position, quat, linear and angular velocity."""
    row[:] = (*moving.pose.position, *moving.pose.quat, *moving.linear, *moving.angular)
