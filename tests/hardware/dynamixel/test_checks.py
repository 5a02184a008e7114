"""What a servo's registers say against driving it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus_rig import bus_of, four_servos, spec, waist_servos
from hardware.dynamixel.checks import NO_SECONDARY_ID, complaints, needed_ticks, notes, profile_values
from hardware.dynamixel.settings import ServoImage, Setting, SetupRequest, differing, eeprom_settings, plan, settings_of
from hardware.joint_map import JointMap
from hardware.servo import ServoMode, ServoSpec
from messages import shows
from sim.emulator.robot_lines import devices_of


def servo_of(model: str, protocol: int = 2, **values: int) -> tuple[ServoSpec, ServoImage]:
    """A servo as delivered at 12 V, but for these registers, and what they hold."""
    servo = spec(1, model)
    (one,) = devices_of([servo], protocols={"main": protocol})
    one.memory.put("present_voltage" if protocol == 1 else "present_input_voltage", 120)
    for name, value in values.items():
        one.memory.put(name, value)
    last = "lock" if protocol == 1 else "present_temperature"
    return servo, ServoImage(one.table, bytes(one.memory.image[: one.table[last].end]))


def said(servo: ServoSpec, image: ServoImage) -> list[str]:
    bus = bus_of([servo], protocol=image.table.protocol)
    return complaints(servo, bus, image, needed_ticks(JointMap([servo]))[servo.joint])


@pytest.mark.parametrize(("volts", "fine"), [(94, False), (95, True), (160, True), (161, False)])
def test_the_supply_is_held_against_the_servo_s_own_limits(volts: int, fine: bool) -> None:
    assert (said(*servo_of("XM430-W350", present_input_voltage=volts)) == []) == fine


@pytest.mark.parametrize("model", ["AX-12A", "MX-28"])
def test_a_locked_eeprom_is_reported_with_what_opens_it(model: str) -> None:
    for lock, reported in ((0, False), (1, True)):
        text = " ".join(said(*servo_of(model, 1, lock=lock)))
        shows(text)
        assert ("EEPROM" in text) == reported


@pytest.mark.parametrize(
    ("model", "protocol", "fine"),
    [("XL430-W250", 2, False), ("AX-12A", 1, False), ("MX-64", 1, False), ("MX-64", 2, True), ("XM430-W350", 2, True)],
)
def test_a_current_that_the_servo_cannot_limit_is_refused(model: str, protocol: int, fine: bool) -> None:
    servo, image = servo_of(model, protocol)
    assert said(servo, image) == []
    found = said(replace(servo, current_limit=0.5), image)
    assert (found == []) == fine and (fine or "remove `current`" in found[0])


@pytest.mark.parametrize(
    ("model", "protocol", "mode", "values", "noted"),
    [
        ("XM430-W350", 2, ServoMode.POSITION, {}, []),
        ("XM430-W350", 2, ServoMode.POSITION, {"pwm_limit": 442, "current_limit": 3}, ["pwm_limit 442"]),
        ("XM430-W350", 2, ServoMode.CURRENT_BASED_POSITION, {"current_limit": 596}, ["current_limit 596"]),
        ("XM430-W350", 2, ServoMode.CURRENT_BASED_POSITION, {"current_limit": 597}, []),
        ("AX-12A", 1, ServoMode.POSITION, {"max_torque": 511}, ["max_torque 511"]),
        ("AX-12A", 1, ServoMode.POSITION, {"max_torque": 512}, []),
    ],
)
def test_a_small_share_of_the_drive_is_noted(
    model: str, protocol: int, mode: ServoMode, values: dict[str, int], noted: list[str]
) -> None:
    servo, image = servo_of(model, protocol, **values)
    found = notes(replace(servo, mode=mode, current_limit=0.1), image)
    assert len(found) == len(noted) and all(text in line for text, line in zip(noted, found, strict=True))


def test_a_servo_that_may_draw_less_than_the_profile_says_is_noted() -> None:
    servo, image = servo_of("XM430-W350", current_limit=700)
    driven = replace(servo, mode=ServoMode.CURRENT_BASED_POSITION)
    assert notes(replace(driven, current_limit=1.88), image) == []
    (note,) = notes(replace(driven, current_limit=1.89), image)
    shows(note, "current_limit", "1.88", "1.89")


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


def due(servo: ServoSpec, image: ServoImage, *, return_delay: float | None = None) -> list[Setting]:
    """What a profile would have written."""
    bus = bus_of([servo], protocol=image.table.protocol)
    wanted = profile_values(servo, bus, image, needed_ticks(JointMap([servo]))[servo.joint])
    return plan(image, settings_of(image.table, SetupRequest(return_delay=return_delay, registers=wanted)))


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
    one.memory.put("present_input_voltage" if protocol == 2 else "present_voltage", 120)
    image = ServoImage(one.table, bytes(one.memory.image))
    for setting in due(servo, image, return_delay=bus.return_delay):
        assert image.value(setting.register.name) != setting.value
        one.memory.put(setting.register.name, setting.value)
    after = ServoImage(one.table, bytes(one.memory.image))
    assert said(servo, after) == []
    assert differing(eeprom_settings(servo, bus, one.table), after) == []
    assert due(servo, after, return_delay=bus.return_delay) == []


@pytest.mark.parametrize(
    ("name", "value", "wanted"),
    [
        ("drive_mode", 13, 4),
        ("startup_configuration", 3, 2),
        ("secondary_id", 7, NO_SECONDARY_ID),
        ("homing_offset", 9, 0),
    ],
)
def test_only_what_harms_is_changed(name: str, value: int, wanted: int) -> None:
    found = due(*servo_of("XM430-W350", **{name: value}))
    assert [(one.register.name, one.value) for one in found] == [(name, wanted)]


@pytest.mark.parametrize("servos", [four_servos(), waist_servos()])
def test_no_goal_inside_the_limits_is_beyond_the_needed_ticks_and_both_ends_are_met(
    servos: Sequence[ServoSpec],
) -> None:
    joint_map = JointMap(servos)
    corners = np.stack(np.meshgrid(*[[0.0, 0.37, 1.0]] * len(servos), indexing="ij"), axis=-1).reshape(-1, len(servos))
    ticks = joint_map.to_ticks(joint_map.lower + corners * (joint_map.upper - joint_map.lower))
    needed = needed_ticks(JointMap(servos))
    low, high = np.array([needed[joint] for joint in joint_map.joints]).T
    assert (low <= ticks.min(axis=0)).all() and (ticks.max(axis=0) <= high).all()
    slack = 2 * np.array([servo.coupling is not None for servo in servos])  # corners that are moved in
    assert (ticks.min(axis=0) - low <= slack).all() and (high - ticks.max(axis=0) <= slack).all()
