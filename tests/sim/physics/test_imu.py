"""The IMU of a simulated robot measures what its body does."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hardware.bus import ServoBus, ServoGoals
from hardware.clock import VirtualClock
from hardware.imu import STANDARD_GRAVITY, ImuSample, from_roll_pitch_yaw
from retarget import rotations
from retarget.cli.buses import posture_ticks
from retarget.model.robot import RobotBody, load_robot
from sim.buses import imu_stand_in, physics_bus, physics_wire_bus, simulation_of
from sim.imu import Ailment, ImuErrors, ImuStandIn, ImuTruth
from sim.physics.imu import LinkMotion
from sim.physics.perturbation import Push
from sim.physics.simulation import Simulation

CYCLE, PUSHED_S = 0.008, 1.5


@pytest.fixture(scope="module")
def robot() -> RobotBody:
    return load_robot("op3")


def pushed(robot: RobotBody, *, seed: int = 0) -> Simulation:
    """An OP3 that is pushed forward so hard that it falls."""
    simulation = simulation_of(robot, start=posture_ticks(robot), seed=seed)
    simulation.push(Push((15.0, 0.0, 0.0), PUSHED_S, PUSHED_S + 0.2))
    return simulation


def standing(bus: ServoBus, clock: VirtualClock, cycles: int) -> list[ImuSample]:
    """Torque on in the present posture, held for so many cycles."""
    bus.open()
    goals, found = ServoGoals(bus.read().position), []
    bus.write(goals)
    bus.torque(True)
    for _ in range(cycles):
        clock.advance(CYCLE / 2)
        bus.write(goals)
        clock.advance(CYCLE / 2)
        sample = bus.read().imu
        assert sample is not None
        found.append(sample)
    return found


def test_the_imu_of_a_falling_robot_shows_the_fall(robot: RobotBody) -> None:
    """It pitches forward until it lies; then one g acts along another axis."""
    clock = VirtualClock()
    samples = standing(physics_bus(pushed(robot), clock), clock, 600)
    before = round(1.4 / CYCLE)
    assert all(sample.valid for sample in samples[5:])
    assert all(abs(angle) < 0.1 for angle in samples[before].tilt)
    assert samples[before].acceleration[2] == pytest.approx(STANDARD_GRAVITY, abs=0.6)
    assert max(sample.tilt[1] for sample in samples) > 1.2
    assert max(float(sample.angular_velocity[1]) for sample in samples) > 1.5
    lying = replace(samples[-1], acceleration=np.mean([sample.acceleration for sample in samples[-100:]], axis=0))
    assert np.linalg.norm(lying.acceleration) == pytest.approx(STANDARD_GRAVITY, abs=0.6)
    assert lying.orientation is not None
    up = rotations.rotate(rotations.conjugate(lying.orientation), [0.0, 0.0, 1.0])
    assert float(np.dot(up, lying.acceleration)) / STANDARD_GRAVITY == pytest.approx(1.0, abs=0.05)


def test_the_gyroscope_is_the_change_of_the_orientation(robot: RobotBody) -> None:
    """Of the true motion, without the errors of a sensor: finite differences of the pose agree with what is read."""
    simulation, spec = pushed(robot), robot.profile.imu_spec()
    assert spec is not None
    motion = LinkMotion(simulation, spec)
    simulation.switch(np.full(len(robot.joint_map), True))
    step, worst = simulation.world.step, 0.0
    simulation.advance(PUSHED_S + 0.1)
    for k in range(100):
        before = motion()
        simulation.advance(PUSHED_S + 0.1 + (k + 1) * step + 1e-9)
        after = motion()
        change = rotations.multiply(rotations.conjugate(before.orientation), after.orientation)
        turned = rotations.log(change) / step  # the engine turns it by the speed that it then has
        worst = max(worst, float(np.abs(turned - after.angular_velocity).max()))
    assert worst < 0.05 and np.linalg.norm(after.angular_velocity) > 1.0


def test_reading_it_changes_no_bit_of_the_motion(robot: RobotBody) -> None:
    read, alone = pushed(robot), pushed(robot)
    spec = robot.profile.imu_spec()
    assert spec is not None
    sensor = imu_stand_in(spec, read)
    for simulation in (read, alone):
        simulation.switch(np.full(len(robot.joint_map), True))
    for k in range(250):
        sensor.measure(k * CYCLE)
        for simulation in (read, alone):
            simulation.advance(k * CYCLE)
    assert read.data.qpos.tobytes() == alone.data.qpos.tobytes()
    assert read.data.qvel.tobytes() == alone.data.qvel.tobytes()


def test_both_physics_buses_measure_the_same_but_for_noise(robot: RobotBody) -> None:
    found = []
    for make in (physics_bus, physics_wire_bus):
        clock = VirtualClock()
        simulation = simulation_of(robot, start=posture_ticks(robot))
        found.append(standing(make(simulation, clock), clock, 100))
    for plain, wired in zip(*(samples[20:] for samples in found), strict=True):
        assert plain.valid and wired.valid
        assert plain.tilt == pytest.approx(wired.tilt, abs=0.05)


@pytest.mark.parametrize("ailment", [Ailment.FROZEN, Ailment.SPIKES])
def test_samples_of_a_broken_one_are_invalid(robot: RobotBody, ailment: Ailment) -> None:
    clock = VirtualClock()
    bus = physics_bus(simulation_of(robot, start=posture_ticks(robot)), clock)
    bus._bus._imu._sensor.ailment = ailment  # type: ignore[attr-defined]
    assert not all(sample.valid for sample in standing(bus, clock, 60)[30:])


def test_delay_and_dropouts() -> None:
    """A body that tips over by 1 rad/s, seen 50 ms late, with every third reading missing."""
    now = [0.0]
    sensor = ImuStandIn(
        motion=lambda: ImuTruth(from_roll_pitch_yaw(0.0, now[0], 0.0)),
        errors=ImuErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, delay=0.05, dropouts=0.33),
        seed=3,
    )
    found = []
    for k in range(150):
        now[0] = 0.01 * k
        reading = sensor.measure(now[0])
        if reading is not None and k > 10:
            assert reading.orientation is not None
            found.append(now[0] - 2.0 * math.asin(reading.orientation[2]))
    assert 70 < len(found) < 120
    assert min(found) == pytest.approx(0.05, abs=1e-6) and max(found) < 0.061
