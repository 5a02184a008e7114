"""Robot `retarget_humanoid` and teleoperator `retarget_performer` for LeRobot."""

import sys

try:
    from lerobot_robot_retarget.config_humanoid import RetargetHumanoidConfig
    from lerobot_robot_retarget.config_performer import RetargetPerformerConfig
    from lerobot_robot_retarget.humanoid import RetargetHumanoid
    from lerobot_robot_retarget.performer import RetargetPerformer
except ImportError as error:  # LeRobot logs it, goes on, and later knows no such type
    sys.stderr.write(f"lerobot_robot_retarget cannot be used: {error}\n")
    raise

__all__ = ["RetargetHumanoid", "RetargetHumanoidConfig", "RetargetPerformer", "RetargetPerformerConfig"]
