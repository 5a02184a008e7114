"""Goals of a walking robot: offsets that hold its planned posture; `DeflectionCompensation` makes them while it stands.

A servo with a P gain is a lagging spring: goal = posture + torque / stiffness + lag * speed. Inverse dynamics give the
torque, with the ground's force at the zero-moment point. Encoders and IMU correct it, by ankle torque for an error of
the divergent component (Englsberger et al., IEEE T-RO 31(2), 2015), and by turns of hip and ankle against tilt. As
torques change fast, offsets have their own bounds.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hardware.arrays import FloatArray
from hardware.imu import ImuSample
from hardware.motors import drive_numbers
from hardware.servo import loop_lag
from retarget import rotations
from retarget._solver import Probe
from retarget.arithmetic import arctan2, cos, dot, matmul, norms, sin
from retarget.ik.gravity_torque import GRAVITY, UPWARD, joint_compliance
from retarget.ik.support_polygon import Stance
from retarget.model.robot import RobotBody, plant_root
from retarget.robot.balance import leg_joints
from retarget.robot.deflection_compensation import DeflectionCompensation, Offset
from retarget.robot.free_legs import UP
from retarget.robot.walking.path import ROOT
from retarget.robot.walking.pattern import Gait
from retarget.robot.walking.pattern import rotated as yawed
from retarget.rotations import arc, as_quat, as_vector, axis_turn, product, rotated, rotation_vector

MOST_WALKING_RAD = 0.35
"""Greatest offset, rad: 0.31 is needed at 0.15 m/s."""
OFFSET_SPEED = 4.0
"""Greatest rate of an offset, relative to the joint's."""
BEHIND_S = 0.008
"""Age of measurements relative to plans, beyond one bus cycle, s."""
MEASURED_S = 0.02
"""Time constant of measurements, s, as noise would accelerate goals."""
ZMP_GAIN = 1.0
"""Shift of the zero-moment point per error of the divergent component."""
MOST_SHIFT = 0.7, 0.64
"""Bounds of this shift, relative to half a sole."""
TILT_GAIN, HIP_RATE_S, ANKLE_RATE_S = 0.5, 0.05, 0.05
"""Turn of the hip per tilt, and of hip and ankle per angular velocity."""


@dataclass(frozen=True, eq=False)
class Planned:
    """Offset (2, 2) m of the centre of mass from each sole, along its axes, and its divergent component (2, 2) m."""

    offset: FloatArray
    divergent: FloatArray


@dataclass(frozen=True, eq=False)
class Walked:
    """Offset (n,) rad of a walking robot. q (nq,): planted posture; places (k, 3) m: of link masses."""

    q: FloatArray
    joints: FloatArray
    places: FloatArray
    offset: FloatArray
    planned: tuple[Planned, ...]


