"""What one servo's registers hold, read in a few blocks: for checks before anything moves."""

from dataclasses import dataclass

from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.one_off import OneOff

CHUNK = 64
"""Most bytes that are read at once."""


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
    """Everything from address 0 to the present values. Raises BusError when it does not answer."""
    end = table["present_temperature"].end
    last = max(end, table["present_input_voltage" if table.protocol == 2 else "present_voltage"].end)
    parts = [client.read_block(device, at, min(CHUNK, last - at)) for at in range(0, last, CHUNK)]
    return ServoImage(table, b"".join(parts))
