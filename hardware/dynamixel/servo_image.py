"""What one servo's registers hold, read in a few blocks: for checks before anything moves."""

from dataclasses import dataclass

from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.one_off import OneOff

CHUNK = 64
"""Most bytes that are read at once."""
LAST = ("present_temperature", "present_input_voltage", "present_voltage", "lock", "goal_acceleration")
"""The registers behind which no table has one that is looked at."""


@dataclass(frozen=True, eq=False)
class ServoImage:
    """Registers of a servo of this table, as read. Turn by turn: nothing in it changes with the servo."""

    table: ControlTable
    data: bytes

    def has(self, name: str) -> bool:
        """Whether the register is there."""
        return self.table.has(name) and self.table[name].end <= len(self.data)

    def value(self, name: str) -> int:
        """A register's value, counts."""
        register = self.table[name]
        return register.decode(self.data[register.address : register.end])


def read_image(client: OneOff, device: int, table: ControlTable) -> ServoImage:
    """Everything from address 0 to the last register of LAST. Raises BusError when it does not answer."""
    last = max(table[name].end for name in LAST if table.has(name))
    parts = [client.read_block(device, at, min(CHUNK, last - at)) for at in range(0, last, CHUNK)]
    return ServoImage(table, b"".join(parts))
