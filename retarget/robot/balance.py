"""Balance of a robot on its soles: bounds for its centre of mass, and for the torques of its legs.

At rest a robot stands while its centre of mass c is over the support polygon. In motion, as a point mass at height z,
it stands while its zero-moment point p is inside (Vukobratovic and Borovac, Int. J. Humanoid Robotics 1(1), 2004), and
can stop while its capture point xi is (Pratt et al., Humanoids 2006):

    p  = c - z / (g + z'') c''                n . p <= d for every edge (n, d)
    xi = c + c' / omega, omega^2 = g / z      n . xi <= d

Both are half-spaces for the centre of mass after the tick. With p = xi + (xi - d) n, a capture point outside returns as
exp(-omega t).
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from retarget import rotations
from retarget._solver import MASS_BRAKING, Probe, braking_displacement
from retarget.arithmetic import dot, matmul, norm
from retarget.ik.gravity_torque import GRAVITY, GravityTorque
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.least_squares import least_squares
from retarget.ik.support_polygon import Stance, plant
from retarget.ik.tasks import CARRIES
from retarget.model.body import Frame, JointType
from retarget.model.robot import RobotBody
from retarget.schema.priorities import CentreOfMassTask, Priorities, StrengthTask
from retarget.types import FloatArray

HEAVE = 1.5
"""Greatest vertical acceleration of the centre of mass, m/s^2: soles slide or tilt under other loads."""
LARGER = 1.2
"""Size of the zero-moment point's polygon relative to the capture point's, as soles slip less in a small one."""
SPARE = 0.5
"""Tolerance of the zero-moment point that returns a capture point, relative to the distance outside."""

Edges = list[list[float]]
Row = tuple[float, float, float, float]


@dataclass(frozen=True)
class Room:
    """Edges for capture point and zero-moment point; outer: for the latter while the former is outside."""

    capture_point: Edges
    zero_moment_point: Edges
    outer: Edges


class StandingBalance:
    """Half-spaces of the `support` tasks. edges (e, 3): of the support polygon, drawn in by their margin."""

    def __init__(self, priorities: Priorities, stance: Stance) -> None:
        self.edges = stance.edges(max((task.margin for task in support_tasks(priorities)), default=0.0))
        self._drawn_in: Edges = self.edges.tolist()
        share = moving_share(priorities)
        self._room = None
        if share is not None:  # polygons about the middle of the soles
            middle = np.concatenate([sole.outline for sole in stance.soles]).mean(axis=0)
            at, largest = matmul(self.edges[:, :2], middle), min(LARGER * share, 1.0)
            captured, pressed = (
                np.column_stack([self.edges[:, :2], at + size * (self.edges[:, 2] - at)]).tolist()
                for size in (largest / LARGER, largest)
            )
            self._room = Room(captured, pressed, self.edges.tolist())

    def spaces(self, com: FloatArray, velocity: FloatArray, dt: float) -> FloatArray:
        """Half-spaces (k, 4) for the centre of mass after `dt` s, now at com (3,) m with velocity (3,) m/s."""
        if self._room is None:
            x, y, _ = com.tolist()
            change, drawn = MASS_BRAKING * dt * dt, []
            for nx, ny, offset in self._drawn_in:
                across = nx * x + ny * y
                drawn.append((nx, ny, 0.0, across + braking_displacement(offset - across, change)))
            return np.array(drawn)
        return moving_spaces(self._room, com, velocity, dt)


def support_tasks(priorities: Priorities) -> list[CentreOfMassTask]:
    """Tasks that keep the centre of mass over the soles."""
    return [task for _, _, task in priorities.tasks() if isinstance(task, CentreOfMassTask)]


def moving_share(priorities: Priorities) -> float | None:
    """Share of the support polygon for a mass in motion; None: at rest."""
    return min((task.moving for task in support_tasks(priorities) if task.moving is not None), default=None)


def moving_spaces(room: Room, com: FloatArray, velocity: FloatArray, dt: float) -> FloatArray:
    """Half-spaces (k, 4), n . c <= d in m, for capture point and zero-moment point."""
    x, y, z = com.tolist()
    vx, vy, vz = velocity.tolist()
    settle = sqrt(z / GRAVITY) / dt  # 1 / (omega dt)
    capture = (x + settle * dt * vx, y + settle * dt * vy)
    push = _pushed_back(room, capture)

    def captured(nx: float, ny: float, offset: float) -> Row:
        # n . (c + (c - c_now) / (omega dt)) <= d, or as the push allows
        at, speed = nx * x + ny * y, nx * vx + ny * vy
        inside = (offset + settle * at) / (1.0 + settle)
        if push is not None and nx * capture[0] + ny * capture[1] > offset:
            inside = max(inside, at + speed * dt + GRAVITY / z * (at - (nx * push[0] + ny * push[1])) * dt * dt)
        return nx, ny, 0.0, inside

    def borne(nx: float, ny: float, offset: float) -> Row:
        at, speed = nx * x + ny * y, nx * vx + ny * vy
        if push is not None:
            offset = max(offset, nx * push[0] + ny * push[1] + push[2])
        # (n.c - d)(g + z'') <= z n.c'', times dt^2 / z
        lever = (at - offset) / z
        return -nx, -ny, lever, lever * (z + vz * dt - GRAVITY * dt * dt) - at - speed * dt

    ahead, change = z + vz * dt, HEAVE * dt * dt
    heaved = ((0.0, 0.0, 1.0, ahead + change), (0.0, 0.0, -1.0, change - ahead))
    kept = [captured(*edge) for edge in room.capture_point] + [borne(*edge) for edge in room.zero_moment_point]
    return np.array([*kept, *heaved])


def _pushed_back(room: Room, capture: tuple[float, float]) -> tuple[float, float, float] | None:
    """Zero-moment point (x, y) m that returns a capture point, and its tolerance, m; None: it is inside."""
    x, y = capture
    beyond, nx, ny = max((ex * x + ey * y - offset, ex, ey) for ex, ey, offset in room.capture_point)
    if beyond <= 0.0:
        return None
    reach = beyond
    for ex, ey, offset in room.outer:
        along = ex * nx + ey * ny
        if along > 0.0:
            reach = min(reach, max(offset - ex * x - ey * y, 0.0) / along)
    return x + reach * nx, y + reach * ny, SPARE * reach


# Torque limits. Joint j of a leg, at o with axis a, carries the force on its sole at p:
#
#     torque = A - share W u . (p - o),    W = m (g + z''),    u = (-a_y, a_x)
#
# A is of the leg's own weight. At rest p and share follow from the centre of mass, and a limit is a half-space.

STANDING_SPARE = 1.1
"""A joint may always carry this multiple of its torque in `stand`."""
WATCHED = 0.5
"""Share of its limit above which a torque is bounded."""
STRENGTH_BRAKING = 0.5
"""Deceleration before a torque limit, m/s^2."""
BACK = 0.5
"""Acceleration of an overloaded joint's return, m/s^2."""

