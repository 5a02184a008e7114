"""Reference governor: turns what is asked into goals that the robot can reach, and stop at without overshoot.

See `OnlineTrajectory`. The limits of a limb follow from the acceleration of its own servos, the weakest of them, and
from its length, so a new robot needs no tuning.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import copysign, sqrt

import numpy as np

from retarget._solver import braking_displacement
from retarget.arithmetic import exp
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.tasks import SlotKind
from retarget.model.robot import HEAD, TRUNK, RobotBody, joints_between
from retarget.robot.landmarks import AskedLandmarks, Reached, robot_limbs
from retarget.rotations import Quat, Vector, arc, inverse, minus, product, rotated, rotation_vector, turn
from retarget.types import FloatArray

# Online trajectory generation: how fast to approach what is asked, without overshoot.
#
# A solver that corrects all of an error at once, within the acceleration of its joints, gets there too fast to stop,
# and oscillates about the goal. Here the step of a tick is the asked motion's own, as far as it is smooth, plus no more
# than can be braked: v = sqrt(2 a gap). An even motion within the limits is followed without any lag. A jump is neither
# taken for motion nor followed at once: it is caught up with.

SMOOTH_S = 0.025
"""Time constant (s) of each of two low passes: of what is asked, and of its velocity. Shorter is noise: one
low pass alone, of 0.04 s, lets through two to four times its jerk. What the first is behind is added by that velocity,
the lag of the second is caught up with; so a swing of 2 Hz goes 17 % too far."""
RATE = 25.0
"""Share of the gap that is caught up with, per s, where braking does not matter: the gain for noise."""
STILL = 1e-12
"""Least length, m or rad, by which is divided: it keeps a still channel from dividing by zero."""


@dataclass(frozen=True)
class ChannelLimits:
    """Limits of a channel, in m or rad. own: greatest acceleration of the asked motion that counts as motion, per s^2.

    catch_up: acceleration and braking towards what is asked, per s^2; speed: greatest speed of that, per s.
    """

    own: float
    catch_up: float
    speed: float


class OnlineTrajectory:
    """Steps of one channel, a vector of three: a point, or a rotation as rotation vectors."""

    def __init__(self, limits: ChannelLimits, *, lead_time: float = 0.0) -> None:
        """lead_time: s; the channel aims at where the motion will be then, at its own velocity."""
        self._limits, self._lead_time = limits, lead_time
        self.restart()

    def restart(self) -> None:
        """Start at rest, after something that stands still."""
        self._own: Vector = (0.0, 0.0, 0.0)
        self._behind: Vector = (0.0, 0.0, 0.0)
        self._before = 0.0

    def step(self, moved: Vector, error: Vector, dt: float) -> Vector:
        """Displacement to ask for in this tick of `dt` s.

        moved: how far what is asked moved since the last tick. error: from where the robot is to what is asked now.
        """
        limits = self._limits
        # What is asked is low-passed: how far that is behind, and how far it moved. Its velocity is low-passed once
        # more, and the change of it limited: a jump of what is asked is no motion.
        kept = exp(-dt / SMOOTH_S)
        px, py, pz = self._behind
        bx, by, bz = self._behind = kept * (px + moved[0]), kept * (py + moved[1]), kept * (pz + moved[2])
        mx, my, mz = moved[0] + px - bx, moved[1] + py - by, moved[2] + pz - bz
        ox, oy, oz = self._own
        share = 1.0 - kept
        cx, cy, cz = share * (mx / dt - ox), share * (my / dt - oy), share * (mz / dt - oz)
        scale = min(1.0, limits.own * dt / max(sqrt(cx * cx + cy * cy + cz * cz), STILL))
        ox, oy, oz = self._own = (ox + scale * cx, oy + scale * cy, oz + scale * cz)

        # What is left after following that motion for this tick is the gap that is to be caught up with.
        a = dt * kept / share + self._lead_time
        ex, ey, ez = error[0] - bx + a * ox, error[1] - by + a * oy, error[2] - bz + a * oz
        ox, oy, oz = ox * dt, oy * dt, oz * dt
        rx, ry, rz = ex - ox, ey - oy, ez - oz
        gap = sqrt(rx * rx + ry * ry + rz * rz)
        change = limits.catch_up * dt * dt
        # Along the gap, no faster than can be braked before it closes, and with limited acceleration from tick to tick.
        ahead = min(braking_displacement(gap, change), self._before + change)
        self._before = ahead = min(ahead, limits.speed * dt, gap * min(1.0, RATE * dt))
        share = ahead / max(gap, STILL)
        return ox + share * rx, oy + share * ry, oz + share * rz


STANDING, HELD = (0.5, 0.2, 0.5), (2.0, 0.4, 1.0)
"""Shares of a servo's acceleration, at the length of the limb, for the asked motion's own and for catching up; and of
its speed for catching up. STANDING: a robot on its soles. HELD: one on a stand or a gantry.

