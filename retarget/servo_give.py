"""How far the joints of a robot give way under load: a position loop with a pure P gain is a spring."""

import numpy as np

from hardware.servo_lag import loop_stiffness
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["servo_give"]


def servo_give(robot: RobotBody) -> FloatArray:
    """(n, n) rad per N m: from torques of the joints to how far they give way, in servo order.

    By the profile's gains, at the voltage that the maker's numbers are for. Coupled joints give way together.
    """
    servos = robot.joint_map.servos
    protocols = {line.name: line.protocol for line in robot.profile.bus_specs()}
    of_shaft = np.array([1.0 / loop_stiffness(servo, protocol=protocols[servo.bus]) for servo in servos])
    give = np.diag(of_shaft / np.array([servo.gear for servo in servos]) ** 2)
    columns = {servo.joint: index for index, servo in enumerate(servos)}
    for coupling in {servo.coupling for servo in servos if servo.coupling is not None}:
        pair = [columns[joint] for joint in coupling.joints]
        turns = np.array(coupling.matrix)  # joint angles = turns @ shaft angles
        give[np.ix_(pair, pair)] = turns @ np.diag(of_shaft[pair]) @ turns.T
    return np.asarray(give)
