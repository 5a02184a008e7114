"""Ports and servos of the `servo` commands: of a robot, of one port, or emulated."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from hardware.bus import BAUDS, BusSpec
from hardware.clock import Clock, MonotonicClock, VirtualClock
from hardware.dynamixel.bus import CyclicImu
from hardware.dynamixel.checks import Span, needed_ticks
from hardware.dynamixel.codec import MAX_ID
from hardware.dynamixel.cyclic import BusLine
from hardware.dynamixel.found_servos import Look, as_bus, look, look_at_bus
from hardware.dynamixel.line_scan import (
    PROTOCOLS,
    LineScan,
    Sighting,
    Speed,
    all_speeds,
    has_speed,
    scan_likely,
    scan_line,
)
from hardware.dynamixel.serial_port import BytePort, SerialPort, existing_ports, ports_text
from hardware.errors import BusError, RetargetError
from hardware.servo import ServoSpec
from retarget.cli.application import confirmed, note, progress_bar
from retarget.cli.buses import posture_ticks
from retarget.cli.exit import echo
from retarget.cli.servo.find_port import port_of_bus
from retarget.errors import UsageError, suggest
from retarget.model.robot import RobotBody, load_robot, load_uncalibrated
from sim.bno08x import EmulatedBno08x
from sim.emulator.fault_state import load_fault_plan
from sim.emulator.line import Line
from sim.emulator.ports import EmulatedPort
from sim.emulator.robot_lines import connect, robot_lines
from sim.imu import ImuStandIn

EMULATOR = "emulator"
EMULATED_ROBOT = "op3"
"""Emulated robot of the commands without --robot."""


@dataclass(frozen=True)
class Where:
    """Options that choose ports.

    Options:
        port (--port, --bus) PATH|emulator: Serial port; without it those of the profile.
        faults FILE.yaml: Faults on the emulator.
    """

    robot: str | None = None
    port: str | None = None
    faults: Path | None = None


@dataclass(frozen=True)
class Only:
    """Options that narrow a search.

    Options:
        baud BAUD: Only this speed, bits per second.
        protocol 1|2: Only this protocol.
    """

    baud: int | None = None
    protocol: int | None = None


@dataclass(frozen=True, eq=False)
class ServoPort:
    """A port, with bus, servos and their indices in the robot's order; without a robot neither.

    connect: connects the emulated servo of a joint alone; None for real ones.
    """

    port: BytePort
    spec: BusSpec | None = None
    servos: tuple[tuple[int, ServoSpec], ...] = ()
    connect: Callable[[str], None] | None = None

    @property
    def where(self) -> str:
        """Name in messages."""
        return self.port.name if self.spec is None else f"bus {self.spec.name} ({self.port.name})"


def find_places(
    where: Where, *, clock: Clock | None = None, bus: str | None = None, as_delivered: bool = False
) -> list[ServoPort]:
    """Ports, none of them open. clock: None: virtual for an emulator, else real. bus: only this one of the robot.
    as_delivered: emulated servos are new, and none is connected.

    Raises UsageError without a port, and for a port of none of the robot's several buses.
    """
    robot, port, faults = where.robot, where.port, where.faults
    if port != EMULATOR and faults is not None:
        raise UsageError(
            "only the emulator has faults to inject", where="--faults", found=f"--port {port or 'of the profile'}"
        )
    emulated = port == EMULATOR
    clock = clock or (VirtualClock() if emulated else MonotonicClock())
    if robot is None and not emulated:
        if port is None:
            allowed = "--port PATH, --bus emulator, or --robot NAME"
            raise UsageError("no port is named", where="servo", found=ports_text(existing_ports()), allowed=allowed)
        return [ServoPort(SerialPort(port, clock))]
    body = load_uncalibrated(robot or EMULATED_ROBOT)
    lines = emulated_lines(body, clock, faults, as_delivered=as_delivered) if emulated else {}

    def connect_alone(joint: str) -> None:
        connect(lines, body.joint_map.servos, (joint,))

    buses = [one for one in body.profile.bus_specs() if bus in (None, one.name)]
    if port is not None and not emulated and len(buses) > 1:
        at_port = [bus for bus in buses if bus.port == port]
        if len(at_port) != 1:
            ports = ", ".join(f"{bus.port} (bus {bus.name})" for bus in buses)
            raise UsageError(
                "one port for a robot with several buses, and it is that of none of them",
                where="--port",
                found=port,
                allowed=f"{ports}, or none: then all of them",
                next_step="Write it into the profile, leave --robot out, or (servo setup) name the servo with --joint",
            )
        buses = at_port
    places = []
    for one in buses:
        found: BytePort = SerialPort(port or one.port, clock)
        if emulated:
            found = EmulatedPort(lines[one.name], clock, name=f"emulated {one.port}")
        servos = [(index, servo) for index, servo in enumerate(body.joint_map.servos) if servo.bus == one.name]
        places.append(
            ServoPort(found)
            if robot is None
            else ServoPort(found, one, tuple(servos), connect_alone if emulated else None)
        )
    return places


@contextmanager
def opened(places: Sequence[ServoPort]) -> Iterator[None]:
    """Open all ports, each at the speed of its bus, and close them afterwards. Raises BusError."""
    try:
        for place in places:
            place.port.open(all_speeds()[0].baud if place.spec is None else place.spec.baud)
        yield
    finally:
        for place in places:
            place.port.close()


def chosen_speeds(place: ServoPort, only: Only) -> list[Speed]:
    """Speeds at which servos are looked for, that of the bus first. Raises UsageError."""
    protocol, baud = only.protocol, only.baud
    check_speed(protocol, baud)
    own = None if place.spec is None else Speed(place.spec.protocol, place.spec.baud)
    protocols = [one for one in PROTOCOLS if protocol in (None, one) and (baud is None or has_speed(one, baud))]
    return all_speeds(protocols, baud, first=own)


def check_speed(protocol: int | None, baud: int | None) -> None:
    """Raise UsageError for an unknown protocol, and for a speed that no servo of it has."""
    if protocol is not None and protocol not in PROTOCOLS:
        raise UsageError("no such protocol", where="--protocol", found=protocol, allowed="1, 2")
    possible = PROTOCOLS if protocol is None else (protocol,)
    if baud is not None and not any(has_speed(one, baud) for one in possible):
        allowed = ", ".join(map(str, sorted({rate for one in possible for rate in BAUDS[one]})))
        raise UsageError("no such speed: no servo has it", where="--baud", found=baud, allowed=allowed)


def emulated_lines(
    body: RobotBody, clock: Clock, faults: Path | None, *, as_delivered: bool = False
) -> dict[str, Line]:
    """The robot's emulated servos with their power on, by bus. as_delivered: new, and none connected."""
    servos, buses = body.joint_map.servos, body.profile.bus_specs()
    plan = None if faults is None else load_fault_plan(faults, {bus.name: bus.ids for bus in buses})
    start, now = posture_ticks(body), clock.now()
    return robot_lines(servos, buses, start=start, now=now, plan=plan, powered=True, as_delivered=as_delivered)


