"""Motors: a shaft under load, at full speed, without torque, and in a pair."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from hardware.servo import ServoGains, ServoSpec, find_model
from servos import waist_servos
from sim.physics.drive_numbers import drive_numbers
from sim.physics.motors import Drive, Motors, add_motors
from sim.physics.position_loop import position_loop

ARM = """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
<default><position kp="77"/></default><worldbody>
<body><joint name="knee" type="hinge" axis="0 1 0"/><inertial pos="0.1 0 0" mass="{mass}" diaginertia="1e-4 1e-4 1e-4"/>
</body></worldbody></mujoco>"""
WAIST = """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body><joint name="roll" axis="1 0 0"/><inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
<body><joint name="yaw" axis="0 0 1"/><inertial pos="0 0 0" mass="0.1" diaginertia="1e-3 1e-3 1e-3"/></body>
</body></worldbody></mujoco>"""


class Bench:
    def __init__(self, text: str, servos: tuple[ServoSpec, ...]) -> None:
        self.drives = tuple(Drive(s, drive_numbers(s.model), position_loop(s, protocol=2)) for s in servos)
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


def knee(**changes: Any) -> ServoSpec:
    gains = ServoGains(position_p=changes.pop("p", 800), position_i=changes.pop("i", 0))
    direction = changes.pop("direction", 1)
    model = find_model("XM430-W350")
    return ServoSpec("knee", 1, model, "main", direction, 2048, -1.0, 1.0, 2.0, 20.0, gains=gains, **changes)


def test_under_load_it_hangs_back_by_the_torque_over_the_stiffness() -> None:
    bench = Bench(ARM.format(mass=1.0), (knee(),))
    bench.run(3.0)
    torque, drive = 0.981, bench.drives[0]
    stiffness = drive.loop.proportional * drive.numbers.stall_torque(12.0)
    error = -float(bench.motors.angle(bench.data)[0])
    assert error == pytest.approx(-torque / stiffness, abs=drive.numbers.friction / stiffness)
    assert abs(float(bench.motors.torque(bench.data)[0])) == pytest.approx(torque, abs=drive.numbers.friction)


def test_an_i_gain_takes_the_error_away() -> None:
    bench = Bench(ARM.format(mass=1.0), (knee(i=1000),))
    bench.run(6.0)
    assert abs(float(bench.motors.angle(bench.data)[0])) < 0.006


@pytest.mark.parametrize("volts", [9.0, 12.0])
def test_its_speed_is_bounded_by_the_supply(volts: float) -> None:
    bench = Bench(ARM.format(mass=1e-4), (knee(p=16000),))
    bench.power(True, volts)
    bench.motors.goal = np.array([100.0])
    bench.run(1.0)
    numbers = bench.drives[0].numbers
    top = (numbers.stall_torque(volts) - numbers.friction) / (numbers.back_emf + numbers.viscous)
    assert float(bench.motors.speed(bench.data)[0]) == pytest.approx(top, rel=0.01)


@pytest.mark.parametrize(("current", "most"), [(None, 2.95), (0.5, 0.5 * 2.388)])
def test_its_torque_is_bounded_by_the_motor_and_by_its_current_limit(current: float | None, most: float) -> None:
    bench = Bench(ARM.format(mass=10.0), (knee(current_limit=current),))  # 9.8 N m at the start
    bench.motors.goal = np.array([-1.0])
    bench.run(0.02)
    assert abs(float(bench.motors.torque(bench.data)[0])) == pytest.approx(most, rel=0.01)
    assert float(bench.data.qfrc_actuator[0]) == pytest.approx(-most, rel=0.01)


def test_without_torque_the_motor_is_open() -> None:
    bench = Bench(ARM.format(mass=1.0), (knee(),))
    bench.power(False)
    bench.run(0.2)
    assert float(bench.data.qpos[0]) > 0.1  # down
    assert not bench.motors.torque(bench.data).any()


@pytest.mark.parametrize(("direction", "gear"), [(-1, 1.0), (1, 2.0), (-1, 0.5)])
def test_direction_and_gear_turn_the_shaft(direction: int, gear: float) -> None:
    bench = Bench(ARM.format(mass=1e-3), (knee(direction=direction, gear=gear),))
    bench.motors.goal = np.array([0.4])
    bench.run(2.0)
    assert float(bench.data.qpos[0]) == pytest.approx(0.4 * direction / gear, abs=0.02)
    assert float(bench.motors.angle(bench.data)[0]) == pytest.approx(0.4, abs=0.02)


def test_a_coupled_pair_turns_both_joints() -> None:
    _, roll, yaw, _ = waist_servos()
    pair = tuple(replace(servo, gains=ServoGains(position_p=900)) for servo in (roll, yaw))
    bench = Bench(WAIST, pair)
    coupling = roll.coupling
    assert coupling is not None
    asked = np.array([0.2, -0.3])  # joints
    shafts = np.array(coupling.inverse) @ asked * [roll.direction, yaw.direction]
    bench.motors.goal = shafts
    bench.run(3.0)
    assert bench.data.qpos.tolist() == pytest.approx(asked.tolist(), abs=0.01)
    assert bench.motors.angle(bench.data).tolist() == pytest.approx(shafts.tolist(), abs=0.03)
