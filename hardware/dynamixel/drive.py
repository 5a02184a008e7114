"""How hard the servos of one bus may push while their torque comes up: little at first, then what the profile wants."""

from collections.abc import Collection

from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.confirm import write_and_read
from hardware.dynamixel.settings import Setting, full_drive

FIRST_DRIVE = 0.1
"""Share of the full drive with which torque comes on."""


class Drive:
    """The drive of all servos of a bus. Those in `limp` begin with FIRST_DRIVE; others never have less than now, since
    they carry the robot."""

    def __init__(self, line: BusLine, limp: Collection[int]) -> None:
        self._line = line
        self._full = {device: full_drive(servo, line.images[device]) for device, servo in line.servos.items()}
        self._least = {
            device: 1 if device in limp else min(line.images[device].value(full.register.name), full.value)
            for device, full in self._full.items()
        }

    @property
    def limited(self) -> bool:
        """Whether any servo has less than its full drive, or is limp."""
        return any(self._least[device] < full.value for device, full in self._full.items())

    def send(self, share: float) -> None:
        """Allow a share of the full drive; nobody confirms. Raises BusError when the port is gone."""
        for settings in self._by_register(share):
            register = settings[0][1].register
            self._line.write_all(register, [(device, setting.value) for device, setting in settings])

    def confirm(self, share: float) -> None:
        """Allow a share of the full drive, and see that everybody knows. Raises BusError."""
        for settings in self._by_register(share):
            write_and_read(self._line, settings)

    def _by_register(self, share: float) -> list[list[tuple[int, Setting]]]:
        """Servos limit their drive by several registers: by mode and protocol."""
        found: dict[str, list[tuple[int, Setting]]] = {}
        for device, (register, full) in self._full.items():
            value = max(round(share * full), self._least[device])
            found.setdefault(register.name, []).append((device, Setting(register, value)))
        return list(found.values())
