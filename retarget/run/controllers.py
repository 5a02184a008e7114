"""Controllers, which give the target of a tick in each state of a run, and the commanded posture.

The loop of a run and `retarget.Pipeline` move a robot by `RobotMotion`, which holds them and the gate.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from hardware.clock import thread_cpu
from hardware.errors import RetargetError, describe
from hardware.guard import CheckedGoal
from retarget._solver import TrajectoryGenerator
from retarget.frames import SensorSample
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import PerformerInput
from retarget.ik.whole_body_stop import StopPath
from retarget.model.robot import RobotBody, plant_root
from retarget.robot.follower import Follower
from retarget.robot.landmarks import standing_dofs
from retarget.safety.contact import Press, return_path
from retarget.safety.gate import Gate
from retarget.safety.governor import CommandGovernor
from retarget.types import FloatArray, HumanPosture, RobotPosture, RunState


@dataclass(frozen=True, eq=False)
class Target:
    """The target of a tick. joints (n,): rad, servo order. q (nq,): with the root; None: on the planted soles. stop:
    None: the joints brake in proportion."""

    joints: FloatArray
    q: FloatArray | None = None
    stop: StopPath | None = None


class Controller(ABC):
    """Gives the targets of one state."""

    def has_arrived(self, commanded: "Commanded") -> bool:
        """True if the controller has nothing left to do; by default never."""
        return False

    def is_refused(self, commanded: "Commanded") -> bool:
        """True if the gate refuses the targets, so that the robot is to hold; by default never."""
        return False

    def begin(self, commanded: "Commanded") -> None:  # noqa: B027 - most go on from where the robot is
        """Begin the state, from the commanded posture."""

    @abstractmethod
    def target(self, commanded: "Commanded", performer: PerformerInput, *, speed_override: float) -> Target | None:
        """The target of the next tick; None: brake, or stand. speed_override: share in (0, 1], below 1 for warm
        servos."""


@dataclass(frozen=True, eq=False)
class Commanded:
    """The posture commanded last, without the deflection of the servos.

    target: that of this posture; while the robot stands it stays the same object, so a controller recognises its own. q
    (nq,): the posture. standing (nq,): the posture on the soles that gives the base pose: the last one, or the stance
    to which an approach leads. velocity (nv,) per s. stood_s: s since the posture changed; waited_s: s since then and
    since the last refusal.
    """

    goal: CheckedGoal
    target: Target
    q: FloatArray
    standing: FloatArray
    velocity: FloatArray
    stood_s: float = np.inf
    waited_s: float = np.inf

    @property
    def joints(self) -> FloatArray:
        """Joint positions (n,) rad, servo order."""
        return self.goal.posture

    @property
    def stands(self) -> bool:
        """True if the posture did not change."""
        return self.stood_s > 0.0


def first_commanded(robot: RobotBody, goal: CheckedGoal, standing: FloatArray) -> Commanded:
    """A robot at rest at its first goal."""
    q = standing.copy()
    q[robot.servo_columns] = goal.posture
    return Commanded(goal, Target(goal.posture), q, standing, np.zeros(robot.body.nv))


def next_commanded(
    robot: RobotBody, before: Commanded, goal: CheckedGoal, target: Target | None, *, dt: float, on_soles: bool
) -> Commanded:
    """The commanded posture `dt` s after a goal was sent for a target. on_soles: the robot stands as commanded."""
    standing, velocity = before.standing, before.velocity
    stands = np.array_equal(goal.posture, before.joints)
    stood_s = before.stood_s + dt if stands else 0.0
    waited_s = 0.0 if target is not None and not goal.passed else min(before.waited_s + dt, stood_s)
    passed = target if goal.passed else None
    if passed is before.target:
        q = before.q
    elif passed is not None and passed.q is not None:
        q = passed.q
    else:
        q = standing.copy()
        q[robot.servo_columns] = goal.posture
        plant_root(robot, standing, q)
    if on_soles:
        standing, velocity = q, robot.kinematics.difference(standing, q) / dt
    target = passed or (before.target if stands else Target(goal.posture))
    return Commanded(goal, target, q, standing, velocity, stood_s, waited_s)


RISE_S, JERK_S = 0.5, 0.2
"""[s] Rise of speed and of acceleration, gentle for a robot on planted soles."""
BRAKE_S, BRAKE_JERK_S = 0.12, 0.04
"""[s] The same for braking: the robot stands within 0.35 s of a hold."""
RETRY_S = 0.2
"""[s] Standing time before a refused slow move goes on, in which the servos catch up."""


class SlowMove:
    """A slow move of all joints at a share of their greatest speeds."""

    def __init__(self, robot: RobotBody, *, share: float, dt: float) -> None:
        velocity, most = share * robot.joint_map.max_velocity, robot.joint_map.max_acceleration
        moving, braking = np.minimum(velocity / RISE_S, most), np.minimum(velocity / BRAKE_S, most)
        self._moving = TrajectoryGenerator(velocity, moving, moving / JERK_S, dt=dt)
        self._braking = TrajectoryGenerator(velocity, braking, braking / BRAKE_JERK_S, dt=dt)
        self._moves = self._moving
        self._last: Target | None = None

    def begin(self, commanded: Commanded) -> None:
        """Begin at rest at the commanded posture."""
        self._moves.reset(commanded.joints)
        self._last = commanded.target

    def is_at(self, goal: FloatArray, commanded: Commanded) -> bool:
        """True if the robot rests at a goal (n,) rad."""
        return self._moves.at_rest and np.array_equal(self._moves.position, goal) and self._is_sent(commanded)

    def towards(self, goal: FloatArray, commanded: Commanded, *, speed_override: float) -> Target | None:
        """The target of the next tick to a goal (n,) rad; None: something else moved the robot, which has to stand
        first."""
        if not self._is_sent(commanded):
            if commanded.waited_s < RETRY_S:
                return None
            self.begin(commanded)
        return self._step(self._moving, goal, speed_override)

    def brake(self, commanded: Commanded) -> Target | None:
        """The target of the next tick of braking; None: something else moved the robot."""
        return self._step(self._braking, self._moves.position, 0.0) if self._is_sent(commanded) else None

    def _step(self, moves: TrajectoryGenerator, goal: FloatArray, speed_override: float) -> Target:
        if moves is not self._moves:
            moves.reset(self._moves.position, self._moves.velocity, self._moves.acceleration)
            self._moves = moves
        self._last = Target(moves.step(goal, speed_override))
        return self._last

    def is_refused(self, commanded: Commanded) -> bool:
        """True if the gate has refused this move less than RETRY_S ago."""
        return not self._is_sent(commanded) and commanded.waited_s < RETRY_S

    def _is_sent(self, commanded: Commanded) -> bool:
        return commanded.target is self._last


class ApproachPart(Enum):
    """A part of the approach."""

    STRAIGHT = "straight to the follower's first posture"
    SETTLING = "on its soles to the posture of the performer"
    ARRIVED = "at rest there"


class Approach(Controller):
    """Moves from the present posture to the beginning of following, at the speed `approach` of the profile."""

    def __init__(
        self,
        robot: RobotBody,
        follower: Follower,
        human: HumanPosture,
        *,
        dt: float,
        goal: FloatArray | None = None,
    ) -> None:
        """human: the performer's first posture. goal (n,): rad, another destination. Raises RetargetError if the
        robot's posture for the performer is not finite."""
        self._follower, self._human, self._dt = follower, human, dt
        self._share = robot.profile.safety.speed_caps.approach
        self.first = require_finite(follower.start(human))
        """The posture in which the robot stands first."""
        self._settles = goal is None
        if goal is not None:
            q = self.first.q.copy()
            q[robot.servo_columns] = goal
            plant_root(robot, self.first.q, q)
            self.first = replace(self.first, q=q, joint_positions=goal)
        self._goal = self.first.joint_positions
        self._columns = robot.servo_columns
        self._move = SlowMove(robot, share=self._share, dt=dt)
        self.part = ApproachPart.STRAIGHT

    def is_refused(self, commanded: Commanded) -> bool:
        """True if the gate refuses the straight part."""
        return self.part is ApproachPart.STRAIGHT and self._move.is_refused(commanded)

    @property
    def arrived(self) -> bool:
        """True if following can begin."""
        return self.part is ApproachPart.ARRIVED

    def has_arrived(self, commanded: Commanded) -> bool:
        """True if following can begin."""
        return self.arrived

    def target(self, commanded: Commanded, performer: PerformerInput, *, speed_override: float) -> Target | None:
        """The target of the next tick."""
        if self.part is ApproachPart.STRAIGHT and self._move.is_at(self._goal, commanded):
            self.part = ApproachPart.SETTLING
        if self.part is ApproachPart.STRAIGHT:
            self._follower.pass_time(self._dt)
            return self._move.towards(self._goal, commanded, speed_override=speed_override)
        posture = None
        if self._settles:
            self._follower.set_speed_override(self._share * speed_override)
            posture = self._follower.settle(self._human, self._dt)
        if posture is None:
            self.part = ApproachPart.ARRIVED
            return commanded.target
        return Target(posture.q[self._columns], posture.q, self._follower.stop(self._dt))

    def brake(self, commanded: Commanded) -> Target | None:
        """The target of the next tick of braking on the straight part."""
        return self._move.brake(commanded)


