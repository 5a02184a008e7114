"""What the joints of a robot on its soles may carry: a servo gives much less for long than when it is stalled.

A leg's joint j at o, about the axis a, carries what the ground presses on its sole with, at p:

    torque = A - share W u . (p - o),    W = m (g + z''),    u = (-a_y, a_x)

with A from the leg's own weight, which changes slowly. Under a robot at rest p is where its centre of mass is, between
the middles of both soles, and so is the share of the weight. So a bound on a torque is a half-space for centre of mass
and joint together, which the hierarchy keeps like any others: where it carries too much, the robot leans or crouches
less. And the mass is not thrown up faster than the most loaded joint can.
"""

import numpy as np

from retarget import rotations
from retarget._solver import Probe
from retarget.body import Frame, JointType
from retarget.carried_load import CarriedLoad
from retarget.hierarchy import Hierarchy
from retarget.priorities import Priorities, StrengthTask
from retarget.pursuit import braking_displacement
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.stance import Stance
from retarget.standing_balance import GRAVITY
from retarget.task_slots import CARRIES

__all__ = ["StandingStrength", "carrying_frames", "leg_joints", "standing_strength"]

STANDING_SPARE = 1.1
"""A joint may carry so many times what it does in `stand`, however much that is."""
WATCHED = 0.5
"""Share of what it may carry from which on a joint is watched."""
BRAKING = 0.5
"""m/s^2 with which the centre of mass or a joint is braked before the joint carries what it may."""
BACK = 0.5
"""m/s^2 from rest with which it is asked back to where it carries no more. What legs and balance could not give at once
would be taken from limbs that are to be kept apart."""
PEAK = 1.4
"""So many times what it may carry for long a joint may carry while the mass is thrown up."""
LEAST_THROW = 1.0
"""m/s^2 at which it may be thrown up anyway."""

_FREE = np.zeros((0, 7))


