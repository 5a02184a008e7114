"""Steps in place: goals for a follower's swinging sole, weight and support, tick by tick, as `StepPlan` decides."""

from collections.abc import Callable
from math import exp, sqrt

import numpy as np

from retarget.ik.hierarchy import Hierarchy
from retarget.ik.support_polygon import Stance
from retarget.ik.whole_body_stop import Stopping
from retarget.model.robot import RobotBody
from retarget.robot.balance import GRAVITY, Edges
from retarget.robot.crouch_envelope import Envelope
from retarget.robot.landmarks import AskedLandmarks
from retarget.robot.reference_governor import Glide, Reached
from retarget.robot.step_plan import Sight, StepBalance, StepPlan, StepState, balance_in_motion, swinging
from retarget.rotations import Vector, minus
from retarget.schema.priorities import Priorities
from retarget.types import BoolArray, Carrying, FloatArray

# The swing foot: the sole that carries nothing follows the performer's foot within bounds, and returns to its place.

LOW, HIGH = 0.06, 0.18
"""Least and greatest height of a lifted sole, as shares of the length of the leg."""
WAY = 0.14
"""Greatest distance from above its place, as a share of the length of the leg; never towards the other foot."""
CLEAR = 0.7
"""Share of the least height above which it may move sideways."""
ACCELERATION, SPEED = 0.5, 0.1
"""m/s^2 and m/s along each axis: slow enough that its mass hardly disturbs the balance."""
DOWNWARD = 0.4
"""Share of that speed at which it is put down."""
ABOVE_M = 0.001
"""So near to above its place it may come down."""


class SwingFoot:
    """The path of one sole's centre, world frame. It begins and ends where the sole is planted, flat."""

    def __init__(self, place: FloatArray, *, outward: float, leg: float) -> None:
        """place (3,) m: where it is planted. outward: 1 for a left foot, -1 for a right one. leg: its length, m."""
        x, y, z = place.tolist()
        self._place: Vector = (x, y, z)
        self._outward, self._low, self._high, self._way = outward, LOW * leg, HIGH * leg, WAY * leg
        self._glide = Glide(self._place, acceleration=ACCELERATION, speed=SPEED)

    def restart(self, at: list[float]) -> None:
        """Start at rest at a point, m."""
        self._glide.restart(at)

    @property
    def at(self) -> list[float]:
        """Where the sole is to be, m."""
        return self._glide.at

    def follow(self, offset: Vector, dt: float) -> list[float]:
        """Where it is to be `dt` s later, on its way to an offset from its place, m."""
        x, y, z = self._place
        ahead, aside, up = offset
        goal = [x, y, z + min(max(up, self._low), self._high)]
        if self.at[2] - z > CLEAR * self._low:
            goal[0] += min(max(ahead, -self._way), self._way)
            goal[1] += self._outward * min(max(self._outward * aside, 0.0), self._way)
        return self._glide.step(goal, dt)

    def lower(self, dt: float) -> list[float]:
        """Where it is to be `dt` s later, on its way down to its place: first above it, then straight down."""
        x, y, z = self._place
        off = max(abs(self.at[0] - x), abs(self.at[1] - y))
        height = z if off < ABOVE_M else z + self._low
        return self._glide.step((x, y, height), dt, speed_share=DOWNWARD if off < ABOVE_M else 1.0)


# Weight shift: the centre of mass goes from over one place to over another, no faster than the soles can push it.
#
# The distance of the zero-moment point from the centre of mass pushes it: behind it to speed up, before it to brake.
# Where the zero-moment point would leave the region that carries, the mass speeds up or brakes less across that edge.

ROOM_SHARE = 0.7
"""Share of the room around a place that the zero-moment point uses on the way to it."""
SHIFT_SPEED = 0.15
"""m/s along each axis."""


