"""A robot's own driver above its emulated servos."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from hardware.bus import ServoBus, ServoGoals
from hardware.clock import VirtualClock
from hardware.errors import BusError
from hardware.guard import Guard
from hardware.servo import loop_lag
from messages import refuses
from physics_rig import DT, PhysicsRig, op3, standing
from retarget.cli.buses import posture_ticks
from retarget.errors import ConfigError
from retarget.model.robot import load_robot
from retarget.safety.gate import Gate
from sim.buses import WITH_MASS, emulated_bus, physics_wire_bus, simulation_of
from sim.emulator.fault_state import EVERY_KIND
from sim.emulator.faults import MEASURED_KINDS
from sim.emulator.faults import FaultKind as LineFault
from sim.emulator.shaft import Shaft
from sim.physics.bus import SimulatedShafts
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


def test_a_hand_holds_it_before_torque_then_it_stands_with_its_own_gains_and_its_feet_stay() -> None:
    rig = PhysicsRig()
    bus, witness = rig.bus, rig.bus.witness
    states = bus.read()
    assert states.position.tolist() == rig.start.tolist()
    assert states.valid.all() and not states.driven.any() and not states.age.any()
    assert (states.voltage > 11.0).all() and (states.temperature == 25.0).all() and not states.current.any()
    rig.clock.advance(5.0)
    assert bus.read().position.tolist() == rig.start.tolist()
    assert witness.fall is None and witness.log.rows == 0
    assert witness.simulation.held and bus.read().soles is None, "no state of soles while a hand holds the robot"
    rig.arm()
    rig.run(1.0)
    before = witness.state.sole.copy()
    states = rig.run(10.0)
    assert witness.fall is None and not states.alert.any() and not witness.log.self_contact_ticks
    assert np.abs(witness.state.sole - before).max() < 5e-4
    assert witness.log.slip_m.max() < 5e-4
    assert np.degrees(witness.log.worst_tilt) < 0.5
    assert 0.005 < rig.error(states) < 0.05  # P gains without an I gain sag
    assert witness.state.load.sum() == pytest.approx(witness.simulation.world.weight, rel=0.01)
    assert states.soles is not None and states.soles.tolist() == [True, True]
    assert witness.state.load[0] == pytest.approx(witness.state.load[1], rel=0.1)
    goal = standing()
    goal[3] = 5000
    with refuses(BusError):
        bus.write(ServoGoals(goal))
    bus.close()
    for call in (bus.read, lambda: bus.write(ServoGoals(standing())), lambda: bus.torque(True)):
        with refuses(BusError):
            call()


def test_the_guard_drives_it_from_arming_to_release() -> None:
    rig, joints = PhysicsRig(), op3().joint_map
    guard = Guard(bus=rig.bus, joint_map=joints, limits=op3().profile.safety.guard_limits())
    present, gate = guard.present(), Gate(joints, dt=DT)
    goal = gate.begin(present)
    guard.arm(goal)
    arms = np.arange(len(joints)) < 6
    for _ in range(150):
        rig.clock.advance(DT)
        guard.check(guard.read(), rig.clock.now(), rig.clock.idle())
        target = present + 0.05 * np.sin(2.0 * rig.clock.now()) * arms
        goal = gate.check(goal, target) or gate.brake(goal)
        guard.write(goal)
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


def test_a_fault_that_mechanics_cannot_play_is_refused_before_anything_moves(tmp_path: Path) -> None:
    faults = tmp_path / "faults.yaml"
    faults.write_text("faults:\n  - {fault: late, start: 1}\n  - {fault: overload, ids: [13]}\n")
    emulated_bus(op3(), VirtualClock(), start=standing(), faults=faults)
    with refuses(ConfigError):
        physics_wire_bus(simulation_of(op3(), start=standing()), VirtualClock(), faults=faults)


@pytest.mark.parametrize("mass", [pytest.param(True, marks=pytest.mark.long), False])
def test_every_fault_that_a_bus_takes_changes_something(tmp_path: Path, mass: bool) -> None:
    healthy = seen_through(tmp_path, None, mass=mass)
    kinds = (WITH_MASS if mass else EVERY_KIND) - MEASURED_KINDS  # tests/hardware/dynamixel/test_opencr.py
    unseen = [kind for kind in kinds if seen_through(tmp_path, kind, mass=mass) == healthy]
    assert unseen == [LineFault.ECHO], "the driver takes its own bytes away"


def seen_through(folder: Path, kind: LineFault | None, *, mass: bool) -> list[tuple[object, ...]]:
    """The host's view of a robot on an emulated wire that moves an elbow, with this fault from 0.8 s on."""
    faults, clock, start = folder / "faults.yaml", VirtualClock(), standing()
    faults.write_text(f"faults: [{'' if kind is None else f'{{fault: {kind.value}, start: 0.8}}'}]\n")
    bus: ServoBus
    if mass:
        bus = physics_wire_bus(simulation_of(op3(), start=start), clock, faults=faults)
    else:
        bus = emulated_bus(op3(), clock, start=start, faults=faults)
    seen: list[tuple[object, ...]] = []
    try:
        bus.open()
        bus.write(ServoGoals(bus.read().position))
        bus.torque(True)
        for tick in range(190):
            clock.advance(DT)
            states = bus.read()
            shown = np.nan_to_num([states.temperature, states.voltage]).tolist()
            seen.append((states.position.tolist(), states.valid.tolist(), states.alert.tolist(), states.retries, shown))
            goal = start.copy()
            goal[5] += round(400 * min(tick / 100, 1.0))
            bus.write(ServoGoals(goal))
    except BusError as error:
        seen.append((str(error),))
    with suppress(BusError):
        bus.close()
    return seen