# One servo: by its id on a port, or by its joint in a profile, which also gives the bus.


@dataclass(frozen=True, eq=False)
class ServoTarget:
    """One servo. device: its present id. servo, needed: its profile entry and ticks, or None."""

    place: ServoPort
    device: int
    servo: ServoSpec | None = None
    needed: Span | None = None


def find_target(where: Where, joint: str | None, device: int | None = None) -> ServoTarget:
    """The servo of the options; its port is not open. device: its present id, None: that of the profile.

    Raises UsageError for none or several.
    """
    robot = where.robot
    if robot is None:
        if joint is not None:
            raise UsageError("a joint of which robot", where="--joint", found=joint, allowed="--robot NAME beside it")
        if device is None:
            raise UsageError("which servo", where="servo setup", allowed="--id N, or --robot NAME --joint NAME")
        return ServoTarget(find_places(where)[0], device)
    body = load_uncalibrated(robot)
    servo = _servo(body, where.port, joint, device)
    places = find_places(where, bus=None if servo is None else servo.bus)
    if len(places) != 1:
        names = ", ".join(place.where for place in places)
        raise UsageError("which bus", where="--robot", found=names, allowed="--joint NAME, or --port PATH of one")
    if servo is None:
        assert device is not None
        return ServoTarget(places[0], device)
    needed = needed_ticks(_calibrated(robot, body).joint_map)[servo.joint]
    return ServoTarget(places[0], servo.id if device is None else device, servo, needed)