How a limb's acceleration maps to a joint's depends on the posture. A fifth leaves room for unfavourable ones, and a
robot that is held cannot tip. The own motion of a limb is that of several joints, of which one alone is looked at here:
a foot that kicks may have what two can."""
FAR = 1e3
"""Distance (m) of the point that the eyes are turned to: so far away it is a direction."""


class _Channels:
    """The channels of landmarks, or of limbs, that a hierarchy has tasks for, and where their goals go."""

    def __init__(
        self,
        hierarchy: Hierarchy,
        kind: SlotKind,
        names: Sequence[str],
        limits: Mapping[str, ChannelLimits],
        *,
        lead_time: float,
    ) -> None:
        """names: of all rows that `aim` is given. limits: of those that may move. lead_time: s."""
        moving = [name for name in names if name in limits and hierarchy.uses(kind, name)]
        self._rows = [names.index(name) for name in moving]
        self._trajectories = [OnlineTrajectory(limits[name], lead_time=lead_time) for name in moving]
        self._source, self._slots = hierarchy.position_slots(moving, kind)

    def restart(self) -> None:
        """Start at rest."""
        for trajectory in self._trajectories:
            trajectory.restart()

    def aim(
        self, targets: FloatArray, asked: list[Vector], before: list[Vector], reached: list[Vector], dt: float
    ) -> None:
        """Write the goals of a tick of `dt` s. asked: now; before: in the last tick; reached: where they are, m."""
        goals = []
        for row, trajectory in zip(self._rows, self._trajectories, strict=True):
            here, there, last = reached[row], asked[row], before[row]
            x, y, z = trajectory.step(minus(there, last), minus(there, here), dt)
            goals.append((1.0, here[0] + x, here[1] + y, here[2] + z))
        if goals:
            targets[self._slots] = np.array(goals)[self._source]

    def ask_nothing(self, targets: FloatArray) -> None:
        """Take the goals out of the target vector."""
        targets[self._slots] = 0.0


class ReferenceGovernor:
    """Goals of the pelvis and other landmarks, of limbs, of the trunk and of the eyes."""

    def __init__(
        self,
        robot: RobotBody,
        hierarchy: Hierarchy,
        *,
        still: frozenset[str],
        trunk_at_stance: Quat,
        lead_time: float = 0.0,
    ) -> None:
        """still: landmarks that are planted. trunk_at_stance: orientation wxyz of the trunk's frame in the stance.
        lead_time: s, see `OnlineTrajectory`."""
        marks, soles = robot.profile.landmarks, [foot.frame for foot in robot.profile.feet.values()]
        points = {
            name: _limits(robot, mark.frame, mark.anchor, mark.robot_length)
            for name, mark in marks.items()
            if name not in still
        }
        limbs = {name: _limb_limits(robot, name, limb.length) for name, limb in robot_limbs(robot).items()}
        self._points = _Channels(hierarchy, SlotKind.POSITION, tuple(marks), points, lead_time=lead_time)
        self._limbs = _Channels(hierarchy, SlotKind.LIMB, tuple(limbs), limbs, lead_time=lead_time)
        self._trunk = OnlineTrajectory(_limits(robot, TRUNK, soles), lead_time=lead_time)
        self._gaze = OnlineTrajectory(_limits(robot, HEAD, [TRUNK]), lead_time=lead_time)
        self._hierarchy = hierarchy
        self._trunk_at_stance = trunk_at_stance
        self._before: AskedLandmarks | None = None

    def restart(self) -> None:
        """Start at rest, without a motion that was asked before."""
        self._before = None
        for channels in (self._points, self._limbs, self._trunk, self._gaze):
            channels.restart()

    def aim(self, targets: FloatArray, asked: AskedLandmarks, reached: Reached, dt: float) -> None:
        """Write the goals of a tick of `dt` s into the target vector."""
        before = asked if self._before is None else self._before
        self._before = asked
        self._points.aim(targets, asked.landmarks, before.landmarks, reached.landmarks, dt)
        self._limbs.aim(targets, asked.limbs, before.limbs, reached.limbs, dt)

        moved = rotation_vector(product(asked.trunk, inverse(before.trunk)))
        error = rotation_vector(product(asked.trunk, inverse(reached.trunk)))
        trunk = product(turn(self._trunk.step(moved, error, dt)), reached.trunk)
        self._hierarchy.set_orientation(targets, TRUNK, np.array(product(trunk, self._trunk_at_stance)))

        moved, error = rotation_vector(arc(before.gaze, asked.gaze)), rotation_vector(arc(reached.gaze, asked.gaze))
        x, y, z = rotated(turn(self._gaze.step(moved, error, dt)), reached.gaze)
        self._hierarchy.set_look_at(targets, HEAD, np.array((FAR * x, FAR * y, FAR * z)))

    def ask_nothing(self, targets: FloatArray) -> None:
        """Take all goals out of the target vector: the robot goes by its posture alone."""
        self._points.ask_nothing(targets)
        self._limbs.ask_nothing(targets)
        self._hierarchy.set_orientation(targets, TRUNK, np.zeros(4), 0.0)
        self._hierarchy.set_look_at(targets, HEAD, np.zeros(3), 0.0)


def _limb_limits(robot: RobotBody, name: str, length: float) -> ChannelLimits:
    """Limits of a limb, which all joints from the trunk to its end turn; of the trunk's line, those of the legs. A limb
    that turns has farther to go than a point on its line: it may use all of its servos' speed."""
    mark = robot.profile.landmarks.get(name)
    if mark is None:
        return _limits(robot, TRUNK, [foot.frame for foot in robot.profile.feet.values()], length)
    limits, movers = _limits(robot, mark.frame, [TRUNK], length), joints_between(robot, mark.frame, [TRUNK])
    return replace(limits, speed=length * float(robot.limits.max_velocity[movers].min()))


