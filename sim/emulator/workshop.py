"""Builds the emulated servos of a robot's profile."""

import random
from collections.abc import Mapping, Sequence

from hardware.arrays import TickArray
from hardware.dynamixel.baud_codes import code_of
from hardware.dynamixel.control_table import ControlTable, find_table
from hardware.dynamixel.settings import MODES
from hardware.errors import HardwareError, describe
from hardware.servo import ServoModel, ServoSpec
from sim.emulator.body import ServoBuild
from sim.emulator.conduct import Conduct
from sim.emulator.power import Supply
from sim.emulator.servo import EmulatedServo
from sim.emulator.servo1 import EmulatedServo1
from sim.servo_load import AMBIENT

WARMER = 3.0  # [degrees Celsius] most by which a servo is above the room at first


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
    supply: Supply | None = None,
) -> tuple[EmulatedServo | EmulatedServo1, ...]:
    """Return one device per servo, in order, with id, mode and homing offset of the profile, all else as delivered.

    By bus: `protocols` 1 or 2, `bauds` bits/s and `return_delays` register value, where given. start: ticks (n,), None:
    zero ticks. conduct: None: the usual. All share one supply. Raises HardwareError for a model without a table and a
    baud that it lacks.
    """
    chance = random.Random(seed)
    shared, ways = supply or Supply(), conduct or Conduct()
    devices: list[EmulatedServo | EmulatedServo1] = []
    for index, spec in enumerate(specs):
        table = find_table(spec.model.name, protocols[spec.bus])
        position = float(spec.zero_tick if start is None else start[index])
        warmth = AMBIENT + WARMER * chance.random()
        build = ServoBuild(position, now=now, supply=shared, boot_time=ways.boot_time, warmth=warmth)
        device = _built(table, spec.model, build, ways)
        device.memory.put("id", spec.id)
        if bauds is not None and spec.bus in bauds:
            device.memory.put("baud_rate", _code(table, bauds[spec.bus], spec))
        if return_delays is not None and spec.bus in return_delays:
            device.memory.put("return_delay_time", return_delays[spec.bus])
        if table.protocol == 2:
            device.memory.put("operating_mode", MODES[spec.mode])
            device.memory.put("homing_offset", spec.homing_offset)
        device.place(position)
        devices.append(device)
    return tuple(devices)


def _built(table: ControlTable, model: ServoModel, build: ServoBuild, ways: Conduct) -> EmulatedServo | EmulatedServo1:
    if table.protocol == 2:
        return EmulatedServo(table, model, build)
    return EmulatedServo1(table, model, build, torque_by_goal=ways.torque_by_goal)


def _code(table: ControlTable, baud: int, spec: ServoSpec) -> int:
    """The register value of a rate in bits/s."""
    code = code_of(table, baud)
    if code is None:
        raise HardwareError(
            describe(what="the servo does not have this baud rate", where=f"{spec.joint} ({table.model})", found=baud)
        )
    return code