class WeightShift:
    """`at`: where the centre of mass is to be, x and y, m. It starts at rest."""

    def __init__(self, *, room: float, height: float) -> None:
        """room: of the zero-moment point around where the way ends, m. height: of the centre of mass, m."""
        self._lever = height / GRAVITY
        self._glide = Glide((0.0, 0.0), acceleration=ROOM_SHARE * room / self._lever, speed=SHIFT_SPEED)

    @property
    def at(self) -> list[float]:
        """Where the centre of mass is to be, m."""
        return self._glide.at

    def restart(self, com: FloatArray, velocity: FloatArray, dt: float) -> None:
        """Go on from a centre of mass (3,) m that moves at velocity (3,) m/s, in ticks of `dt` s."""
        self._glide.restart(com[:2].tolist(), (velocity[:2] * dt).tolist())

    def step(self, goal: FloatArray, region: Edges, dt: float) -> FloatArray:
        """Where it is to be (2,) m `dt` s later, on its way to a goal (2,) m. region: of its zero-moment point."""
        before, moved = np.array(self._glide.at), np.array(self._glide.moved)
        after = np.array(self._glide.step(goal.tolist(), dt))
        push = (after - before - moved) / (dt * dt) * self._lever  # (2,) [m] that the zero-moment point is behind
        held = push.copy()
        for nx, ny, offset in region:
            # p = c - push; n . p <= offset
            beyond = nx * float(before[0] - held[0]) + ny * float(before[1] - held[1]) - offset
            if beyond > 0.0 and nx * float(held[0]) + ny * float(held[1]) < 0.0:
                held += min(beyond, -nx * float(held[0]) - ny * float(held[1])) * np.array([nx, ny])
        if (held != push).any():
            slower = moved + held * (dt * dt / self._lever)
            after = before + slower
            self._glide.restart(after.tolist(), slower.tolist())
        return after


AWAY = 1.3
"""How far the pelvis goes aside at most, in shares of the way to over one sole."""
BENT = 0.02
"""Share of a leg by which it is still bent then, so that its knee need not hurry."""

DOWN_M = 3e-4
"""A sole is down whose corners are no farther from their places than this."""
SETTLED_M, SETTLED_SPEED = 0.003, 0.01
"""The mass is back when it is so near (m) to where standing asks for it, and no faster (m/s)."""
ASTRAY_M = 0.01
"""A mass or sole that is so far from where it was to be has been led elsewhere, and goes on from where it is."""

LED_S = 0.15
"""Time constant (s) with which the whole body is led aside, and with which on one foot its hands return to their
goals."""
LED = (StepState.SHIFT, StepState.BACK)
"""States in which the whole body is led aside."""
NOWHERE = (0.0, 0.0, 0.0)
StoppingOn = Callable[[Stance], Stopping]
"""From a stance to the stop trajectories in it."""


def reaching_aside(envelope: Envelope | None, robot: RobotBody, stance: Stance) -> Envelope | None:
    """An envelope with the pelvis no higher than from where each leg still reaches its planted sole, bent, while the
    mass is over the other."""
    if envelope is None:
        return None
    leg = robot.profile.landmarks["pelvis"].robot_length
    left, right = (sole.position for sole in stance.soles)
    aside = min(AWAY * 0.5 * float(np.linalg.norm(left - right)), 0.9 * leg)
    return envelope.below(envelope.highest - leg + sqrt(leg * leg - aside * aside) - BENT * leg)


