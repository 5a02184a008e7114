"""What LeRobot's programs do, by hand: discover, parse, make, and loop in their order. Prints JSON.

Run by a Python that has LeRobot and the plug-in; arguments as of `lerobot-teleoperate`, and `--seconds`.
"""

import json
import sys
from dataclasses import dataclass
from typing import Any

import draccus
from lerobot.robots import RobotConfig, make_robot_from_config
from lerobot.teleoperators import TeleoperatorConfig, make_teleoperator_from_config
from lerobot.utils.errors import DeviceNotConnectedError
from lerobot.utils.import_utils import register_third_party_plugins

from hardware.clock import MonotonicClock


@dataclass
class Arguments:
    """The options."""

    robot: RobotConfig
    teleop: TeleoperatorConfig
    seconds: float = 2.0
    fps: float = 30.0


def loop(arguments: Arguments, robot: Any, teleop: Any) -> dict[str, Any]:
    """The loop of `lerobot-teleoperate`, as it stands there."""
    clock, done = MonotonicClock(), dict[str, Any]()
    begun = due = clock.now()
    teleop.connect()
    robot.connect()
    begun = due = clock.now()
    try:
        while clock.now() - begun < arguments.seconds:
            observation = robot.get_observation()
            action = teleop.get_action()
            driven = robot.send_action(action)
            due += 1.0 / arguments.fps
            clock.sleep_until(due)
        done = {"observation": [*observation], "action": [*action], "driven": [*driven]}
        done["off"] = max(abs(driven[key] - action[key]) for key in action)
    finally:
        teleop.disconnect()
        robot.disconnect()
        robot.disconnect()
    return done


def main() -> None:
    """Print what was found."""
    register_third_party_plugins()
    arguments = draccus.parse(config_class=Arguments, args=sys.argv[1:])
    robot, teleop = make_robot_from_config(arguments.robot), make_teleoperator_from_config(arguments.teleop)
    found: dict[str, Any] = {
        "types": [arguments.robot.type, arguments.teleop.type],
        "robot_actions": [*robot.action_features],
        "robot_observations": [*robot.observation_features],
        "teleop_actions": [*teleop.action_features],
        "kinds": sorted({kind.__name__ for kind in robot.observation_features.values()}),
        "cameras": robot.cameras,
    }
    try:
        robot.get_observation()
    except DeviceNotConnectedError:
        found["not_connected"] = True
    sys.stdout.write(json.dumps(found | loop(arguments, robot, teleop)) + "\n")


if __name__ == "__main__":
    main()
