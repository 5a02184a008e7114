"""The live pose of one obstacle: updates from outside are judged, the last good one is kept, and its age is known."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import hypot, inf, isfinite

from retarget.scalar_rotations import Vector, inverse, minus, product, rotation_vector, turn
from retarget.scene_poses import STILL, MovingPose, Pose, unit
from retarget.solid_shapes import MAX_COORDINATE

__all__ = ["LIVE_SPEED", "LIVE_TURN", "VELOCITY_HOLDS", "LivePose"]

LIVE_SPEED = 10.0
"""Live velocities are cut to this, m/s: a jump of the tracker is no throw."""
LIVE_TURN = 20.0
"""Live angular velocities are cut to this, rad/s."""
VELOCITY_HOLDS = 0.2
"""A live obstacle goes on at its velocity for so long, s, when it is silent; then it is taken to rest."""

Numbers = Iterable[float]


@dataclass(frozen=True, slots=True)
class _Seen:
    """A good update; velocities that were not told are None."""

    time: float
    pose: Pose
    linear: Vector | None
    angular: Vector | None


@dataclass(frozen=True, slots=True)
class _Held:
    """The last good update, with velocities, and the one before it."""

    last: _Seen
    before: _Seen | None
    moving: MovingPose


class LivePose:
    """The last good pose of an obstacle. A reader in another thread sees an update as a whole or not at all.

    dropped: updates that were not taken.
    """

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
        """Take a pose; whether it was good.

        Dropped and counted: what is not finite, not of its length or farther than 1000 m, a quaternion of length
        zero, a time before the last good one. A second update of the same time replaces the first. A velocity that is
        not given is that between the last two good poses of different times.
        """
        seen = _read(position, quat, time, velocity, angular_velocity)
        held = self._held
        if seen is None or (held is not None and seen.time < held.last.time):
            self.dropped += 1
            return False
        before = None if held is None else held.last if held.last.time < seen.time else held.before
        self._held = _Held(seen, before, _moving(seen, before))
        return True

    def restart(self) -> None:
        """Forget every pose, because time begins anew; what was dropped stays counted."""
        self._held = None

    def at(self, time: float) -> MovingPose | None:
        """The last good pose gone on at its velocities for as long as they hold, then at rest; None before the
        first."""
        held = self._held
        if held is None:
            return None
        age = time - held.last.time
        (x, y, z), moving = held.last.pose.position, held.moving
        gone = min(max(age, 0.0), VELOCITY_HOLDS)
        (u, v, w), (p, q, r) = moving.linear, moving.angular
        turned = product(turn((gone * p, gone * q, gone * r)), held.last.pose.quat)
        there = Pose((x + gone * u, y + gone * v, z + gone * w), turned) if gone > 0.0 else held.last.pose
        return MovingPose(there, moving.linear, moving.angular) if age <= VELOCITY_HOLDS else MovingPose(there)

    def age(self, now: float) -> float:
        """How old the last good pose is, s; infinite before the first."""
        held = self._held
        return inf if held is None else max(0.0, now - held.last.time)


def _read(
    position: Numbers, quat: Numbers, time: float, velocity: Numbers | None, angular_velocity: Numbers | None
) -> _Seen | None:
    """The update, or None where anything of it is unusable."""
    try:
        x, y, z = map(float, position)
        w, i, j, k = map(float, quat)
        linear = None if velocity is None else _vector(velocity)
        angular = None if angular_velocity is None else _vector(angular_velocity)
        moment = float(time)
    except (TypeError, ValueError, OverflowError):
        return None
    numbers = (moment, x, y, z, w, i, j, k, *(linear or ()), *(angular or ()))
    norm = hypot(w, i, j, k)
    if not all(map(isfinite, numbers)) or max(abs(x), abs(y), abs(z)) > MAX_COORDINATE or not 1e-6 < norm < 1e6:
        return None
    return _Seen(moment, Pose((x, y, z), unit((w, i, j, k))), linear, angular)


def _vector(numbers: Numbers) -> Vector:
    x, y, z = map(float, numbers)
    return (x, y, z)


def _moving(seen: _Seen, before: _Seen | None) -> MovingPose:
    """The pose with velocities: those told, else those since the update before, else none; cut to the bounds."""
    linear, angular = seen.linear or STILL, seen.angular or STILL
    if before is not None:
        step = seen.time - before.time
        if seen.linear is None:
            linear = _rate(minus(seen.pose.position, before.pose.position), step, LIVE_SPEED)
        if seen.angular is None:
            angular = _rate(rotation_vector(product(seen.pose.quat, inverse(before.pose.quat))), step, LIVE_TURN)
    return MovingPose(seen.pose, _rate(linear, 1.0, LIVE_SPEED), _rate(angular, 1.0, LIVE_TURN))


def _rate(way: Vector, step: float, bound: float) -> Vector:
    """A way per time, its length at most the bound; no quotient overflows, however short the step."""
    length = hypot(*way)
    if length > bound * step:
        return (bound / length * way[0], bound / length * way[1], bound / length * way[2])
    return (way[0] / step, way[1] / step, way[2] / step)