class Stepping:
    """The feet of one robot. `stopping`: stop trajectories on the soles that carry now. `plan`: what the feet do, and
    how often. `waits`: the robot makes no new step, and ends the one that it makes. `contact`: which soles (2,) press
    on the floor, left and right; None where it is not measured."""

    def __init__(
        self, robot: RobotBody, priorities: Priorities, stance: Stance, hierarchy: Hierarchy, *, stopping: StoppingOn
    ) -> None:
        """hierarchy: of these priorities, which are `stepping_priorities`."""
        share, leg = balance_in_motion(priorities), robot.profile.landmarks["pelvis"].robot_length
        assert share is not None, "checked with the levels"
        self._body, self._stance, self._hierarchy = robot.body.solver_body(), stance, hierarchy
        self._balance = StepBalance(stance, share)
        one_by_one = [Stance(stance.q, stance.points, (sole,)) for sole in stance.soles]
        self._stoppings = {(True, True): stopping(stance)}
        self._stoppings |= {
            feet: stopping(on) for feet, on in zip(((True, False), (False, True)), one_by_one, strict=True)
        }
        self._swings = [
            SwingFoot(sole.position, outward=outward, leg=leg)
            for sole, outward in zip(stance.soles, (1.0, -1.0), strict=True)
        ]
        left, right = (sole.position for sole in stance.soles)
        self._apart = tuple((left - right).tolist())
        com = self._body.centre_of_mass(stance.q[None])[0]
        self._weight = WeightShift(room=self._balance.room, height=float(com[2]))
        self.plan = StepPlan()
        self._pelvis = list(robot.profile.landmarks).index("pelvis")
        self.waits = False
        self.contact: BoolArray | None = None
        self.restart()

    def restart(self) -> None:
        """Planted on both soles, at rest."""
        self.plan.restart()
        self.stopping = self._stoppings[True, True]
        self._velocity: FloatArray | None = None
        self._place = self._standing = self._balance.middles[0]
        self._aside: Vector = NOWHERE  # how far from where standing asks for it the pelvis is led, m
        self._whole = 1.0  # share of that by which all others are led: hands that stay behind would hold it up
        self._was = self.plan.state

    @property
    def stands(self) -> bool:
        """Whether it stands on both soles, its mass where standing asks for it."""
        return self.plan.state is StepState.BOTH

    @property
    def onto_one(self) -> bool:
        """Whether its mass is over one sole, or on the way there."""
        return self.plan.state in (StepState.SHIFT, StepState.SWING)

    def wait(self) -> bool:
        """Make no new step, and end the one that it makes. Returns whether it stands."""
        self.waits = True
        return self.stands

    def inside(self, com: FloatArray) -> float:
        """How far (m) a centre of mass (3,) is inside the outline of what carries."""
        return self._balance.inside(com, self.plan.feet)

    def aim(
        self, targets: FloatArray, q: FloatArray, velocity: FloatArray, dt: float, *, asked: AskedLandmarks, at: Reached
    ) -> AskedLandmarks:
        """Write the goals of the next tick of `dt` s. q (nq,), velocity (nv,): of the robot now, which has reached
        `at`. Returns the goals of its other parts, which bring its weight where it is to be."""
        performer = Carrying.BOTH if self.waits else asked.carrying
        x, y, _ = minus(asked.landmarks[self._pelvis], at.landmarks[self._pelvis])
        com = self._body.centre_of_mass(q[None])[0]
        moving = self._body.centre_of_mass_jacobian(q) @ velocity
        acceleration = np.zeros(3) if self._velocity is None else (moving - self._velocity) / dt
        self._velocity = moving
        before = self.plan.feet
        self._standing = com[:2] + np.array((x, y))  # where its mass would be, stood it as it is asked to
        self._place = self._balance.place(self._standing)
        self._look(q, com, moving, acceleration, dt, performer=performer)
        if self.plan.feet != before:
            self._change_feet(q, velocity)
        self._aim_weight(targets, com, moving, dt)
        self._aim_soles(targets, q, dt, apart=asked.apart)
        self._was = self.plan.state
        return asked.led(self._pelvis, self._aside, self._whole)

    def _look(
        self,
        q: FloatArray,
        com: FloatArray,
        moving: FloatArray,
        acceleration: FloatArray,
        dt: float,
        *,
        performer: Carrying,
    ) -> None:
        """Let the plan go on by `dt` s."""
        balance = self._balance
        left, right = (balance.depth(region, com, moving, acceleration) for region in balance.over)
        near = float(np.abs(com[:2] - self._place).max()) < SETTLED_M
        slow = float(np.abs(moving[:2]).max()) < SETTLED_SPEED
        settled = near and slow and balance.depth(balance.both, com, moving, acceleration) > 0.0
        if self.waits and balance.depth(balance.both, com, np.zeros(3), np.zeros(3)) < 0.0:
            self.plan.return_weight()
        down = self.plan.state is not StepState.SWING or self._off(q, 1 - int(self.plan.onto or 0)) < DOWN_M
        contact = (True, True) if self.contact is None else (bool(self.contact[0]), bool(self.contact[1]))
        self.plan.look(Sight(performer, (left, right), settled, down, contact), dt)

    def _change_feet(self, q: FloatArray, velocity: FloatArray) -> None:
        """Stop on the soles that carry from now on; a sole that swings begins in its place."""
        self.stopping = self._stoppings[self.plan.feet]
        self.stopping.begin(q, velocity)
        for foot, carries in enumerate(self.plan.feet):
            if not carries:
                self._swings[foot].restart(self._stance.soles[foot].position.tolist())

    def _aim_weight(self, targets: FloatArray, com: FloatArray, moving: FloatArray, dt: float) -> None:
        plan, balance, hierarchy = self.plan, self._balance, self._hierarchy
        alone, region = plan.state is StepState.SWING, balance.on_the_way
        if plan.state is StepState.BOTH:
            region, goal = balance.both, self._place
            hierarchy.set_centre_of_mass(targets, com, 0.0)
        else:
            if self._was is StepState.BOTH or float(np.abs(com[:2] - self._weight.at).max()) > ASTRAY_M:
                self._weight.restart(com, moving, dt)
            if alone and plan.onto is not None:
                region = balance.over[plan.onto]
            to = self._place if plan.onto is None else balance.middles[1 + plan.onto]
            goal = self._weight.step(to, balance.pressed(region), dt)
            hierarchy.set_centre_of_mass(targets, np.array([*goal, 0.0]))
        hierarchy.set_support(targets, balance.spaces(region, com, moving, dt))
        x, y = (goal - self._standing).tolist()
        self._aside = (x, y, 0.0)
        self._whole += (1.0 - exp(-dt / LED_S)) * (float(plan.state in LED) - self._whole)

    def _aim_soles(self, targets: FloatArray, q: FloatArray, dt: float, *, apart: Vector) -> None:
        for foot, (sole, carries) in enumerate(zip(self._stance.soles, self.plan.feet, strict=True)):
            name, locked = sole.frame.name, float(carries)
            self._hierarchy.set_position(targets, name, sole.position, locked)
            self._hierarchy.set_orientation(targets, name, sole.orientation, locked)
            place = sole.position if carries else np.array(self._swing(foot, q, dt, apart=apart))
            self._hierarchy.set_position(targets, swinging(name), place, 1.0 - locked)
            self._hierarchy.set_orientation(targets, swinging(name), sole.orientation, 1.0 - locked)

    def _swing(self, foot: int, q: FloatArray, dt: float, *, apart: Vector) -> list[float]:
        """Where the sole that swings is to be."""
        swing, sole = self._swings[foot], self._stance.soles[foot]
        at = self._body.points(q[None], [sole.frame.body], sole.frame.position[None])[0, 0].tolist()
        if max(abs(a - b) for a, b in zip(at, swing.at, strict=True)) > ASTRAY_M:
            swing.restart(at)
        if self.plan.lowers:
            return swing.lower(dt)
        sign = 1.0 if foot == 0 else -1.0
        x, y, z = (sign * (now - planted) for now, planted in zip(apart, self._apart, strict=True))
        return swing.follow((x, y, z), dt)

    def _off(self, q: FloatArray, foot: int) -> float:
        """How far (m) the corner of a sole that is farthest from its place on the floor is."""
        sole = self._stance.soles[foot]
        corners = self._body.points(q[None], [sole.frame.body] * len(sole.corners), sole.corners)[0]
        corners[:, :2] -= sole.outline
        return float(np.abs(corners).max())
