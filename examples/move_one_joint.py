"""Move one joint of an OP3, slowly, through the guard: on emulated servos, or on real ones with another bus."""

import numpy as np

from hardware.clock import VirtualClock
from hardware.guard import Guard
from retarget.cli.buses import posture_ticks
from retarget.model.robot import load_robot
from retarget.safety.gate import Gate
from sim.buses import emulated_bus

DT, SECONDS, TURN = 0.008, 2.0, 0.5


def main() -> None:
    """Turn the head by TURN rad within SECONDS, and print how far off the servo is in the end."""
    robot, clock = load_robot("op3"), VirtualClock()
    joints, gate = robot.joint_map, Gate(robot.joint_map, dt=DT)
    bus = emulated_bus(robot, clock, start=posture_ticks(robot), notify=print)
    guard = Guard(bus=bus, joint_map=joints, limits=robot.profile.safety.guard_limits())
    head, ticks = joints.joints.index("head_pan"), round(SECONDS / DT)
    bus.open()  # checks every servo and writes what the profile wants
    try:
        target = guard.present()
        guard.arm(gate.begin(target))  # torque on, where the robot is
        due, path = clock.now(), target[head] + TURN * (1.0 - np.cos(np.linspace(0.0, np.pi, ticks))) / 2.0
        for tick, angle in enumerate(path):
            clock.sleep_until(due + (tick + 1) * DT)
            states, target[head] = guard.read(), angle
            guard.check(states, clock.now(), clock.idle())  # latches what is wrong with a servo
            guard.write((None if guard.stop else gate.check(guard.goal, target)) or gate.brake(guard.goal))
    finally:
        bus.close()  # torque off, whatever happened
    off = abs(joints.to_radians(states.position)[head] - target[head])
    print(f"head_pan turned to {target[head]:.2f} rad, its servo is {off:.4f} rad off; {bus.retries} retries")


if __name__ == "__main__":
    main()