def all_targets(where: Where, *, yes: bool) -> list[ServoTarget]:
    """Every servo of a robot, in its order; no port is open. yes: ports of the profile, without a question. Raises
    RetargetError."""
    assert where.robot is not None
    body = load_uncalibrated(where.robot)
    places = {}
    for bus in body.profile.bus_specs():
        port = where.port or port_of_bus(bus, yes=yes)
        (places[bus.name],) = find_places(replace(where, port=port), bus=bus.name, as_delivered=True)
    needed = needed_ticks(_calibrated(where.robot, body).joint_map)
    servos = body.joint_map.servos
    return [ServoTarget(places[servo.bus], servo.id, servo, needed[servo.joint]) for servo in servos]


def _servo(body: RobotBody, port: str | None, joint: str | None, device: int | None) -> ServoSpec | None:
    servos = body.joint_map.servos
    if joint is not None:
        found = [one for one in servos if one.joint == joint]
        if not found:
            known = [one.joint for one in servos]
            step = suggest(joint, known)
            raise UsageError(
                "no such joint", where="--joint", found=repr(joint), allowed=", ".join(known), next_step=step
            )
        return found[0]
    if device is None:
        raise UsageError("which servo", where="servo setup", allowed="--joint NAME, or --id N of the profile")
    buses = body.profile.bus_specs()
    there = {bus.name for bus in buses if bus.port == port} or {bus.name for bus in buses}
    found = [one for one in servos if one.id == device and one.bus in there]
    if len(found) > 1:
        joints = ", ".join(f"{one.joint} (bus {one.bus})" for one in found)
        raise UsageError(
            "several servos have this id", where="--id", found=f"{device}: {joints}", allowed="--joint NAME"
        )
    return found[0] if found else None


def _calibrated(robot: str, body: RobotBody) -> RobotBody:
    """The body with the zero ticks of its calibration, if they are valid."""
    try:
        return load_robot(robot)
    except RetargetError:
        return body


def look_at(
    places: Sequence[ServoPort], only: Only, *, ids: Sequence[int] | None = None, unknown_too: bool = False
) -> list[Look]:
    """Look at each open port. ids: only these; None: all, or those of the profile.

    unknown_too: accept servos of unknown models. Raises BusError when no servo answers.
    """
    protocol, baud = only.protocol, only.baud
    check_speed(protocol, baud)
    chosen = sorted(index for place in places for index, one in place.servos if ids is None or one.id in ids)
    looks: list[Look] = []
    for place in places:
        if place.spec is not None:
            spec = replace(place.spec, baud=baud or place.spec.baud, protocol=protocol or place.spec.protocol)
            servos = [(chosen.index(index), one) for index, one in place.servos if index in chosen]
            place.port.set_baud(spec.baud)
            line = BusLine(spec, place.port, servos)
            if ids is None:
                looks.append(look_at_bus(line))
            else:
                looks.append(look(line, search(place, [Speed(spec.protocol, spec.baud)], ids).sightings))
            continue
        speeds = chosen_speeds(place, only)
        if ids is None and len(speeds) > 1:
            text = f"looking at {len(speeds)} speeds on {place.where}: up to a minute; --baud and --protocol shorten it"
            echo(text, err=True)
        seen = search(place, speeds, ids)
        if seen.sightings:
            first = sum(len(one.line.servos) for one in looks)
            spec, found = as_bus(place.port.name, seen.sightings, first=first)
            place.port.set_baud(spec.baud)
            looks.append(look(BusLine(spec, place.port, found), seen.sightings))
    if not any(one.line.images or (unknown_too and one.unknown) for one in looks):
        notes = [note for one in looks for note in (*one.wrong, *one.notes)]
        raise BusError(
            "no servo answers" + (f" to id {', '.join(map(str, ids))}" if ids else ""),
            where=", ".join(place.where for place in places),
            found="; ".join(notes) or None,
            then="Check power and wiring, and see `retarget servo scan`",
        )
    for one in looks:
        for text in (*one.wrong, *one.notes):
            echo(f"note: bus {one.line.spec.name}: {text}", err=True)
    return looks


