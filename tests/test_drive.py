"""How hard servos may push while torque comes up."""

from bus_rig import BusRig, specs
from hardware.dynamixel.drive import Drive


def test_the_drive_is_a_share_of_the_full_one_and_never_nothing() -> None:
    rig = BusRig(specs(2)).ready()
    (line,) = rig.bus.lines
    drive = Drive(line, limp=(1, 2))
    for share, counts in ((0.5, 442), (1.0, 885), (0.0, 1)):
        drive.confirm(share)
        assert rig.shown("goal_pwm") == [counts] * 2
    assert drive.limited


def test_who_carries_the_robot_never_gets_less() -> None:
    rig = BusRig(specs(2)).ready(torque=True)
    rig.device(2).memory.put("goal_pwm", 300)
    (line,) = rig.bus.lines
    rig.bus.torque(True)  # reads everybody anew, and raises the second one's drive from where it was
    assert rig.shown("goal_pwm") == [885, 885]
    rig.device(2).memory.put("goal_pwm", 300)
    line.images[2] = type(line.images[2])(line.images[2].table, bytes(rig.device(2).memory.image))
    drive = Drive(line, limp=())
    drive.confirm(0.1)
    assert rig.shown("goal_pwm") == [885, 300]
    assert drive.limited
