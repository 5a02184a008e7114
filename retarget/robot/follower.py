"""Stage 2, the follower: a human posture -> a robot posture within the limits of its servos, on its soles; settling at
the start, and return to stance at the end.
"""

from dataclasses import dataclass, replace
from functools import partial
from math import inf, sqrt
from typing import TYPE_CHECKING

import numpy as np

from retarget._solver import Footing, Solver, TrajectoryGenerator, braking_displacement
from retarget.arithmetic import Dwell, matmul
from retarget.human.samples import Parts
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.hierarchy import Hierarchy, SceneObstacles
from retarget.ik.support_polygon import Stance, plant
from retarget.ik.tasks import SlotKind
from retarget.ik.whole_body_stop import StopPath, WholeBodyStop
from retarget.model.body import JointLimits
from retarget.model.human_dimensions import POINTS, HumanDimensions
from retarget.model.observers import Observers, robot_observers
from retarget.model.robot import TRUNK, RobotBody, lift_soles
from retarget.model.scene_state import SceneState
from retarget.robot.arm_branches import DAMPING, ITERATIONS, ArmBranches
from retarget.robot.balance import StandingBalance, StandingStrength, carrying_frames, moving_share, standing_strength
from retarget.robot.crouch_envelope import robot_envelope
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


# A stop may displace soles, and the gate would refuse a return in one tick.

SLIPPED_M = 1e-4
"""Displacement beyond which a sole returns slowly, m."""
SOLE_BRAKING = 0.2
"""Deceleration of its return, m/s^2."""


SETTLING_S = 8.0
"""Longest settling from the stance to a performer who stands still, s."""
RESTING_SPEED, RESTING_S = 0.1, 0.04
"""A robot rests if all coordinates are slower (rad/s, m/s) for this time, s: longer than a turning point. A speed
override scales both."""


# Return to stance: to legs and trunk of the stance and arms of `attractor`, straight in joint space. The rest
# trajectory begins there, as from other legs it could tip the soles, and from other arms collide. A target for the
# pelvis would be met by swinging the arms.

RETURN_PENDULUM_TIMES = 7.5
"""Duration of a return if servos can, in sqrt(height of the centre of mass / g): shorter ones tip the soles."""
AT_SPEED = 0.999
"""Least speed override of a walk, as steps have one pace."""
RESTS_S = 0.1
"""Time at rest after which a return is over, s, as limbs that meet stand still for a tick."""
LEAST_SHARE = 0.01
"""Least speed of the return, relative to the servos'."""
RETURN_RISE_S, RETURN_JERK_S, DRIVEN_SETTLE_S = 0.2, 0.05, 0.1
"""Times of acceleration and jerk of a return, and settling time of driven joints, s."""


class StanceTrajectory:
    """The trajectory of one robot's joints to its stance."""

    def __init__(self, robot: RobotBody, stance: Stance) -> None:
        self._joints, self._fastest = robot.servo_columns, robot.joint_map.max_velocity
        self._end = robot.posture(stance_angles(robot))[self._joints]
        height = float(robot.body.solver_body().centre_of_mass(stance.q[None])[0, 2])
        self.duration = RETURN_PENDULUM_TIMES * sqrt(height / GRAVITY)  # [s] if servos can
        self._posture = stance.q.copy()
        self._moves: TrajectoryGenerator | None = None
        self._rest = Dwell()

    def begin(self, q: FloatArray, dt: float) -> None:
        """Begin in posture q (nq,), for ticks of `dt` s."""
        needed = float((np.abs(self._end - q[self._joints]) / self._fastest).max())  # [s] at full speed
        rise = max(self.duration - RETURN_RISE_S - RETURN_JERK_S, RETURN_RISE_S)
        speed = min(max(needed / rise, LEAST_SHARE), 1.0) * self._fastest
        acceleration = speed / RETURN_RISE_S
        self._moves = TrajectoryGenerator(speed, acceleration, acceleration / RETURN_JERK_S, dt=dt)
        self.reset(q)

    def reset(self, q: FloatArray) -> None:
        """Go on from posture q (nq,), at rest, that was sent instead."""
        if self._moves is not None:
            self._moves.reset(q[self._joints])

    def goes_on(self, velocity: FloatArray, dt: float) -> bool:
        """False after `dt` s once the robot rests in its stance, or as near as limbs allow. velocity (nv,):
        commanded."""
        assert self._moves is not None, "the return has begun"
        arrived = self._moves.at_rest and np.array_equal(self._moves.position, self._end)
        rests = arrived and float(np.abs(velocity).max()) < RESTING_SPEED
        return self._rest.step(dt, holds=rests) < RESTS_S

    def step(self, speed_override: float) -> FloatArray:
        """Posture (nq,) of the next tick."""
        assert self._moves is not None, "the return has begun"
        self._posture[self._joints] = self._moves.step(self._end, speed_override)
        return self._posture