RETURNED_M, SPEED_UP_S = 0.01, 0.75
"""After a hold the robot is slow until each sensor is within RETURNED_M, m, of its goal, and fast again after
SPEED_UP_S, s."""


class Follow(Controller):
    """Maps the sample to the human posture, and that to the robot. costs: thread CPU of both stages, s."""

    def __init__(
        self,
        reconstructor: Reconstructor,
        follower: Follower,
        human: HumanPosture,
        *,
        dt: float,
        motion_dt: float,
        slow: float,
    ) -> None:
        """motion_dt: s of the performer's time per tick. slow: share of its speed at which the robot returns to the
        performer."""
        self._reconstructor, self._follower, self._slow = reconstructor, follower, slow
        self._dt, self._motion_dt = dt, motion_dt
        self.human = human
        self.posture: RobotPosture | None = None
        self.lost = False
        """True if the last tick found no posture."""
        self.costs = (np.nan, np.nan)
        self._ticks = 0
        self._settled = 1.0  # share of its speed that the robot may use beyond `slow`

    def begin(self, commanded: Commanded) -> None:
        """Follow from where the robot is; after a hold slowly."""
        self.posture, self.lost = None, False
        if self._ticks > 0:
            self._reconstructor.resume(self._motion_dt / self._dt)
            self._follower.resume()
            self._settled = 0.0

    def target(self, commanded: Commanded, performer: PerformerInput, *, speed_override: float) -> Target | None:
        """The target for the sample of the performer; None: no posture was found."""
        sample = performer.sample
        assert sample is not None, "the supervisor holds the robot without a sample"
        begun = thread_cpu()
        if self._ticks > 0:  # the human was started with the first sample
            self.human = self._reconstructor.step(sample, self._motion_dt)
        self._ticks += 1
        reconstructed = thread_cpu()
        if self._reconstructor.away < RETURNED_M:
            self._settled = min(self._settled + self._dt / SPEED_UP_S, 1.0)
        own = self._slow + (1.0 - self._slow) * self._settled
        self._follower.set_speed_override(min(speed_override, own))
        self.posture = posture = self._follower.step(self.human, self._dt)
        self.costs = (reconstructed - begun, thread_cpu() - reconstructed)
        self.lost = not np.isfinite(posture.q).all()
        return None if self.lost else Target(posture.joint_positions, posture.q, self._follower.stop(self._dt))


