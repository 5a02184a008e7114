"""Gain registers: what they are in drive per angle."""

from dataclasses import replace

import pytest

from hardware.servo import ServoGains, ServoSpec, find_model
from hardware.servo_lag import loop_lag
from sim.physics.drive_numbers import drive_numbers
from sim.physics.position_loop import lacks_gain, position_loop


def servo(model: str = "XM430-W350", **gains: int) -> ServoSpec:
    return ServoSpec("knee", 1, find_model(model), "main", 1, 2048, -1.0, 1.0, 2.0, 20.0, gains=ServoGains(**gains))


def test_an_xm430_at_800_is_as_stiff_as_the_public_model_of_op3() -> None:
    spec = servo(position_p=800)
    stiffness = position_loop(spec, protocol=2).proportional * drive_numbers(spec.model).stall_torque(12.0)
    assert stiffness == pytest.approx(18.9, rel=0.01)  # 21.1 N m/rad there
    assert stiffness == pytest.approx(800 / 128 * 4096 / (2.0 * 3.14159265) / 885 * 4.1)


def test_stiffness_grows_with_the_register_and_agrees_with_the_mock_bus() -> None:
    soft, stiff = (position_loop(servo(position_p=gain), protocol=2) for gain in (400, 1600))
    assert stiff.proportional == pytest.approx(4.0 * soft.proportional)
    spec = servo(position_p=400)
    assert 1.0 / (soft.proportional * spec.model.no_load_speed) == pytest.approx(loop_lag(spec))


def test_damping_beyond_the_default_damps_and_the_default_does_not() -> None:
    assert position_loop(servo("XL430-W250", position_p=640, position_d=4000), protocol=2).derivative == 0.0
    assert position_loop(servo("XL430-W250", position_p=640, position_d=5000), protocol=2).derivative > 0.0
    assert position_loop(servo(position_p=800, position_d=0), protocol=2).derivative == 0.0


def test_the_integral_is_relative_to_the_p_gain() -> None:
    assert position_loop(servo(position_p=800, position_i=0), protocol=2).integral == 0.0
    one = position_loop(servo(position_p=800, position_i=100), protocol=2).integral
    assert position_loop(servo(position_p=1600, position_i=100), protocol=2).integral == pytest.approx(one / 2.0)


def test_protocol_1_has_its_own_register() -> None:
    old = position_loop(servo("MX-28", position_p=32), protocol=1)
    new = position_loop(servo("MX-28", position_p=800), protocol=2)
    assert old.proportional == pytest.approx(new.proportional)


def test_a_gain_that_nobody_gave_is_noticed() -> None:
    spec = servo()
    assert lacks_gain(spec, protocol=2) and not lacks_gain(servo(position_p=0), protocol=2)
    assert lacks_gain(replace(spec, model=find_model("MX-28")), protocol=1)
    assert not lacks_gain(replace(spec, model=find_model("AX-12A")), protocol=1)  # has no such register
    assert position_loop(replace(spec, model=find_model("AX-12A")), protocol=1).proportional > 0.0
