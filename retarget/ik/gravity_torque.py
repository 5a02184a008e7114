"""Gravity torque of a robot on its soles (inverse dynamics), and the compliance of its joints on P servos.

The mass m has an acceleration a, and its angular momentum changes at a rate M. Each sole takes a share of the force -m
(g + a) on the ground at the zero-moment point:

    torque = m (g + a) J_com - sum_i share_i m (g + a) J_i

J_com: Jacobian of the centre of mass; J_i: of the point of sole i through which its force goes. At rest this is exact,
up to what soles press against each other.
"""

import numpy as np

from hardware.servo import loop_stiffness
from retarget import rotations
from retarget._solver import Probe
from retarget.arithmetic import dot, matmul
from retarget.ik.support_polygon import Stance
from retarget.model.robot import RobotBody
from retarget.types import FloatArray

GRAVITY = 9.81  # m/s^2
UPWARD = np.array([0.0, 0.0, GRAVITY])  # m/s^2
NO_MOMENT = np.zeros(2)  # N m


class GravityTorque:
    """The gravity torques of a robot in a stance."""

    def __init__(self, robot: RobotBody, stance: Stance) -> None:
        self._body = robot.body.solver_body()
        self._mass = robot.body.total_mass
        # Map from the world to the link of each planted sole: local = turn (3, 3) @ world + offset (3,) m.
        self._soles = []
        for sole in stance.soles:
            link = rotations.multiply(sole.orientation, rotations.conjugate(sole.frame.quat))
            turn = rotations.rotate(rotations.conjugate(link), np.eye(3)).T
            self._soles.append((sole.frame, turn, sole.frame.position - matmul(turn, sole.position)))
        self._middles = np.array([sole.outline.mean(axis=0) for sole in stance.soles])  # (k, 2) [m]

    def torques(
        self,
        q: FloatArray,
        acceleration: FloatArray,
        *,
        moment: FloatArray = NO_MOMENT,
    ) -> FloatArray:
        """Torque of every DoF (nv,), N m, in a posture q (nq,) on planted soles. A torque of a free root is a loss of
        balance.

        acceleration: of the centre of mass, (3,) m/s^2. moment: rate of the angular momentum, (2,) N m about x, y.
        """
        com = self._body.centre_of_mass(q[None])[0]
        force = self._mass * (UPWARD + acceleration)
        pressed = com[:2] - (com[2] * force[:2] + np.array([moment[1], -moment[0]])) / force[2]
        shares = np.ones(1)
        if len(self._middles) == 2:
            first, second = self._middles
            between = second - first
            share = min(max(dot(pressed - first, between) / dot(between, between), 0.0), 1.0)
            shares = np.array([1.0 - share, share])
        across = pressed - matmul(shares, self._middles)
        torque = matmul(force, self._body.centre_of_mass_jacobian(q))
        for (frame, turn, offset), middle, share in zip(self._soles, self._middles, shares.tolist(), strict=True):
            point = matmul(turn, np.array([*(middle + across), 0.0])) + offset
            jacobian = self._body.frame_jacobian(q, frame.body, rotations.as_vector(point))[:3]  # (3, nv) of the point
            torque -= matmul(share * force, jacobian)
        return np.asarray(torque)


class LinkMasses:
    """The masses of a robot's links as points."""

    def __init__(self, robot: RobotBody) -> None:
        body = robot.body
        links = np.flatnonzero(body.mass)
        self._masses = body.mass[links]  # (k,) [kg]
        self._probe = Probe(body.solver_body(), links.tolist(), body.com[links], [])

    def places(self, q: FloatArray) -> FloatArray:
        """Positions (k, 3) m of the masses in a posture q (nq,)."""
        return np.asarray(self._probe.read(q)[0])

    def sums(self, places: FloatArray, accelerations: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Acceleration (3,) m/s^2 of the centre of mass, and rate (2,) N m of the angular momentum about it."""
        total = self._masses.sum()
        middle = matmul(self._masses, places) / total
        turning = matmul(self._masses, np.cross(places - middle, accelerations))
        return matmul(self._masses, accelerations) / total, turning[:2]


def joint_compliance(robot: RobotBody) -> FloatArray:
    """Joint deflections by joint torques: (n, n) rad per N m, in servo order. A position loop with a P gain is a
    spring."""
    servos = robot.joint_map.servos
    of_shaft = np.array([1.0 / loop_stiffness(servo) for servo in servos])
    compliance = np.diag(of_shaft / np.square([servo.gear for servo in servos]))
    columns = {servo.joint: index for index, servo in enumerate(servos)}
    for coupling in {servo.coupling for servo in servos if servo.coupling is not None}:
        pair = [columns[joint] for joint in coupling.joints]
        turns = np.array(coupling.matrix)  # joint angles = turns @ shaft angles
        compliance[np.ix_(pair, pair)] = matmul(turns, of_shaft[pair, None] * turns.T)
    return np.asarray(compliance)