class StandingStrength:
    """Of one robot on two soles. share: of their stall torque, what joints may carry."""

    def __init__(self, robot: RobotBody, stance: Stance, *, share: float) -> None:
        body = robot.body
        joints = leg_joints(robot)
        self._names = tuple(joints)
        self._foot = np.array([foot for foot, _ in joints.values()], dtype=np.intp)
        frames = [frame for _, frame in joints.values()]
        rows = [body.joint_index(name) for name in joints]
        self._axis = body.joint_axis[rows]  # (k, 3), of the link
        links = [frame.body for frame in frames]
        self._probe = Probe(body.solver_body(), links, np.array([frame.position for frame in frames]), links)
        self._load = CarriedLoad(robot, stance)
        self.dofs = body.joint_dof[rows]
        """Of the joints (k,) that are watched."""
        self._middles = np.array([sole.outline.mean(axis=0) for sole in stance.soles])  # (2, 2) [m]
        self._weight = GRAVITY * body.total_mass  # [N]
        servos = {servo.joint: servo for servo in robot.joint_map.servos}
        self.stall = np.array([servos[name].model.stall_torque * abs(servos[name].gear) for name in joints])
        """Stall torque of each joint's servo (k,), N m."""
        at_rest = np.abs(self._load.torques(stance.q, np.zeros(3))[self.dofs])
        self.most = np.maximum(share * self.stall, STANDING_SPARE * at_rest)
        """What each joint (k,) may carry for long, N m."""

    @property
    def names(self) -> tuple[str, ...]:
        """The joints that are watched."""
        return self._names

    def torques(self, q: FloatArray) -> FloatArray:
        """What the joints (k,) carry at rest in posture q (nq,), N m."""
        return np.asarray(self._load.torques(q, np.zeros(3))[self.dofs])

    def aim(
        self,
        hierarchy: Hierarchy,
        targets: FloatArray,
        q: FloatArray,
        mass: tuple[FloatArray, FloatArray],
        dt: float,
        *,
        keeps: bool = True,
    ) -> None:
        """Write what is allowed in the next `dt` s to a robot in posture q (nq,). mass: its centre of mass (3,) m, and
        the velocity of that (3,) m/s. keeps: whether anything is to be kept; on one leg more is to be carried."""
        spaces = self.spaces(q, mass, dt) if keeps else [_FREE] * len(self._names)
        for name, edges in zip(self._names, spaces, strict=True):
            hierarchy.set_strength(targets, name, edges)

    def spaces(self, q: FloatArray, mass: tuple[FloatArray, FloatArray], dt: float) -> list[FloatArray]:
        """Half-spaces (e, 7) of each joint: n . c + m . o <= d for the centre of mass c and the joint's place o, after
        the next `dt` s."""
        com, velocity = mass
        torque = self.torques(q)
        used = np.abs(torque) / self.most
        by_com, by_joint, places = self._gradients(q, com)
        lever = 2.0 / self._weight  # [m per N m]: half of the weight is on either leg
        edges: list[list[list[float]]] = [[] for _ in self._names]
        for k in np.flatnonzero(used > WATCHED).tolist():
            sign = 1.0 if torque[k] > 0.0 else -1.0
            n, m = sign * lever * by_com[k], sign * lever * by_joint[k]
            step = braking_displacement(lever * float(self.most[k] - abs(torque[k])), BRAKING * dt * dt)
            d = float(n @ com[:2] + m @ places[k, :2]) + max(step, -BACK * dt * dt)
            edges[k].append([*n.tolist(), 0.0, *m.tolist(), 0.0, d])
        worst = int(used.argmax())
        throw = max(GRAVITY * (PEAK / max(float(used[worst]), 1e-3) - 1.0), LEAST_THROW)
        rise = float(com[2] + velocity[2] * dt) + throw * dt * dt
        edges[worst].append([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, rise])
        return [np.array(rows).reshape(-1, 7) for rows in edges]

    def _gradients(self, q: FloatArray, com: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of the torques: by the centre of mass (k, 2) and by the joint's place (k, 2), N; and these places (k, 3)."""
        places, turns, _ = self._probe.read(q)
        axes = rotations.rotate(turns, self._axis)
        u = np.column_stack([-axes[:, 1], axes[:, 0]])
        first, second = self._middles
        across = second - first
        length = float(np.linalg.norm(across))
        along, share = across / length, float((com[:2] - first) @ across) / length**2
        between = 0.0 < share < 1.0
        shares = np.array([1.0 - share, share]).clip(0.0, 1.0)[self._foot]
        pressed = self._middles[self._foot] + com[:2] - (self._middles[0] + min(max(share, 0.0), 1.0) * across)
        arm = np.einsum("ki,ki->k", u, pressed - places[:, :2])
        moved = u - np.outer(u @ along, along) if between else u
        shifted = np.where(self._foot == 0, -1.0, 1.0)[:, None] * (along / length if between else 0.0 * along)
        by_com = -self._weight * (arm[:, None] * shifted + shares[:, None] * moved)
        return by_com, self._weight * shares[:, None] * u, places


def leg_joints(robot: RobotBody) -> dict[str, tuple[int, Frame]]:
    """Joints that one leg alone has between root and sole: number of the foot, and where the joint is on its link."""
    body = robot.body
    chains = [body.chain_to_root(robot.frame(foot.frame).body) for foot in robot.profile.feet.values()]
    found = {}
    for servo in robot.joint_map.servos:
        index = body.joint_index(servo.joint)
        link = int(body.joint_body[index])
        feet = [foot for foot, chain in enumerate(chains) if link in chain]
        if len(feet) == 1 and body.joint_type[index] == JointType.HINGE and servo.coupling is None:
            frame = Frame(servo.joint, link, body.joint_pos[index], np.array([1.0, 0.0, 0.0, 0.0]))
            found[servo.joint] = (feet[0], frame)
    return found


def carrying_frames(robot: RobotBody) -> dict[str, Frame]:
    """Frames at the joints that carry, under the names by which tasks find them."""
    return {CARRIES + name: frame for name, (_, frame) in leg_joints(robot).items()}


def standing_strength(robot: RobotBody, priorities: Priorities, stance: Stance) -> StandingStrength | None:
    """What these priorities keep of the strength of a robot in its stance on two soles; None: nothing."""
    shares = [task.share for _, _, task in priorities.tasks() if isinstance(task, StrengthTask)]
    if not shares or len(stance.soles) != 2:
        return None
    return StandingStrength(robot, stance, share=min(shares))
