"""Where servos are looked for: the ports of a robot, one port, or emulated ones in this process."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hardware.bus_spec import BAUDS, BusSpec
from hardware.clock import Clock, MonotonicClock, VirtualClock
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.line_scan import PROTOCOLS, Speed, all_speeds, has_speed
from hardware.dynamixel.serial_port import SerialPort
from hardware.servo import ServoSpec
from retarget.cli.buses import standing_ticks
from retarget.errors import UsageError
from retarget.robot_body import RobotBody, load_uncalibrated
from sim.emulator.fault_file import load_fault_plan
from sim.emulator.line import Line
from sim.emulator.loopback import EmulatedPort
from sim.emulator.robot_lines import robot_lines

EMULATOR = "emulator"
EMULATED_ROBOT = "op3"
"""Whose servos are emulated when no robot is named."""

Robot = Annotated[str | None, typer.Option(help="Robot by name or path.", metavar="NAME|PATH")]
Port = Annotated[
    str | None,
    typer.Option("--port", "--bus", help="Serial port; without it those of the profile.", metavar="PATH|emulator"),
]
Faults = Annotated[Path | None, typer.Option(help="What goes wrong on the emulator.", metavar="FILE.yaml")]
Baud = Annotated[int | None, typer.Option(help="Only this speed, bits per second.", metavar="BAUD")]
Protocol = Annotated[int | None, typer.Option(help="Only this protocol.", metavar="1|2")]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Say what would be done, and do not open a port.")]


@dataclass(frozen=True, eq=False)
class Place:
    """A port, and what the profile says of it: its bus, and its servos with their place in the robot's order.

    Without a robot there is neither.
    """

    port: BytePort
    spec: BusSpec | None = None
    servos: tuple[tuple[int, ServoSpec], ...] = ()

    @property
    def where(self) -> str:
        """What a person calls it."""
        return self.port.name if self.spec is None else f"bus {self.spec.name} ({self.port.name})"


def find_places(
    robot: str | None,
    port: str | None,
    *,
    faults: Path | None = None,
    clock: Clock | None = None,
    bus: str | None = None,
) -> list[Place]:
    """Ports, none of them open. clock: None: real, and virtual for an emulator. bus: only this one of the robot.

    Raises UsageError where no port is named, and for a port that none of the robot's several buses has.
    """
    if port != EMULATOR and faults is not None:
        raise UsageError("faults happen on the emulator", where="--faults", found=f"--port {port or 'of the profile'}")
    if port == EMULATOR:
        body = load_uncalibrated(robot or EMULATED_ROBOT)
        return _emulated(body, clock or VirtualClock(), faults, robot is not None, bus)
    clock = clock or MonotonicClock()
    if robot is None:
        if port is None:
            raise UsageError("no port is named", where="servo", allowed="--port PATH, --port emulator, or --robot NAME")
        return [Place(SerialPort(port, clock))]
    body = load_uncalibrated(robot)
    buses = [one for one in body.profile.bus_specs() if bus in (None, one.name)]
    if port is not None and len(buses) > 1:
        buses = _at_port(buses, port)
    return [Place(SerialPort(port or one.port, clock), one, _servos_of(body, one)) for one in buses]


def _at_port(buses: Sequence[BusSpec], port: str) -> list[BusSpec]:
    """The bus whose port this is. Raises UsageError where it is none's."""
    found = [bus for bus in buses if bus.port == port]
    if len(found) != 1:
        ports = ", ".join(f"{bus.port} (bus {bus.name})" for bus in buses)
        raise UsageError(
            "one port for a robot with several buses, and it is that of none of them",
            where="--port",
            found=port,
            allowed=f"{ports}, or none: then all of them",
            next_step="Write it into the profile, leave --robot out, or (servo setup) name the servo with --joint",
        )
    return found


@contextmanager
def opened(places: Sequence[Place]) -> Iterator[None]:
    """All ports open, each at its bus's speed; closed afterwards, whatever happens. Raises BusError."""
    try:
        for place in places:
            place.port.open(all_speeds()[0].baud if place.spec is None else place.spec.baud)
        yield
    finally:
        for place in places:
            place.port.close()


def chosen_speeds(place: Place, protocol: int | None, baud: int | None, *, everywhere: bool) -> list[Speed]:
    """Where to look: at the bus's speed, unless `everywhere`; narrowed by the options. Raises UsageError."""
    check_speed(protocol, baud)
    own = None if place.spec is None else Speed(place.spec.protocol, place.spec.baud)
    if own is not None and not everywhere and protocol is None and baud is None:
        return [own]
    protocols = [one for one in PROTOCOLS if protocol in (None, one) and (baud is None or has_speed(one, baud))]
    return all_speeds(protocols, baud, first=own)


def check_speed(protocol: int | None, baud: int | None, *, option: str = "--baud") -> None:
    """Raise UsageError for a protocol that there is not, and for a speed that no servo (of it) has."""
    if protocol is not None and protocol not in PROTOCOLS:
        raise UsageError("no such protocol", where="--protocol", found=protocol, allowed="1, 2")
    possible = PROTOCOLS if protocol is None else (protocol,)
    if baud is not None and not any(has_speed(one, baud) for one in possible):
        rates = sorted({rate for one in possible for rate in BAUDS[one]})
        raise UsageError("no such speed: no servo has it", where=option, found=baud, allowed=", ".join(map(str, rates)))


def emulated_lines(body: RobotBody, clock: Clock, faults: Path | None) -> dict[str, Line]:
    """The robot's emulated servos with their power on, by bus."""
    servos, buses = body.joint_map.servos, body.profile.bus_specs()
    plan = None if faults is None else load_fault_plan(faults, {bus.name: bus.ids for bus in buses})
    return robot_lines(servos, buses, start=standing_ticks(body), now=clock.now(), plan=plan, powered=True)


def _emulated(body: RobotBody, clock: Clock, faults: Path | None, known: bool, only: str | None) -> list[Place]:
    lines = emulated_lines(body, clock, faults)
    places = []
    for bus in body.profile.bus_specs():
        if only not in (None, bus.name):
            continue
        port = EmulatedPort(lines[bus.name], clock, name=f"emulated {bus.port}")
        places.append(Place(port, bus, _servos_of(body, bus)) if known else Place(port))
    return places


def _servos_of(body: RobotBody, bus: BusSpec) -> tuple[tuple[int, ServoSpec], ...]:
    return tuple((index, servo) for index, servo in enumerate(body.joint_map.servos) if servo.bus == bus.name)
