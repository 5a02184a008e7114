"""The robot `retarget_humanoid`: `retarget.lerobot.robot.HumanoidDevice` as LeRobot calls it."""

from typing import Any

from lerobot.robots import Robot
from lerobot.utils.decorators import check_if_not_connected

from lerobot_robot_retarget.config_humanoid import RetargetHumanoidConfig
from lerobot_robot_retarget.device import RetargetDevice
from retarget.cli.application import log
from retarget.cli.buses import PhysicsBench
from retarget.cli.controls import (
    NEVER_GOES_ON,
    Control,
    ControlSocket,
    Oversight,
    StopFile,
    refuse_oversight,
)
from retarget.cli.exit import StopRequest
from retarget.cli.operator import RunOperator
from retarget.cli.stop import socket_path
from retarget.lerobot.robot import HumanoidDevice, Wiring
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared


class RetargetHumanoid(RetargetDevice, Robot):
    """A humanoid that follows joint goals. Actions and observations are radians; torque comes with the first action."""

    config_class = RetargetHumanoidConfig
    name = "retarget_humanoid"

    def __init__(self, config: RetargetHumanoidConfig) -> None:
        super().__init__(config)
        self.config = config
        self.cameras: dict[str, Any] = {}
        refuse_oversight(Oversight(stop_file=config.stop_file), virtual=False)
        options = RunOptions(
            robot=config.profile,
            bus=config.bus,
            scene=config.scene,
            stand_at_end=config.stand_at_end,
            torque_off_at_end=config.torque_off_at_end,
        )
        bench = PhysicsBench(options, log)
        self._bench = bench
        self._socket: ControlSocket | None = None
        wiring = Wiring(make_bus=bench.make_bus, operator=self._operator, close=self._close, notify=log)
        self._device: HumanoidDevice = HumanoidDevice(options, wiring, stale_ms=config.stale_ms)

    def _operator(self, prepared: Prepared) -> RunOperator:
        """Who may stop or hold the robot beside LeRobot."""
        controls = list[Control]()
        operator = RunOperator(prepared, StopRequest(), bench=self._bench, controls=controls, notify=log)
        if self.config.stop_file is not None:
            controls.append(StopFile(self.config.stop_file))
        if self.config.control_socket is not None:
            path = socket_path(self.config.control_socket)
            self._socket = ControlSocket(path, status=operator.status, goes_on=NEVER_GOES_ON)
            controls.append(self._socket)
        return operator

    def _close(self) -> None:
        """Close the control socket, if there is one."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    @property
    def observation_features(self) -> dict[str, type]:
        """`<joint>.pos` and `<joint>.goal`, rad."""
        return self._device.observation_features

    @check_if_not_connected
    def get_observation(self) -> dict[str, Any]:
        """The newest reading."""
        return dict(self._device.observation())

    @check_if_not_connected
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Leave a target, and return the goals that were sent last."""
        return dict(self._device.send(action))
