"""Stage 2, the follower: a human posture -> a posture of the robot, within the limits of its servos, on its soles.

Besides following: settling at the start, and the return to stance at the end of a run.
"""

from dataclasses import dataclass, replace
from functools import partial
from math import inf, sqrt
from typing import TYPE_CHECKING

import numpy as np

from retarget._solver import Footing, Solver, TrajectoryGenerator, braking_displacement
from retarget.arithmetic import Dwell, matmul
from retarget.human.samples import Parts
from retarget.ik.base_pose import lift_soles
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.hierarchy import Hierarchy, SceneObstacles
from retarget.ik.support_polygon import Stance, plant
from retarget.ik.tasks import SlotKind
from retarget.ik.whole_body_stop import StopPath, WholeBodyStop
from retarget.model.body import JointLimits
from retarget.model.human_dimensions import POINTS, HumanDimensions
from retarget.model.observers import Observers, robot_observers
from retarget.model.robot import TRUNK, RobotBody
from retarget.model.scene_state import SceneState
from retarget.robot.arm_branches import DAMPING, ITERATIONS, ArmBranches
from retarget.robot.balance import StandingBalance, StandingStrength, carrying_frames, moving_share, standing_strength
from retarget.robot.crouch_envelope import Envelope, robot_envelope
from retarget.robot.desired_motion import DesiredMotion
from retarget.robot.following_limits import following_limits, servo_limits
from retarget.robot.landmarks import (
    PELVIS,
    DesiredLandmarks,
    LandmarkMap,
    RobotReader,
    leg_scale,
    plant_back,
    plant_soles,
    robot_frames,
    robot_limbs,
    robot_postures,
    standing_dofs,
    standing_targets,
)
from retarget.robot.strategies import REACH, Strategies, arms_alone, strategies_of
from retarget.robot.walking.legs import Legs
from retarget.robot.walking.pattern import Request
from retarget.rotations import minus, plus
from retarget.schema.priorities import Priorities
from retarget.types import BoolArray, FloatArray, RobotPosture

if TYPE_CHECKING:
    from retarget.types import HumanPosture


# Soles that a stop left off their places go back there as slowly as legs can stop. A way back in one tick could not be
# stopped, so that no posture would be admitted and the legs would stand still for ever.

SLIPPED_M = 1e-4
"""m off its place at which a sole goes back slowly."""
SOLE_BRAKING = 0.2
"""m/s^2 with which it is braked there."""


# Settling: the robot goes from its stance to a performer who stands still, before it follows.

SETTLING_S = 8.0
"""Longest duration, s."""
RESTING_SPEED, RESTING_S = 0.1, 0.04
"""A robot none of whose coordinates is faster (rad/s, m/s) for so long (s) rests: a few ticks, so that the turning
point of a swing does not count. At a share of all speeds it is that share of both."""


# Return to stance: a robot on its own soles stands before it goes to rest, legs and trunk as in its stance, arms aside.
#
# The rest trajectory is straight in joint space. From legs that lean or twist, it would tip two planted soles; from
# arms in any posture it leads through the body. So the follower returns to a stand first: on locked soles, within its
# balance, limbs kept apart; a foot that is lifted is put down on the way. All joints are led straight from where they
# are to legs and trunk of the stance and to the arms of posture `attractor`, and nothing else is asked. A goal of the
# pelvis above the posture would be reached by swinging the arms as a counterweight, and drive them away from theirs.
# So the rest trajectory always begins in the same posture.

RETURN_PENDULUM_TIMES = 7.5
"""Duration of a return to stance where the servos can, in time constants sqrt(height of the centre of mass / g) of the
standing robot: the faster, the nearer its zero-moment point to the edge. 1.2 s for OP3, 1.6 s for Poppy, which fell in
one of ten stops with 1.5 s."""
AT_SPEED = 0.999
"""Share of its speed from which on a robot begins to walk, and goes on: steps have one pace."""
RESTS_S = 0.1
"""A robot that is no faster than RESTING_SPEED for so long (s) has returned. One tick is not enough: where limbs
meet, all joints stand still for one tick, and go on in the next."""
LEAST_SHARE = 0.01
"""Share of the servos' speeds for a robot that stands already."""
LED_RISE, LED_JERK, LED_SETTLE = 0.2, 0.05, 0.1
"""s until the joint that is led the longest way has its speed, and its acceleration; s by which the robot follows."""


