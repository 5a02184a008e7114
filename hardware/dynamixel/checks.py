"""What one servo's registers say against driving it: complaints, each with its cure, and notes."""

from hardware.bus import ServoAlert
from hardware.bus_spec import BusSpec
from hardware.dynamixel.servo_image import ServoImage
from hardware.dynamixel.settings import differing, eeprom_settings
from hardware.servo import ServoMode, ServoSpec

REVERSE, FOLLOWER, TORQUE_BY_GOAL = 0x01, 0x02, 0x08  # bits of Drive Mode
TORQUE_AT_BOOT = 0x01  # bit of Startup Configuration

MEANINGS = {
    ServoAlert.INPUT_VOLTAGE: "supply out of the servo's range",
    ServoAlert.OVERHEATING: "too hot",
    ServoAlert.ENCODER: "encoder or motor broken",
    ServoAlert.ELECTRICAL_SHOCK: "electrical shock, or too little power for the motor",
    ServoAlert.OVERLOAD: "loaded beyond its maximum for too long",
}
"""What a bit of Hardware Error Status means."""


def alert_text(bits: int) -> str:
    """Names and meanings of the alert bits."""
    known = [f"{alert.name} ({meaning})" for alert, meaning in MEANINGS.items() if bits & alert]
    rest = bits & ~sum(ServoAlert)
    return ", ".join([*known, *([f"0x{rest:02x}"] if rest else [])])


def complaints(servo: ServoSpec, bus: BusSpec, image: ServoImage) -> list[str]:
    """What keeps this servo from being driven as it is, one text each; empty when it can be."""
    found = _supply(image) + _travel(servo, image)
    if image.table.protocol == 2:
        found += _errors(image) + _drive_mode(image) + _homing(servo, image)
    due = differing(eeprom_settings(servo, bus, image.table), image)
    if due and image.value("torque_enable"):
        names = ", ".join(f"{setting.register.name} := {setting.value}" for setting in due)
        found.append(
            f"has torque on, and its EEPROM must be written ({names}): secure the robot, then `retarget servo rest`"
        )
    return found


def _errors(image: ServoImage) -> list[str]:
    bits = image.value("hardware_error_status")
    if not bits:
        return []
    return [f"has latched {alert_text(bits)}: mend the cause, then `retarget servo reboot` (or switch its power)"]


def _supply(image: ServoImage) -> list[str]:
    volts = image.value("present_input_voltage" if image.table.protocol == 2 else "present_voltage") / 10
    low, high = image.value("min_voltage_limit") / 10, image.value("max_voltage_limit") / 10
    if low <= volts <= high:
        return []
    return [f"has a supply of {volts:.1f} V, allowed {low:g} to {high:g} V: check battery, supply and fuse"]


def _drive_mode(image: ServoImage) -> list[str]:
    if not image.has("drive_mode"):
        return []  # firmware before 38
    mode, found = image.value("drive_mode"), []
    for bit, meaning in (
        (REVERSE, "reverse: it turns the other way than the profile's direction says"),
        (FOLLOWER, "follower: it obeys another servo"),
        (TORQUE_BY_GOAL, "torque on by goal update: a goal alone would switch its torque on"),
    ):
        if mode & bit:
            cure = f"`retarget servo setup` sets drive_mode to {mode & ~bit}"
            found.append(f"has drive mode 0x{mode:02x}, bit {bit.bit_length() - 1} ({meaning}): {cure}")
    if image.has("startup_configuration") and image.value("startup_configuration") & TORQUE_AT_BOOT:
        found.append("switches its torque on by itself when it starts: `retarget servo setup` clears that")
    return found


def _homing(servo: ServoSpec, image: ServoImage) -> list[str]:
    offset = image.value("homing_offset")
    if offset == servo.homing_offset:
        return []
    return [
        f"has homing offset {offset}, the profile says {servo.homing_offset}: every angle of the joint would be off; "
        "correct the profile, or the servo with `retarget servo setup`"
    ]


def _travel(servo: ServoSpec, image: ServoImage) -> list[str]:
    """The servo's own limits, which would silently refuse goals."""
    if image.table.protocol == 1:
        low, high = image.value("cw_angle_limit"), image.value("ccw_angle_limit")
        if low == high == 0:
            return ["is in wheel mode (both angle limits 0): set them with `retarget servo setup`"]
        if image.has("multi_turn_offset") and low == high == servo.model.ticks - 1:
            return ["is in multi-turn mode (both angle limits at their end): set them with `retarget servo setup`"]
    elif servo.mode is ServoMode.POSITION:
        low, high = image.value("min_position_limit"), image.value("max_position_limit")
    else:
        return []
    if servo.coupling is not None:
        return []
    ends = sorted(servo.zero_tick + servo.ticks_per_rad * q for q in (servo.lower, servo.upper))
    if low - 1 <= ends[0] and ends[1] <= high + 1:
        return []
    return [
        f"takes ticks {low} to {high} only, the joint needs {ends[0]:.0f} to {ends[1]:.0f}: set its limits with "
        "`retarget servo setup`, or narrow those of the profile"
    ]
