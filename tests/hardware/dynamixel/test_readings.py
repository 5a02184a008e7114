"""States as they come in: units, signs, ages, alerts until they are known."""

import numpy as np
import pytest

from hardware.bus import UNREAD_AFTER_S, ServoAlert
from hardware.dynamixel.codec import Status, side_by_side
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.cyclic import block_of
from hardware.dynamixel.readings import UNKNOWN_ALERT, Readings, names_of

TABLE = find_table("XM430-W350", 2)
NAMES = names_of(TABLE)
BLOCK = block_of(TABLE, *NAMES.wide)


def answer(device: int, *, position: int = 2048, velocity: int = 0, error: int = 0) -> Status:
    data = bytearray(BLOCK.size)
    for name, value in (
        ("present_current", -100),
        ("present_velocity", velocity),
        ("present_position", position),
        ("present_input_voltage", 118),
        ("present_temperature", 41),
    ):
        register = TABLE[name]
        at = register.address - BLOCK.address
        data[at : at + register.size] = register.encode(value)
    return Status(device, error, bytes(data))


def take(readings: Readings, servo: int, said: Status, now: float) -> None:
    readings.take(np.array([servo]), BLOCK.unpack(side_by_side([said])), bytes((said.error,)), NAMES, now)


def test_values_are_in_si_and_of_their_servo_alone() -> None:
    readings = Readings([TABLE] * 3)
    take(readings, 1, answer(2, position=-7, velocity=-10), 1.0)
    states = readings.states(1.0)
    assert states.position.tolist() == [0, -7, 0]
    assert states.velocity[1] == pytest.approx(-10 * 0.229 * 2 * np.pi / 60, rel=1e-3)
    assert states.current[1] == pytest.approx(-0.269)
    assert states.voltage[1] == pytest.approx(11.8)
    assert states.temperature[1] == 41
    assert np.isnan(states.current[[0, 2]]).all() and np.isnan(states.voltage[[0, 2]]).all()
    assert states.valid.tolist() == [False, True, False]
    assert states.age.tolist() == [np.inf, 0.0, np.inf]


def test_what_was_given_is_nobodys_to_change_and_not_changed_later() -> None:
    """Arrays that stay as they are may be given again: a write into one would be a write into all."""
    readings = Readings([TABLE])
    take(readings, 0, answer(1, error=0x80), 1.0)
    first = readings.states(1.0)
    kept = {name: getattr(first, name).copy() for name in ("voltage", "temperature", "error", "alert", "age", "valid")}
    calm = []
    for k in range(3):
        take(readings, 0, answer(1), 2.0 + k)
        calm.append(readings.states(2.0 + k))
    readings.begin()
    late = readings.states(2.0 + 2.5 * UNREAD_AFTER_S)
    assert not late.valid.any() and late.age.tolist() == [2.5 * UNREAD_AFTER_S - 2.0] and np.isnan(late.voltage).all()
    for name, value in kept.items():
        np.testing.assert_array_equal(getattr(first, name), value)
    for states in calm:
        assert states.valid.all() and not states.age.any() and not states.alert.any() and not states.error.any()
        assert states.voltage.tolist() == kept["voltage"].tolist()
        for name in ("voltage", "temperature", "error", "alert", "age", "valid"):
            array = getattr(states, name)
            assert not array.flags.writeable or not any(
                array is getattr(other, name) for other in calm if other is not states
            )


def test_an_alert_is_unknown_until_it_is_read_and_gone_when_reported_gone() -> None:
    readings = Readings([TABLE] * 2)
    take(readings, 0, answer(1, error=0x80), 0.0)
    assert readings.states(0.0).alert.tolist() == [UNKNOWN_ALERT, 0]
    assert readings.alarmed() == [0]
    readings.take_alert(0, 0)
    assert readings.alarmed() == [0]
    readings.take_alert(0, ServoAlert.OVERLOAD)
    take(readings, 0, answer(1, error=0x80), 0.1)
    assert readings.states(0.1).alert.tolist() == [ServoAlert.OVERLOAD, 0]
    assert readings.alarmed() == []
    take(readings, 0, answer(1), 0.2)
    assert readings.states(0.2).alert.tolist() == [0, 0]


@pytest.mark.parametrize(("speed", "sign"), [(0x3FF, 1), (0x7FF, -1), (0x401, -1), (0, 0)])
def test_a_speed_of_protocol_1_has_a_direction_bit(speed: int, sign: int) -> None:
    table = find_table("AX-12A", 1)
    names = names_of(table)
    block = block_of(table, *names.motion)
    data = (512).to_bytes(2, "little") + speed.to_bytes(2, "little") + bytes((0, 0, 119, 30))
    readings = Readings([table])
    readings.take(np.array([0]), block.unpack(side_by_side([Status(1, 4, data)])), b"\x04", names, 0.0)
    states = readings.states(0.0)
    assert np.sign(states.velocity[0]) == sign
    assert states.voltage[0] == pytest.approx(11.9)
    assert states.alert.tolist() == [ServoAlert.OVERHEATING]
