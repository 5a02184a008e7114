"""OP3 stands in physics on its own servos, and is pushed.

python examples/stand_in_physics.py
"""

from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from retarget.model.robot import load_robot
from sim.buses import physics_bus, simulation_of
from sim.physics.perturbation import Perturbation, Push
from sim.physics.witness import physics_run

robot, clock = load_robot("op3"), VirtualClock()
stand = robot.joint_map.to_ticks(robot.posture(robot.profile.postures.stand)[robot.servo_columns])
push = Push(force=(0.0, 3.0, 0.0), start=2.0, duration=0.2)
bus = physics_bus(simulation_of(robot, start=stand, perturbation=Perturbation(pushes=(push,))), clock)
bus.open()
bus.write(ServoGoals(bus.read().position))
bus.torque(True)
for _ in range(500):
    clock.advance(0.008)
    states = bus.read()
    bus.write(ServoGoals(stand))
error = abs(robot.joint_map.turned(states.position - stand)).max()
run = physics_run(bus.witness)
print(f"fallen: {bus.witness.fall is not None}; {error:.3f} rad off at most; slipped {1e3 * run.slip.sum():.2f} mm")
print(f"pressure never nearer than {1e3 * (run.least_margin or 0.0):.0f} mm to the edge of the soles")