class WalkingGoals:
    """A `retarget.safety.gate.Compensation` of a robot that stands or walks."""

    def __init__(self, robot: RobotBody, stance: Stance, standing: DeflectionCompensation, gait: Gait) -> None:
        """standing: compensation while it stands."""
        self._robot, self._standing, self._gait, self._stance = robot, standing, gait, stance
        self._dynamics = WalkDynamics(robot, stance)
        servos, limits = robot.joint_map.servos, robot.limits
        self._compliance = joint_compliance(robot)
        gear = np.array([abs(servo.gear) for servo in servos])
        legs = leg_joints(robot)
        self._on_leg = np.array([servo.joint in legs for servo in servos])
        armature = np.array([drive_numbers(servo.model).armature for servo in servos])
        self._armature = np.where(self._on_leg, armature * gear * gear, 0.0)
        self._lag = np.where(self._on_leg, [loop_lag(servo) for servo in servos], 0.0)
        self._most_change = OFFSET_SPEED * limits.max_velocity * gait.dt
        self._lower, self._upper = limits.lower, limits.upper
        self._behind = 1 + round(BEHIND_S / gait.dt)
        self._feedback = Feedback(robot, stance, gait, self._compliance)

    def begin(self, posture: FloatArray) -> Offset:
        """Offset at rest in a posture (n,), rad."""
        self._feedback.restart()
        return self._standing.begin(posture)

    def measure(self, joints: FloatArray, imu: ImuSample | None) -> None:
        """Set the measurements: encoders (n,) rad, and IMU."""
        self._feedback.measure(joints, imu)

    def propose(
        self,
        last: Offset,
        posture: FloatArray,
        nearest: Callable[[FloatArray], FloatArray],
        *,
        ahead: FloatArray,
        walks: bool | None,
    ) -> tuple[FloatArray, Offset]:
        """Goal (n,) that holds a posture (n,), rad, and its offset.

        nearest: maps a goal to the nearest one within the gate's limits. ahead (n,): next posture. walks: None as
        before.
        """
        walked = last.walked
        if not (walked is not None if walks is None else walks):
            if walked is not None:
                begun = self._standing.begin(last.posture)
                last = replace(begun, compensated=walked.offset, integrated=last.integrated, ticks=last.ticks)
            return self._standing.propose(last, posture, nearest)
        if walked is None:  # at rest in the posture of the last goal
            q = self._planted(self._stance.q, last.posture)
            walked = Walked(q, last.posture, self._dynamics.look(q).masses, last.compensated, ())
        walked = self._next(walked, posture, ahead)
        return posture + walked.offset, replace(last, posture=posture, walked=walked)

    def _planted(self, before: FloatArray, joints: FloatArray) -> FloatArray:
        """Posture (nq,) with joints (n,) rad, whose lower sole stays in place."""
        q = before.copy()
        q[self._robot.servo_columns] = joints
        plant_root(self._robot, before, q)
        return q

    def _next(self, last: Walked, posture: FloatArray, ahead: FloatArray) -> Walked:
        """Offset of the next tick, for its posture and the one after, (n,) rad."""
        dt, q = self._gait.dt, self._planted(last.q, posture)
        now, after = self._dynamics.look(q), self._dynamics.look(self._planted(q, ahead))
        accelerations = (after.masses - 2.0 * now.masses + last.places) / (dt * dt)
        speed = (ahead - last.joints) / (2.0 * dt)
        acceleration = (ahead - 2.0 * posture + last.joints) / (dt * dt)
        torque, shares = self._dynamics.torques(now, accelerations)
        desired = matmul(self._compliance, torque + self._armature * acceleration) + self._lag * speed
        planned = (*last.planned, self._feedback.plan(now, last.planned[-1] if last.planned else None))[
            -self._behind - 1 :
        ]
        desired = desired + self._feedback.correction(now, planned[0], shares)
        change = np.minimum(np.maximum(desired - last.offset, -self._most_change), self._most_change)
        offset = np.minimum(np.maximum(last.offset + change, -MOST_WALKING_RAD), MOST_WALKING_RAD)
        offset = np.minimum(np.maximum(posture + offset, self._lower), self._upper) - posture
        return Walked(q, posture, now.masses, offset, planned)


@dataclass(frozen=True, eq=False)
class LinkStates:
    """World positions in a posture: masses (k, 3) of links; origins, axes (n, 3) of joints; soles (2, 3), mass (3,), m;
    yaws (2,) of soles, yaw of the root, rad."""

    masses: FloatArray
    origins: FloatArray
    axes: FloatArray
    soles: FloatArray
    yaws: FloatArray
    yaw: float
    mass: FloatArray


