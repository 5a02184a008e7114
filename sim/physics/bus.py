"""A simulated robot with mass, behind the interface of every bus."""

import numpy as np

from hardware.arrays import BoolArray, FloatArray
from hardware.bus import ServoGoals, ServoStates
from hardware.clock import Clock
from hardware.errors import BusError, describe
from sim.mock_bus import ALERT_BIT, VELOCITY_UNIT
from sim.physics.fall import Fall, FallWatch
from sim.physics.log import PhysicsLog
from sim.physics.mount import Support
from sim.physics.simulation import Simulation
from sim.physics.state import PhysicsState, StateReader

__all__ = ["AFTERMATH_S", "PhysicsBus"]

AFTERMATH_S = 1.5
"""How long a robot is watched after its torque went off, s: whether it goes down."""


class PhysicsBus:
    """A `hardware.bus.ServoBus`. Each call moves the simulation up to the clock's now, in whole steps.

    Goals take effect `latency` s after they are written: one cycle of the robot, as on a wire. Until torque first goes
    on a hand holds the robot (see `hand`). `state`, `log` and `fall` are what the report needs; a state is taken at
    each read.
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
        self._unit = np.array([servo.model.current_unit or np.nan for servo in servos])
        self._reader = StateReader(simulation)
        self._watch = FallWatch(world.robot) if world.mount.support is Support.FLOOR else None
        self._origin = clock.now()
        self._open = self._powered = False
        self.parked = False
        """Whether the robot was in its rest posture when its torque went off last."""
        self.state: PhysicsState = self._reader.read()
        """As of the last read."""
        self.log = PhysicsLog(
            servos=len(servos), soles=len(world.soles), nq=world.robot.body.nq, loaded=self._reader.loaded
        )

    @property
    def fall(self) -> Fall | None:
        """The first fall; None: it has not fallen, or hangs."""
        return None if self._watch is None else self._watch.fall

    @property
    def fallen(self) -> bool:
        """Whether it has fallen."""
        return self.fall is not None

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
        self._look()
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
        elif self._powered and self._watch is not None:
            self.parked = self._watch.parks(self._reader.read().q)
        self.simulation.switch(wanted)
        self._powered = on

    def close(self) -> None:
        """Torque off; then the robot is watched for AFTERMATH_S, unless it was parked. No further call but `open`."""
        if not self._open:
            return
        self.torque(False)
        self._open = False
        if self._watch is None or not self.simulation.moves:
            return
        cycle = max(self._latency, self.simulation.world.step)
        for _ in range(int(AFTERMATH_S / cycle)):
            self.simulation.advance(self.simulation.time + cycle)
            self._judge(self._reader.read())

    def _look(self) -> None:
        self.state = state = self._reader.read()
        if self.simulation.moves:
            self.log.add(state)
            self._judge(state)

    def _judge(self, state: PhysicsState) -> None:
        """Say whether it has fallen: one that was parked sits, whatever happens without torque."""
        if self._watch is not None and (self._powered or not self.parked):
            self._watch.look(state, powered=self._powered)

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
        current = electrics.current(motors.torque(data), motors.driven)
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
            valid=np.ones(count, dtype=np.bool_),
            driven=motors.driven.copy(),
        )

    def _require_open(self, action: str) -> None:
        if not self._open:
            raise BusError(describe(what="the bus is closed", where=f"physics bus, {action}", then="Call open first"))
