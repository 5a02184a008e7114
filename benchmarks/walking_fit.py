"""`python -m benchmarks.walking_fit`: which step times, heights and lengths a robot's servos could follow, by the plan
alone: its greatest speed and acceleration of a joint, and torque as a share of what the servo gives at that speed.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from benchmarks.table import print_table
from benchmarks.walking import SETTLED_S, STOP_S, Case, Walker
from hardware.motors import drive_numbers
from retarget.model.robot import RobotBody, load_robot
from retarget.types import FloatArray
from sim.physics.mount import mount_of
from sim.physics.perturbation import NOMINAL
from sim.physics.world import World, build_world

STEPS = 8
"""Steps at full speed of which needs are taken."""


@dataclass(frozen=True)
class Needs:
    """What a walk asks of the joint that needs most: speed rad/s and acceleration rad/s^2 of the posture, the same of
    the goal before it, and torque as a share of what the servo gives at that speed."""

    speed: float
    acceleration: float
    goal_speed: float
    goal_acceleration: float
    torque: float
    joint: str


def needs(robot: RobotBody, world: World, case: Case) -> Needs:
    """What a walk asks of the servos, without a simulation."""
    step = case.ticks / robot.profile.safety.rate_hz
    begin = SETTLED_S + 0.5 + max(case.forward, 4.0 * case.left, case.turn / 4.0) / 0.03 * step + 2.0 * step
    walker = Walker(robot, world.model, replace(case, arms=0.0, seconds=begin + STEPS * step + STOP_S))
    dt = walker.gait.dt
    rows = [walker.plan() for _ in range(round((begin + STEPS * step) / dt))]
    planned, ahead = (np.array(column)[round(begin / dt) :] for column in zip(*rows, strict=True))
    speed, acceleration = _rates(planned, dt)
    goal_speed, goal_acceleration = _rates(planned + ahead, dt)
    numbers = [drive_numbers(servo.model) for servo in robot.joint_map.servos]
    # What the spring and the lag ask for is torque and the loss with speed; friction is on top.
    torque = (ahead - walker.lag * speed) * walker.stiffness + np.sign(speed) * [one.friction for one in numbers]
    voltage = robot.joint_map.servos[0].model.voltage
    line = [one.stall_torque(voltage) for one in numbers] - np.sign(torque) * speed * [one.back_emf for one in numbers]
    given = np.clip(line, 0.05, [one.most_torque for one in numbers])
    worst = int(np.abs(acceleration).max(axis=0).argmax())
    return Needs(
        float(np.abs(speed).max()),
        float(np.abs(acceleration).max()),
        float(np.abs(goal_speed).max()),
        float(np.abs(goal_acceleration).max()),
        float((np.abs(torque) / given).max()),
        robot.joint_map.joints[worst],
    )


def _rates(path: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Speeds and accelerations of a path (k, n), each (k, n)."""
    speed = np.gradient(path, dt, axis=0)
    return speed, np.gradient(speed, dt, axis=0)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.walking_fit", description=__doc__)
    parser.add_argument("--ticks", type=int, nargs="+", default=[41, 56, 64, 72], help="of a step")
    parser.add_argument("--lift", type=float, nargs="+", default=[0.01, 0.03], help="of the foot, m")
    parser.add_argument("--forward", type=float, nargs="+", default=[0.0, 0.1, 0.15, 0.2], help="speeds, m/s")
    asked = parser.parse_args()
    robot = load_robot("op3")
    still = np.zeros(len(robot.joint_map.joints))
    world = build_world(robot, still, mount=mount_of(robot), perturbation=NOMINAL)
    rows = []
    for ticks, lift, forward in product(asked.ticks, asked.lift, asked.forward):
        found = needs(robot, world, Case(ticks=ticks, lift=lift, forward=forward))
        step = ticks / robot.profile.safety.rate_hz
        rows.append(
            [
                f"{step:.2f} s, {1e3 * lift:.0f} mm, {1e3 * forward * step:.0f} mm",
                *(f"{one:.1f}" for one in (found.speed, found.acceleration, found.goal_speed, found.goal_acceleration)),
                f"{100.0 * found.torque:.0f}",
                found.joint,
            ]
        )
    heads = ["step: time, height, length", "speed rad/s", "acceleration rad/s2", "of goals rad/s", "of goals rad/s2"]
    print_table([*heads, "torque %", "joint"], rows, text=1)


if __name__ == "__main__":
    main()
