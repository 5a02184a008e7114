"""Servos with mass: the numbers of their makers, heat, supply and position loop."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from bus_rig import waist_servos
from hardware.arrays import FloatArray
from hardware.bus import ServoAlert
from hardware.motors import drive_numbers
from hardware.servo import SERVO_MODELS, ServoGains, ServoSpec, find_model, loop_lag, loop_stiffness
from physics_rig import op3
from sim.physics.motors import HEAT_PER_WATT, Drive, Electrics, Motors, PositionLoop, add_motors, position_loop
from sim.physics.world import robot_drives
from sim.servo_model import AMBIENT, HEAT_PER_AMPERE2, HEAT_TIME, IDLE_CURRENT, SUPPLY_RESISTANCE

BY_BAM = {"MX-64", "MX-106", "XL330-M288"}
LINES = {
    "XM430-W350": {0.5: 2.95, 1.5: 2.31, 3.0: 1.351, 4.0: 0.712},
    "XM430-W210": {0.8: 1.94, 3.0: 1.442, 5.0: 0.989},
    "XC430-W240": {1.2: 1.47, 4.0: 0.852},
    "2XC430-W250": {2.0: 1.09, 4.0: 0.73},
    "2XL430-W250": {2.0: 0.93, 4.0: 0.502, 5.0: 0.288},
    "XC330-T288": {1.0: 0.68, 3.0: 0.611},
}
"""N m by rad/s, as ToddlerBot's makers identified them: physics gives no more, up to the maker's no-load speed."""


@pytest.mark.parametrize("name", sorted(SERVO_MODELS))
def test_every_model_has_sound_numbers_and_stalls_and_turns_as_its_maker_says(name: str) -> None:
    model, drive = find_model(name), drive_numbers(find_model(name))
    stall = drive.stall_torque(model.voltage)
    assert min(drive.armature, drive.friction, drive.backlash, drive.resistance) > 0.0 and drive.source
    assert drive.friction < 0.1 * stall and drive.friction < drive.most_torque <= 1.001 * stall
    assert 60.0 <= drive.temperature_limit <= 90.0
    top = (stall - drive.friction) / (drive.back_emf + drive.viscous)
    if name in LINES:  # never stronger than identified, never faster than its maker says
        assert 0.9 * model.no_load_speed <= top <= 1.0001 * model.no_load_speed
        for speed, torque in LINES[name].items():
            assert 0.75 * torque <= min(drive.most_torque, stall - drive.back_emf * speed) <= 1.001 * torque
    elif name in BY_BAM:
        assert stall == pytest.approx(model.stall_torque, rel=0.25)
    else:
        assert stall == pytest.approx(model.stall_torque) and top == pytest.approx(model.no_load_speed)


DRIVES: tuple[Drive, ...] = robot_drives(op3())
COUNT = len(DRIVES)
ON = np.ones(COUNT, dtype=np.bool_)
STILL = np.zeros(COUNT)


def load(value: float) -> FloatArray:
    return np.where(np.arange(COUNT) == 3, value, 0.0)


def test_a_servo_warms_to_its_final_rise_of_the_size_of_the_emulator_and_cools_again() -> None:
    electrics = Electrics(DRIVES)
    current = electrics.current(load(1.0), ON)[3]
    final = AMBIENT + HEAT_PER_WATT * DRIVES[3].numbers.resistance * current**2
    assert final - AMBIENT == pytest.approx(HEAT_PER_AMPERE2 * current**2, rel=0.7)
    seen = []
    for torque, seconds in ((1.0, HEAT_TIME), (1.0, 100 * HEAT_TIME), (0.0, 100 * HEAT_TIME)):
        electrics.advance(load(torque), STILL, ON, seconds)
        seen.append(float(electrics.temperature[3]))
    assert seen == pytest.approx([AMBIENT + (final - AMBIENT) * (1.0 - np.exp(-1.0)), final, AMBIENT])
    assert electrics.temperature[4] == AMBIENT


def test_motors_that_turn_draw_what_they_do_and_what_they_lose_and_give_none_back_as_they_brake() -> None:
    every, ohm = np.ones(COUNT), np.array([drive.numbers.resistance for drive in DRIVES])
    lost = ohm / np.array([drive.numbers.torque_constant for drive in DRIVES]) ** 2  # at 1 N m
    sags = []
    for speed in (0.0, 3.0, -1000.0):
        electrics = Electrics(DRIVES)
        electrics.advance(every, speed * every, ON, 1e-3)
        sags.append(DRIVES[0].servo.model.voltage - float(electrics.voltage[0]))
    volts, idle = DRIVES[0].servo.model.voltage, IDLE_CURRENT * COUNT
    still, turning = (SUPPLY_RESISTANCE * (idle + float((lost + speed).sum()) / volts) for speed in (0.0, 3.0))
    assert sags == pytest.approx([still, turning, 0.0])  # the last: too little to be noticed


def test_too_much_for_too_long_or_too_hot_is_an_alert_that_stays() -> None:
    electrics = Electrics(DRIVES)
    most, breath = 0.9 * DRIVES[3].most_torque, 0.0
    for torque, times in ((most, 99), (breath, 1), (most, 99)):
        for _ in range(times):
            electrics.advance(load(torque), STILL, ON, 0.01)
        assert not electrics.alert.any()
    for _ in range(3):
        electrics.advance(load(most), STILL, ON, 0.01)
    assert electrics.alert[3] == ServoAlert.OVERLOAD and not electrics.alert[4]
    electrics.temperature[5] = 200.0
    assert electrics.advance(load(0.0), STILL, ON, 1e-3)
    electrics.advance(load(0.0), STILL, ON, 1e6)
    assert electrics.alert[5] == ServoAlert.OVERHEATING and electrics.temperature[5] < 30.0


ARM = """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
<default><position kp="77"/></default><worldbody>
<body><joint name="knee" type="hinge" axis="0 1 0"/><inertial pos="0.1 0 0" mass="{mass}" diaginertia="1e-4 1e-4 1e-4"/>
</body></worldbody></mujoco>"""
WAIST = """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body><joint name="roll" axis="1 0 0"/><inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
<body><joint name="yaw" axis="0 0 1"/><inertial pos="0 0 0" mass="0.1" diaginertia="1e-3 1e-3 1e-3"/></body>
</body></worldbody></mujoco>"""


class Bench:
    def __init__(self, text: str, servos: tuple[ServoSpec, ...], scale: float = 1.0) -> None:
        self.drives = tuple(
            Drive(s, drive_numbers(s.model), position_loop(s), scale * loop_stiffness(s)) for s in servos
        )
        spec: Any = mujoco.MjSpec.from_string(text)
        add_motors(spec, self.drives)
        self.model = spec.compile()
        self.motors = Motors(self.model, self.drives)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_setConst(self.model, self.data)
        self.power(True)

    def power(self, on: bool, volts: float = 12.0) -> None:
        self.motors.power(np.full(len(self.drives), on), np.full(len(self.drives), volts))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.002)):
            self.motors.command(self.data, 0.002)
            mujoco.mj_step(self.model, self.data)


def servo(model: str = "XM430-W350", **gains: int) -> ServoSpec:
    return ServoSpec("knee", 1, find_model(model), "main", 1, 2048, -1.0, 1.0, 2.0, 20.0, gains=ServoGains(**gains))


KNEE = servo(position_p=800, position_i=0)


@pytest.mark.parametrize("scale", [0.5, 1.0, 1.3])
def test_under_load_it_hangs_back_by_the_torque_over_the_stiffness(scale: float) -> None:
    bench = Bench(ARM.format(mass=1.0), (KNEE,), scale)
    bench.run(3.0)
    torque, drive = 0.981, bench.drives[0]
    stiffness = scale * loop_stiffness(drive.servo)
    error = -float(bench.motors.angle(bench.data)[0])
    assert error == pytest.approx(-torque / stiffness, abs=drive.numbers.friction / stiffness)
    assert abs(float(bench.motors.torque(bench.data)[0])) == pytest.approx(torque, abs=drive.numbers.friction)


@pytest.mark.parametrize("volts", [9.0, 12.0])
def test_its_speed_is_bounded_by_the_supply(volts: float) -> None:
    bench = Bench(ARM.format(mass=1e-4), (servo(position_p=16000, position_i=0),))
    bench.power(True, volts)
    bench.motors.goal = np.array([100.0])
    bench.run(1.0)
    numbers = bench.drives[0].numbers
    top = (numbers.stall_torque(volts) - numbers.friction) / (numbers.back_emf + numbers.viscous)
    assert float(bench.motors.speed(bench.data)[0]) == pytest.approx(top, rel=0.01)


@pytest.mark.parametrize(("current", "most"), [(None, 2.95), (0.5, 0.5 * 2.362)])
def test_its_torque_is_bounded_by_the_motor_and_by_its_current_limit(current: float | None, most: float) -> None:
    bench = Bench(ARM.format(mass=10.0), (replace(KNEE, current_limit=current),))  # 9.8 N m at the start
    bench.motors.goal = np.array([-1.0])
    bench.run(0.02)
    assert abs(float(bench.motors.torque(bench.data)[0])) == pytest.approx(most, rel=0.01)
    assert float(bench.data.qfrc_actuator[0]) == pytest.approx(-most, rel=0.01)


def test_a_coupled_pair_turns_both_joints() -> None:
    _, roll, yaw, _ = waist_servos()
    pair = tuple(replace(servo, gains=ServoGains(position_p=900)) for servo in (roll, yaw))
    bench = Bench(WAIST, pair)
    coupling = roll.coupling
    assert coupling is not None
    joints = np.array([0.2, -0.3])
    shafts = np.array(coupling.inverse) @ joints * [roll.direction, yaw.direction]
    bench.motors.goal = shafts
    bench.run(3.0)
    assert bench.data.qpos.tolist() == pytest.approx(joints.tolist(), abs=0.01)
    assert bench.motors.angle(bench.data).tolist() == pytest.approx(shafts.tolist(), abs=0.03)


def loop(model: str = "XM430-W350", protocol: int = 2, **gains: int) -> PositionLoop:
    return position_loop(replace(servo(model, **gains), protocol=protocol))


def test_an_xm430_at_800_is_as_stiff_as_the_public_model_of_op3() -> None:
    stiffness = loop_stiffness(servo(position_p=800))
    assert stiffness == pytest.approx(18.9, rel=0.01)  # 21.1 N m/rad there
    assert stiffness == pytest.approx(800 / 128 * 4096 / (2.0 * 3.14159265) / 885 * 4.1)


def test_gains_of_the_loop_agree_with_the_mock_bus() -> None:
    soft, spec = loop(position_p=400), servo(position_p=400)
    assert loop(position_p=1600).proportional == pytest.approx(4.0 * soft.proportional)
    assert 1.0 / (soft.proportional * spec.model.no_load_speed) == pytest.approx(loop_lag(spec))
    damping = [loop("XL430-W250", position_p=640, position_d=gain).derivative for gain in (4000, 5000)]
    assert damping[0] == loop(position_p=800, position_d=0).derivative == 0.0 < damping[1]  # 4000 is the default
    assert loop(position_p=800, position_i=0).integral == 0.0
    integral = loop(position_p=800, position_i=100).integral
    assert loop(position_p=1600, position_i=100).integral == pytest.approx(integral / 2.0)
    old, new = loop("MX-28", 1, position_p=32), loop("MX-28", position_p=800)
    assert old.proportional == pytest.approx(new.proportional)
