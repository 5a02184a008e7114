"""The legs of a robot that walks, as its follower leads it: what they do, and where the world of its stance is.

While it stands, that is where its soles are; while it walks, it goes along under the pelvis, and turns with it.
"""

from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from retarget._solver import Braking
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.support_polygon import Stance, footing
from retarget.ik.tasks import SlotKind
from retarget.ik.whole_body_stop import StopPath
from retarget.model.body import JointLimits
from retarget.model.robot import TRUNK, RobotBody
from retarget.robot.following_limits import servo_limits
from retarget.robot.landmarks import PELVIS
from retarget.robot.walking.gait import fastest, gait_of
from retarget.robot.walking.pattern import Request
from retarget.robot.walking.place import StancePlace, place_of, soles_at
from retarget.robot.walking.travel import Travel, WalkTally
from retarget.robot.walking.walker import Walker
from retarget.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from retarget.types import HumanPosture

NO_SPACES = np.zeros((0, 4))
"""Half-spaces of a mass that may be anywhere."""


class Legs:
    """Legs of one robot. upper: leads all else while they walk, by the same priorities. velocity: asked by a stick in
    this tick, in the robot's own frame, all zeros to stand; None: they walk with the performer."""

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
        """limits (nv,): of following. carrying (nv,): the root and the joints of the legs. scale: of lengths, from the
        performer's leg to the robot's."""
        self._scale = scale
        self._travel: Travel | None = None
        widest = servo_limits(robot)
        self._limits = JointLimits(limits.lower, limits.upper, widest.max_velocity, widest.max_acceleration)
        self._robot, self._stance, self._carrying, self.upper = robot, stance, carrying, upper
        self._soles = [sole.frame.name for sole in stance.soles]
        dofs = np.array([robot.body.dof_index(joint) for joint in robot.joint_map.joints])
        self._dofs = dofs[~carrying[dofs]]  # of servos that carry nothing
        self.velocity: Request | None
        self._walker: Walker | None = None
        self._brakes: Braking | None = None
        self.restart()

    def restart(self) -> None:
        """Stand in the stance."""
        self._place, self.velocity = StancePlace(), None
        self._plant()
        self._walker, self._travel = None, None

    def _plant(self) -> None:
        self.footing = footing(self._robot.kinematics, soles_at(self._stance, self._place))

    @property
    def walks(self) -> bool:
        """Whether they are on their way."""
        return self._walker is not None and self._walker.path is not None

    def tally(self) -> WalkTally:
        """How the robot has walked so far."""
        steps, travel = 0 if self._walker is None else self._walker.steps, self._travel
        if travel is None:
            return WalkTally(steps)
        (walked, turned), (asked, asked_turn) = travel.walked.tolist(), travel.asked.tolist()
        return WalkTally(steps, walked, asked, degrees(turned), degrees(asked_turn))

    def asked(self, human: "HumanPosture", dt: float) -> Request | None:
        """How fast the robot is to walk, in its own frame; None: it is to stand."""
        if self._travel is None:
            gait = gait_of(self._robot, self._stance, dt=dt)
            self._travel = Travel(gait, fastest(gait), scale=self._scale)
        speed = Request() if self._walker is None else self._walker.speed
        return self._travel.step(human, speed) if self.velocity is None else self._travel.steer(speed, self.velocity)

    def fastest(self, dt: float) -> Request:
        """The fastest that they may be asked to walk, in ticks of `dt` s."""
        return fastest(gait_of(self._robot, self._stance, dt=dt))

    def begin(self, stop: StopPath | None, q: FloatArray, velocity: FloatArray, dt: float) -> None:
        """Begin to walk. stop: how the robot stops now, world. q (nq,), velocity (nv,): in the world of the stance."""
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

    def step(self, asked: Request | None, dt: float) -> tuple[FloatArray, FloatArray]:
        """Go on by a tick. Returns the posture (nq,) with the legs of this tick, and its velocity (nv,), in the world
        of the stance; where that walk is over, with legs at rest."""
        walker, q, velocity = self._walker, self.upper.solver.q, self.upper.solver.velocity
        assert walker is not None and walker.path is not None, "it walks"
        walker.step(asked, q, None if self._travel is None else self._travel.swing)
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
        """Have the world of the stance under the root of a posture (nq,), world."""
        x, y, _ = StancePlace(yaw=yaw).point((float(self._stance.q[0]), float(self._stance.q[1]), 0.0))
        self._place = StancePlace(float(q[0]) - x, float(q[1]) - y, yaw)

    def stand(self) -> None:
        """Stand where the walk has led to."""
        if self._walker is not None:
            self._walker.stand()
            self._place = place_of(self._stance, self._walker.feet)
            self._plant()

    def stop(self, q: FloatArray, velocity: FloatArray, dt: float) -> StopPath:
        """How the robot stops, world: the rest of its path, on which all that does not carry brakes in proportion. q
        (nq,), velocity (nv,): now, in the world of the stance."""
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
        """Let all else keep off where the legs will be. q (nq,), velocity (nv,): now, in the world of the stance."""
        walker = self._walker
        assert walker is not None and self._brakes is not None, "it walks"
        others = walker.others
        rows = self._brakes.stop(q[others], velocity[self._dofs] * dt)
        rest = walker.through()
        rest[:, others] = q[others] if not len(rows) else rows[-1]
        rest[:, :7] = q[:7]
        self.upper.solver.foresee(rest, dt * max(len(rows), 1))

    def locate(self, q: FloatArray) -> None:
        """Go on from a posture (nq,), world, to which the robot was sent instead of that of the last `step`."""
        walker = self._walker
        if walker is not None and walker.path is not None:
            walker.locate(q)
            if walker.path is None or walker.is_over:
                self.stand()
            else:
                self._go_along(q, float(walker.path.pattern.yaws[walker.row]))

    def hold(self) -> None:
        """Go nowhere from the end of the path: the follower does not lead the robot. Nothing that the performer does
        meanwhile is a way to go."""
        if self._walker is not None:
            self._walker.drop()
        if self._travel is not None:
            self._travel.resume()

    def leave_out(self, targets: FloatArray) -> None:
        """Ask nothing of what legs alone could do."""
        for sole in self._soles:
            self.upper.weigh(targets, SlotKind.POSITION, sole, 0.0)
            self.upper.weigh(targets, SlotKind.ORIENTATION, sole, 0.0)
        for kind, name in ((SlotKind.LIMB, TRUNK), (SlotKind.ORIENTATION, TRUNK), (SlotKind.POSITION, PELVIS)):
            self.upper.weigh(targets, kind, name, 0.0)
        self.upper.set_support(targets, NO_SPACES)

    # From the world of the stance to the world, and back.

    def in_world(self, q: FloatArray) -> FloatArray:
        """A posture (nq,) in the world."""
        walker = self._walker
        if walker is not None and walker.path is not None:  # to the bit, as the path is verified
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
        """A stop of a standing robot, in the world."""
        postures = stop.postures if self._place.is_origin else self._place.postures(stop.postures)
        return StopPath(postures, self.footing)
