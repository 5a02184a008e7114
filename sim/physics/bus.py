"""A simulated robot with mass, behind the interface of every bus."""

import numpy as np

from hardware.arrays import BoolArray, FloatArray
from hardware.bus import ServoGoals, ServoStates
from hardware.clock import Clock
from hardware.errors import BusError, describe
from sim.mock_bus import ALERT_BIT, VELOCITY_UNIT
from sim.physics.simulation import Simulation
from sim.physics.witness import Witness

__all__ = ["PhysicsBus"]


class PhysicsBus:
    """A `hardware.bus.ServoBus`. Each call moves the simulation up to the clock's now, in whole steps.

    Goals take effect `latency` s after they are written: one cycle of the robot, as on a wire. Until torque first goes
    on a hand holds the robot (see `hand`). `witness` looks at each read, and has what the report needs.
    """

    def __init__(self, simulation: Simulation, clock: Clock, *, latency: float) -> None:
        world = simulation.world
        servos = world.robot.joint_map.servos
        self.simulation = simulation
        self._clock, self._latency = clock, latency
        self._servos = servos
        self._zero = np.array([servo.zero_tick for servo in servos], dtype=np.float64)
        self._tick_rad = np.array([servo.model.tick_rad for servo in servos])
        self._first = np.array([servo.lowest_tick for servo in servos], dtype=np.int64)
        self._last = np.array([servo.highest_tick for servo in servos], dtype=np.int64)
        self._here: BoolArray = np.ones(len(servos), dtype=np.bool_)
        self._unit = np.array([servo.model.current_unit or np.nan for servo in servos])
        self._origin = clock.now()
        self._open = False
        self.witness = Witness(simulation)

    @property
    def torque_on(self) -> bool:
        """Whether any servo has torque."""
        return bool(self.simulation.motors.driven.any())

    def open(self) -> None:
        """Open the bus; torque is off."""
        if not self._open:
            self._open = True
            self._origin = self._clock.now() - self.simulation.time

    def read(self) -> ServoStates:
        """Move time on and return what the servos say. Raises BusError when closed."""
        self._require_open("read")
        self._catch_up()
        self.witness.look()
        return self._registers()

    def write(self, goals: ServoGoals) -> None:
        """Set the goal registers. Raises BusError when closed, and on a goal that a servo does not have."""
        self._require_open("write")
        self._catch_up()
        ticks = goals.ticks
        if ticks.shape != self._last.shape or ((ticks < self._first) | (ticks > self._last)).any():
            allowed = f"{self._first} to {self._last}"
            raise BusError(
                describe(what="goal ticks out of range", where="physics bus, write", found=ticks, allowed=allowed)
            )
        self.simulation.aim((ticks - self._zero) * self._tick_rad, self._now() + self._latency)

    def torque(self, on: bool) -> None:
        """Switch torque; a servo with an alert stays off. It is acknowledged, so goals that are on their way arrive
        first. Raises BusError when closed."""
        self._require_open("torque")
        self._catch_up()
        wanted: BoolArray = np.full(len(self._servos), on)
        if on:
            self.simulation.settle_goals()
        self.simulation.switch(wanted)
        self.witness.switched(on)

    def close(self) -> None:
        """Torque off; then the robot is watched for a while, whether it falls. No further call but `open`."""
        if not self._open:
            return
        self.torque(False)
        self._open = False
        self.witness.see_it_out()

    def _now(self) -> float:
        """Time since the bus was opened, s."""
        return self._clock.now() - self._origin

    def _catch_up(self) -> None:
        self.simulation.advance(self._now())

    def _registers(self) -> ServoStates:
        """What the registers of all servos show now, rounded as they round."""
        simulation = self.simulation
        data, motors, electrics = simulation.data, simulation.motors, simulation.electrics
        count = len(self._servos)
        angle: FloatArray = motors.angle(data)
        current = electrics.current(self.witness.state.torque, motors.driven)  # as of just now
        return ServoStates(
            time=self._clock.now(),
            position=np.rint(self._zero + angle / self._tick_rad).astype(np.int64),
            velocity=np.rint(motors.speed(data) / VELOCITY_UNIT) * VELOCITY_UNIT,
            current=np.rint(current / self._unit) * self._unit,
            voltage=np.rint(10.0 * electrics.voltage) / 10.0,
            temperature=np.rint(electrics.temperature),
            error=ALERT_BIT * (electrics.alert != 0),
            alert=electrics.alert.copy(),
            age=np.zeros(count),
            valid=self._here.copy(),
            driven=motors.driven.copy(),
            soles=self.witness.soles,
        )

    def _require_open(self, action: str) -> None:
        if not self._open:
            raise BusError(describe(what="the bus is closed", where=f"physics bus, {action}", then="Call open first"))