REGAIN_S = 0.4  # [s] in which a playback regains full speed after a hold
MOST_REFUSED, GONE_S = 5, 1.0
"""Most consecutive interruptions of a playback, each within GONE_S, s, of progress."""


class GoalPlayback(Controller):
    """Sends recorded goals. After an interruption the robot stands, and returns to them slowly."""

    def __init__(self, robot: RobotBody, goals: FloatArray, *, dt: float) -> None:
        """goals (T, n): rad, servo order, a row per tick; the robot begins at the first."""
        self._goals, self._dt = goals, dt
        self._last: Target | None = None  # None: the robot is at the first goal
        self._gone, self._pace = 0.0, 1.0  # rows; share of the recording's speed
        self._lost, self._lost_at = 0, 0.0  # times in a row that something else was sent; the row of the last
        self._move = SlowMove(robot, share=robot.profile.safety.speed_caps.approach, dt=dt)

    def has_arrived(self, commanded: Commanded) -> bool:
        """True if the last goal was sent."""
        at_last = self._last is not None and np.array_equal(self._last.joints, self._goals[-1])
        return self._gone == len(self._goals) - 1 and at_last and self._is_sent(commanded)

    def is_refused(self, commanded: Commanded) -> bool:
        """True if the gate refuses the goals, or has done so too often."""
        return self._lost > MOST_REFUSED or (not self._is_sent(commanded) and self._move.is_refused(commanded))

    def target(self, commanded: Commanded, performer: PerformerInput, *, speed_override: float) -> Target | None:
        """The next recorded goal, or a step back to it; None: the robot has to stand first."""
        row, share = int(self._gone), self._gone % 1.0
        goal = self._goals[row]
        if share > 0.0:
            goal = goal + share * (self._goals[row + 1] - goal)
        if not self._is_sent(commanded) and not self._move.is_at(goal, commanded):
            if self._pace > 0.0:
                gone = (self._gone - self._lost_at) * self._dt > GONE_S
                self._lost, self._lost_at = 1 if gone else self._lost + 1, self._gone
            self._pace = 0.0
            return self._move.towards(goal, commanded, speed_override=speed_override)
        self._last = Target(goal)
        self._gone = min(self._gone + self._pace * speed_override, len(self._goals) - 1.0)
        self._pace = min(self._pace + self._dt / REGAIN_S, 1.0)
        return self._last

    def _is_sent(self, commanded: Commanded) -> bool:
        return self._last is None or commanded.target is self._last


