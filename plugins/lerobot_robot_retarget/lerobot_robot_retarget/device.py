"""What the robot and the teleoperator have alike: LeRobot's calls, passed on to a device of `retarget.lerobot`."""

from lerobot.utils.decorators import check_if_already_connected

from retarget.lerobot.performer import PerformerDevice
from retarget.lerobot.robot import HumanoidDevice


class RetargetDevice:
    """A device of LeRobot that has one of ours. It needs no calibration and no configuration."""

    _device: HumanoidDevice | PerformerDevice

    @property
    def action_features(self) -> dict[str, type]:
        """`<joint>.pos`, rad."""
        return self._device.action_features

    @property
    def is_connected(self) -> bool:
        """Whether there are readings, or goals."""
        return self._device.connection.is_connected

    @property
    def is_calibrated(self) -> bool:
        """Always: the profile has zeros and signs (`retarget servo home`), and `connect` measures a live performer."""
        return True

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Open the bus and read the servos, nothing moves; or open the source, and wait for the measured performer."""
        self._device.connect()

    def calibrate(self) -> None:
        """Do nothing."""

    def configure(self) -> None:
        """Do nothing: servos are set up by `retarget servo setup`."""

    def disconnect(self) -> None:
        """Go to rest, and torque off; or close the source. Raises nothing. Ctrl-C while a robot goes to rest switches
        torque off at once."""
        self._device.disconnect()