def _limits(robot: RobotBody, frame: str, others: Sequence[str], lever: float = 1.0) -> ChannelLimits:
    """Limits of a frame that the joints between it and `others` move, `lever` m away from them (of a rotation: 1)."""
    limits, movers = robot.limits, joints_between(robot, frame, others)
    acceleration = lever * float(limits.max_acceleration[movers].min())
    speed = lever * float(limits.max_velocity[movers].min())
    own, catch_up, fast = STANDING if robot.stands else HELD
    return ChannelLimits(own * acceleration, catch_up * acceleration, fast * speed)


# A point that goes to a goal which may jump, with bounded speed and acceleration along each axis, and stops there.


class Glide:
    """`at`: where the point is, m; `moved`: how far it went in the last tick, m. It starts at rest."""

    def __init__(self, at: Sequence[float], *, acceleration: float, speed: float) -> None:
        """acceleration, m/s^2, and speed, m/s: the most along each axis."""
        self._acceleration, self._speed = acceleration, speed
        self.restart(at)

    def restart(self, at: Sequence[float], moved: Sequence[float] | None = None) -> None:
        """Go on from a point. moved: how far it went in the last tick, m; absent: it rests there."""
        self.at = [float(value) for value in at]
        self.moved = [0.0] * len(self.at) if moved is None else [float(value) for value in moved]

    def step(self, goal: Sequence[float], dt: float, *, speed_share: float = 1.0) -> list[float]:
        """Return the position `dt` s later on the way to a goal. speed_share: of its greatest speed."""
        change, most = self._acceleration * dt * dt, speed_share * self._speed * dt
        for axis, (at, moved) in enumerate(zip(self.at, self.moved, strict=True)):
            gap = goal[axis] - at
            wanted = copysign(min(braking_displacement(abs(gap), change), most), gap)
            moved = min(max(wanted, moved - change), moved + change)
            self.at[axis], self.moved[axis] = at + moved, moved
        return self.at