@dataclass(frozen=True, eq=False)
class GoalsInstead:
    """Goals that replace a performer. first (n,): rad, destination of the approach."""

    controller: Controller
    first: FloatArray
    name: str


class ComeToRest(Controller):
    """Leaves the robot to the last verified stop. On the straight part of the approach it brakes more gently, on its
    line. A limb in contact (`pressed`) returns to its posture at that moment."""

    def __init__(self, robot: RobotBody, follower: Follower, approach: Approach, gate: Gate, *, dt: float) -> None:
        self._robot, self._follower, self._approach, self._dt = robot, follower, approach, dt
        self._standing = gate.standing
        self.pressed: Press | None = None

    def target(self, commanded: Commanded, performer: PerformerInput, *, speed_override: float) -> Target | None:
        """The commanded target of a robot that stands, or one of braking; None: the gate follows the stop."""
        self._follower.pass_time(self._dt)
        if self.pressed is not None and self._standing is not None and not self._follower.walks:
            path = return_path(self.pressed, commanded.goal, self._robot.joint_map, dt=self._dt)
            if path is not None:
                postures = self._standing.postures(path, commanded.standing)
                return Target(path[0], postures[0], StopPath(postures, self._follower.footing))
        if commanded.stands:  # the stop of a target that passed in part would lead on
            return commanded.target if commanded.target.stop is None else replace(commanded.target, stop=None)
        return self._approach.brake(commanded) if self._approach.part is ApproachPart.STRAIGHT else None


class ReturnToStance(Controller):
    """Leads the robot to its stance on its soles."""

    def __init__(self, robot: RobotBody, follower: Follower, *, dt: float) -> None:
        self._follower, self._dt = follower, dt
        self._columns = robot.servo_columns
        self._next: FloatArray | None = None  # (nq,) posture; None: the robot is there

    def has_arrived(self, commanded: Commanded) -> bool:
        """True if the robot is in its stance."""
        return self._next is None

    def begin(self, commanded: Commanded) -> None:
        """Begin where the robot stands."""
        self._next = commanded.q
        self._follower.begin_return_to_stance(self._next, self._dt)

    def target(self, commanded: Commanded, performer: PerformerInput, *, speed_override: float) -> Target:
        """The target of the next tick."""
        self._follower.set_speed_override(speed_override)
        self._next = q = self._follower.return_to_stance(self._dt)
        if q is None:
            return Target(commanded.joints)
        return Target(q[self._columns], q, self._follower.stop(self._dt))


