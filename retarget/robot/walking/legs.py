"""The legs of a walking robot, and the place of its stance: on its soles, or under its pelvis in a walk."""

from dataclasses import dataclass, replace
from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from retarget._solver import Braking
from retarget.arithmetic import cos, sin
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.support_polygon import Stance, footing
from retarget.ik.tasks import SlotKind
from retarget.ik.whole_body_stop import StopPath
from retarget.model.body import JointLimits
from retarget.model.robot import TRUNK, RobotBody
from retarget.robot.following_limits import servo_limits
from retarget.robot.free_legs import UP
from retarget.robot.landmarks import PELVIS
from retarget.robot.walking.gait import fastest, gait_of
from retarget.robot.walking.pattern import Request
from retarget.robot.walking.travel import Travel, WalkTally
from retarget.robot.walking.walker import Walker
from retarget.rotations import Quat, Vector, as_quat, as_vector, axis_turn, product, rotated
from retarget.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from retarget.types import HumanPosture

NO_SPACES = np.zeros((0, 4))
"""Half-spaces of an unbounded mass."""


@dataclass(frozen=True)
class StancePlace:
    """Place of the stance in the world: x, y m; yaw rad."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    @property
    def is_origin(self) -> bool:
        """True if postures are the same in both worlds."""
        return self == StancePlace()

    @property
    def turn(self) -> Quat:
        """Orientation wxyz."""
        return axis_turn(UP, self.yaw)

    @property
    def inverse(self) -> "StancePlace":
        """The world's origin in the frame of this place."""
        x, y, _ = rotated(axis_turn(UP, -self.yaw), (-self.x, -self.y, 0.0))
        return StancePlace(x, y, -self.yaw)

    def point(self, local: Vector) -> Vector:
        """A point, m, of the stance's world in the world."""
        x, y, z = rotated(self.turn, local)
        return self.x + x, self.y + y, z

    def points(self, local: FloatArray) -> FloatArray:
        """Points (..., 3) m of the stance's world in the world."""
        c, s = cos(self.yaw), sin(self.yaw)
        x, y, z = np.moveaxis(local, -1, 0)
        return np.stack([self.x + c * x - s * y, self.y + s * x + c * y, z], axis=-1)

    def postures(self, q: FloatArray) -> FloatArray:
        """Postures (k, nq) of the stance's world in the world."""
        moved = q.copy()
        moved[:, :3] = self.points(q[:, :3])
        for row in moved:
            row[3:7] = product(self.turn, as_quat(row[3:7]))
        return moved

    def velocity(self, local: FloatArray) -> FloatArray:
        """Velocity (nv,), root first, of the stance's world in the world."""
        moved = local.copy()
        moved[:3] = rotated(self.turn, as_vector(local[:3]))
        return moved


