"""A DynamixelBus above emulated servos on virtual time, with the time that it takes and its notes."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hardware.arrays import FloatArray, TickArray
from hardware.bus import BusSpec, ServoGoals, ServoStates
from hardware.clock import VirtualClock
from hardware.dynamixel.bus import DynamixelBus
from hardware.guard import Guard, Torque
from hardware.joint_map import JointMap
from hardware.servo import ServoCoupling, ServoMode, ServoSpec, find_model
from retarget.safety.gate import Gate
from sim.emulator.conversation import Conduct, Gaps
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Fault
from sim.emulator.line import Line, LineTiming
from sim.emulator.ports import EmulatedPort
from sim.emulator.robot_lines import devices_of
from sim.emulator.servo2 import EmulatedServo

CYCLE = 0.008
"""[s] Of the robot."""


class Cycle(NamedTuple):
    """The states of one read, and how long it took, s."""

    states: ServoStates
    took: float


def spec(number: int, model: str = "XM430-W350", *, bus: str = "main") -> ServoSpec:
    """A servo j<number> with this id."""
    found = find_model(model)
    speed = 0.9 * found.no_load_speed
    return ServoSpec(f"j{number}", number, found, bus, 1, found.centre_tick, -1.5, 1.5, speed, 40.0)


def specs(count: int, model: str = "XM430-W350") -> list[ServoSpec]:
    """Servos j1, j2, ... of one model, ids from 1."""
    return [spec(number, model) for number in range(1, count + 1)]


def bus_of(servos: Sequence[ServoSpec], *, name: str = "main", protocol: int = 2, baud: int = 2_000_000) -> BusSpec:
    """The bus with those servos whose bus has the name."""
    return BusSpec(name, f"/dev/{name}", baud, protocol, tuple(one.id for one in servos if one.bus == name))


class Tapped(EmulatedPort):
    """An emulated port that keeps what was sent, and counts waits; `latency_command`: what would fix its adapter."""

    latency_command = "echo 1 | sudo tee latency_timer"

    def __init__(self, line: Line, clock: VirtualClock, *, name: str) -> None:
        super().__init__(line, clock, name=name)
        self.sent: list[bytes] = []
        self.opened, self.waits = False, 0

    def open(self, baud: int) -> None:
        super().open(baud)
        self.opened = True

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        super().write(data)

    def wait(self, deadline: float) -> bool:
        self.waits += 1
        return super().wait(deadline)

    def close(self) -> None:
        super().close()
        self.opened = False


class BusRig:
    """Servos, lines, ports and the buses above them, by default of one protocol at 1 or 2 Mbps. supply of 12 V; shafts
    begin at `start`, None: their middles."""

    def __init__(
        self,
        servos: Sequence[ServoSpec] | None = None,
        *,
        buses: Sequence[BusSpec] = (),
        protocol: int = 2,
        baud: int | None = None,
        timing: LineTiming | dict[str, LineTiming] | None = None,
        gaps: Gaps = Gaps.SILENCE,
        start: Sequence[int] | None = None,
        unknown_ids: Sequence[ServoSpec] = (),
    ) -> None:
        self.servos = list(specs(20) if servos is None else servos)
        names, speed = dict.fromkeys(one.bus for one in self.servos), baud or protocol * 1_000_000
        self.buses = list(buses) or [bus_of(self.servos, name=one, protocol=protocol, baud=speed) for one in names]
        self.clock = VirtualClock()
        self.notes: list[str] = []
        protocols = {bus.name: bus.protocol for bus in self.buses}
        bauds = {bus.name: bus.baud for bus in self.buses}
        self.devices = list(devices_of(self.servos, protocols=protocols, bauds=bauds, start=start))
        others = devices_of(unknown_ids, protocols=protocols, bauds=bauds)
        self.lines: dict[str, Line] = {}
        for bus in self.buses:
            own = [one for one, servo in zip(self.devices, self.servos, strict=True) if servo.bus == bus.name]
            own += [one for one, servo in zip(others, unknown_ids, strict=True) if servo.bus == bus.name]
            wire = timing.get(bus.name) if isinstance(timing, dict) else timing
            self.lines[bus.name] = Line(own, timing=wire, conduct=Conduct(gaps=gaps), faults=FaultState(own, seed=7))
        self.ports = {name: Tapped(line, self.clock, name=f"emulated {name}") for name, line in self.lines.items()}
        self.bus = self.another()

    def another(self) -> DynamixelBus:
        """A further bus over the same ports."""
        return DynamixelBus(
            JointMap(self.servos), self.buses, lambda bus: self.ports[bus.name], notify=self.notes.append
        )

    @property
    def line(self) -> Line:
        """The only line, or the first."""
        return next(iter(self.lines.values()))

    @property
    def port(self) -> Tapped:
        """The only port, or the first."""
        return next(iter(self.ports.values()))

    def device(self, number: int) -> EmulatedServo:
        """The 2.0 servo with an id."""
        found = next(one for one in self.devices if one.id == number)
        assert isinstance(found, EmulatedServo)
        return found

    def put(self, *ids: int, **values: int) -> None:
        """Registers of these servos, or of all, hold something else."""
        for one in [one for one in self.devices if not ids or one.id in ids]:
            for name, value in values.items():
                one.memory.put(name, value)
            one.tune()

    def fault(self, fault: Fault) -> None:
        """Begin a fault now."""
        self.line.faults.add(fault, self.clock.now())

    def clear_faults(self) -> None:
        """End all faults now."""
        self.line.faults.clear(self.clock.now())

    def shafts(self) -> TickArray:
        """Where the servos really are, (n,) ticks."""
        now = self.clock.now()
        for one in self.devices:
            one.catch_up(now)
        return np.array([round(one.shaft.position) for one in self.devices])

    def shown(self, name: str) -> list[int]:
        """A register of every servo."""
        return [one.memory.value(name) for one in self.devices]

    def images(self) -> list[bytes]:
        """EEPROM of every servo, and what RAM holds before any present value."""
        return [bytes(one.memory.image[: one.table["goal_position"].address + 2]) for one in self.devices]

    def read(self) -> Cycle:
        """One read."""
        begun = self.clock.now()
        states = self.bus.read()
        return Cycle(states, self.clock.now() - begun)

    def tick(self, goals: Sequence[int] | TickArray | None = None) -> Cycle:
        """One cycle of the robot: read, write (None: the reported positions), and wait for the next."""
        begun = self.clock.now()
        cycle = self.read()
        self.bus.write(ServoGoals(cycle.states.position if goals is None else np.asarray(goals)))
        self.clock.sleep_until(begun + CYCLE)
        return cycle

    def ready(self, *, torque: bool = False) -> "BusRig":
        """Opened; with torque: on, holding."""
        self.bus.open()
        states = self.bus.read()
        if torque:
            self.bus.write(ServoGoals(states.position))
            self.bus.torque(True)
        return self


class GuardedBus:
    """A guard and a gate over an open bus."""

    def __init__(self, rig: BusRig) -> None:
        joint_map = JointMap(rig.servos)
        self._clock, self._gate = rig.clock, Gate(joint_map, dt=CYCLE)
        self.guard = Guard(bus=rig.bus, joint_map=joint_map)

    def arm(self) -> FloatArray:
        """Switch torque on. Returns the present posture, rad (n,)."""
        present = self.guard.present()
        self.guard.arm(self._gate.begin(present))
        return present

    def run(self, ticks: int) -> None:
        """So many ticks on the spot, while torque is on."""
        for _ in range(ticks):
            if self.guard.torque is Torque.ON:
                begun = self._clock.now()
                self.guard.check(self.guard.read(), begun, 0.0)
                if self.guard.torque is Torque.ON:
                    assert self.guard.goal is not None
                    self.guard.write(self._gate.brake(self.guard.goal))
                self._clock.sleep_until(begun + CYCLE)


# A bus with a servo of many turns.

TURN = 4096
FAR = 2048 + round(4.5 / math.tau * TURN)
"""Tick of a joint at 4.5 rad, on the second turn of its servo."""


def of_many_turns() -> BusRig:
    """A plain servo and one of many turns that stands on its second."""
    servos = [spec(1), replace(spec(2), mode=ServoMode.EXTENDED_POSITION, lower=3.5, upper=6.0)]
    return BusRig(servos, start=[2048, FAR])


# Small robots for tests: joints with every kind of difference that a servo map must bear.


def four_servos() -> tuple[ServoSpec, ...]:
    """Plain, reversed, geared and AX servos, in that order."""
    x_series = find_model("XM430-W350")
    return (
        ServoSpec("shoulder", 1, x_series, "main", 1, 2048, -1.5, 1.5, 4.0, 40.0),
        ServoSpec("elbow", 2, x_series, "main", -1, 2100, -0.5, 2.0, 4.0, 40.0),
        ServoSpec("waist", 3, x_series, "main", 1, 2048, -0.6, 0.6, 1.5, 10.0, gear=2.0),
        ServoSpec("head", 4, find_model("AX-12A"), "main", -1, 512, -1.0, 1.0, 5.0, 60.0),
    )


def waist_servos() -> tuple[ServoSpec, ...]:
    """A differential waist of many turns between a plain servo and a geared one of many turns."""
    x_series, small = find_model("XM430-W350"), find_model("XC330-T288")
    waist = ServoCoupling(("roll", "yaw"), ((-0.29166667, 0.29166667), (0.20833333, 0.20833333)))
    many = ServoMode.EXTENDED_POSITION
    return (
        ServoSpec("knee", 7, x_series, "main", -1, 2048, -1.0, 1.0, 4.0, 40.0),
        ServoSpec("roll", 2, small, "main", 1, 2000, -0.5236, 0.5236, 1.5, 10.0, mode=many, coupling=waist),
        ServoSpec("yaw", 3, small, "main", -1, 2100, -1.5708, 1.5708, 1.5, 10.0, mode=many, coupling=waist),
        ServoSpec("neck", 0, small, "main", -1, 1500, -2.618, 2.618, 5.0, 40.0, gear=1.1, mode=many),
    )
