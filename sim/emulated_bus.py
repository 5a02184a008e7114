"""A robot's own driver above emulated servos: the bytes that would be on its wires, on the time of a given clock."""

from collections.abc import Callable
from pathlib import Path

from hardware.arrays import TickArray
from hardware.bus_spec import BusSpec
from hardware.clock import Clock
from hardware.dynamixel.bus import DynamixelBus
from retarget.robot_body import RobotBody
from sim.emulator.fault_file import load_fault_plan
from sim.emulator.loopback import EmulatedPort
from sim.emulator.robot_lines import robot_lines
from sim.emulator.wire import Timing
from sim.physics.simulation import Simulation
from sim.physics.wire import drive_shafts


def emulated_bus(
    robot: RobotBody,
    clock: Clock,
    *,
    start: TickArray,
    faults: Path | None = None,
    timing: Timing | None = None,
    simulation: Simulation | None = None,
    tell: Callable[[str], object] = lambda note: None,
) -> DynamixelBus:
    """The bus of a robot whose emulated servos begin at `start`, ticks (n,). timing: of the wires; None: the usual.
    simulation: what turns their shafts, begun at the same ticks; None: the emulator's own motion.

    Raises ConfigError for a bad file of faults.
    """
    servos, buses = robot.joint_map.servos, robot.profile.bus_specs()
    plan = None if faults is None else load_fault_plan(faults, {bus.name: bus.ids for bus in buses})
    lines = robot_lines(servos, buses, start=start, now=clock.now(), plan=plan, timing=timing)
    if simulation is not None:
        drive_shafts(simulation, servos, lines, now=clock.now())

    def port(bus: BusSpec) -> EmulatedPort:
        return EmulatedPort(lines[bus.name], clock, name=f"emulated {bus.port}")

    return DynamixelBus(robot.joint_map, buses, port, tell=tell)
