"""Checks of one servo's registers before it is driven: complaints with their fixes, notes, and values to set."""

from typing import NamedTuple

from hardware.bus import BusSpec, ServoAlert, alert_names
from hardware.dynamixel.codec import MAX_ID
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.readings import names_of
from hardware.dynamixel.settings import OWN_OPTION, ServoImage, differing, eeprom_settings, setup_command
from hardware.joint_map import JointMap
from hardware.servo import ServoMode, ServoSpec


class Span(NamedTuple):
    """First and last tick."""

    low: int
    high: int


def needed_ticks(joint_map: JointMap) -> dict[str, Span]:
    """The goal ticks within the joints' limits, by joint. A servo ignores goals beyond its own limits."""
    first, last = joint_map.tick_limits()
    spans = map(Span, first.tolist(), last.tolist())
    return dict(zip(joint_map.joints, spans, strict=True))


FORBIDDEN = (
    ("drive_mode", 0x01, "reverse: it turns the other way than the profile's direction says"),
    ("drive_mode", 0x02, "follower: it obeys another servo"),
    ("drive_mode", 0x08, "torque on by goal update: a goal alone would switch its torque on"),
    ("startup_configuration", 0x01, "it switches its torque on by itself when it starts"),
)
"""Register, bit and meaning of forbidden settings."""
NO_SECONDARY_ID = 255
"""Secondary ID of a servo that has none."""
LOW_SHARE = 0.5
"""Share of its maximum below which a drive limit is noted."""

MEANINGS = {
    ServoAlert.INPUT_VOLTAGE: "supply out of the servo's range",
    ServoAlert.OVERHEATING: "too hot",
    ServoAlert.ENCODER: "encoder or motor broken",
    ServoAlert.ELECTRICAL_SHOCK: "electrical shock, or too little power for the motor",
    ServoAlert.OVERLOAD: "loaded beyond its maximum for too long",
}
"""Meanings of the bits of Hardware Error Status."""


def alert_text(bits: int) -> str:
    """Return names and meanings of the alert bits."""
    return ", ".join(alert_names(bits, MEANINGS))


def complaints(servo: ServoSpec, bus: BusSpec, image: ServoImage, needed: Span) -> list[str]:
    """The reasons why this servo cannot be driven, one text each. needed: see `needed_ticks`."""
    found, table = [], image.table
    volts = image.value(names_of(table).voltage) / 10
    low, high = image.value("min_voltage_limit") / 10, image.value("max_voltage_limit") / 10
    if not low <= volts <= high:
        found.append(f"has a supply of {volts:.1f} V, allowed {low:g} to {high:g} V: check battery, supply and fuse")
    if servo.current_limit is not None and not table.has("current_limit"):
        found.append(
            f"is to draw {servo.current_limit:g} A at most, and {table.model} with protocol {table.protocol}.0 cannot "
            "limit its current: remove `current` from the profile"
        )
    found += [text + setup_command(bus, servo.id, counts) for text, counts in _corrections(servo, image, needed)]
    bits = image.value("hardware_error_status") if image.has("hardware_error_status") else 0
    if bits:
        found.append(
            f"has latched {alert_text(bits)}: fix the cause, then `retarget servo reboot` (or switch its power)"
        )
    if bus.watchdog and not table.has("bus_watchdog") and find_table(table.model, table.protocol).has("bus_watchdog"):
        found.append(
            f"has firmware {image.value('firmware_version')}, which has no bus watchdog: it would hold its last goal "
            "when the host goes silent. Update it, or write watchdog_s: 0 for the bus"
        )
    if image.has("lock") and image.value("lock"):
        found.append("has its EEPROM locked (register lock): switch its power off and on, nothing else opens it")
    due = differing(eeprom_settings(servo, bus, table), image)
    if due and image.value("torque_enable"):
        names = ", ".join(f"{setting.register.name} := {setting.value}" for setting in due)
        found.append(
            f"has torque on, and its EEPROM must be written ({names}): secure the robot, then `retarget servo rest`"
        )
    return found


