"""What a servo is to hold: what was asked for, and all else as its profile says."""

from hardware.dynamixel.line_scan import Sighting, Speed
from hardware.dynamixel.muted import LEVEL
from hardware.dynamixel.profile_wishes import wishes
from hardware.dynamixel.servo_image import ServoImage
from hardware.errors import BusError, describe
from retarget.cli.servo.setup_options import Asked
from retarget.cli.servo.target import Target


def wanted_of(target: Target, asked: Asked, seen: Sighting, image: ServoImage) -> Asked:
    """Options filled up by the profile, which comes second; the drive mode is among the registers.

    Status Return Level is in RAM with protocol 2.0, and is left out: whoever is mute was told before, and every run
    sets it. Raises BusError for a servo that is not of the profile's model and protocol.
    """
    level = LEVEL[2].name
    registers = {
        name: value for name, value in asked.all_registers.items() if name != level or image.table.protocol == 1
    }
    servo, bus = target.servo, target.place.spec
    if servo is None or bus is None:
        return Asked(asked.new_id, asked.baud, asked.return_delay, None, registers)
    own = Speed(bus.protocol, seen.speed.baud)
    if seen.model != servo.model.name or seen.speed != own:
        raise BusError(
            describe(
                what=f"id {target.device} is not the servo of {servo.joint} by its model or protocol",
                where=target.place.where,
                found=f"{seen.model}, protocol {seen.speed.protocol}.0",
                allowed=f"{servo.model.name}, protocol {bus.protocol}.0",
                then="Check which servo it is, or correct the profile",
            )
        )
    wished = wishes(servo, bus, image, target.needed)
    return Asked(
        servo.id if asked.new_id is None else asked.new_id,
        bus.baud if asked.baud is None else asked.baud,
        1e6 * bus.return_delay if asked.return_delay is None else asked.return_delay,
        None,
        wished | registers,
    )
