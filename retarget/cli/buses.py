"""From what a person calls a bus to the bus: servos of this process, an emulated wire, or real ones."""

from dataclasses import replace
from pathlib import Path

import typer

from hardware.arrays import TickArray
from hardware.bus import ServoBus
from hardware.bus_spec import BusSpec
from hardware.clock import Clock
from retarget.errors import UsageError
from retarget.robot_body import RobotBody

__all__ = ["make_bus", "standing_ticks"]


def make_bus(name: str, robot: RobotBody, clock: Clock, *, faults: Path | None = None) -> ServoBus:
    """The bus of that name, or on the port of that path. Simulated servos begin in the robot's `stand` posture.

    Raises UsageError for a port where the robot has several, ConfigError for a bad file of faults.
    """
    if name == "none":
        from sim.no_bus import NoBus

        return NoBus(clock, start=standing_ticks(robot))
    if name == "mock":
        from sim.mock_bus import mock_bus

        return mock_bus(robot, clock)
    if name == "emulator":
        from sim.emulated_bus import emulated_bus

        return emulated_bus(robot, clock, start=standing_ticks(robot), faults=faults)
    return _real_bus(name, robot, clock)


def standing_ticks(robot: RobotBody) -> TickArray:
    """Ticks (n,) of the posture `stand`."""
    return robot.joint_map.to_ticks(robot.posture(robot.profile.postures.stand)[robot.servo_columns])


def _real_bus(name: str, robot: RobotBody, clock: Clock) -> ServoBus:
    from hardware.dynamixel.bus import DynamixelBus
    from hardware.dynamixel.serial_port import SerialPort

    buses = robot.profile.bus_specs()
    if name != "profile" and len(buses) > 1:
        raise UsageError(
            "one port for a robot with several buses",
            where="--bus",
            found=name,
            allowed=f"profile, which takes the ports of {', '.join(bus.name for bus in buses)}",
            next_step="Write the ports into the profile",
        )

    if name != "profile":
        buses = tuple(replace(bus, port=name) for bus in buses)

    def port(bus: BusSpec) -> SerialPort:
        return SerialPort(bus.port, clock)

    return DynamixelBus(robot.joint_map, buses, port, tell=_note)


def _note(text: str) -> None:
    typer.echo(f"note: {text}", err=True)
