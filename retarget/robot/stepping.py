"""Steps in place: goals for a follower's swing foot, weight and support, tick by tick, as `StepPlan` decides."""

from collections.abc import Sequence
from math import copysign, sqrt

import numpy as np

from retarget._solver import braking_displacement
from retarget.arithmetic import low_pass, matmul, norm
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.support_polygon import Stance, support_edges
from retarget.model.robot import RobotBody
from retarget.robot.balance import (
    HEAVE_ROWS,
    Edges,
    Room,
    inside,
    moving_share,
    moving_spaces,
    one_leg_squat,
    room_of,
    sizes,
)
from retarget.robot.crouch_envelope import Envelope
from retarget.robot.landmarks import AskedLandmarks, Reached
from retarget.robot.step_plan import FOOT, StepInput, StepPlan, StepState, swinging
from retarget.rotations import Vector, as_vector, minus
from retarget.schema.priorities import Priorities
from retarget.types import BoolArray, FloatArray

# Step balance: where capture point and zero-moment point of a stepping robot are to be: over both feet, over one, or on
# the way.
#
# As in `StandingBalance`, each room is a share of the polygon that carries, about its middle. From one room to another
# the mass goes through their hull, while both soles carry. A room only ever grows, or shrinks to one that holds both
# points already: so no change of it asks for a jump.


