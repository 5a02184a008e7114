"""The emulated servos of a profile."""

from dataclasses import replace

from hardware.errors import HardwareError
from hardware.servo import ServoMode
from servos import four_servos
from sim.emulator.servo import EmulatedServo
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.workshop import devices_of
from support.messages import refuses


def test_they_are_as_the_profile_says() -> None:
    x_series, ax = four_servos()[0], replace(four_servos()[3], bus="old")
    wound = replace(x_series, id=8, mode=ServoMode.EXTENDED_POSITION, homing_offset=2000)
    first, second, third = devices_of(
        (x_series, wound, ax),
        protocols={"main": 2, "old": 1},
        bauds={"main": 4_000_000, "old": 1_000_000},
        return_delays={"main": 0},
        start=(1000, 9000, 300),
    )
    assert isinstance(first, EmulatedServo) and isinstance(third, EmulatedServo1)
    assert [device.id for device in (first, second, third)] == [x_series.id, 8, ax.id]
    assert [device.baud for device in (first, third)] == [4_000_000, 1_000_000]
    assert [device.return_delay for device in (first, third)] == [0.0, 500e-6]
    assert [device.shaft.position for device in (first, second, third)] == [1000.0, 9000.0, 300.0]
    assert second.memory.value("goal_position") == 9000 and second.memory.value("operating_mode") == 4
    assert first.electrics.voltage == second.electrics.voltage < 12.0


def test_they_start_alike_for_one_seed() -> None:
    def warmth(seed: int) -> list[float]:
        devices = devices_of(four_servos()[:3], protocols={"main": 2}, seed=seed)
        return [device.electrics.warmth for device in devices]

    assert warmth(1) == warmth(1) != warmth(2)


def test_what_a_model_lacks_is_said() -> None:
    with refuses(HardwareError, 4500000):
        devices_of(four_servos()[3:], protocols={"main": 1}, bauds={"main": 4_500_000})
    with refuses(HardwareError):
        devices_of(four_servos()[3:], protocols={"main": 2})