_FREE = np.zeros((0, 7))  # half spaces of a strength that limits nothing


class StandingStrength:
    """Torque limits of legs on two soles, at a share of the stall torque."""

    def __init__(self, robot: RobotBody, stance: Stance, *, share: float) -> None:
        body = robot.body
        joints = leg_joints(robot)
        self.names = tuple(joints)
        self._foot = np.array([foot for foot, _ in joints.values()], dtype=np.intp)
        frames = [frame for _, frame in joints.values()]
        rows = [body.joint_index(name) for name in joints]
        self._axis = body.joint_axis[rows]  # (k, 3), of the link
        links = [frame.body for frame in frames]
        self._probe = Probe(body.solver_body(), links, np.array([frame.position for frame in frames]), links)
        self._load = GravityTorque(robot, stance)
        self.dofs = body.joint_dof[rows]
        self._middles = np.array([sole.outline.mean(axis=0) for sole in stance.soles])  # (2, 2) [m]
        self._weight = GRAVITY * body.total_mass  # [N]
        servos = {servo.joint: servo for servo in robot.joint_map.servos}
        self.stall = np.array([servos[name].model.stall_torque * abs(servos[name].gear) for name in joints])
        """Stall torques (k,), N m."""
        at_rest = np.abs(self._load.torques(stance.q, np.zeros(3))[self.dofs])
        self.most = np.maximum(share * self.stall, STANDING_SPARE * at_rest)
        """Greatest continuous torques (k,), N m."""

    def torques(self, q: FloatArray) -> FloatArray:
        """Torques (k,) at rest in posture q (nq,), N m."""
        return np.asarray(self._load.torques(q, np.zeros(3))[self.dofs])

    def aim(
        self,
        hierarchy: Hierarchy,
        targets: FloatArray,
        q: FloatArray,
        com: FloatArray,
        dt: float,
        *,
        keeps: bool = True,
    ) -> None:
        """Write the half-spaces of the next `dt` s. q: (nq,); com: (3,) m. keeps: False removes all limits."""
        spaces = self.spaces(q, com, dt) if keeps else [_FREE] * len(self.names)
        for name, edges in zip(self.names, spaces, strict=True):
            hierarchy.set_strength(targets, name, edges)

    def spaces(self, q: FloatArray, com: FloatArray, dt: float) -> list[FloatArray]:
        """Half-spaces (0 or 1, 7) of each joint, n . c + m . o <= d after `dt` s; none for a small torque."""
        torque = self.torques(q)
        used = np.abs(torque) / self.most
        by_com, by_joint, places = self._gradients(q, com)
        lever = 2.0 / self._weight  # [m per N m]
        spaces = [_FREE] * len(self.names)
        for k in np.flatnonzero(used > WATCHED).tolist():
            sign = 1.0 if torque[k] > 0.0 else -1.0
            n, m = sign * lever * by_com[k], sign * lever * by_joint[k]
            step = braking_displacement(lever * float(self.most[k] - abs(torque[k])), STRENGTH_BRAKING * dt * dt)
            d = dot(n, com[:2]) + dot(m, places[k, :2]) + max(step, -BACK * dt * dt)
            spaces[k] = np.array([[*n.tolist(), 0.0, *m.tolist(), 0.0, d]])
        return spaces

    def _gradients(self, q: FloatArray, com: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Gradients (k, 2) N of torques by centre of mass and joints' places, and these places (k, 3) m."""
        places, turns, _ = self._probe.read(q)
        axes = rotations.rotate(turns, self._axis)
        u = np.column_stack([-axes[:, 1], axes[:, 0]])
        first, second = self._middles
        across = second - first
        length = norm(across)
        along, share = across / length, dot(com[:2] - first, across) / (length * length)
        between = 0.0 < share < 1.0
        shares = np.array([1.0 - share, share]).clip(0.0, 1.0)[self._foot]
        pressed = self._middles[self._foot] + com[:2] - (self._middles[0] + min(max(share, 0.0), 1.0) * across)
        arm = (u * (pressed - places[:, :2])).sum(axis=1)
        moved = u - matmul(u, along)[:, None] * along if between else u
        shifted = np.where(self._foot == 0, -1.0, 1.0)[:, None] * (along / length if between else 0.0 * along)
        by_com = -self._weight * (arm[:, None] * shifted + shares[:, None] * moved)
        return by_com, self._weight * shares[:, None] * u, places


def leg_joints(robot: RobotBody) -> dict[str, tuple[int, Frame]]:
    """Joints between the root and a single sole: name -> foot, and frame on the link."""
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
    """Frames of `leg_joints` by the names in tasks."""
    return {CARRIES + name: frame for name, (_, frame) in leg_joints(robot).items()}


def standing_strength(robot: RobotBody, priorities: Priorities, stance: Stance) -> StandingStrength | None:
    """Limits of the `strength` tasks; None without them or without two soles."""
    shares = [task.share for _, _, task in priorities.tasks() if isinstance(task, StrengthTask)]
    if not shares or len(stance.soles) != 2:
        return None
    return StandingStrength(robot, stance, share=min(shares))


ENOUGH = 0.65
"""Share of the stall torque that a servo may need at rest."""
FROM_STAND = 1e-4
"""Weight of a radian away from `stand`, relative to a metre of error."""
FREE_ROOT = 3
"""Coordinates of the root that the fit may change."""


@dataclass(frozen=True)
class PostureLoad:
    """Greatest torque in a posture at rest, and its servo's stall torque, N m."""

    posture: str
    joint: str
    torque: float
    stall: float

    @property
    def share(self) -> float:
        """Share of the stall torque."""
        return self.torque / self.stall

    def __str__(self) -> str:
        return f"{self.posture} {self.joint} {self.torque:.2f} N m, {100.0 * self.share:.0f}% of its stall torque"


def heaviest_loads(robot: RobotBody) -> list[PostureLoad]:
    """Heaviest loads of the legs in `stand`, in `rest` and on one leg."""
    stance = plant(robot, robot.profile.postures.stand)
    if len(stance.soles) != 2:
        return []
    keeps = StandingStrength(robot, stance, share=1.0)
    rest = plant(robot, robot.profile.postures.rest)
    both = [_heaviest(keeps, f"in {name}", keeps.torques(at.q)) for name, at in (("stand", stance), ("rest", rest))]
    return [*both, on_one_leg(robot)[0]]


def on_one_leg(robot: RobotBody) -> tuple[PostureLoad, float]:
    """The heavier load of both legs, each under the centre of mass; and the distance, m, that the mass stays off."""
    stance = plant(robot, robot.profile.postures.stand)
    keeps, loads, missed = StandingStrength(robot, stance, share=1.0), [], 0.0
    for sole in stance.soles:
        alone = Stance(stance.q, stance.points, (sole,))
        over, off = _over(robot, keeps.names, stance, alone)
        missed = max(missed, off)
        torque = GravityTorque(robot, alone).torques(over, np.zeros(3))[keeps.dofs]
        loads.append(_heaviest(keeps, "on one leg", torque))
    return max(loads, key=lambda load: load.share), missed


def _heaviest(keeps: StandingStrength, posture: str, torque: FloatArray) -> PostureLoad:
    worst = int((np.abs(torque) / keeps.stall).argmax())
    return PostureLoad(posture, keeps.names[worst], float(abs(torque[worst])), float(keeps.stall[worst]))


def _over(robot: RobotBody, joints: tuple[str, ...], stance: Stance, alone: Stance) -> tuple[FloatArray, float]:
    """Posture (nq,) nearest to `stand` with the centre of mass over the sole of `alone`; and its error, m."""
    body, solver = robot.body, robot.body.solver_body()
    columns = body.joint_qpos[[body.joint_index(joint) for joint in joints]]
    dofs = [body.dof_index(joint) for joint in joints]
    middle = alone.soles[0].outline.mean(axis=0)

    def posture(moved: FloatArray) -> FloatArray:
        q = stance.q.copy()
        q[:FREE_ROOT] += moved[:FREE_ROOT]
        q[columns] += moved[FREE_ROOT:]
        return q

    def off(moved: FloatArray) -> FloatArray:
        q = posture(moved)[None]
        planted = [np.zeros(0)]
        for sole in stance.soles:
            corners = solver.points(q, [sole.frame.body] * len(sole.corners), sole.corners)[0]
            planted.append((corners - np.column_stack([sole.outline, np.zeros(len(corners))])).ravel())
        across = solver.centre_of_mass(q)[0, :2] - middle
        return np.concatenate([*planted, across, FROM_STAND * moved[FREE_ROOT:]])

    at = stance.q[columns]
    low = np.concatenate([np.full(FREE_ROOT, -np.inf), np.minimum(body.lower[dofs] - at, -1e-6)])
    high = np.concatenate([np.full(FREE_ROOT, np.inf), np.maximum(body.upper[dofs] - at, 1e-6)])
    found = least_squares(off, np.zeros(FREE_ROOT + len(joints)), lower=low, upper=high, close=1e-10)
    return posture(found), float(np.abs(off(found)[: -len(joints)]).max())