def imu_of(where: Where, lines: Sequence[BusLine], clock: Clock) -> CyclicImu | None:
    """The IMU of the robot, on these lines or on a port of its own; it is not open. None: no robot is named, its
    profile has no IMU, or its bus is left out."""
    robot = where.robot or (EMULATED_ROBOT if where.port == EMULATOR else None)
    spec = None if robot is None else load_uncalibrated(robot).profile.imu_spec()
    if spec is None or (spec.bus and spec.bus not in {line.spec.name for line in lines}):
        return None

    def port(bus: BusSpec) -> BytePort:
        emulated = where.port == EMULATOR
        return EmulatedBno08x(ImuStandIn(spec), clock) if emulated else SerialPort(bus.port, clock)

    return CyclicImu(spec, lines, port, note)


def ids_of(text: str, *, option: str = "--ids", highest: int = MAX_ID + 1) -> list[int] | None:
    """The ids of a text such as `1,2,5-9`; None for an empty one. Raises UsageError."""
    if not text:
        return None
    found: set[int] = set()
    for part in text.split(","):
        first, _, last = part.partition("-")
        ends = [end.strip() for end in (first, last or first)]
        if not all(end.isascii() and end.isdigit() and len(end) <= 3 and int(end) <= highest for end in ends):
            allowed = f"such as 1,2,5-9; 0 to {highest}"
            raise UsageError("these are no ids", where=option, found=repr(text[:80]), allowed=allowed)
        found |= set(range(int(ends[0]), int(ends[1]) + 1))
    if not found:
        raise UsageError("no id is meant", where=option, found=repr(text[:80]), allowed="such as 1,2,5-9")
    return sorted(found)


def search(
    place: ServoPort,
    speeds: Sequence[Speed],
    ids: Sequence[int] | None,
    on_found: Callable[[Sighting], object] = lambda seen: None,
) -> LineScan:
    """Look for `ids` (None: all) at each speed, with a progress bar. See `scan_line`."""
    with progress_bar(f"looking on {place.where}", len(speeds)) as progress:
        return scan_line(place.port, speeds, ids=ids, progress=progress, on_found=on_found)


def quick_search(place: ServoPort, speeds: Sequence[Speed], on_found: Callable[[Sighting], object]) -> LineScan:
    """Look for servos at the usual ids, with a progress bar. See `scan_likely`."""
    expected = () if place.spec is None else place.spec.ids
    with progress_bar(f"looking on {place.where}", len(speeds)) as progress:
        return scan_likely(place.port, speeds, ids=expected, progress=progress, on_found=on_found)


def names(one: Look, ids: Sequence[int]) -> str:
    """Servos by joint and id; unknown ones by id."""
    return ", ".join(map(one.line.name_of, ids))


def agreed(question: str, *, yes: bool) -> bool:
    """True if the operator agrees, or `yes`. ENTER alone is no. Raises UsageError at the end of the input."""
    if yes or confirmed(question, enter=False, where="servo (--yes agrees beforehand)"):
        return True
    echo("nothing was done")
    return False