class StanceTrajectory:
    """How the joints of one robot are led to its stance."""

    def __init__(self, robot: RobotBody, stance: Stance, standing: DesiredLandmarks) -> None:
        """standing: the landmarks of the stance."""
        self.asked = standing
        """The landmarks of the stance, where the weight of a robot that steps is to be."""
        self._joints, self._fastest = robot.servo_columns, robot.joint_map.max_velocity
        self._end = robot.posture(stance_angles(robot))[self._joints]
        height = float(robot.body.solver_body().centre_of_mass(stance.q[None])[0, 2])
        self.duration = RETURN_PENDULUM_TIMES * sqrt(height / GRAVITY)
        """In which the joints are led there where the servos can, s."""
        self._posture = stance.q.copy()
        self._moves: TrajectoryGenerator | None = None
        self._rest = Dwell()

    def begin(self, q: FloatArray, dt: float) -> None:
        """Begin in posture q (nq,), in ticks of `dt` s."""
        needed = float((np.abs(self._end - q[self._joints]) / self._fastest).max())  # [s] at full speed
        speed = min(max(needed / max(self.duration - LED_RISE - LED_JERK, LED_RISE), LEAST_SHARE), 1.0) * self._fastest
        acceleration = speed / LED_RISE
        self._moves = TrajectoryGenerator(speed, acceleration, acceleration / LED_JERK, dt=dt)
        self.reset(q)

    def reset(self, q: FloatArray) -> None:
        """Lead the joints on from posture q (nq,), at rest: something else was sent than was asked."""
        if self._moves is not None:
            self._moves.reset(q[self._joints])

    def goes_on(self, velocity: FloatArray, dt: float) -> bool:
        """Whether the return is not over yet after another `dt` s: it is when the robot rests, in its stance or as near
        to it as its limbs come. velocity (nv,) per s: as it was commanded to."""
        assert self._moves is not None, "the return has begun"
        led = self._moves.at_rest and np.array_equal(self._moves.position, self._end)
        rests = led and float(np.abs(velocity).max()) < RESTING_SPEED
        return self._rest.step(dt, holds=rests) < RESTS_S

    def lead(self, speed_override: float) -> FloatArray:
        """The posture (nq,) in which joints are to be a tick later."""
        assert self._moves is not None, "the return has begun"
        self._posture[self._joints] = self._moves.step(self._end, speed_override)
        return self._posture


def stance_angles(robot: RobotBody) -> dict[str, float]:
    """Angles, rad by joint, at which a return to stance ends, 0 elsewhere: legs and trunk as in `stand`, the others as
    in `attractor`."""
    postures, carrying = robot.profile.postures, standing_dofs(robot, TRUNK)
    return {
        joint: (postures.stand if carrying[robot.body.dof_index(joint)] else postures.attractor).get(joint, 0.0)
        for joint in postures.stand | postures.attractor
    }


@dataclass(frozen=True, eq=False)
class OnSoles:
    """The parts of a follower whose robot stands on its soles; each may be missing. to_stance: the return to stance.
    legs: of a robot that walks."""

    balance: StandingBalance | None = None
    strength: StandingStrength | None = None
    stop: WholeBodyStop | None = None
    to_stance: StanceTrajectory | None = None
    legs: Legs | None = None


