"""Writing into servos what the profile wants, and reading it back: EEPROM first, since a change of mode resets RAM."""

from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.servo_image import read_image
from hardware.dynamixel.settings import WAKING, differing, eeprom_settings, ram_settings
from hardware.servo import ServoSpec


def provision(line: BusLine, servo: ServoSpec, *, limp: bool) -> list[str]:
    """Bring one servo to what its profile wants; what was changed, one text each. What is right is not written.

    limp: it has no torque. One that has takes nothing in EEPROM; of one of protocol 1.0 that has none, what would
    switch it on is left for `torque.wake`. Raises BusError (NoAnswer, ServoError) when it does not answer, refuses, or
    does not keep what it was told.
    """
    table = line.images[servo.id].table
    image = read_image(line.client, servo.id, table)
    changed = []
    eeprom = differing(eeprom_settings(servo, line.spec, table), image)
    for register, value in eeprom:
        # Torque is off here; a servo that has it on says no, and is heard.
        line.client.write(servo.id, register, value, verify=True)
        changed.append(f"{register.name} {image.value(register.name)} -> {value}")
    if eeprom:
        image = read_image(line.client, servo.id, table)
    for register, value in differing(ram_settings(servo, image), image):
        if limp and table.protocol == 1 and register.name in WAKING:
            continue
        line.client.write(servo.id, register, value, verify=True)
        if not limp:
            changed.append(f"{register.name} {image.value(register.name)} -> {value}")
    line.images[servo.id] = read_image(line.client, servo.id, table)
    return changed
