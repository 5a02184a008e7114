"""A robot's own driver above its emulated servos."""

import numpy as np
import pytest

from hardware.bus import ServoBus, ServoGoals
from hardware.clock import VirtualClock
from hardware.errors import BusError
from hardware.guard import Guard
from messages import refuses
from physics_rig import DT, PhysicsRig, op3, standing, ticks
from retarget.cli.buses import posture_ticks
from retarget.model.robot import load_robot
from retarget.safety.gate import Gate
from sim.buses import emulated_bus
from sim.physics.perturbation import Perturbation, Push


def test_the_servos_of_op3_stand_and_follow() -> None:
    robot, clock = load_robot("op3"), VirtualClock()
    start = posture_ticks(robot)
    bus = emulated_bus(robot, clock, start=start)
    bus.open()
    assert np.array_equal(bus.read().position, start)
    bus.write(ServoGoals(start))
    bus.torque(True)
    for _ in range(60):
        states = bus.read()
        bus.write(ServoGoals(start + 20))
        clock.advance(0.008)
    assert states.valid.all() and states.driven.all()
    assert np.abs(states.position - start - 20).max() <= 1
    bus.close()


def test_before_torque_a_hand_holds_it() -> None:
    rig = PhysicsRig()
    bus: ServoBus = rig.bus
    states = bus.read()
    assert states.position.tolist() == rig.start.tolist()
    assert states.valid.all() and not states.driven.any() and not states.age.any()
    assert (states.voltage > 11.0).all() and (states.temperature == 25.0).all() and not states.current.any()
    rig.clock.advance(5.0)
    assert rig.bus.read().position.tolist() == rig.start.tolist()
    assert rig.bus.witness.fall is None and rig.bus.witness.log.rows == 0
    assert rig.bus.witness.simulation.held and rig.bus.read().soles is None, (
        "no state of soles while a hand holds the robot"
    )


def test_it_stands_with_its_own_gains_and_its_feet_stay() -> None:
    rig = PhysicsRig()
    rig.arm()
    rig.run(1.0)
    before = rig.bus.witness.state.sole.copy()
    states = rig.run(10.0)
    bus = rig.bus
    assert bus.witness.fall is None
    assert np.abs(bus.witness.state.sole - before).max() < 5e-4
    assert bus.witness.log.slip_m.max() < 5e-4
    assert np.degrees(bus.witness.log.worst_tilt) < 0.5
    assert 0.005 < rig.error(states) < 0.05  # P gains without an I gain sag
    assert bus.witness.state.load.sum() == pytest.approx(bus.witness.simulation.world.weight, rel=0.01)
    assert states.soles is not None and states.soles.tolist() == [True, True]
    assert bus.witness.state.load[0] == pytest.approx(bus.witness.state.load[1], rel=0.1)


def test_a_robot_that_sits_on_its_ankles_may_lose_its_torque() -> None:
    rest = ticks(op3().profile.postures.rest)
    rig = PhysicsRig(start=rest)
    rig.arm()
    rig.run(1.0, rest)
    rig.bus.torque(False)
    rig.run(1.5, rest)
    rig.bus.close()
    witness = rig.bus.witness
    assert witness.at_rest and witness.fall is None
    assert np.degrees(np.arccos(1.0 - 2.0 * np.square(witness.state.root[4:6]).sum())) < 15.0


def test_the_guard_leads_it_from_arming_to_release() -> None:
    rig, joints = PhysicsRig(), op3().joint_map
    guard = Guard(
        bus=rig.bus,
        joint_map=joints,
        clock=rig.clock,
        limits=op3().profile.guard_limits(),
    )
    present, gate = guard.present(), Gate(joints, dt=DT)
    guard.arm(gate.begin(present))
    arms = np.arange(len(joints)) < 6
    for _ in range(150):
        rig.clock.advance(DT)
        guard.read()
        guard.write(gate.check(present + 0.05 * np.sin(2.0 * rig.clock.now()) * arms) or gate.brake())
    assert guard.stop is None and rig.bus.witness.fall is None
    guard.release()
    assert not rig.bus.witness.simulation.motors.driven.any()


def test_a_strong_push_fells_it_and_a_weak_one_does_not() -> None:
    weak, strong = (
        PhysicsRig(perturbation=Perturbation(pushes=(Push((force, 0.0, 0.0), 1.0, 0.2),))) for force in (3.0, 20.0)
    )
    for rig in (weak, strong):
        rig.arm()
        rig.run(3.0)
    assert weak.bus.witness.fall is None
    assert np.ptp(weak.bus.witness.log.column("com")[150:, 0]) > 1e-3
    fall = strong.bus.witness.fall
    assert fall is not None and fall.powered and fall.time > 1.0


def test_goals_take_effect_one_cycle_after_they_are_written() -> None:
    rig, late = PhysicsRig(), PhysicsRig(perturbation=Perturbation(latency_s=0.03))
    moved = []
    for one in (rig, late):
        one.arm()
        one.run(1.5)
        goal = standing()
        goal[0] += 200
        one.bus.write(ServoGoals(goal))
        quiet = one.bus.witness.simulation.motors.goal[0]
        cycles = 0
        while one.bus.witness.simulation.motors.goal[0] == quiet:
            one.clock.advance(0.002)
            one.bus.read()
            cycles += 1
        moved.append(cycles)
    assert moved[0] == pytest.approx(5, abs=1)  # applied in the step that begins at 8 ms
    assert moved[1] - moved[0] == pytest.approx(15, abs=1)


def test_the_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    def record(seed: int) -> bytes:
        rig = PhysicsRig(seed=seed, perturbation=Perturbation(pushes=(Push((0.0, 3.0, 0.0), 0.8, 0.2),)))
        rig.arm()
        rig.run(1.5)
        return rig.bus.witness.log.column("q").tobytes()

    assert record(3) == record(3) != record(4)


def test_what_it_refuses() -> None:
    rig = PhysicsRig()
    goal = standing()
    goal[3] = 5000
    with refuses(BusError):
        rig.bus.write(ServoGoals(goal))
    rig.bus.close()
    for call in (rig.bus.read, lambda: rig.bus.write(ServoGoals(standing())), lambda: rig.bus.torque(True)):
        with refuses(BusError):
            call()