def profile_values(servo: ServoSpec, bus: BusSpec, image: ServoImage, needed: Span) -> dict[str, int]:
    """The counts, by EEPROM register, that the profile requires, without id, speed and return delay. needed: see
    `needed_ticks`."""
    named = {one.register.name: one.value for one in eeprom_settings(servo, bus, image.table)}
    values = {name: value for name, value in named.items() if name not in OWN_OPTION}
    for _, counts in _corrections(servo, image, needed):
        values |= counts
    return values


def _corrections(servo: ServoSpec, image: ServoImage, needed: Span) -> list[tuple[str, dict[str, int]]]:
    """Return EEPROM faults, as texts that end before the command that corrects them, with counts by register."""
    found: list[tuple[str, dict[str, int]]] = []
    names = ("min_position_limit", "max_position_limit") if servo.mode is ServoMode.POSITION else ()
    if image.has("cw_angle_limit"):
        names = ("cw_angle_limit", "ccw_angle_limit")
    if names:
        low, high = (image.value(name) for name in names)
        # In the older layout, equal angle limits select a mode without position control.
        mode = ""
        if image.has("cw_angle_limit") and not image.has("control_mode") and low == high:
            if low == 0:
                mode = "is in wheel mode (both angle limits 0)"
            elif image.has("multi_turn_offset") and low == servo.model.ticks - 1:
                mode = "is in multi-turn mode (both angle limits at their end)"
        # The servo's own limits become those ticks, where they are not wide enough.
        moved = {names[0]: needed.low} if mode or low > needed.low else {}
        moved |= {names[1]: needed.high} if mode or high < needed.high else {}
        narrow = (
            f"takes ticks {low} to {high} only, the joint needs {needed.low} to {needed.high}: narrow the limits of "
            "the profile, or "
        )
        found += [(f"{mode}: " if mode else narrow, moved)] if moved else []
    for name, bit, meaning in FORBIDDEN:  # firmware before 38 and most of protocol 1.0 have none of them
        if image.has(name) and image.value(name) & bit:
            kept = image.value(name) & ~sum(other for register, other, _ in FORBIDDEN if register == name)
            has = f"has {name.replace('_', ' ')} 0x{image.value(name):02x}, bit {bit.bit_length() - 1} ({meaning}): "
            found.append((has, {name: kept}))
    if image.has("homing_offset") and image.value("homing_offset") != servo.homing_offset:
        offset = (
            f"has homing offset {image.value('homing_offset')}, the profile says {servo.homing_offset}: every angle of "
            "the joint would be off; correct the profile, or "
        )
        found.append((offset, {"homing_offset": servo.homing_offset}))
    if image.has("secondary_id") and image.value("secondary_id") <= MAX_ID:
        second = image.value("secondary_id")
        obeys = f"also obeys what is meant for id {second} (its secondary id), torque and goals included: "
        found.append((obeys, {"secondary_id": NO_SECONDARY_ID}))
    return found


def notes(servo: ServoSpec, image: ServoImage) -> list[str]:
    """Return notes about drive limits that leave a servo weak or slow."""
    names = ["max_torque", "pwm_limit"]
    found = []
    if servo.mode is ServoMode.CURRENT_BASED_POSITION:
        names.append("current_limit")
        most = image.value("current_limit") * (image.table["current_limit"].scale or 1.0)
        if servo.current_limit is not None and servo.current_limit > most:
            found.append(f"has current_limit {most:.3g} A, the profile says {servo.current_limit:g} A: it draws less")
    for name in names:
        highest = image.table[name].highest if image.has(name) else None
        if highest is not None and image.value(name) < LOW_SHARE * highest:
            found.append(f"has {name} {image.value(name)}, the maximum is {highest}: it is weak, or slow")
    return found
