"""Options of the robot: `--robot.type=retarget_humanoid --robot.profile=op3 --robot.bus=mock`."""

from dataclasses import dataclass
from pathlib import Path

from lerobot.robots import RobotConfig

from retarget.lerobot.robot import STALE_MS


@RobotConfig.register_subclass("retarget_humanoid")
@dataclass(kw_only=True)
class RetargetHumanoidConfig(RobotConfig):
    """profile: name or path of a robot profile. bus: as of `retarget run`: mock, emulator, physics, physics+wire,
    profile, or a port. stale_ms: an action that is older is signal loss. scene: name or file. stand_at_end,
    torque_off_at_end: as of `retarget run`. control_socket: "usual" or a path, for `retarget stop`. stop_file: stops
    the robot when it appears."""

    profile: str = "op3"
    bus: str = "mock"
    stale_ms: float = STALE_MS
    scene: str | None = None
    stand_at_end: bool = False
    torque_off_at_end: bool = False
    control_socket: str | None = None
    stop_file: Path | None = None