class Legs:
    """Legs of one robot. upper: hierarchy of all else in a walk. velocity: of a stick, all zeros to stand; None: the
    robot follows the performer's travel."""

    def __init__(
        self,
        robot: RobotBody,
        stance: Stance,
        limits: JointLimits,
        carrying: BoolArray,
        upper: Hierarchy,
        *,
        scale: float,
    ) -> None:
        """limits (nv,): of following. carrying (nv,): root and joints of the legs. scale: of lengths, from the
        performer's leg to the robot's."""
        self._scale = scale
        self._travel: Travel | None = None
        widest = servo_limits(robot)
        self._limits = JointLimits(limits.lower, limits.upper, widest.max_velocity, widest.max_acceleration)
        self._robot, self._stance, self._carrying, self.upper = robot, stance, carrying, upper
        self._soles = [sole.frame.name for sole in stance.soles]
        dofs = np.array([robot.body.dof_index(joint) for joint in robot.joint_map.joints])
        self._dofs = dofs[~carrying[dofs]]  # of servos of the upper body
        self.velocity: Request | None
        self._walker: Walker | None = None
        self._brakes: Braking | None = None
        self.restart()

    def restart(self) -> None:
        """Stand in the stance at the origin."""
        self._place, self.velocity = StancePlace(), None
        self._plant()
        self._walker, self._travel = None, None

    def _plant(self) -> None:
        place = self._place
        soles = [
            replace(
                sole,
                position=np.array(place.point(as_vector(sole.position))),
                orientation=np.array(product(place.turn, as_quat(sole.orientation))),
                outline=place.points(np.insert(sole.outline, 2, 0.0, axis=1))[:, :2],
            )
            for sole in self._stance.soles
        ]
        self.footing = footing(self._robot.kinematics, soles)

    @property
    def walks(self) -> bool:
        """True during a walk."""
        return self._walker is not None and self._walker.path is not None

    def tally(self) -> WalkTally:
        """Totals of the walk so far."""
        steps, travel = 0 if self._walker is None else self._walker.steps, self._travel
        if travel is None:
            return WalkTally(steps)
        (walked, turned), (desired, desired_turn) = travel.walked.tolist(), travel.desired.tolist()
        return WalkTally(steps, walked, desired, degrees(turned), degrees(desired_turn))

    def desired(self, human: "HumanPosture", dt: float) -> Request | None:
        """Desired velocity in the robot's own frame; None: stand."""
        if self._travel is None:
            gait = gait_of(self._robot, self._stance, dt=dt)
            self._travel = Travel(gait, fastest(gait), scale=self._scale)
        speed = Request() if self._walker is None else self._walker.speed
        return self._travel.step(human, speed) if self.velocity is None else self._travel.steer(speed, self.velocity)

    def fastest(self, dt: float) -> Request:
        """Greatest velocity, in ticks of `dt` s."""
        return fastest(gait_of(self._robot, self._stance, dt=dt))

    def begin(self, stop: StopPath | None, q: FloatArray, velocity: FloatArray, dt: float) -> None:
        """Begin to walk. stop: world. q (nq,), velocity (nv,): in the world of the stance."""
        assert stop is not None, "its legs move"
        if self._walker is None:
            limits, dofs = self._limits, self._dofs
            gait = gait_of(self._robot, self._stance, dt=dt)
            self._walker = Walker(self._robot, self._stance, limits, self._carrying, gait)
            own = (one[dofs] for one in (limits.lower, limits.upper, limits.max_velocity, limits.max_acceleration))
            self._brakes = Braking(*own, dt=dt)
        self._walker.begin(stop.postures)
        self._go_along(stop.postures[0], self._place.yaw)
        self.upper.solver.correct(q, velocity)

    def step(self, request: Request | None, dt: float) -> tuple[FloatArray, FloatArray]:
        """Go on by a tick. Returns posture (nq,) and velocity (nv,) in the world of the stance."""
        walker, q, velocity = self._walker, self.upper.solver.q, self.upper.solver.velocity
        assert walker is not None and walker.path is not None, "it walks"
        walker.step(request, q, None if self._travel is None else self._travel.swing)
        path, row = walker.path, walker.row
        now = path.postures[row].copy()
        now[walker.others] = q[walker.others]
        if walker.is_over:
            moved = np.zeros(len(velocity))
            moved[self._dofs] = velocity[self._dofs]
            self.stand()
            return self.seen(now, moved)
        moved = self._robot.kinematics.difference(path.postures[row - 1], path.postures[row]) / dt
        moved[self._dofs] = velocity[self._dofs]
        moved[:6] = 0.0
        self._go_along(now, float(path.pattern.yaws[row]))
        return self.seen(now, moved)

    def _go_along(self, q: FloatArray, yaw: float) -> None:
        """Move the world of the stance under the root of a posture (nq,), world."""
        x, y, _ = StancePlace(yaw=yaw).point((float(self._stance.q[0]), float(self._stance.q[1]), 0.0))
        self._place = StancePlace(float(q[0]) - x, float(q[1]) - y, yaw)

    def stand(self) -> None:
        """Stand at the end of the walk."""
        if self._walker is not None:
            self._walker.stand()
            left, right = self._walker.feet
            middle, yaw = 0.5 * (left.place + right.place), 0.5 * (left.yaw + right.yaw)
            own = 0.5 * (self._stance.soles[0].outline.mean(axis=0) + self._stance.soles[1].outline.mean(axis=0))
            x, y, _ = StancePlace(yaw=yaw).point((float(own[0]), float(own[1]), 0.0))
            self._place = StancePlace(float(middle[0]) - x, float(middle[1]) - y, yaw)
            self._plant()

    def stop(self, q: FloatArray, velocity: FloatArray, dt: float) -> StopPath:
        """The stop, world: the rest of the path, while other joints brake. q (nq,), velocity (nv,): in the world of the
        stance."""
        walker = self._walker
        assert walker is not None and walker.path is not None and self._brakes is not None, "it walks"
        path, row, others = walker.path, walker.row, walker.others
        rows = np.vstack([q[others], self._brakes.stop(q[others], velocity[self._dofs] * dt)])
        end = len(path.postures) - 1
        on_path = np.minimum(np.arange(row, max(end + 1, row + len(rows))), end)
        postures = path.postures[on_path]
        postures[:, others] = rows[np.minimum(np.arange(len(postures)), len(rows) - 1)]
        return StopPath(postures, None, path.pattern.carries[on_path])

    def foresee(self, q: FloatArray, velocity: FloatArray, dt: float) -> None:
        """Keep the upper body clear of the legs' future. q (nq,), velocity (nv,): in the world of the stance."""
        walker = self._walker
        assert walker is not None and self._brakes is not None, "it walks"
        others = walker.others
        rows = self._brakes.stop(q[others], velocity[self._dofs] * dt)
        rest = walker.through()
        rest[:, others] = q[others] if not len(rows) else rows[-1]
        rest[:, :7] = q[:7]
        self.upper.solver.foresee(rest, dt * max(len(rows), 1))

    def locate(self, q: FloatArray) -> None:
        """Go on from a posture (nq,), world, that was sent instead."""
        walker = self._walker
        if walker is not None and walker.path is not None:
            walker.locate(q)
            if walker.path is None or walker.is_over:
                self.stand()
            else:
                self._go_along(q, float(walker.path.pattern.yaws[walker.row]))

    def hold(self) -> None:
        """Plan no further, and ignore the performer's travel meanwhile."""
        if self._walker is not None:
            self._walker.drop()
        if self._travel is not None:
            self._travel.resume()

    def leave_out(self, targets: FloatArray) -> None:
        """Remove the targets that need the legs."""
        for sole in self._soles:
            self.upper.weigh(targets, SlotKind.POSITION, sole, 0.0)
            self.upper.weigh(targets, SlotKind.ORIENTATION, sole, 0.0)
        for kind, name in ((SlotKind.LIMB, TRUNK), (SlotKind.ORIENTATION, TRUNK), (SlotKind.POSITION, PELVIS)):
            self.upper.weigh(targets, kind, name, 0.0)
        self.upper.set_support(targets, NO_SPACES)

    def in_world(self, q: FloatArray) -> FloatArray:
        """Posture (nq,) in the world."""
        walker = self._walker
        if walker is not None and walker.path is not None:  # to the bit, as the gate verified it
            now: FloatArray = walker.path.postures[walker.row].copy()
            now[walker.others] = q[walker.others]
            return now
        return q if self._place.is_origin else self._place.postures(q[None])[0]

    def points_in_world(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) m in the world."""
        return points if self._place.is_origin else self._place.points(points)

    def seen(self, q: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A posture (nq,) and a velocity (nv,) of the world in that of the stance."""
        if self._place.is_origin:
            return q, velocity
        back = self._place.inverse
        return back.postures(q[None])[0], back.velocity(velocity)

    def moved(self, stop: StopPath) -> StopPath:
        """The stop of a standing robot in the world."""
        postures = stop.postures if self._place.is_origin else self._place.postures(stop.postures)
        return StopPath(postures, self.footing)