def rest_joints(robot: RobotBody) -> FloatArray:
    """Posture `rest`, (n,) rad, servo order."""
    return robot.posture(robot.profile.postures.rest)[robot.servo_columns]


REST_WITHIN_S = 1.9  # [s] longest move from one keyframe to the next, if the servos can


class GoToRest(Controller):
    """Moves through keyframes to posture `rest`. After a refusal the robot holds, and tries again."""

    def __init__(
        self,
        robot: RobotBody,
        keyframes: Sequence[str],
        *,
        dt: float,
        pass_time: Callable[[float], object] = lambda dt: None,
    ) -> None:
        """keyframes: postures of the profile, the last is `rest`. pass_time: receives `dt` s per tick."""
        self._robot, self._dt, self._pass_time = robot, dt, pass_time
        self._names, self._keyframes = keyframes, list[FloatArray]()
        self._move: SlowMove | None = None

    def has_arrived(self, commanded: Commanded) -> bool:
        """True if the robot is at rest."""
        return self._move is not None and not self._keyframes

    def begin(self, commanded: Commanded) -> None:
        """Begin at the commanded posture."""
        angles = [getattr(self._robot.profile.postures, name) for name in self._names]
        self._keyframes = [self._robot.posture(one)[self._robot.servo_columns] for one in angles]
        servos, caps = self._robot.joint_map, self._robot.profile.safety.speed_caps
        path = np.abs(np.diff([commanded.joints, *self._keyframes], axis=0)).max(axis=0)  # (n,) longest move
        needed = float((path / servos.max_velocity).max()) / (REST_WITHIN_S - RISE_S - 2.0 * JERK_S)
        self._move = SlowMove(self._robot, share=min(max(caps.approach, needed), 1.0), dt=self._dt)
        self._move.begin(commanded)

    def target(self, commanded: Commanded, performer: PerformerInput, *, speed_override: float) -> Target | None:
        """The target of the next tick; None: the robot has to stand first."""
        assert self._move is not None, "the state has begun"
        self._pass_time(self._dt)
        while self._keyframes and self._move.is_at(self._keyframes[0], commanded):
            self._keyframes.pop(0)
        if not self._keyframes:
            return Target(commanded.joints)
        return self._move.towards(self._keyframes[0], commanded, speed_override=speed_override)

    def brake(self, commanded: Commanded) -> Target | None:
        """The target of the next tick of slowing down on the line."""
        if self._move is None or not self._keyframes:
            return None
        return self._move.towards(self._keyframes[0], commanded, speed_override=0.0)


def require_finite(posture: RobotPosture) -> RobotPosture:
    """Raise RetargetError for a posture that is not finite, before the robot has torque."""
    if not np.isfinite(posture.q).all():
        raise RetargetError(
            describe(
                what="the posture to approach is not finite",
                where="solver",
                found=f"{np.count_nonzero(~np.isfinite(posture.q))} of {posture.q.size} values",
                then="Begin again; if it comes again, report it: no input may cause it",
            )
        )
    return posture


