"""The end of a run, planned before it begins. The move to rest is tried from the stance, with the controller and the
kind of gate of the run."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from retarget.errors import UsageError
from retarget.human.samples import PerformerInput
from retarget.ik.hierarchy import SceneObstacles
from retarget.ik.support_polygon import Stance, plant, support_distance
from retarget.model.observers import contacts, robot_observers
from retarget.model.robot import RobotBody, plant_root
from retarget.model.scene_state import SceneState
from retarget.robot.follower import stance_angles
from retarget.run.controllers import GoToRest, first_commanded, next_commanded
from retarget.run.options import RunOptions
from retarget.run.supervisor import End
from retarget.safety.clearance import PathClearance
from retarget.safety.gate import Gate
from retarget.schema.scene import FLOOR, on_floor
from retarget.types import MM, FloatArray

LONGEST_S = 30.0
"""[s] Longest trial: three keyframes at the slowest speed cap take less."""


@dataclass(frozen=True)
class RestTrajectory:
    """A tried move to rest. keyframes: postures, the last is `rest`. refused: the reason, or "". margin: least
    distance, m, of the centre of mass inside the soles."""

    keyframes: tuple[str, ...]
    refused: str
    margin: float

    @property
    def is_safe(self) -> bool:
        """True if it passes the gate, and the robot does not tip."""
        return not self.refused and self.margin > 0.0

    def __str__(self) -> str:
        *by, _ = self.keyframes
        text = f"to rest by {' and '.join(by)}" if by else "straight to rest"
        if self.refused:
            return f"{text}: {self.refused}"
        if self.margin <= 0.0:
            return f"{text}: it would tip, with its centre of mass {-MM * self.margin:.0f} mm outside the soles"
        return f"{text}, centre of mass {MM * self.margin:.0f} mm inside the edge of the soles at worst"


@dataclass(frozen=True)
class EndPlan:
    """The planned end of a run. why: it ends standing."""

    end: End = End.BRAKED
    keyframes: tuple[str, ...] = ("rest",)
    why: str = ""


UNKNOWN = "its profile does not say that it stays_at_rest"
STANDS_BY_OPTION = "as --stand-at-end asks"


def plan_end(robot: RobotBody, stance: Stance, gate: Gate, options: RunOptions, *, dt: float) -> EndPlan:
    """The end of a run of a robot in its stance. gate: for this purpose alone. Raises UsageError if no move to rest is
    safe, and no option allows to end standing."""
    postures = robot.profile.postures
    if not robot.stands:
        return EndPlan(End.AT_REST, postures.to_rest)
    if options.stand_at_end:
        return EndPlan(End.STANDING, why=STANDS_BY_OPTION)
    if not (postures.stays_at_rest or options.torque_off_at_end):
        return EndPlan(End.STANDING, why=UNKNOWN)
    first: RestTrajectory | None = None
    for tried in rest_trajectories(robot, stance, gate, dt=dt):
        if tried.is_safe:
            return EndPlan(End.AT_REST, tried.keyframes)
        first = first or tried
    raise UsageError(
        "no way to rest is safe",
        where=robot.profile.name if options.scene is None else f"{robot.profile.name}, --scene {options.scene}",
        found=str(first),
        allowed="a way from its stance to posture `rest`, straight or by other postures of its profile",
        next_step="Move what is in the way, give postures.to_rest other keyframes, or end it standing: --stand-at-end",
    )


def usual_rest_trajectory(robot: RobotBody) -> RestTrajectory | None:
    """The profile's move to rest, tried without a scene; None without planted soles."""
    if not robot.stands:
        return None
    dt, stance = 1.0 / robot.profile.safety.rate_hz, plant(robot, robot.profile.postures.stand)
    observers = robot_observers(robot).for_solver(robot.body)
    clearance = PathClearance(robot, observers, SceneObstacles(None), dt=dt) if robot_observers(robot).names else None
    return next(rest_trajectories(robot, stance, Gate(robot.joint_map, dt=dt, clearance=clearance), dt=dt))


def rest_trajectories(robot: RobotBody, stance: Stance, gate: Gate, *, dt: float) -> Iterator[RestTrajectory]:
    """Try moves to rest from the stance: the profile's, then by other postures, the shortest first."""
    usual = robot.profile.postures.to_rest
    others = [(*by, "rest") for count in (1, 2) for by in permutations(("attractor", "neutral", "stand"), count)]
    for keyframes in dict.fromkeys([usual, ("rest",), *others]):
        yield _played(robot, stance, gate, keyframes, dt=dt)


def _played(robot: RobotBody, stance: Stance, gate: Gate, keyframes: tuple[str, ...], *, dt: float) -> RestTrajectory:
    q = robot.posture(stance_angles(robot))
    plant_root(robot, stance.q, q)
    commanded, clearance = first_commanded(robot, gate.begin(q[robot.servo_columns]), q), gate.clearance
    if clearance is not None:
        clearance.begin(commanded.joints)
    moves = GoToRest(robot, keyframes, dt=dt)
    moves.begin(commanded)
    postures = [commanded.q]
    for _ in range(round(LONGEST_S / dt)):
        target = moves.target(commanded, PerformerInput(), speed_override=1.0)
        goal = None if target is None else gate.check(commanded.goal, target.joints, standing=commanded.standing)
        if goal is None:
            break
        commanded = next_commanded(robot, commanded, goal, target, dt=dt, on_soles=True)
        postures.append(commanded.q)
        if moves.has_arrived(commanded):
            return RestTrajectory(keyframes, "", _margin(robot, stance, np.array(postures)))
    near = "" if clearance is None else clearance.limiting_pair(robot_observers(robot).names)
    refused = f"{near} come too near to each other" if near else "a goal is beyond the limits, or it takes too long"
    return RestTrajectory(keyframes, refused, _margin(robot, stance, np.array(postures)))


def _margin(robot: RobotBody, stance: Stance, postures: FloatArray) -> float:
    """Least distance, m, of the centre of mass inside the soles in postures (T, nq)."""
    edges = stance.edges(0.0)
    return min(float(support_distance(com, edges)) for com in robot.kinematics.centre_of_mass(postures))


def at_rest(robot: RobotBody) -> str:
    """Describe posture `rest` of a robot on its soles: balance, lowest part, and advice if it may topple; "" without
    soles."""
    if not robot.stands:
        return ""
    stance = plant(robot, robot.profile.postures.rest)
    com = robot.kinematics.centre_of_mass(stance.q[None])[0]
    margin = MM * float(support_distance(com, stance.edges(0.0)))
    text = f"centre of mass {abs(margin):.0f} mm {'inside' if margin > 0.0 else 'outside'} the edge of the soles"
    floor = SceneState(on_floor(None))
    near = contacts(robot.body, robot_observers(robot), floor, stance.q, deeper_than=-np.inf)
    lowest = next((contact for contact in near if contact.other == FLOOR), None)
    if lowest is not None:
        where = "in" if lowest.depth > 0.0 else "above"
        text += f"; lowest: {lowest.part}, {abs(MM * lowest.depth):.0f} mm {where} the floor"
    if margin <= 0.0 or (lowest is not None and lowest.depth >= 0.0):
        text += "; it may topple when torque goes off: crouch less, or lean it over its soles, in postures.rest"
    return text
