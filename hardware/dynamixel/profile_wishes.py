"""Everything in which a servo's EEPROM should follow its profile: more than opening writes, which asks nobody."""

from hardware.bus_spec import BusSpec
from hardware.dynamixel.checks import FOLLOWER, HIGHEST_SECONDARY, REVERSE, TORQUE_AT_BOOT, TORQUE_BY_GOAL
from hardware.dynamixel.servo_image import ServoImage
from hardware.dynamixel.settings import eeprom_settings
from hardware.dynamixel.setup_plan import OWN_OPTION
from hardware.dynamixel.travel import Span, limits_to_move
from hardware.servo import ServoSpec

NOBODY = 255
"""Secondary ID of a servo that has none."""


def wishes(servo: ServoSpec, bus: BusSpec, image: ServoImage, needed: Span | None) -> dict[str, int]:
    """Counts by register that this servo is to hold, those that it has already too; bits that do no harm stay.

    Without id, speed and return delay, which the profile says itself. needed: ticks that its joint needs, see
    `travel.needed_ticks`; None: not known.
    """
    named = {one.register.name: one.value for one in eeprom_settings(servo, bus, image.table)}
    wanted = {name: value for name, value in named.items() if name not in OWN_OPTION}
    if image.has("drive_mode"):
        wanted["drive_mode"] = image.value("drive_mode") & ~(REVERSE | FOLLOWER | TORQUE_BY_GOAL)
    if image.has("startup_configuration"):
        wanted["startup_configuration"] = image.value("startup_configuration") & ~TORQUE_AT_BOOT
    if image.has("homing_offset"):
        wanted["homing_offset"] = servo.homing_offset
    if image.has("secondary_id") and image.value("secondary_id") <= HIGHEST_SECONDARY:
        wanted["secondary_id"] = NOBODY
    return wanted | limits_to_move(servo, image, needed)
