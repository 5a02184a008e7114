"""Numbers of servos: what the maker prints comes out of them again."""

import pytest

from hardware.servo import SERVO_MODELS, find_model
from sim.physics.drive_numbers import drive_numbers

BY_BAM = {"MX-64", "MX-106", "XL330-M288"}


@pytest.mark.parametrize("name", sorted(set(SERVO_MODELS) - BY_BAM))
def test_it_stalls_and_turns_as_its_maker_says(name: str) -> None:
    model = find_model(name)
    drive = drive_numbers(model)
    assert drive.stall_torque(model.voltage) == pytest.approx(model.stall_torque)
    left = drive.stall_torque(model.voltage) - drive.friction
    assert left / (drive.back_emf + drive.viscous) == pytest.approx(model.no_load_speed)


@pytest.mark.parametrize("name", sorted(BY_BAM))
def test_identified_motors_agree_with_their_maker(name: str) -> None:
    model = find_model(name)
    drive = drive_numbers(model)
    assert drive.stall_torque(model.voltage) == pytest.approx(model.stall_torque, rel=0.25)


def test_more_supply_is_more_torque_as_printed() -> None:
    drive = drive_numbers(find_model("XM430-W350"))
    assert drive.stall_torque(11.1) == pytest.approx(3.8, rel=0.02)
    assert drive.stall_torque(14.8) == pytest.approx(4.8, rel=0.06)
    assert drive.torque_constant == pytest.approx(1.0 / (149.795 * 2.69e-3), rel=0.05)  # OP3: current per torque


@pytest.mark.parametrize("name", sorted(SERVO_MODELS))
def test_every_model_has_sound_numbers(name: str) -> None:
    drive = drive_numbers(find_model(name))
    assert min(drive.armature, drive.friction, drive.backlash, drive.resistance) > 0.0
    assert drive.friction < 0.1 * drive.stall_torque(find_model(name).voltage)
    assert drive.friction < drive.most_torque <= 1.001 * drive.stall_torque(find_model(name).voltage)
    assert 60.0 <= drive.temperature_limit <= 90.0
    assert drive.source
