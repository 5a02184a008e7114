"""Buses of a robot without hardware: above emulated servos, and above its simulated mechanics."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from hardware.arrays import TickArray
from hardware.bus import BusSpec
from hardware.clock import Clock
from hardware.dynamixel.bus import DynamixelBus
from hardware.dynamixel.serial_port import BytePort
from hardware.errors import BusError
from hardware.imu import ImuSpec
from retarget.errors import ConfigError
from retarget.model.robot import RobotBody
from retarget.schema.scene import Scene
from sim.bno08x import EmulatedBno08x
from sim.emulator.fault_state import EVERY_KIND, load_fault_plan
from sim.emulator.faults import FaultKind
from sim.emulator.line import Line
from sim.emulator.ports import EmulatedPort
from sim.emulator.robot_lines import robot_lines
from sim.imu import ImuStandIn, ImuTruth, PlantedMotion, SensedMotion, standing_still
from sim.physics.bus import PhysicsBus, drive_shafts, servos_on
from sim.physics.imu import LinkMotion
from sim.physics.mount import Mount, mount_of
from sim.physics.perturbation import NOMINAL, Perturbation, PerturbationKind, combined, drawn
from sim.physics.simulation import Simulation
from sim.physics.witness import Witness, WitnessedBus
from sim.physics.world import build_world

SETTLE_S = 1.0
"""Time for a robot to settle on its servos, of which a hand holds it for 0.6 s, s."""

WITH_MASS = EVERY_KIND - {FaultKind.OVERLOAD}
"""Faults of servos whose shafts simulated mechanics turn: nothing there blocks a shaft."""


def emulated_bus(
    robot: RobotBody,
    clock: Clock,
    *,
    start: TickArray,
    faults: Path | None = None,
    simulation: Simulation | None = None,
    notify: Callable[[str], object] = lambda note: None,
) -> DynamixelBus:
    """Make the bus of a robot whose emulated servos begin at `start`, ticks (n,).

    simulation: turns their shafts, begun at the same ticks; None: the emulator's own motion. Raises ConfigError for a
    bad file of faults, or one that the bus cannot play.
    """
    servos, buses = robot.joint_map.servos, robot.profile.bus_specs()
    ids, kinds = {bus.name: bus.ids for bus in buses}, EVERY_KIND if simulation is None else WITH_MASS
    plan = None if faults is None else load_fault_plan(faults, ids, kinds=kinds)
    imu = robot.profile.imu_spec()
    sensor = None if imu is None else imu_stand_in(imu, simulation)
    lines = robot_lines(servos, buses, start=start, now=clock.now(), plan=plan, imu=sensor)
    if sensor is not None and simulation is None:
        sensor.motion = motion_of_shafts(robot, lines, start, clock)
    if simulation is not None:
        drive_shafts(simulation, servos, lines, now=clock.now())

    def port(bus: BusSpec) -> BytePort:
        if sensor is not None and bus.name not in lines:
            return EmulatedBno08x(sensor, clock)
        return EmulatedPort(lines[bus.name], clock, name=f"emulated {bus.port}")

    return DynamixelBus(robot.joint_map, buses, port, imu=imu, notify=notify)


def imu_stand_in(imu: ImuSpec, simulation: Simulation | None, *, seed: int = 0) -> ImuStandIn:
    """Make the stand-in of a robot's IMU: it moves with the simulation; None: see `motion_of_shafts`."""
    motion = standing_still if simulation is None else LinkMotion(simulation, imu)
    return ImuStandIn(imu, seed=seed, motion=motion)


def motion_of_shafts(
    robot: RobotBody, lines: Mapping[str, Line], start: TickArray, clock: Clock
) -> Callable[[], ImuTruth]:
    """The motion of the IMU's link on a robot without mass whose emulated servos began at `start`, ticks
    (n,)."""
    shafts = [one.shaft for one in servos_on(lines, robot.joint_map.servos)]
    offset = start - np.array([shaft.position for shaft in shafts])
    return PlantedMotion(
        robot, lambda: robot.joint_map.to_radians(np.array([shaft.position for shaft in shafts]) + offset), clock
    )


# A robot's bus above its simulated mechanics: what `--bus physics` opens.


def physics_bus(simulation: Simulation, clock: Clock) -> WitnessedBus:
    """Make the bus of a robot with mass. Goals take effect one cycle of the robot after they are written."""
    profile = simulation.world.robot.profile
    imu, seed = profile.imu_spec(), simulation.seed
    sensor = None if imu is None else SensedMotion(imu, imu_stand_in(imu, simulation, seed=seed))
    bus = PhysicsBus(simulation, clock, latency=1.0 / profile.safety.rate_hz, imu=sensor)
    return WitnessedBus(bus, Witness(simulation))


def physics_wire_bus(
    simulation: Simulation,
    clock: Clock,
    *,
    faults: Path | None = None,
    notify: Callable[[str], object] = lambda note: None,
) -> WitnessedBus:
    """Make the bus of a robot with mass below emulated servos (see `emulated_bus`). Raises ConfigError."""
    robot = simulation.world.robot
    start = robot.joint_map.to_ticks(simulation.world.start_angles)
    bus = emulated_bus(robot, clock, start=start, faults=faults, simulation=simulation, notify=notify)
    return WitnessedBus(bus, Witness(simulation))


def simulation_of(
    robot: RobotBody,
    *,
    start: TickArray,
    scene: Scene | None = None,
    mount: Mount | None = None,
    perturbation: Perturbation | None = None,
    seed: int = 0,
    notify: Callable[[str], object] = lambda note: None,
) -> Simulation:
    """Build the mechanics of a robot whose servos begin at `start`, ticks (n,). mount: None: of its profile. notify:
    receives what is left out of the scene. Raises ConfigError (see `build_world`)."""
    perturbation = NOMINAL if perturbation is None else perturbation
    world = build_world(
        robot,
        np.asarray(robot.joint_map.to_radians(start)),
        mount=mount_of(robot) if mount is None else mount,
        perturbation=perturbation,
        scene=scene,
        notify=notify,
    )
    return Simulation(world, perturbation=perturbation, seed=seed)


TRIALS = 6
"""Trials at rest: one as planned, then each with masses, centre of mass, friction and stiffness drawn anew."""
DRAWN = (
    PerturbationKind.MASS,
    PerturbationKind.CENTRE_OF_MASS,
    PerturbationKind.FRICTION,
    PerturbationKind.STIFFNESS,
)


def topples_at_rest(robot: RobotBody) -> str | None:
    """Return how a robot on its soles goes down when its torque goes off in its posture `rest`, in words.

    None: it stays in all TRIALS, or it cannot be simulated.
    """
    if not robot.stands:
        return None
    rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
    for seed in range(TRIALS):
        perturbation = combined([drawn(kind, seed, within=(0, 0)) for kind in DRAWN]) if seed else NOMINAL
        try:
            simulation = simulation_of(robot, start=robot.joint_map.to_ticks(rest), perturbation=perturbation)
            witness = Witness(simulation)
            for on in (True, False):
                simulation.switch(np.full(len(rest), on))
                witness.switched(on)
                simulation.advance(simulation.time + SETTLE_S * on)
            witness.see_it_out()
        except (ConfigError, BusError):  # no masses, or a simulation that diverges
            return None
        seen = witness.toppled or witness.fall
        if seen is not None:
            return f"{seen.how}, in trial {seed + 1} of {TRIALS}"
    return None
