"""The body of a walking robot: posture of a moment of the pattern, its torques, and what is measured of it."""

from typing import Any

import numpy as np

from benchmarks.walking_feedback import Measured
from benchmarks.walking_legs import CHAIN, leg_angles, leg_of, turn_z
from benchmarks.walking_pattern import Moment
from hardware.imu import ImuSample
from retarget import rotations
from retarget.ik.gravity_torque import GRAVITY
from retarget.model.body_file import engine
from retarget.model.robot import RobotBody
from retarget.types import FloatArray

SIDES = ("l", "r")
FITS = 2
"""Times that the trunk is moved until the centre of mass is where it was planned; the last posture is a good start."""


class WalkingBody:
    """Postures of a robot whose legs follow a pattern while its other joints are given."""

    def __init__(self, robot: RobotBody, model: Any, *, height: float) -> None:
        """model: compiled, of the nominal robot, a free root first."""
        self._robot, self._model = robot, model
        mujoco = engine()
        self._data = mujoco.MjData(model)
        self._mujoco = mujoco
        joints = robot.joint_map.joints
        self.legs = tuple(leg_of(robot, side) for side in SIDES)
        self.columns = np.array([[joints.index(f"{side}_{name}") for name in CHAIN] for side in SIDES])
        """(2, 6): where the joints of both legs stand in servo order."""
        self._qpos = np.array([model.joint(name).qposadr[0] for name in joints])
        self._dofs = np.array([model.joint(name).dofadr[0] for name in joints])
        self._feet = [model.body(robot.body.body_names[sole.body]).id for sole in robot.soles]
        self._root = np.array([0.0, 0.0, height + 0.02, 1.0, 0.0, 0.0, 0.0])
        self._jacobian = np.zeros((2, 3, model.nv))
        self.weight = float(model.body_subtreemass[1]) * GRAVITY

    def posture(self, moment: Moment, height: float, joints: FloatArray) -> FloatArray:
        """The engine's coordinates (nq,) at a moment. joints (n,): in servo order; those of the legs are replaced."""
        robot, root = self._robot, self._root
        trunk = turn_z(moment.yaw)
        root[3:7] = rotations.turn((0.0, 0.0, moment.yaw))
        joints = joints.copy()
        q = np.zeros(robot.body.nq)
        target = np.array([*moment.pendulum.mass, height])
        soles = [(turn_z(sole.yaw), sole.place) for sole in moment.soles]
        for fit in range(FITS + 1):
            for leg, columns, (turn, place) in zip(self.legs, self.columns, soles, strict=True):
                joints[columns] = leg_angles(leg, trunk, root[:3], turn, place)
            if fit == FITS:
                break
            q[:7], q[robot.servo_columns] = root, joints
            root[:3] += target - robot.kinematics.centre_of_mass(q[None])[0]
        found = np.zeros(self._model.nq)
        found[:7], found[self._qpos] = root, joints
        return found

    def joints(self, q: FloatArray) -> FloatArray:
        """Joints (n,) in servo order."""
        return np.asarray(q[self._qpos])

    def torques(
        self, postures: tuple[FloatArray, ...], dt: float, moment: Moment
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Torques (n,) N m without armature and friction, speeds (n,) rad/s and accelerations (n,) rad/s^2 of joints in
        the middle one of three postures (nq,), dt s apart. The soles press as the pattern's load asks."""
        before, now, after = postures
        mujoco, model, data = self._mujoco, self._model, self._data
        v0, v1 = np.zeros(model.nv), np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, v0, dt, before, now)
        mujoco.mj_differentiatePos(model, v1, dt, now, after)
        data.qpos[:], data.qvel[:], data.qacc[:] = now, 0.5 * (v0 + v1), (v1 - v0) / dt
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        needed = np.zeros(model.nv)
        mujoco.mj_rne(model, data, 1, needed)
        torque = needed[self._dofs] - self._pressed(needed, moment)[self._dofs]
        return torque, data.qvel[self._dofs].copy(), data.qacc[self._dofs].copy()

    def _pressed(self, needed: FloatArray, moment: Moment) -> FloatArray:
        """Generalised forces (nv,) of the ground on the soles. It gives what the root lacks of `needed` (nv,): a force
        that presses where the zero-moment point is, and a turn about z."""
        mujoco, model, data = self._mujoco, self._model, self._data
        force = needed[:3].copy()
        about = data.xmat[1].reshape(3, 3) @ needed[3:6] + np.cross(data.qpos[:3], force)
        lift = max(float(force[2]), 1.0)
        centre = np.array([-about[1] / lift, about[0] / lift, 0.0])
        spin = float(about[2] - (centre[0] * force[1] - centre[1] * force[0]))
        places = [sole.place for sole in moment.soles]
        middle = moment.shares[0] * places[0] + moment.shares[1] * places[1]
        found = np.zeros(model.nv)
        for share, place, foot in zip(moment.shares, places, self._feet, strict=True):
            if share > 0.0:
                point = place + (centre - middle)
                point[2] = 0.0
                mujoco.mj_jac(model, data, self._jacobian[0], self._jacobian[1], point, foot)
                found += share * (self._jacobian[0].T @ force + spin * self._jacobian[1][2])
        return found

    def measure(self, joints: FloatArray, sample: ImuSample, yaw: float) -> Measured:
        """What encoders (n,) rad and the IMU say of a robot whose trunk is planned at `yaw`."""
        robot, mujoco, model, data = self._robot, self._mujoco, self._model, self._data
        roll, pitch = sample.tilt
        turn = rotations.product(rotations.turn((0.0, 0.0, yaw)), rotations.turn((roll, pitch, 0.0)))
        data.qpos[:3], data.qpos[3:7], data.qpos[self._qpos] = 0.0, turn, joints
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        soles, yaws = [], []
        for foot, sole in zip(self._feet, robot.soles, strict=True):
            matrix = data.xmat[foot].reshape(3, 3)
            soles.append(data.xpos[foot] + matrix @ sole.position)
            yaws.append(np.arctan2(matrix[1, 0], matrix[0, 0]))
        legs = self._dofs[self.columns]
        axes = data.xaxis[np.array([[model.dof_jntid[dof] for dof in leg] for leg in legs])]
        about = data.xmat[1].reshape(3, 3)
        upright = turn_z(yaw)
        return Measured(
            mass=data.subtree_com[1].copy(),
            axes=axes,
            tilt=upright @ np.array([roll, pitch, 0.0]),
            rate=about @ sample.angular_velocity,
            soles=np.array(soles),
            yaws=np.array(yaws),
        )
