"""The registers that show what an emulated servo does."""

from emulated import servo2, shown, told


def test_the_realtime_tick_wraps() -> None:
    servo = servo2()
    assert shown(servo, "realtime_tick", 0.5) == 500
    assert shown(servo, "realtime_tick", 32.7675) == 32767
    assert shown(servo, "realtime_tick", 32.7685) == 0


def test_moving_and_its_threshold() -> None:
    servo = servo2(position=0.0)
    told(servo, "torque_enable", 1)
    told(servo, "goal_position", 4000)
    assert (shown(servo, "moving", 0.5), shown(servo, "moving_status", 0.5)) == (1, 8)
    assert (shown(servo, "moving", 5.0), shown(servo, "moving_status", 5.0)) == (0, 1)
    told(servo, "torque_enable", 0, 5.0)
    told(servo, "moving_threshold", 1023, 5.0)
    told(servo, "torque_enable", 1, 5.0)
    told(servo, "goal_position", 0, 5.0)
    assert shown(servo, "moving", 5.5) == 0 and shown(servo, "present_velocity", 5.5) < -150


def test_the_trajectory_is_ahead_of_the_shaft() -> None:
    servo = servo2(position=0.0)
    told(servo, "profile_velocity", 100)
    told(servo, "torque_enable", 1)
    told(servo, "goal_position", 4000)
    ahead = shown(servo, "position_trajectory", 1.0) - shown(servo, "present_position", 1.0)
    assert 20 < ahead < 100 and shown(servo, "velocity_trajectory", 1.0) == 100
    assert shown(servo, "moving_status", 1.0) == 2 | 1 << 4


def test_a_load_register_where_there_is_no_current() -> None:
    servo = servo2("XL430-W250")
    told(servo, "torque_enable", 1)
    servo.load(-1.0, 0.0)
    assert 500 < shown(servo, "present_load", 0.5) < 800