class Follower:
    """Follows one performer with one robot. Deterministic; `start`, then one `step` per tick.

    It leads the robot in the world of its stance, which goes along with a robot that walks (`legs`); the postures that
    it gives and takes are those of the world in which the robot began."""

    def __init__(
        self,
        robot: RobotBody,
        priorities: Priorities,
        dimensions: HumanDimensions,
        *,
        parts: Parts = "whole",
        iterations: int | None = None,
        scene: SceneState | None = None,
    ) -> None:
        """dimensions: of the performer. parts: `upper` keeps pelvis and legs still. iterations: instead of the file's.

        scene: in the robot's world. Raises ConfigError: the priorities name what the robot does not have.
        """
        self._robot = robot
        self.stance = stance = plant(robot, robot.profile.postures.stand)
        limits = following_limits(robot, stance, priorities.deflection_compensation)
        legs_move = parts == "whole" and bool(stance.soles)
        soles = tuple(sole.frame.name for sole in stance.soles)
        priorities = priorities if legs_move and priorities.steps != "walk" else arms_alone(priorities)
        balance = StandingBalance(priorities, stance) if soles else None
        edges = balance.edges if legs_move and balance else None
        margin = priorities.observers.margin
        envelope = None if edges is None else robot_envelope(robot, limits, edges=edges, margin=margin)
        self.landmark_map = LandmarkMap(robot.profile, dimensions, stance, envelope, floats=robot.floats)
        self.scene_obstacles = SceneObstacles(scene)
        carrying = standing_dofs(robot)
        build = partial(self._hierarchy_of, limits=limits, iterations=iterations)
        self.hierarchy = build(priorities, np.zeros_like(carrying) if parts == "whole" else carrying)
        unhurried = partial(self._hierarchy_of, limits=limits.unhurried, iterations=ITERATIONS, damping=DAMPING)
        self._arms = ArmBranches(robot, priorities, stance, unhurried)
        self._soles = OnSoles(balance)
        if legs_move:
            legs = None
            if priorities.steps == "walk":
                scale = leg_scale(robot.profile, dict(zip(POINTS, dimensions.standing(), strict=True)))
                legs = Legs(robot, stance, limits, carrying, build(priorities, carrying), scale=scale)
            returns, tips = "pelvis" in robot.profile.landmarks, moving_share(priorities) is not None
            self._soles = OnSoles(
                balance,
                standing_strength(robot, priorities, stance),
                WholeBodyStop(robot.body, limits, servo_limits(robot), stance, carrying, tips=tips),
                StanceTrajectory(robot, stance, self.landmark_map.standing) if returns else None,
                legs,
            )
        self._reader = RobotReader(robot, stance)
        self.strategies = self._strategies_of(priorities, limits, envelope)
        """How hands get to places that the arms do not reach; None: by the arms alone."""
        self._motion = DesiredMotion(
            robot,
            self.hierarchy,
            limits,
            still=frozenset(soles),
            trunk_at_stance=self._reader.trunk_at_stance,
            servo_lead=priorities.servo_lead,
        )
        self._speed, self._rest, self._settled_s = 1.0, Dwell(), 0.0

    def _strategies_of(
        self, priorities: Priorities, limits: JointLimits, envelope: Envelope | None
    ) -> Strategies | None:
        soles, standing = self._soles, self.landmark_map.standing
        if not priorities.strategies or envelope is None or soles.balance is None:
            return None
        build = partial(self._hierarchy_of, limits=limits.unhurried, **REACH)
        return strategies_of(
            self._robot,
            priorities,
            self.stance,
            self.hierarchy,
            build,
            standing,
            soles.balance,
            soles.strength,
            envelope,
        )

    @property
    def observers(self) -> Observers:
        """The robot's."""
        return robot_observers(self._robot)

    @property
    def legs(self) -> Legs | None:
        """The legs of a robot that walks."""
        return self._soles.legs

    @property
    def walks(self) -> bool:
        """Whether the robot is not on the soles of its stance."""
        return self.legs is not None and self.legs.walks

    @property
    def footing(self) -> Footing | None:
        """Where the soles of a robot are planted that stands; None: it has none."""
        if self.legs is not None:
            return self.legs.footing
        return None if self._soles.stop is None else self._soles.stop.footing

    @property
    def _solver(self) -> Solver:
        """What leads the robot."""
        return self.legs.upper.solver if self.legs is not None and self.legs.walks else self.hierarchy.solver

    @property
    def _q(self) -> FloatArray:
        """The posture (nq,) that was planned last."""
        return self._solver.q

    @property
    def note(self) -> str:
        """A sentence for the operator where it can hardly crouch, else ""."""
        return self.landmark_map.note

    def _hierarchy_of(
        self,
        priorities: Priorities,
        locked: BoolArray,
        *,
        limits: JointLimits,
        iterations: int | None,
        damping: float | None = None,
    ) -> Hierarchy:
        """The robot's hierarchy, with these DoFs (nv,) locked."""
        return Hierarchy(
            priorities,
            self._robot.body,
            frames=robot_frames(self._robot) | carrying_frames(self._robot),
            limbs=robot_limbs(self._robot),
            lengths={name: entry.robot_length for name, entry in self._robot.profile.landmarks.items()},
            postures=robot_postures(self._robot, self.stance),
            limits=limits,
            locked=locked,
            iterations=iterations,
            damping=damping,
            observers=self.observers,
            scene=self.scene_obstacles.shapes,
        )

    def start(self, human: "HumanPosture") -> RobotPosture:
        """Stand, at rest. The robot goes to the performer's posture tick by tick, slowly at first."""
        self.landmark_map.restart()
        self._motion.restart()
        self._arms.restart()
        if self.strategies is not None:
            self.strategies.restart()
        self._rest, self._settled_s, self._speed = Dwell(), 0.0, 1.0
        self.scene_obstacles.restart()
        self._targets = standing_targets(self.hierarchy, self.stance)
        self.hierarchy.solver.reset(self.stance.q)
        if self.legs is not None:
            self.legs.restart()
        self._reached = self._reader.read(self._q)
        return self._posture(self._ask(human, 0.0))

    def settle(self, human: "HumanPosture", dt: float) -> RobotPosture | None:
        """Return the next posture (nq,) on the way from `start` to what a performer who stands still asks for; None:
        the robot rests there. So a hand that is asked high up has been raised before the performer moves on."""
        if self._rest.held >= RESTING_S or self._settled_s >= SETTLING_S:
            self.scene_obstacles.begin()
            return None
        before = self._q
        posture = self._follow(self._ask(human, dt), dt)
        own = dt * self._speed
        self._rest.step(own, holds=float(np.abs(self._q - before).max()) < RESTING_SPEED * own)
        self._settled_s += dt
        return posture

    def step(self, human: "HumanPosture", dt: float) -> RobotPosture:
        """The posture after the next `dt` s."""
        asked, legs = self._ask(human, dt), self.legs
        if legs is not None:
            speed = legs.desired(human, dt)
            speed = speed if self._speed > AT_SPEED else None
            if speed is not None and not legs.walks:
                legs.begin(self.stop(dt), self._q, self._solver.velocity, dt)
            if legs.walks:
                return self._walk(legs, asked, speed, dt)
        return self._follow(asked, dt)

    def _ask(self, human: "HumanPosture", dt: float) -> DesiredLandmarks:
        """What a posture asks of the robot, `dt` s after the one before."""
        asked = self.landmark_map.desired(human, dt)
        return asked if self.strategies is None else self.strategies.places(asked)

    def _follow(self, asked: DesiredLandmarks, dt: float) -> RobotPosture:
        """The posture after the next `dt` s, on the way to what is asked."""
        self._advance(asked, dt)
        return self._posture(asked)

    def _walk(self, legs: Legs, asked: DesiredLandmarks, speed: Request | None, dt: float) -> RobotPosture:
        """The posture after the next `dt` s of a robot whose legs walk: all else follows what is asked."""
        q, velocity = legs.step(speed, dt)
        if not legs.walks:
            self.hierarchy.solver.correct(q, velocity)
            self._reached = self._reader.read(q)
            self._motion.restart()
            return self._follow(asked, dt)
        upper, targets = legs.upper, self._targets
        self.scene_obstacles.tick(upper, dt)
        upper.solver.correct(q, velocity)
        self._reached = self._reader.read(q)
        self._motion.aim(targets, asked, self._reached, dt, speed_override=self._speed)
        is_led = self._arms.step(
            upper, targets, q, dt, limbs=asked.limbs, reached=self._reached, speed_override=self._speed
        )
        if self._soles.strength is not None:
            self._soles.strength.aim(upper, targets, q, self._reached.centre_of_mass, dt, keeps=False)
        legs.leave_out(targets)
        upper.set_previous(targets, q, dt, settle=LED_SETTLE if is_led else inf)
        legs.foresee(q, velocity, dt)
        self._reached = reached = self._reader.read(upper.solver.frame(targets, dt, self._speed))
        # Soles and pelvis are where the path has them, and all else goes along with the pelvis.
        names, soles = self.landmark_map.names, {sole.frame.name for sole in self.stance.soles}
        pelvis = names.index(PELVIS)
        along = minus(reached.landmarks[pelvis], asked.landmarks[pelvis])
        rows = zip(names, asked.landmarks, reached.landmarks, strict=True)
        landmarks = [here if name in soles else plus(there, along) for name, there, here in rows]
        return self._posture(replace(asked, landmarks=landmarks))

    def _advance(self, asked: DesiredLandmarks, dt: float, *, to_stance: bool = False) -> None:
        """Go on by `dt` s towards what is asked. to_stance: whether the robot returns to its stance."""
        targets, hierarchy, q = self._targets, self.hierarchy, self._q
        self.scene_obstacles.tick(hierarchy, dt)
        soles = self._soles
        if soles.balance is not None:
            if soles.stop is not None and soles.stop.footing is not None:
                # Soles that are off their places go back there no faster than legs can stop.
                slip, _ = soles.stop.footing.losses(q[None])
                if slip > SLIPPED_M:
                    share = braking_displacement(slip, SOLE_BRAKING * dt * dt) / slip
                    plant_back(hierarchy, targets, self.stance, self._robot.kinematics, q, share)
                else:
                    plant_soles(hierarchy, targets, self.stance)
            com = self._reached.centre_of_mass
            velocity = matmul(self._robot.kinematics.centre_of_mass_jacobian(q), hierarchy.solver.velocity)
            hierarchy.set_support(targets, soles.balance.spaces(com, velocity, dt))
        if soles.strength is not None:
            soles.strength.aim(hierarchy, targets, q, self._reached.centre_of_mass, dt)
        if to_stance:
            self._motion.ask_nothing(targets)
            is_led = True
        else:
            asked = asked if self.strategies is None else self.strategies.choose(asked, self._reached, dt)
            self._motion.aim(targets, asked, self._reached, dt, speed_override=self._speed)
            if self.strategies is None or self.strategies.is_arm_alone:
                is_led = self._arms.step(
                    hierarchy, targets, q, dt, limbs=asked.limbs, reached=self._reached, speed_override=self._speed
                )
            else:
                is_led = self._arms.release(hierarchy, targets)
            if self.strategies is not None:
                self.strategies.weigh(targets)
        for sole in asked.soles:
            hierarchy.weigh(targets, SlotKind.POSITION, sole.name, sole.weight)
            hierarchy.set_orientation(targets, sole.frame, np.array(sole.orientation))
        hierarchy.set_previous(targets, q, dt, settle=LED_SETTLE if is_led else inf)
        if (stop := self._stop(q, hierarchy.solver.velocity, dt)) is not None:
            hierarchy.solver.foresee(stop.postures[-1:], dt * (len(stop.postures) - 1))
        q = hierarchy.solver.frame(targets, dt, self._speed)
        if self._robot.floats:
            lift_soles(self._robot, q)
            hierarchy.solver.correct(q, hierarchy.solver.velocity)
        self._reached = self._reader.read(q)

    def return_to_stance(self, dt: float) -> FloatArray | None:
        """Return the next posture (nq,), m, wxyz and rad, of the return to stance; None: the robot stands, or needs no
        return."""
        to_stance, hierarchy = self._soles.to_stance, self.hierarchy
        if to_stance is None or not to_stance.goes_on(hierarchy.solver.velocity, dt):
            return None
        hierarchy.set_posture(self._targets, to_stance.lead(self._speed))
        self._advance(to_stance.asked, dt, to_stance=True)
        return self._in_world(self._q)

    def begin_return_to_stance(self, q: FloatArray, dt: float) -> None:
        """Begin the return to stance in posture q (nq,), m, wxyz and rad, whether the robot has followed or not."""
        if self.legs is not None:
            self.legs.stand()
        self.reseed(q, np.zeros(self._robot.body.nv))
        if self._soles.to_stance is not None:
            self._soles.to_stance.begin(q, dt)

    def set_speed_override(self, override: float) -> None:
        """Follow at a share (0, 1] of all speeds, with its square of all accelerations, from the next tick on."""
        self._speed = override

    def stop(self, dt: float) -> StopPath | None:
        """How the robot stops on its soles from the posture that was planned last; None: its legs do not move."""
        if self.legs is not None and self.legs.walks:
            return self.legs.stop(self._q, self._solver.velocity, dt)
        return self._moved(self._stop(self._q, self._solver.velocity, dt))

    def stop_from(self, q: FloatArray, velocity: FloatArray, dt: float) -> StopPath | None:
        """How the robot stops on its soles from posture q (nq,), moving at velocity (nv,) per s; None: its legs do not
        move."""
        if self.legs is not None:
            q, velocity = self.legs.seen(q, velocity)
        return self._moved(self._stop(q, velocity, dt))

    def _stop(self, q: FloatArray, velocity: FloatArray, dt: float) -> StopPath | None:
        """The same in the world of the stance."""
        return None if self._soles.stop is None else self._soles.stop.path(q, velocity, dt)

    def _moved(self, stop: StopPath | None) -> StopPath | None:
        """A stop in the world of the stance as one in the world."""
        return stop if stop is None or self.legs is None else self.legs.moved(stop)

    def resume(self) -> None:
        """Follow again after a hold: what was asked before is no motion to it."""
        self._motion.restart()

    def pass_time(self, dt: float) -> None:
        """Let obstacles move on in a tick in which the follower does not lead the robot."""
        if self.legs is not None:
            self.legs.hold()
        self.scene_obstacles.tick(None, dt)

    def reseed(self, q: FloatArray, velocity: FloatArray, *, rests: bool = True) -> None:
        """Go on from posture q (nq,), moving at velocity (nv,) per s: another goal was sent than was planned. rests:
        what is led joint by joint begins at rest there."""
        if self.legs is not None:
            self.legs.locate(q)
            q, velocity = self.legs.seen(q, velocity)
        self._solver.correct(q, velocity)
        self._reached = self._reader.read(q)
        if rests:
            self._arms.reset(q)
            if self._soles.to_stance is not None:
                self._soles.to_stance.reset(q)

    def _in_world(self, q: FloatArray) -> FloatArray:
        """A posture (nq,) of the world of the stance in the world."""
        return q if self.legs is None else self.legs.in_world(q)

    def _points_in_world(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) m of the world of the stance in the world."""
        return points if self.legs is None else self.legs.points_in_world(points)

    def _posture(self, asked: DesiredLandmarks) -> RobotPosture:
        robot, q, reached = self._robot, self._in_world(self._q), self._reached
        free = robot.profile.root == "free"
        return RobotPosture(
            q=q,
            joint_positions=q[robot.servo_columns],
            root_position=q[:3] if free else robot.body.body_pos[1],
            root_quaternion=q[3:7] if free else robot.body.body_quat[1],
            landmark_names=self.landmark_map.names,
            landmarks_asked=self._points_in_world(np.array(asked.landmarks)),
            landmarks_reached=self._points_in_world(reached.points),
            centre_of_mass=self._points_in_world(reached.centre_of_mass),
            observer_modes=self._solver.observer_modes,
        )