# Physics below the bytes: the robot's own driver, emulated registers, simulated shafts.


def test_it_stands_through_the_wire_as_without() -> None:
    clock, start = VirtualClock(), standing()
    bus = physics_wire_bus(simulation_of(op3(), start=start), clock)
    bus.open()
    bus.write(ServoGoals(bus.read().position))
    bus.torque(True)
    due = clock.now()
    for _ in range(250):
        due += DT
        clock.sleep_until(due)
        states = bus.read()
        bus.write(ServoGoals(start))
    assert bus.witness.fall is None
    assert bus.witness.log.slip_m.max() < 5e-4
    error = np.abs(op3().joint_map.turned(states.position - start)).max()
    assert error == pytest.approx(0.0245, abs=0.004)  # the sag of the knees, as on the bus without a wire
    assert bus.witness.state.load.sum() == pytest.approx(bus.witness.simulation.world.weight, rel=0.02)


def sag(*, softer: float = 1.0, drive_limit: float = 1.0) -> float:
    """Sag of the knee of a standing robot, rad, with these registers."""
    simulation, start = simulation_of(op3(), start=standing()), standing()
    specs = op3().joint_map.servos
    tops = [spec.model.no_load_speed / spec.model.tick_rad for spec in specs]
    shafts = [Shaft(float(tick), top) for tick, top in zip(start, tops, strict=True)]
    mechanics = SimulatedShafts(simulation, shafts, begun=10.0)
    for shaft, spec in zip(shafts, specs, strict=True):
        shaft.mechanics, shaft.torque = mechanics, True
        shaft.lag = softer * loop_lag(spec)
        shaft.drive_limit = drive_limit
        shaft.refresh()
    for tick in range(190):
        for shaft in shafts:
            shaft.advance(10.0 + tick * DT)
    knee = [spec.joint for spec in specs].index("l_knee")
    assert shafts[knee].effort() != 0.0
    return abs(shafts[knee].position - float(start[knee])) * specs[knee].model.tick_rad


def test_the_registers_say_how_stiff_and_how_strong_a_servo_is() -> None:
    usual = sag()
    assert usual == pytest.approx(0.0245, abs=0.006)
    assert sag(softer=2.0) == pytest.approx(2.0 * usual, rel=0.25)
    assert sag(drive_limit=0.05) > 5.0 * usual  # 0.2 N m hold no knee
