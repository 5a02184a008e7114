"""The emulated buses of a robot: the servos of its profile, and the other devices on its buses."""

import random
from collections.abc import Collection, Mapping, Sequence

from hardware.arrays import TickArray
from hardware.bus import BusSpec
from hardware.dynamixel.control_table import code_of, find_table
from hardware.dynamixel.settings import MODES
from hardware.errors import HardwareError, describe
from hardware.servo import Layout, ServoSpec
from sim.emulator.controller import EmulatedController
from sim.emulator.conversation import Conduct
from sim.emulator.device import Device
from sim.emulator.fault_state import FaultPlan, FaultState
from sim.emulator.line import Line, LineTiming
from sim.emulator.power import Supply
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo2 import EmulatedServo
from sim.emulator.servo_body import ServoBuild
from sim.imu import ImuStandIn
from sim.servo_model import AMBIENT

WARMER = 3.0  # [degrees Celsius] most by which a servo is warmer than the room at first


def devices_of(
    specs: Sequence[ServoSpec],
    *,
    protocols: Mapping[str, int],
    bauds: Mapping[str, int] | None = None,
    return_delays: Mapping[str, int] | None = None,
    start: TickArray | Sequence[int] | None = None,
    seed: int = 0,
    now: float = 0.0,
    conduct: Conduct | None = None,
    as_delivered: bool = False,
) -> tuple[EmulatedServo | EmulatedServo1, ...]:
    """Return one device per servo, in order, with id, mode and homing offset of the profile, all else as delivered.

    By bus: protocols; bauds: bits/s; return_delays: register values. start: ticks (n,), None: zero ticks. as_delivered:
    id, mode and offset are the maker's, too. Raises HardwareError for a model without a table and a baud rate that it
    lacks.
    """
    chance = random.Random(seed)
    shared, behaviour = Supply(), conduct or Conduct()
    devices: list[EmulatedServo | EmulatedServo1] = []
    for index, spec in enumerate(specs):
        table = find_table(spec.model.name, protocols[spec.bus])
        position = float(spec.zero_tick if start is None else start[index])
        warmth = AMBIENT + WARMER * chance.random()
        build = ServoBuild(position, now=now, supply=shared, boot_time=behaviour.boot_time, warmth=warmth)
        kind = EmulatedServo if table.layout is Layout.X else EmulatedServo1
        device = kind(table, spec.model, build)
        if not as_delivered:
            device.memory.put("id", spec.id)
            device.memory.put("operating_mode", MODES[spec.mode])
            device.memory.put("homing_offset", spec.homing_offset)
        if (baud := (bauds or {}).get(spec.bus)) is not None:
            code = code_of(table, baud)
            if code is None:
                what, where = "the servo does not have this baud rate", f"{spec.joint} ({table.model})"
                raise HardwareError(describe(what=what, where=where, found=baud))
            device.memory.put("baud_rate", code)
        if (delay := (return_delays or {}).get(spec.bus)) is not None:
            device.memory.put("return_delay_time", delay)
        device.place(position)
        devices.append(device)
    return tuple(devices)


def robot_lines(
    servos: Sequence[ServoSpec],
    buses: Sequence[BusSpec],
    *,
    start: TickArray,
    now: float,
    plan: FaultPlan | None = None,
    seed: int = 0,
    timing: LineTiming | None = None,
    conduct: Conduct | None = None,
    powered: bool = False,
    as_delivered: bool = False,
    imu: ImuStandIn | None = None,
) -> dict[str, Line]:
    """A line for each bus, by its name. start: ticks (n,), in the order of `servos`; now: s, from which faults
    count.

    Ids that no servo has are controllers such as the OpenCR of an OP3. powered: the power switch is on. as_delivered:
    servos are new, and none is connected (see `connect`). imu: of the controllers; None: upright and still. Raises
    HardwareError as `devices_of`.
    """
    devices = devices_of(
        servos,
        protocols={bus.name: bus.protocol for bus in buses},
        bauds=None if as_delivered else {bus.name: bus.baud for bus in buses},
        return_delays=None if as_delivered else {bus.name: bus.return_delay_value for bus in buses},
        start=start,
        seed=seed,
        now=now,
        conduct=conduct,
        as_delivered=as_delivered,
    )
    lines: dict[str, Line] = {}
    for bus in buses:
        own = [device for device, servo in zip(devices, servos, strict=True) if servo.bus == bus.name]
        taken = {servo.id for servo in servos if servo.bus == bus.name}
        others: list[Device] = []
        for device in bus.ids:
            if device not in taken:
                switches = bus.power is not None and bus.power.id == device
                on = powered or not switches
                powers = own if switches else ()
                others.append(EmulatedController(powers, id=device, baud=bus.baud, now=now, on=on, imu=imu))
        on_bus = [*own, *others]
        faults = () if plan is None else plan.of_bus(bus.name)
        origin_seed = f"{seed if plan is None else plan.seed} {bus.name}"
        state = FaultState(on_bus, faults=faults, origin=now, seed=origin_seed)
        lines[bus.name] = Line(on_bus, baud=bus.baud, timing=timing, conduct=conduct, faults=state, seed=seed)
    if as_delivered:
        connect(lines, servos, ())
    return lines


def connect(lines: Mapping[str, Line], servos: Sequence[ServoSpec], joints: Collection[str]) -> None:
    """Connect only the servos of these joints, and the devices that are no servos."""
    for name, line in lines.items():
        own = [servo.joint for servo in servos if servo.bus == name]
        chosen = [device for joint, device in zip(own, line.devices, strict=False) if joint in joints]
        line.connected = (*chosen, *line.devices[len(own) :])