class RobotMotion:
    """Moves one robot: in each tick `target`, `check`, `next`."""

    def __init__(
        self,
        robot: RobotBody,
        reconstructor: Reconstructor,
        follower: Follower,
        gate: Gate,
        *,
        first: SensorSample,
        dt: float,
        motion_dt: float,
        goals: GoalsInstead | None = None,
        keyframes: Sequence[str] | None = None,
    ) -> None:
        """first: the sample to approach. motion_dt: s of the performer's time per tick. keyframes: to rest; None: the
        profile's. Raises RetargetError if the posture to approach is not finite."""
        self._robot, self._follower, self._gate, self._dt = robot, follower, gate, dt
        human, slow = reconstructor.start(first), robot.profile.safety.speed_caps.approach
        self.approach = Approach(robot, follower, human, dt=dt, goal=None if goals is None else goals.first)
        self.follow = Follow(reconstructor, follower, human, dt=dt, motion_dt=motion_dt, slow=slow)
        self._instead = goals
        self._stop = stop = ComeToRest(robot, follower, self.approach, gate, dt=dt)
        standing = gate.standing
        self._governor = None if standing is None else CommandGovernor(robot, gate, standing, standing_dofs(robot))
        keyframes = robot.profile.postures.to_rest if keyframes is None else keyframes
        self._to_rest = GoToRest(robot, keyframes, dt=dt, pass_time=follower.pass_time)
        self._controllers: dict[RunState, Controller] = {
            RunState.APPROACH: self.approach,
            RunState.FOLLOW: self.follow if goals is None else goals.controller,
            RunState.HOLD: stop,
            RunState.STOPPING: stop,
            RunState.RETURN_TO_STANCE: ReturnToStance(robot, follower, dt=dt),
            RunState.GO_TO_REST: self._to_rest,
            RunState.STANDING: stop,
            RunState.FALLING: stop,
        }
        self._state = RunState.OFF  # of the last target

    def set_press(self, pressed: Press | None) -> None:
        """Set the contact whose limb yields while the robot holds."""
        self._stop.pressed = pressed

    @property
    def on_approach(self) -> bool:
        """True on the straight part of the approach."""
        return self.approach.part is ApproachPart.STRAIGHT

    def refused(self, commanded: Commanded) -> str:
        """The motion that the gate refuses now, or ""."""
        if self.approach.is_refused(commanded):
            return "the approach"
        instead = self._instead
        if instead is not None and self.approach.arrived and instead.controller.is_refused(commanded):
            return instead.name
        return ""

    def begin(self, present: FloatArray) -> Commanded:
        """Begin at rest at the present joint positions (n,) rad. Raises HardwareError if not finite."""
        goal = self._gate.begin(present)
        if self._gate.clearance is not None:
            self._gate.clearance.begin(present)
        return first_commanded(self._robot, goal, self.approach.first.q)

    def stands(self, commanded: Commanded) -> bool:
        """True if posture and goals, which may still follow the load, have nothing left to brake."""
        return commanded.stands and self._gate.at_rest(commanded.goal)

    def has_arrived(self, state: RunState, commanded: Commanded) -> bool:
        """True if the controller of a state has begun, and has arrived."""
        controller = self._controllers.get(state)
        return state is self._state and controller is not None and controller.has_arrived(commanded)

    def target(
        self, state: RunState, commanded: Commanded, performer: PerformerInput, *, speed_override: float
    ) -> Target | None:
        """The target of the next tick; the first one of a state begins it."""
        controller = self._controllers.get(state)
        if controller is None:
            return None
        if state is not self._state:
            controller.begin(commanded)
            self._state = state
        return controller.target(commanded, performer, speed_override=speed_override)

    def brake(self, state: RunState, commanded: Commanded) -> Target | None:
        """The target of a robot that brakes on its line to rest; None: its stop goes on."""
        return self._to_rest.brake(commanded) if state is RunState.GO_TO_REST else None

    def check(self, commanded: Commanded, target: Target | None) -> tuple[CheckedGoal, Target | None]:
        """The goal for a target, and the part of it that is fulfilled; after a refusal the next goal of the stop."""
        goal, last, standing = None, commanded.goal, commanded.standing
        if target is not None and target.stop is not None and self._governor is not None:
            governed = self._governor.check(last, target.stop, standing)
            if governed is not None:
                goal, stop = governed
                target = target if stop is target.stop else Target(goal.posture, stop.postures[0], stop)
        elif target is not None:
            goal = self._gate.check(last, target.joints, standing=standing)
        return goal or self._gate.brake(last), target

    def next(self, commanded: Commanded, goal: CheckedGoal, target: Target | None) -> Commanded:
        """The commanded posture after a goal for a target."""
        on_soles = not self.on_approach
        return next_commanded(self._robot, commanded, goal, target, dt=self._dt, on_soles=on_soles)

    def reseed_follower(self, commanded: Commanded, desired: Target | None) -> None:
        """Let the follower go on from the commanded posture, unless that is its desired target, whole."""
        followed = desired is not None and desired.q is not None and commanded.target is desired
        if not (self.on_approach or followed):
            self._follower.reseed(commanded.q, commanded.velocity, rests=not commanded.goal.passed)