def stance_angles(robot: RobotBody) -> dict[str, float]:
    """Joint angles, rad, of a return to stance: legs and trunk of `stand`, the others of `attractor`."""
    postures, carrying = robot.profile.postures, standing_dofs(robot, TRUNK)
    return {
        joint: (postures.stand if carrying[robot.body.dof_index(joint)] else postures.attractor).get(joint, 0.0)
        for joint in postures.stand | postures.attractor
    }


@dataclass(frozen=True, eq=False)
class OnSoles:
    """The parts of a follower on soles, each of which may be missing."""

    balance: StandingBalance | None = None
    strength: StandingStrength | None = None
    stop: WholeBodyStop | None = None
    to_stance: StanceTrajectory | None = None
    legs: Legs | None = None


class Follower:
    """Follows one performer with one robot, deterministically: `start`, then one `step` per tick.

    It works in the world of the stance, which moves in a walk; postures in and out are in the robot's first world.
    """

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
        """dimensions: of the performer. parts: `upper` keeps pelvis and legs still. iterations: replaces the
        priorities'. scene: in the robot's world. Raises ConfigError for names that the robot lacks."""
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
                StanceTrajectory(robot, stance) if returns else None,
                legs,
            )
        self._reader = RobotReader(robot, stance)
        self.strategies: Strategies | None = None
        """None: arms alone."""
        if priorities.strategies and envelope is not None and balance is not None:
            self.strategies = strategies_of(
                robot,
                priorities,
                stance,
                self.hierarchy,
                partial(self._hierarchy_of, limits=limits.unhurried, **REACH),
                self.landmark_map.standing,
                balance,
                self._soles.strength,
                envelope,
            )
        self._motion = DesiredMotion(
            robot,
            self.hierarchy,
            limits,
            still=frozenset(soles),
            trunk_at_stance=self._reader.trunk_at_stance,
            lag_compensation=priorities.lag_compensation,
        )
        self._speed, self._rest, self._settled_s = 1.0, Dwell(), 0.0

    @property
    def observers(self) -> Observers:
        """The robot's observers."""
        return robot_observers(self._robot)

    @property
    def legs(self) -> Legs | None:
        """The legs of a robot that walks."""
        return self._soles.legs

    @property
    def walks(self) -> bool:
        """True while the robot is off the soles of its stance."""
        return self.legs is not None and self.legs.walks

    @property
    def footing(self) -> Footing | None:
        """Places of the planted soles; None without soles."""
        if self.legs is not None:
            return self.legs.footing
        return None if self._soles.stop is None else self._soles.stop.footing

    @property
    def _solver(self) -> Solver:
        return self.legs.upper.solver if self.legs is not None and self.legs.walks else self.hierarchy.solver

    @property
    def _q(self) -> FloatArray:
        return self._solver.q

    @property
    def note(self) -> str:
        """Note for the operator if the robot can hardly crouch, else ""."""
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
        """Stand at rest, before moving to the performer's posture tick by tick."""
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
        return self._posture(self._desired(human, 0.0))

    def settle(self, human: "HumanPosture", dt: float) -> RobotPosture | None:
        """Next posture from `start` to a performer who stands still; None: the robot is there."""
        if self._rest.held >= RESTING_S or self._settled_s >= SETTLING_S:
            self.scene_obstacles.begin()
            return None
        before = self._q
        posture = self._follow(self._desired(human, dt), dt)
        own = dt * self._speed
        self._rest.step(own, holds=float(np.abs(self._q - before).max()) < RESTING_SPEED * own)
        self._settled_s += dt
        return posture

    def step(self, human: "HumanPosture", dt: float) -> RobotPosture:
        """Posture after the next `dt` s."""
        desired, legs = self._desired(human, dt), self.legs
        if legs is not None:
            speed = legs.desired(human, dt)
            speed = speed if self._speed > AT_SPEED else None
            if speed is not None and not legs.walks:
                legs.begin(self.stop(dt), self._q, self._solver.velocity, dt)
            if legs.walks:
                return self._walk(legs, desired, speed, dt)
        return self._follow(desired, dt)

    def _desired(self, human: "HumanPosture", dt: float) -> DesiredLandmarks:
        desired = self.landmark_map.desired(human, dt)
        return desired if self.strategies is None else self.strategies.places(desired)

    def _follow(self, desired: DesiredLandmarks, dt: float) -> RobotPosture:
        self._advance(desired, dt)
        return self._posture(desired)

    def _walk(self, legs: Legs, desired: DesiredLandmarks, speed: Request | None, dt: float) -> RobotPosture:
        q, velocity = legs.step(speed, dt)
        if not legs.walks:
            self.hierarchy.solver.correct(q, velocity)
            self._reached = self._reader.read(q)
            self._motion.restart()
            return self._follow(desired, dt)
        upper, targets = legs.upper, self._targets
        self.scene_obstacles.tick(upper, dt)
        upper.solver.correct(q, velocity)
        self._reached = self._reader.read(q)
        self._motion.aim(targets, desired, self._reached, dt, speed_override=self._speed)
        driven = self._arms.step(
            upper, targets, q, dt, limbs=desired.limbs, reached=self._reached, speed_override=self._speed
        )
        if self._soles.strength is not None:
            self._soles.strength.aim(upper, targets, q, self._reached.centre_of_mass, dt, keeps=False)
        legs.leave_out(targets)
        upper.set_previous(targets, q, dt, settle=DRIVEN_SETTLE_S if driven else inf)
        legs.foresee(q, velocity, dt)
        self._reached = reached = self._reader.read(upper.solver.frame(targets, dt, self._speed))
        # Soles and pelvis are on their path, and other landmarks move along.
        names, soles = self.landmark_map.names, {sole.frame.name for sole in self.stance.soles}
        pelvis = names.index(PELVIS)
        along = minus(reached.landmarks[pelvis], desired.landmarks[pelvis])
        rows = zip(names, desired.landmarks, reached.landmarks, strict=True)
        landmarks = [here if name in soles else plus(there, along) for name, there, here in rows]
        return self._posture(replace(desired, landmarks=landmarks))

    def _advance(self, desired: DesiredLandmarks, dt: float, *, to_stance: bool = False) -> None:
        targets, hierarchy, q = self._targets, self.hierarchy, self._q
        self.scene_obstacles.tick(hierarchy, dt)
        soles = self._soles
        if soles.balance is not None:
            if soles.stop is not None and soles.stop.footing is not None:
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
            self._motion.clear(targets)
            driven = True
        else:
            desired = desired if self.strategies is None else self.strategies.choose(desired, self._reached, dt)
            self._motion.aim(targets, desired, self._reached, dt, speed_override=self._speed)
            if self.strategies is None or self.strategies.is_arm_alone:
                driven = self._arms.step(
                    hierarchy, targets, q, dt, limbs=desired.limbs, reached=self._reached, speed_override=self._speed
                )
            else:
                driven = self._arms.release(hierarchy, targets)
            if self.strategies is not None:
                self.strategies.weigh(targets)
        for sole in desired.soles:
            hierarchy.weigh(targets, SlotKind.POSITION, sole.name, sole.weight)
            hierarchy.set_orientation(targets, sole.frame, np.array(sole.orientation))
        hierarchy.set_previous(targets, q, dt, settle=DRIVEN_SETTLE_S if driven else inf)
        if (stop := self._stop(q, hierarchy.solver.velocity, dt)) is not None:
            hierarchy.solver.foresee(stop.postures[-1:], dt * (len(stop.postures) - 1))
        q = hierarchy.solver.frame(targets, dt, self._speed)
        if self._robot.floats:
            lift_soles(self._robot, q)
            hierarchy.solver.correct(q, hierarchy.solver.velocity)
        self._reached = self._reader.read(q)

    def return_to_stance(self, dt: float) -> FloatArray | None:
        """Next posture (nq,) of the return to stance; None: the robot stands, or needs no return."""
        to_stance, hierarchy = self._soles.to_stance, self.hierarchy
        if to_stance is None or not to_stance.goes_on(hierarchy.solver.velocity, dt):
            return None
        hierarchy.set_posture(self._targets, to_stance.step(self._speed))
        self._advance(self.landmark_map.standing, dt, to_stance=True)
        return self._in_world(self._q)

    def begin_return_to_stance(self, q: FloatArray, dt: float) -> None:
        """Begin the return to stance in posture q (nq,)."""
        if self.legs is not None:
            self.legs.stand()
        self.reseed(q, np.zeros(self._robot.body.nv))
        if self._soles.to_stance is not None:
            self._soles.to_stance.begin(q, dt)

    def set_speed_override(self, override: float) -> None:
        """Follow at a share (0, 1] of all speeds, and its square of accelerations."""
        self._speed = override

    def stop(self, dt: float) -> StopPath | None:
        """The stop from the last planned posture; None: its legs do not move."""
        if self.legs is not None and self.legs.walks:
            return self.legs.stop(self._q, self._solver.velocity, dt)
        return self._moved(self._stop(self._q, self._solver.velocity, dt))

    def stop_from(self, q: FloatArray, velocity: FloatArray, dt: float) -> StopPath | None:
        """The stop from posture q (nq,) and velocity (nv,) per s; None: its legs do not move."""
        if self.legs is not None:
            q, velocity = self.legs.seen(q, velocity)
        return self._moved(self._stop(q, velocity, dt))

    def _stop(self, q: FloatArray, velocity: FloatArray, dt: float) -> StopPath | None:
        return None if self._soles.stop is None else self._soles.stop.path(q, velocity, dt)

    def _moved(self, stop: StopPath | None) -> StopPath | None:
        return stop if stop is None or self.legs is None else self.legs.moved(stop)

    def resume(self) -> None:
        """Follow again after a hold, from rest."""
        self._motion.restart()

    def pass_time(self, dt: float) -> None:
        """Move obstacles in a tick without the follower."""
        if self.legs is not None:
            self.legs.hold()
        self.scene_obstacles.tick(None, dt)

    def reseed(self, q: FloatArray, velocity: FloatArray, *, rests: bool = True) -> None:
        """Go on from posture q (nq,) and velocity (nv,) per s, that were sent instead. rests: trajectories of joints
        begin at rest."""
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
        return q if self.legs is None else self.legs.in_world(q)

    def _points_in_world(self, points: FloatArray) -> FloatArray:
        return points if self.legs is None else self.legs.points_in_world(points)

    def _posture(self, desired: DesiredLandmarks) -> RobotPosture:
        robot, q, reached = self._robot, self._in_world(self._q), self._reached
        free = robot.profile.root == "free"
        return RobotPosture(
            q=q,
            joint_positions=q[robot.servo_columns],
            root_position=q[:3] if free else robot.body.body_pos[1],
            root_quaternion=q[3:7] if free else robot.body.body_quat[1],
            landmark_names=self.landmark_map.names,
            landmarks_asked=self._points_in_world(np.array(desired.landmarks)),
            landmarks_reached=self._points_in_world(reached.points),
            centre_of_mass=self._points_in_world(reached.centre_of_mass),
            observer_modes=self._solver.observer_modes,
        )