class WalkDynamics:
    """Inverse dynamics of one robot's postures."""

    def __init__(self, robot: RobotBody, stance: Stance) -> None:
        body = robot.body
        links = np.flatnonzero(body.mass)
        self._masses = body.mass[links]  # (k,) [kg]
        rows = [body.joint_index(joint) for joint in robot.joint_map.joints]
        moved = body.joint_body[rows]
        self._axes = body.joint_axis[rows]
        frames = [sole.frame for sole in stance.soles]
        middles, self._ahead = [], []
        for sole in stance.soles:
            back = rotations.multiply(sole.frame.quat, rotations.conjugate(sole.orientation))
            off = np.array([*(sole.outline.mean(axis=0) - sole.position[:2]), 0.0])
            middles.append(sole.frame.position + rotations.rotate(back, off))
            self._ahead.append(back)
        self._ends = len(links), len(links) + len(rows)
        self._probe = Probe(
            body.solver_body(),
            [*links.tolist(), *moved.tolist(), *(frame.body for frame in frames)],
            np.concatenate([body.com[links], body.joint_pos[rows], np.array(middles)]),
            [*moved.tolist(), *(frame.body for frame in frames), ROOT],
        )
        root = body.solver_body().orientations(stance.q[None], [ROOT])[0, 0]
        self._ahead.append(rotations.conjugate(root))
        chains = [set(body.chain_to_root(int(link))) for link in (*links, *(frame.body for frame in frames))]
        beyond = np.array([[float(link in chain) for chain in chains] for link in moved.tolist()])
        self._links_beyond, self._soles_beyond = beyond[:, : len(links)], beyond[:, len(links) :]  # (n, k), (n, 2)

    def look(self, q: FloatArray) -> LinkStates:
        """World positions in a posture (nq,)."""
        points, turns, mass = self._probe.read(q)
        first, second = self._ends
        n = second - first
        axes = rotations.rotate(turns[:n], self._axes)
        yaws = []
        for turn, ahead in zip(turns[n:], self._ahead, strict=True):
            x, y, _ = rotated(product(as_quat(turn), as_quat(ahead)), (1.0, 0.0, 0.0))
            yaws.append(arctan2(y, x))
        *yaws, yaw = yaws
        return LinkStates(points[:first], points[first:second], axes, points[second:], np.array(yaws), yaw, mass)

    def torques(self, at: LinkStates, accelerations: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Torques (n,) N m of joints if link masses accelerate by (k, 3) m/s^2; share (2,) of the weight on each
        sole."""
        forces = self._masses[:, None] * (UPWARD + accelerations)
        total, moment = forces.sum(axis=0), np.cross(at.masses, forces).sum(axis=0)
        lift = max(float(total[2]), 1.0)
        height = float(at.soles[:, 2].min())
        pressed = np.array([total[0] * height - moment[1], total[1] * height + moment[0]]) / lift
        first, second = at.soles[:, :2]
        across = second - first
        share = min(max(dot(pressed - first, across) / dot(across, across), 0.0), 1.0)
        shares = np.array([1.0 - share, share])
        off = np.array([*(pressed - matmul(shares, at.soles[:, :2])), 0.0])
        soles, ground = at.soles + off, shares[:, None] * total
        force = matmul(self._links_beyond, forces) - matmul(self._soles_beyond, ground)
        about = matmul(self._links_beyond, np.cross(at.masses, forces)) - matmul(
            self._soles_beyond, np.cross(soles, ground)
        )
        return (at.axes * (about - np.cross(at.origins, force))).sum(axis=1), shares


class Feedback:
    """Corrections of both legs by encoders and IMU."""

    def __init__(self, robot: RobotBody, stance: Stance, gait: Gait, compliance: FloatArray) -> None:
        self._robot, self._gait, self._dynamics = robot, gait, WalkDynamics(robot, stance)
        self._compliance, self._stance = compliance, stance
        self._weight = GRAVITY * robot.body.total_mass
        self._share = gait.dt / (MEASURED_S + gait.dt)
        self._hips, self._ankles = _joints_near(robot, stance)
        extents = [0.5 * np.ptp(sole.outline, axis=0) for sole in stance.soles]
        self._most = np.array(MOST_SHIFT) * np.min(extents, axis=0)
        imu = robot.profile.imu
        self._link = None if imu is None else robot.body.body_index(imu.link)
        self.restart()

    def restart(self) -> None:
        """Forget all measurements."""
        self._measured: Planned | None = None
        self._tilt, self._rate = np.zeros(3), np.zeros(3)

    def measure(self, joints: FloatArray, imu: ImuSample | None) -> None:
        """Set the measurements: encoders (n,) rad, and IMU."""
        if not np.isfinite(joints).all():
            return
        q = self._stance.q.copy()
        q[self._robot.servo_columns] = joints
        tilt, rate = np.zeros(3), np.zeros(3)
        if (
            imu is not None
            and self._link is not None
            and imu.valid
            and np.isfinite([*imu.tilt, *imu.angular_velocity]).all()
        ):
            here = as_quat(self._robot.kinematics.orientations(q[None], [self._link])[0, 0])
            roll, pitch = imu.tilt
            up = -sin(pitch), cos(pitch) * sin(roll), cos(pitch) * cos(roll)
            off = arc(rotated(here, up), UP)
            q[3:7] = product(off, as_quat(q[3:7]))
            tilt = np.array(rotation_vector(off))
            rate = np.array(rotated(product(off, here), as_vector(imu.angular_velocity)))
        self._tilt = self._tilt + self._share * (tilt - self._tilt)
        self._rate = self._rate + self._share * (rate - self._rate)
        self._measured = self.plan(self._dynamics.look(q), self._measured, share=self._share)

    def plan(self, at: LinkStates, before: Planned | None, *, share: float = 1.0) -> Planned:
        """Mass from both soles, after `before`. share: weight of the new velocity."""
        offsets = np.array(
            [yawed((at.mass - sole)[:2], -yaw) for sole, yaw in zip(at.soles, at.yaws.tolist(), strict=True)]
        )
        omega, dt = self._gait.omega, self._gait.dt
        velocity = np.zeros((2, 2))
        if before is not None:
            known = omega * (before.divergent - before.offset)
            velocity = known + share * ((offsets - before.offset) / dt - known)
        return Planned(offsets, offsets + velocity / omega)

    def correction(self, at: LinkStates, planned: Planned, shares: FloatArray) -> FloatArray:
        """Offsets (n,) rad. planned: at the time of the measurements."""
        offset, torque = np.zeros(len(at.axes)), np.zeros(len(at.axes))
        if self._measured is None:
            return offset
        error = matmul(shares, self._measured.divergent - planned.divergent)
        shift = np.minimum(np.maximum(ZMP_GAIN * error, -self._most), self._most)
        upright = axis_turn(UP, at.yaw)
        tilt, rate = (np.array(rotated(upright, as_vector(one))) for one in (self._tilt, self._rate))
        lean = TILT_GAIN * tilt + HIP_RATE_S * rate
        for side, share in enumerate(shares.tolist()):
            x, y = yawed(shift, float(at.yaws[side])).tolist()
            hips, ankles, force = self._hips[side], self._ankles[side], share * self._weight
            torque[ankles] = -matmul(at.axes[ankles], np.array([y * force, -x * force, 0.0]))
            offset[hips] = share * matmul(at.axes[hips], lean)
            offset[ankles] = share * ANKLE_RATE_S * matmul(at.axes[ankles], rate)
        return offset + matmul(self._compliance, torque)


def _joints_near(robot: RobotBody, stance: Stance) -> tuple[list[list[int]], list[list[int]]]:
    """Servos of each leg with the joints nearest to its hip, and to its ankle."""
    names, origins = robot.joint_map.joints, WalkDynamics(robot, stance).look(stance.q).origins
    hips, ankles = list[list[int]](), list[list[int]]()
    legs = leg_joints(robot)
    for foot, side in enumerate("lr"):
        marks = np.array([stance.points[f"{side}_{name}"] for name in ("hip", "knee", "ankle")])
        rows = [row for row, name in enumerate(names) if name in legs and legs[name][0] == foot]
        nearest = [int(norms(marks - origins[row]).argmin()) for row in rows]
        hips.append([row for row, mark in zip(rows, nearest, strict=True) if mark == 0])
        ankles.append([row for row, mark in zip(rows, nearest, strict=True) if mark == 2])
    return hips, ankles
