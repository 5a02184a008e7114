"""What a profile wants in a servo's EEPROM: with it written, nothing keeps the servo from being driven."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus_rig import bus_of, spec
from hardware.dynamixel.checks import complaints
from hardware.dynamixel.profile_wishes import NOBODY, wishes
from hardware.dynamixel.servo_image import ServoImage
from hardware.dynamixel.settings import differing, eeprom_settings
from hardware.dynamixel.setup_plan import plan
from hardware.dynamixel.travel import needed_ticks
from hardware.servo import ServoMode, ServoSpec
from sim.emulator.workshop import devices_of

SPOILT = {
    "drive_mode": (0, 1, 5, 8, 9, 13),
    "startup_configuration": (0, 1, 3),
    "secondary_id": (255, 7, 252, 253),
    "homing_offset": (0, -50, 300),
    "min_position_limit": (0, 1500, 2047),
    "max_position_limit": (4095, 2500, 3000),
    "operating_mode": (3, 4, 1),
    "return_delay_time": (0, 250),
    "current_limit": (1193, 30),
    "cw_angle_limit": (0, 300),
    "ccw_angle_limit": (4095, 0, 2100),
    "status_return_level": (2, 1),
}


def _servo(model: str, homing_offset: int, mode: ServoMode, current: float | None) -> ServoSpec:
    return replace(spec(4, model), homing_offset=homing_offset, mode=mode, current_limit=current)


CASES = [
    (_servo("XM430-W350", 0, ServoMode.POSITION, None), 2),
    (_servo("XM430-W350", 100, ServoMode.POSITION, 1.0), 2),
    (_servo("XM430-W350", 0, ServoMode.CURRENT_BASED_POSITION, 0.5), 2),
    (_servo("XL430-W250", 0, ServoMode.EXTENDED_POSITION, None), 2),
    (_servo("MX-28", 0, ServoMode.POSITION, None), 2),
    (_servo("MX-28", 0, ServoMode.POSITION, None), 1),
]


@settings(max_examples=60, deadline=None)
@given(
    case=st.sampled_from(CASES), spoilt=st.fixed_dictionaries({name: st.sampled_from(v) for name, v in SPOILT.items()})
)
def test_with_the_wishes_written_nothing_is_wrong_or_due_any_more(
    case: tuple[ServoSpec, int], spoilt: dict[str, int]
) -> None:
    servo, protocol = case
    bus = bus_of([servo], protocol=protocol)
    (one,) = devices_of([servo], protocols={"main": protocol})
    for name, value in spoilt.items():
        if one.table.has(name) and one.table[name].allows(value):
            one.memory.put(name, value)
    volts = "present_input_voltage" if protocol == 2 else "present_voltage"
    one.memory.put(volts, 120)
    needed = needed_ticks([servo])[servo.joint]
    image = ServoImage(one.table, bytes(one.memory.image))
    due = plan(image, return_delay=bus.return_delay, registers=wishes(servo, bus, image, needed))
    for setting in due:
        assert image.value(setting.register.name) != setting.value
        one.memory.put(setting.register.name, setting.value)
    after = ServoImage(one.table, bytes(one.memory.image))
    assert complaints(servo, bus, after, needed) == []
    assert differing(eeprom_settings(servo, bus, one.table), after) == []
    assert plan(after, return_delay=bus.return_delay, registers=wishes(servo, bus, after, needed)) == []


@pytest.mark.parametrize(
    ("name", "value", "wanted"),
    [("drive_mode", 13, 4), ("startup_configuration", 3, 2), ("secondary_id", 7, NOBODY), ("homing_offset", 9, 0)],
)
def test_only_what_harms_is_changed(name: str, value: int, wanted: int) -> None:
    servo = spec(4)
    (one,) = devices_of([servo], protocols={"main": 2})
    one.memory.put(name, value)
    image = ServoImage(one.table, bytes(one.memory.image))
    due = plan(image, registers=wishes(servo, bus_of([servo]), image, needed_ticks([servo])["j4"]))
    assert [(one.register.name, one.value) for one in due] == [(name, wanted)]
