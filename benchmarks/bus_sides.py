"""Sides of the comparison on the bus: a cycle is goals to all servos, then current, velocity, position of all."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler

from hardware.arrays import TickArray
from hardware.bus import BusSpec, ServoGoals
from hardware.clock import MonotonicClock
from hardware.dynamixel.bus import DynamixelBus
from hardware.dynamixel.codec import protocol2
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.cyclic import CyclicPort, ReadKind, Wired
from hardware.dynamixel.readings import Readings
from hardware.dynamixel.serial_port import BytePort, SerialPort
from hardware.joint_map import JointMap
from hardware.servo import ServoSpec, find_model
from sim.emulator.line import Line, LineTiming
from sim.emulator.robot_lines import robot_lines

MODEL = "XM430-W350"
GOAL, GOAL_SIZE = 116, 4
PRESENT, PRESENT_SIZE = 126, 10
TORQUE = 64

CENTRE = 2048
"""Tick at which every servo begins."""


def servo_specs(count: int) -> list[ServoSpec]:
    """`count` servos with ids from 1 on, on one bus."""
    model = find_model(MODEL)
    return [
        ServoSpec(f"joint{device}", device, model, "bench", 1, CENTRE, -3.0, 3.0, 4.0, 40.0)
        for device in range(1, count + 1)
    ]


def bus_spec(count: int, baud: int, port: str = "") -> BusSpec:
    """Their bus, without return delay."""
    return BusSpec("bench", port, baud, 2, tuple(range(1, count + 1)))


def make_line(count: int, baud: int, timing: LineTiming, now: float) -> Line:
    """Their line."""
    lines = robot_lines(
        servo_specs(count), [bus_spec(count, baud)], start=np.full(count, CENTRE), now=now, timing=timing, powered=True
    )
    return lines["bench"]


class BusSide(Protocol):
    """Somebody who can do a cycle."""

    name: str

    def cycle(self, ticks: TickArray) -> int:
        """Send goals (n,), read the state of all servos. Returns how many servos it has values of."""

    def close(self) -> None:
        """Let go of the port."""


class OurPort:
    """`CyclicPort` over a port that is open. plain: by Sync Read, as with servos that know no fast one."""

    def __init__(self, port: BytePort, count: int, *, plain: bool = False) -> None:
        self.name = f"CyclicPort, {'sync' if plain else 'fast sync'} read"
        table = find_table(MODEL, 2)
        self.port = port
        self.cyclic = CyclicPort(port, [Wired(i, i + 1, table) for i in range(count)], return_delay=0.0)
        self.readings = Readings([table] * count)
        port.write(protocol2.sync_write(TORQUE, 1, [(device, b"\x01") for device in range(1, count + 1)]))
        if plain:
            use_plain_reads(self.cyclic)

    def cycle(self, ticks: TickArray) -> int:
        """One cycle."""
        cyclic, readings = self.cyclic, self.readings
        cyclic.write(ticks, readings.driven)
        readings.begin()
        cyclic.begin(wide=False)
        while cyclic.busy:
            cyclic.send()
            cyclic.collect(readings)
        cyclic.end(readings)
        return int(readings.states(self.port.now()).valid.sum())

    def close(self) -> None:
        """Close the port."""
        self.port.close()


def use_plain_reads(cyclic: CyclicPort) -> None:
    """Make the groups of a port ask by Sync Read."""
    for group in cyclic._groups:
        object.__setattr__(group, "kind", ReadKind.SYNC)


class OurBus:
    """`DynamixelBus` as `retarget run` has it: `write`, then `read`, at times of voltage and temperature too."""

    name = "DynamixelBus"

    def __init__(self, path: str, count: int, baud: int) -> None:
        clock = MonotonicClock()
        self.bus = DynamixelBus(
            JointMap(servo_specs(count)), [bus_spec(count, baud, path)], lambda spec: SerialPort(spec.port, clock)
        )
        self.bus.open()
        self.bus.write(ServoGoals(self.bus.read().position))
        self.bus.torque(True)

    def cycle(self, ticks: TickArray) -> int:
        """One cycle."""
        self.bus.write(ServoGoals(ticks))
        return int(self.bus.read().valid.sum())

    def close(self) -> None:
        """Torque off, port closed."""
        self.bus.close()


class SdkGroups:
    """dynamixel-sdk's GroupSyncWrite and GroupSyncRead, and the three values of each servo taken out of the group."""

    def __init__(self, path: str, count: int, baud: int, *, plain: bool = False) -> None:
        self.name = f"dynamixel-sdk, {'sync' if plain else 'fast sync'} read"
        self._ids, self._plain = range(1, count + 1), plain
        self._port = PortHandler(path)
        if not self._port.openPort() or not self._port.setBaudRate(baud):
            raise RuntimeError(f"the SDK cannot open {path} at {baud} baud")
        packets = PacketHandler(2.0)
        self._goals = GroupSyncWrite(self._port, packets, GOAL, GOAL_SIZE)
        self._states = GroupSyncRead(self._port, packets, PRESENT, PRESENT_SIZE)
        for device in self._ids:
            self._goals.addParam(device, list(CENTRE.to_bytes(GOAL_SIZE, "little")))
            self._states.addParam(device)

    def cycle(self, ticks: TickArray) -> int:
        """One cycle."""
        for device, tick in zip(self._ids, ticks.tolist(), strict=True):
            self._goals.changeParam(device, list(tick.to_bytes(GOAL_SIZE, "little", signed=True)))
        self._goals.txPacket()
        try:
            result = self._states.txRxPacket() if self._plain else self._states.fastSyncRead()
        except IndexError:  # the SDK reads beyond the end of a fast answer that is cut short
            return 0
        if result != COMM_SUCCESS:
            return 0
        states = self._states
        taken = [(states.getData(i, 126, 2), states.getData(i, 128, 4), states.getData(i, 132, 4)) for i in self._ids]
        return len(taken)

    def close(self) -> None:
        """Close the port."""
        self._port.closePort()
