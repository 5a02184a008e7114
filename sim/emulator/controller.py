"""The OpenCR of an OP3: a device of protocol 2.0 that switches the servos' power, and has an IMU."""

from collections.abc import Sequence
from math import inf

from hardware.dynamixel import opencr
from sim.emulator.device import Device
from sim.emulator.power import BROWN_OUT
from sim.imu import Ailment, ImuStandIn, roll_pitch_yaw

SUPPLY_V = 12.0  # [V]


class EmulatedController(Device):
    """A controller at a fixed `baud`, bits/s, that switches the power of the devices `powered`.

    on: they have power at first. imu: None: upright and still. It answers ping, read and write only.
    """

    def __init__(
        self,
        powered: Sequence[Device] = (),
        *,
        baud: int,
        id: int = opencr.ID,
        now: float = 0.0,
        on: bool = False,
        imu: ImuStandIn | None = None,
    ) -> None:
        super().__init__(opencr.TABLE, -inf)
        self.defaults(0, opencr.TABLE.size)
        self._imu = ImuStandIn() if imu is None else imu
        self.id, self.baud = id, baud
        self._powered = tuple(powered)
        self._volts = SUPPLY_V
        self._switch(on, now)

    def tune(self) -> None:
        """Apply every setting in the registers but the baud rate."""
        baud = self.baud
        super().tune()
        self.baud = baud

    def react(self, names: set[str], now: float) -> None:
        """Switch the power of the servos by its register."""
        self.tune()
        if "dynamixel_power" in names:
            self._switch(bool(self.memory.value("dynamixel_power")), now)

    def show(self, address: int, length: int, now: float) -> None:
        """Refresh the registers of the voltage, 0.1 V, and, if they are read, of the IMU."""
        self.memory.put("present_voltage", round(10.0 * self._volts))
        if address < opencr.IMU_CONTROL and address + length > opencr.IMU_FIRST:
            reading = self._imu.measure(now)
            if reading is None:
                return
            assert reading.orientation is not None, "a stand-in has one"
            counts = [one / opencr.GYRO_UNIT for one in reading.angular_velocity]
            counts += [one / opencr.FORCE_UNIT for one in reading.acceleration]
            counts += [one / opencr.ANGLE_UNIT for one in roll_pitch_yaw(reading.orientation)]
            for name, count in zip(opencr.IMU_NAMES, counts, strict=True):
                self.memory.put(name, round(count))

    def sense(self, ailment: Ailment | None, now: float) -> None:
        """Set the fault of the IMU; None: it works."""
        self._imu.ailment = ailment

    def supply(self, volts: float | None, now: float) -> None:
        """Set the supply voltage in V; below BROWN_OUT of the nominal it and the servos are silent."""
        self._volts = SUPPLY_V if volts is None else volts
        if self._volts < BROWN_OUT * SUPPLY_V:
            self.power_cut(now)
        elif self.booting(now):
            self.power_back(now)

    def power_cut(self, now: float) -> None:
        """Switch the power off, of the servos too."""
        self._awake_at = inf
        self._switch(False, now)

    def power_back(self, now: float) -> None:
        """Switch the power on; the servos have none until register 24 is written."""
        self._awake_at = now

    def _switch(self, on: bool, now: float) -> None:
        self.memory.put("dynamixel_power", int(on))
        for device in self._powered:
            if on:
                device.power_back(now)
            else:
                device.power_cut(now)
