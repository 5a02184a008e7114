"""What a robot's legs carry at rest in the postures that it is put in, beside what their servos can."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from retarget.carried_load import CarriedLoad
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.stance import Stance, plant
from retarget.standing_strength import StandingStrength

__all__ = ["ENOUGH", "PostureLoad", "heaviest_loads", "one_leg_load"]

ENOUGH = 0.65
"""Share of its stall torque that a servo may need for a posture out of which it has to move the robot again."""
FROM_STAND = 1e-4
"""How much a radian away from `stand` counts beside a metre off the floor, or off what carries."""
FREE_ROOT = 3
"""Coordinates of a root that goes where the legs ask; it does not turn."""


@dataclass(frozen=True)
class PostureLoad:
    """What the joint that is nearest to its strength carries in a posture at rest, and the stall torque of its servo
    there, N m. posture: `in stand`, `on one leg`."""

    posture: str
    joint: str
    torque: float
    stall: float

    @property
    def share(self) -> float:
        """Of the stall torque."""
        return self.torque / self.stall

    def __str__(self) -> str:
        return f"{self.posture} {self.joint} {self.torque:.2f} N m, {100.0 * self.share:.0f}% of its stall torque"


def heaviest_loads(robot: RobotBody) -> list[PostureLoad]:
    """Of the legs of a robot with two soles, in `stand`, in `rest` and on one leg; of another none."""
    stance = plant(robot, robot.profile.postures.stand)
    if len(stance.soles) != 2:
        return []
    keeps = StandingStrength(robot, stance, share=1.0)
    rest = plant(robot, robot.profile.postures.rest)
    both = [_heaviest(keeps, f"in {name}", keeps.torques(at.q)) for name, at in (("stand", stance), ("rest", rest))]
    return [*both, one_leg_load(robot)]


def one_leg_load(robot: RobotBody) -> PostureLoad:
    """Of a robot with two soles, its mass over the middle of one, on the leg that carries more then."""
    stance = plant(robot, robot.profile.postures.stand)
    keeps = StandingStrength(robot, stance, share=1.0)
    loads = []
    for sole in stance.soles:
        alone = Stance(stance.q, stance.points, (sole,))
        torque = CarriedLoad(robot, alone).torques(_over(robot, keeps.names, stance, alone), np.zeros(3))
        loads.append(_heaviest(keeps, "on one leg", torque[keeps.dofs]))
    return max(loads, key=lambda load: load.share)


def _heaviest(keeps: StandingStrength, posture: str, torque: FloatArray) -> PostureLoad:
    """torque (k,) N m: of the joints that are watched."""
    worst = int((np.abs(torque) / keeps.stall).argmax())
    return PostureLoad(posture, keeps.names[worst], float(abs(torque[worst])), float(keeps.stall[worst]))


def _over(robot: RobotBody, joints: tuple[str, ...], stance: Stance, alone: Stance) -> FloatArray:
    """The posture (nq,) nearest to `stand` with both soles planted and the centre of mass over the one that is to carry
    alone, its trunk as it is."""
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

    reach = np.full(FREE_ROOT, np.inf)
    at = stance.q[columns]
    low = np.concatenate([-reach, np.minimum(body.lower[dofs] - at, -1e-6)])
    high = np.concatenate([reach, np.maximum(body.upper[dofs] - at, 1e-6)])
    return posture(least_squares(off, np.zeros(FREE_ROOT + len(joints)), bounds=(low, high), xtol=1e-10).x)