class StepBalance:
    """Rooms of one stance on two soles. both, on_the_way: of standing, and of every shift of weight; over: of standing
    on the left sole, and on the right one; least: how far the middle of each sole is inside of its room, m. middles:
    of the soles, (2,) m: both, left, right."""

    def __init__(self, stance: Stance, share: float) -> None:
        """share: of what carries, about its middle."""
        outlines = [sole.outline for sole in stance.soles]
        self.middles = (np.concatenate(outlines).mean(axis=0), *(outline.mean(axis=0) for outline in outlines))
        self.both = room_of(stance.edges(0.0), share, stance)
        left, right = (
            room_of(support_edges([sole.outline]), share, Stance(stance.q, stance.points, (sole,)))
            for sole in stance.soles
        )
        self.over: tuple[Room, Room] = (left, right)
        captured, pressed = (self._hull(outlines, size) for size in sizes(share))
        self.on_the_way = Room(captured, pressed, self.both.outer)
        still = np.zeros(3)
        self.least = min(
            self.depth(room, np.array([*middle, 0.0]), still, still)
            for room, middle in zip(self.over, self.middles[1:], strict=True)
        )

    def _hull(self, outlines: Sequence[FloatArray], size: float) -> Edges:
        """Edges of the hull of both soles (c, 2), each at a share of its size about its middle. It holds the rooms at
        that share, of standing too."""
        middles = self.middles[1:]
        edges: Edges = support_edges(
            [at + size * (sole - at) for sole, at in zip(outlines, middles, strict=True)]
        ).tolist()
        return edges

    def spaces(self, room: Room, com: FloatArray, velocity: FloatArray, dt: float) -> FloatArray:
        """Half-spaces (k, 4) for a centre of mass after the next `dt` s, now at com (3,) m, moving at velocity (3,)
        m/s."""
        spaces = moving_spaces(room, com, velocity, dt)
        if room is self.both:
            return spaces
        # At the height of an even motion. Else a robot that may not go aside fast enough would throw up its arms.
        edges = spaces[:-HEAVE_ROWS]
        edges[:, 3] -= edges[:, 2] * float(com[2] + velocity[2] * dt)
        edges[:, 2] = 0.0
        return spaces

    def depth(self, room: Room, com: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> float:
        """How far (m) inside a room both points are, of a mass at (3,) m, with (3,) m/s and (3,) m/s^2."""
        height = float(com[2])
        capture = com + velocity * sqrt(height / GRAVITY)
        pressed = com - acceleration * (height / max(GRAVITY + float(acceleration[2]), 0.1 * GRAVITY))
        return min(inside(room.capture_point, capture), inside(room.zero_moment_point, pressed))

    def settled(self, com: FloatArray, velocity: FloatArray, acceleration: FloatArray, place: FloatArray) -> bool:
        """Whether a mass rests at a place (2,) m, inside the room of standing; com, velocity, acceleration (3,)."""
        near = float(np.abs(com[:2] - place).max()) < SETTLED_M
        slow = float(np.abs(velocity[:2]).max()) < SETTLED_SPEED
        return near and slow and self.depth(self.both, com, velocity, acceleration) > 0.0

    def place(self, asked: FloatArray) -> FloatArray:
        """The place (2,) m in the room of standing, SETTLED_M from its edges, that is nearest to the one asked (2,) m,
        on the line to the middle."""
        middle = self.middles[0]
        share = 1.0
        for nx, ny, offset in self.both.capture_point:
            most = max(offset - SETTLED_M - nx * float(middle[0]) - ny * float(middle[1]), 0.0)
            out = nx * float(asked[0] - middle[0]) + ny * float(asked[1] - middle[1])
            if out > most:
                share = min(share, most / out)
        return np.asarray(middle + share * (asked - middle))


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
"""Distance, m, from above its place at which a foot may come down."""


class SwingFoot:
    """The path of one sole's centre, world frame. It begins and ends where the sole is planted, flat."""

    def __init__(self, place: FloatArray, *, outward: float, leg: float) -> None:
        """place (3,) m: where it is planted. outward: 1 for a left foot, -1 for a right one. leg: its length, m."""
        self._place = as_vector(place)
        self._outward, self._low, self._high, self._way = outward, LOW * leg, HIGH * leg, WAY * leg
        self._glide = Glide(self._place, acceleration=ACCELERATION, speed=SPEED)

    def restart(self, at: list[float]) -> None:
        """Start at rest at a point, m."""
        self._glide.restart(at)

    @property
    def at(self) -> list[float]:
        """Place of the sole that is asked for, m."""
        return self._glide.at

    def follow(self, offset: Vector, dt: float) -> list[float]:
        """Return the place of the sole, m, `dt` s later on its way to an offset from where it stood."""
        x, y, z = self._place
        ahead, aside, up = offset
        goal = [x, y, z + min(max(up, self._low), self._high)]
        if self.at[2] - z > CLEAR * self._low:
            goal[0] += min(max(ahead, -self._way), self._way)
            goal[1] += self._outward * min(max(self._outward * aside, 0.0), self._way)
        return self._glide.step(goal, dt)

    def lower(self, dt: float) -> list[float]:
        """Return the place of the sole, m, `dt` s later on its way down to where it stood: first above it, then
        straight down."""
        x, y, z = self._place
        off = max(abs(self.at[0] - x), abs(self.at[1] - y))
        height = z if off < ABOVE_M else z + self._low
        return self._glide.step((x, y, height), dt, speed_share=DOWNWARD if off < ABOVE_M else 1.0)


# Weight shift: the centre of mass goes from over one place to over another, no faster than the soles can push it.
#
# The distance of the zero-moment point from the centre of mass pushes it: behind it to speed up, before it to brake.
# Where the zero-moment point would leave its room, the mass speeds up or brakes less across that edge; a mass that is
# beyond the edge already has to press there to come in.

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
        """Place of the centre of mass that is asked for, m."""
        return self._glide.at

    def restart(self, com: FloatArray, velocity: FloatArray, dt: float) -> None:
        """Go on from a centre of mass (3,) m that moves at velocity (3,) m/s, in ticks of `dt` s."""
        self._glide.restart(com[:2].tolist(), (velocity[:2] * dt).tolist())

    def step(self, goal: FloatArray, edges: Edges, dt: float) -> FloatArray:
        """Return the place (2,) m of the centre of mass `dt` s later on its way to a goal (2,) m. edges: of the room of
        its zero-moment point."""
        before, moved = np.array(self._glide.at), np.array(self._glide.moved)
        after = np.array(self._glide.step(goal.tolist(), dt))
        push = (after - before - moved) / (dt * dt) * self._lever  # (2,) [m] that the zero-moment point is behind
        held = push.copy()
        for nx, ny, offset in edges:
            # p = c - push; n . p <= offset
            beyond = nx * float(before[0] - held[0]) + ny * float(before[1] - held[1]) - offset
            inside = nx * float(before[0]) + ny * float(before[1]) < offset
            if inside and beyond > 0.0 and nx * float(held[0]) + ny * float(held[1]) < 0.0:
                held += min(beyond, -nx * float(held[0]) - ny * float(held[1])) * np.array([nx, ny])
        if (held != push).any():
            slower = moved + held * (dt * dt / self._lever)
            after = before + slower
            self._glide.restart(after.tolist(), slower.tolist())
        return after


# Rise: a crouch that two legs share can be more than one leg can hold, so the robot rises before it lifts a foot.

RISE_SPEED, RISE_ACCELERATION = 1.0, 4.0
"""1/s and 1/s^2: shares of its way with which a robot that is too low for one leg rises, and goes down again."""
RISEN_M = 0.003
"""It has risen when it is so near (m) to the height that one leg can carry."""


class Rise:
    """lowest: height (m) of the pelvis at which one leg can carry the robot. It starts where it is asked."""

    def __init__(self, lowest: float) -> None:
        self.lowest = lowest
        self._glide = Glide((0.0,), acceleration=RISE_ACCELERATION, speed=RISE_SPEED)  # share of the way up

    def restart(self) -> None:
        """Stay where it is asked."""
        self._glide.restart((0.0,))

    def step(self, asked: float, dt: float, *, due: bool) -> float:
        """How far (m) above the height `asked` (m) the pelvis is to be `dt` s later. due: whether one leg carries, or
        is to."""
        (share,) = self._glide.step((float(due),), dt)
        return share * max(self.lowest - asked, 0.0)


AWAY = 1.3
"""Most that the pelvis goes aside, in shares of the way to over one sole."""
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
LED = (StepState.SHIFT_WEIGHT, StepState.RETURN_WEIGHT)
"""States in which the whole body is led aside."""


def reaching_aside(envelope: Envelope | None, robot: RobotBody, stance: Stance) -> Envelope | None:
    """An envelope with the pelvis no higher than from where each leg still reaches its planted sole, bent, while the
    mass is over the other."""
    if envelope is None:
        return None
    leg = robot.profile.landmarks["pelvis"].robot_length
    left, right = (sole.position for sole in stance.soles)
    aside = min(AWAY * 0.5 * norm(left - right), 0.9 * leg)
    return envelope.below(envelope.highest - leg + sqrt(leg * leg - aside * aside) - BENT * leg)


class Stepping:
    """The feet of one robot. `plan`: what the feet do, and how often. `contact`: which soles (2,) press on the floor,
    left and right; None where it is not measured."""

    def __init__(
        self,
        robot: RobotBody,
        priorities: Priorities,
        stance: Stance,
        hierarchy: Hierarchy,
        *,
        highest: float,
    ) -> None:
        """hierarchy: of these priorities, which are `stepping_priorities`. highest: of the pelvis, m."""
        share, leg = moving_share(priorities), robot.profile.landmarks["pelvis"].robot_length
        assert share is not None, "checked with the levels"
        self._body, self._stance, self._hierarchy = robot.body.solver_body(), stance, hierarchy
        self._balance = StepBalance(stance, share)
        self._swings = [
            SwingFoot(sole.position, outward=outward, leg=leg)
            for sole, outward in zip(stance.soles, (1.0, -1.0), strict=True)
        ]
        left, right = (sole.position for sole in stance.soles)
        self._apart = tuple((left - right).tolist())
        com = self._body.centre_of_mass(stance.q[None])[0]
        self._weight = WeightShift(room=self._balance.least, height=float(com[2]))
        self.plan = StepPlan()
        self._pelvis = list(robot.profile.landmarks).index("pelvis")
        standing = float(stance.points[robot.profile.landmarks["pelvis"].frame][2])
        self._rise = Rise(min(standing - one_leg_squat(robot), highest))
        self.contact: BoolArray | None = None
        self.restart()

    def restart(self) -> None:
        """Planted on both soles, at rest."""
        self.plan.restart()
        self._velocity: FloatArray | None = None
        self._rise.restart()
        self._whole = 1.0  # share of the way of the pelvis aside that the whole body goes: hands would hold it up

    @property
    def stands(self) -> bool:
        """Whether it stands on both soles, its mass where standing asks for it."""
        return self.plan.state is StepState.DOUBLE_SUPPORT

    def aim(
        self,
        targets: FloatArray,
        q: FloatArray,
        velocity: FloatArray,
        dt: float,
        *,
        asked: AskedLandmarks,
        at: Reached,
        to_stance: bool = False,
    ) -> AskedLandmarks:
        """Write the goals of the next tick of `dt` s. q (nq,), velocity (nv,): of the robot now, which has reached
        `at`. to_stance: whether the robot returns to its stance. Returns the goals of its other parts, which bring its
        weight where it is to be."""
        x, y, _ = minus(asked.landmarks[self._pelvis], at.landmarks[self._pelvis])
        com = self._body.centre_of_mass(q[None])[0]
        moving = matmul(self._body.centre_of_mass_jacobian(q), velocity)
        standing = com[:2] + np.array((x, y))  # where its mass would be, stood it as it is asked to
        place = self._balance.place(standing)
        acceleration = np.zeros(3) if self._velocity is None else (moving - self._velocity) / dt
        self._velocity = moving
        settled = self._balance.settled(com, moving, acceleration, place)
        left, right = (self._balance.depth(room, com, moving, acceleration) for room in self._balance.over)
        outside = to_stance and self._balance.depth(self._balance.both, com, np.zeros(3), np.zeros(3)) < 0.0
        before = self.plan.single_support
        down = self.plan.state is StepState.TOUCHDOWN and self._off(q, 1 - int(self.plan.support or 0)) < DOWN_M
        contact = (True, True) if self.contact is None else (bool(self.contact[0]), bool(self.contact[1]))
        risen = at.landmarks[self._pelvis][2] > self._rise.lowest - RISEN_M
        self.plan.step(StepInput(FOOT.get(asked.carrying), (left, right), outside, settled, down, contact, risen), dt)
        support = self.plan.single_support
        if support is not None and support != before:  # a swing foot begins in its place
            self._swings[1 - support].restart(self._stance.soles[1 - support].position.tolist())
        goal = self._aim_weight(targets, com, moving, dt, place=place)
        self._aim_soles(targets, q, dt, apart=asked.apart)
        self._whole = low_pass(self._whole, float(self.plan.state in LED), dt / LED_S)
        x, y = (goal - standing).tolist()
        up = self._rise.step(asked.landmarks[self._pelvis][2], dt, due=self.plan.support is not None)
        return asked.led(self._pelvis, (x, y, up), self._whole)

    def _aim_weight(
        self, targets: FloatArray, com: FloatArray, moving: FloatArray, dt: float, *, place: FloatArray
    ) -> FloatArray:
        """Write the goal of the centre of mass, and the half-spaces that it stays in. Returns the goal (2,) m."""
        plan, balance, hierarchy = self.plan, self._balance, self._hierarchy
        if self.stands or float(np.abs(com[:2] - self._weight.at).max()) > ASTRAY_M:
            self._weight.restart(com, moving, dt)
        if self.stands:
            hierarchy.set_centre_of_mass(targets, com, 0.0)
            hierarchy.set_support(targets, balance.spaces(balance.both, com, moving, dt))
            return place
        room = balance.on_the_way if plan.single_support is None else balance.over[plan.single_support]
        to = place if plan.support is None else balance.middles[1 + plan.support]
        goal = self._weight.step(to, room.zero_moment_point, dt)
        hierarchy.set_centre_of_mass(targets, np.array([*goal, 0.0]))
        hierarchy.set_support(targets, balance.spaces(room, com, moving, dt))
        return goal

    def _aim_soles(self, targets: FloatArray, q: FloatArray, dt: float, *, apart: Vector) -> None:
        """Write the goals of both soles. apart: the performer's left ankle from the right one, scaled, m."""
        support = self.plan.single_support
        for foot, sole in enumerate(self._stance.soles):
            planted = support is None or foot == support
            name, locked = sole.frame.name, float(planted)
            self._hierarchy.set_position(targets, name, sole.position, locked)
            self._hierarchy.set_orientation(targets, name, sole.orientation, locked)
            place = sole.position if planted else np.array(self._swing(foot, q, dt, apart=apart))
            self._hierarchy.set_position(targets, swinging(name), place, 1.0 - locked)
            self._hierarchy.set_orientation(targets, swinging(name), sole.orientation, 1.0 - locked)

    def _swing(self, foot: int, q: FloatArray, dt: float, *, apart: Vector) -> list[float]:
        """Where the swing foot is to be, m."""
        swing, sole = self._swings[foot], self._stance.soles[foot]
        at = self._body.points(q[None], [sole.frame.body], sole.frame.position[None])[0, 0].tolist()
        if max(abs(a - b) for a, b in zip(at, swing.at, strict=True)) > ASTRAY_M:
            swing.restart(at)
        if self.plan.state is StepState.TOUCHDOWN:
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
