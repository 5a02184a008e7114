"""The bus watchdog of an emulated servo."""

from math import inf

from emulated import servo2, shown, told
from hardware.dynamixel.packets import Error2
from sim.emulator.watchdog import BusWatchdog


def test_it_runs_with_torque_only() -> None:
    watchdog = BusWatchdog()
    watchdog.arm(10, 1.0, torque=False)
    assert watchdog.deadline == inf
    watchdog.arm(10, 1.0, torque=True)
    assert watchdog.deadline == 1.2
    watchdog.feed(1.1)
    assert watchdog.deadline > 1.29
    watchdog.arm(0, 1.1, torque=True)
    assert watchdog.deadline == inf


def test_a_trip_stops_the_servo_where_it_was_then() -> None:
    servo = servo2(position=0.0)
    told(servo, "profile_velocity", 20)
    told(servo, "bus_watchdog", 5)
    told(servo, "torque_enable", 1)
    told(servo, "goal_position", 4000)
    place = shown(servo, "present_position", 3.0)  # nobody was heard since 0
    assert 5 < place < 40  # 0.1 s of 4.6 rpm
    assert shown(servo, "bus_watchdog", 3.0) == -1 and shown(servo, "torque_enable", 3.0) == 1
    assert shown(servo, "profile_velocity", 3.0) == 0
    assert told(servo, "goal_position", 3000, 3.0) == Error2.DATA_RANGE
    assert told(servo, "goal_velocity", 1, 3.0) == Error2.DATA_RANGE
    assert told(servo, "bus_watchdog", 5, 3.0) == Error2.DATA_RANGE
    servo.write(116, (3000).to_bytes(4, "little"), 3.0)
    assert shown(servo, "goal_position", 3.0) == 4000
    assert told(servo, "bus_watchdog", 0, 3.0) == 0
    assert shown(servo, "present_position", 4.0) == place  # it does not go on by itself
    assert told(servo, "goal_position", 3000, 4.0) == 0
    assert shown(servo, "present_position", 6.0) == 3000


def test_old_firmware_has_none() -> None:
    assert servo2(firmware=40).table.has("bus_watchdog")
    assert not servo2(firmware=37).table.has("bus_watchdog")
    old = servo2(firmware=37)
    assert old.change(98, bytes((5,)), 0.0) == Error2.ACCESS
