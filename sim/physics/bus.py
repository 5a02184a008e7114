"""A bus above a simulated robot with mass, and simulated shafts for emulated servos."""

from collections.abc import Mapping, Sequence
from math import inf

import numpy as np

from hardware.arrays import FloatArray
from hardware.bus import ServoGoals, ServoStates, check_open
from hardware.clock import Clock
from hardware.servo import ServoSpec
from sim.emulator.line import Line
from sim.emulator.servo_body import ServoBody
from sim.emulator.shaft import Law, Shaft
from sim.imu import SensedMotion
from sim.mock_bus import ALERT_BIT, VELOCITY_UNIT
from sim.physics.simulation import BATCH_S, Simulation


class PhysicsBus:
    """A `hardware.bus.ServoBus`. Each call moves the simulation up to the time of the clock, in whole steps.

    Goals take effect `latency` s after they are written. Until torque first goes on a hand holds the robot
    (`sim.physics.mount`). imu: read with the servos; None: there is none.
    """

    def __init__(
        self, simulation: Simulation, clock: Clock, *, latency: float, imu: SensedMotion | None = None
    ) -> None:
        world = simulation.world
        servos = world.robot.joint_map.servos
        self.simulation = simulation
        self._clock, self._latency, self._imu = clock, latency, imu
        self._servos = servos
        self._zero = np.array([servo.zero_tick for servo in servos], dtype=np.float64)
        self._tick_rad = np.array([servo.model.tick_rad for servo in servos])
        self._unit = np.array([servo.model.current_unit or np.nan for servo in servos])
        self._origin = clock.now()
        self._open = False

    def open(self) -> None:
        """Open the bus; torque is off."""
        if not self._open:
            self._open = True
            self._origin = self._clock.now() - self.simulation.time

    def read(self) -> ServoStates:
        """Move time on and return the state of the servos. Raises BusError when closed."""
        check_open(self._open, where="physics bus, read")
        self._catch_up()
        return self._registers()

    def write(self, goals: ServoGoals) -> None:
        """Set the goal registers. Raises BusError when closed, and on a goal that a servo does not have."""
        check_open(self._open, where="physics bus, write")
        self._catch_up()
        ticks = goals.ticks
        self.simulation.world.robot.joint_map.check_goals(ticks, where="physics bus, write")
        self.simulation.aim((ticks - self._zero) * self._tick_rad, self._now() + self._latency)

    def limit_drive(self, share: float) -> None:
        """Limit the drive of all servos. Raises BusError when closed."""
        check_open(self._open, where="physics bus, limit_drive")
        self._catch_up()
        self.simulation.motors.tune(limit=np.full(len(self._servos), share))
        self.simulation.switch(self.simulation.motors.driven)

    def torque(self, on: bool) -> None:
        """Switch torque; a servo with an alert stays off. Waiting goals take effect first. Raises BusError when
        closed."""
        check_open(self._open, where="physics bus, torque")
        self._catch_up()
        if on:
            self.simulation.settle_goals()
        self.simulation.switch(np.full(len(self._servos), on))

    def close(self) -> None:
        """Switch torque off. No further call but `open`."""
        if self._open:
            self.torque(False)
        self._open = False

    def _now(self) -> float:
        return self._clock.now() - self._origin

    def _catch_up(self) -> None:
        self.simulation.advance(self._now())

    def _registers(self) -> ServoStates:
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
            imu=None if self._imu is None else self._imu.sample(self._clock.now()),
        )


SAME_TICK = 1e-3
"""Goals closer than this, ticks, are one."""


class SimulatedShafts:
    """A `sim.emulator.shaft.Mechanics` for all shafts (n,) of a robot, in servo order.

    Only position modes have a motor here; in others the shaft is free. A reversed Drive Mode is ignored. begun: time 0
    of the simulation on the line's clock, s.
    """

    def __init__(self, simulation: Simulation, shafts: Sequence[Shaft], *, begun: float) -> None:
        self._simulation, self._shafts, self._begun = simulation, tuple(shafts), begun
        self._row = {id(shaft): row for row, shaft in enumerate(self._shafts)}
        self._tick_rad = np.array([drive.servo.model.tick_rad for drive in simulation.world.drives])
        drives = simulation.world.drives
        self._stall = np.array([drive.numbers.stall_torque(drive.servo.model.voltage) for drive in drives])
        angles = simulation.motors.angle(simulation.data)
        self._seen: FloatArray = angles / self._tick_rad  # (n,) position of each shaft at its last update
        self._sent = self._seen.copy()  # (n,) goals
        self._settings: tuple[tuple[float, float, bool], ...] = ()
        simulation.electrics.trips = False  # the emulated servo protects itself

    def follow(self, shaft: Shaft, now: float) -> tuple[float, float]:
        """Go on to `now` (s); return the position of the shaft, tick, and its velocity, tick/s.

        Only the change of angle is added, since registers may count turns differently (homing offset, one turn).
        """
        simulation, to = self._simulation, now - self._begun
        while to - simulation.time >= simulation.world.step:
            self._take_settings()
            errors = [one.trajectory()[0] - one.position for one in self._shafts]
            goals = self._seen + np.array(errors)
            if np.abs(goals - self._sent).max() > SAME_TICK:
                self._sent = goals
                simulation.aim(goals * self._tick_rad, simulation.time)
            simulation.advance(min(to, simulation.time + BATCH_S))
        row = self._row[id(shaft)]
        angle, speed = simulation.motors.shaft(simulation.data, row)
        tick = angle / float(self._tick_rad[row])
        position = shaft.position + tick - float(self._seen[row])
        self._seen[row] = tick
        return position, speed / float(self._tick_rad[row])

    def effort(self, shaft: Shaft) -> float:
        """The torque of the motor as a share of its stall torque, signed."""
        row = self._row[id(shaft)]
        simulation = self._simulation
        return float(simulation.motors.torque(simulation.data)[row] / self._stall[row])

    def current(self, shaft: Shaft) -> float:
        """The current of the motor, A, signed."""
        simulation = self._simulation
        torque, driven = simulation.motors.torque(simulation.data), simulation.motors.driven
        return float(simulation.electrics.current(torque, driven)[self._row[id(shaft)]])

    def _take_settings(self) -> None:
        settings = tuple(
            (shaft.lag * shaft.full, shaft.drive_limit, shaft.torque and shaft.law is Law.POSITION)
            for shaft in self._shafts
        )
        if settings == self._settings:
            return
        self._settings = settings
        reach, limit, driven = (np.array(column) for column in zip(*settings, strict=True))
        stiff = np.where((reach > 0.0) & (reach < inf), 1.0 / np.maximum(reach * self._tick_rad, 1e-9), 0.0)
        self._simulation.motors.tune(proportional=stiff, limit=limit)
        self._simulation.switch(driven.astype(np.bool_))


def servos_on(lines: Mapping[str, Line], servos: Sequence[ServoSpec]) -> list[ServoBody]:
    """The emulated servos on these lines, in servo order."""
    return [
        next(one for one in lines[servo.bus].devices if isinstance(one, ServoBody) and one.id == servo.id)
        for servo in servos
    ]


def drive_shafts(
    simulation: Simulation, servos: Sequence[ServoSpec], lines: Mapping[str, Line], *, now: float
) -> SimulatedShafts:
    """Let a simulation turn the shafts of the emulated servos on these lines, from `now` on, s."""
    emulated = servos_on(lines, servos)
    shafts = SimulatedShafts(simulation, [one.shaft for one in emulated], begun=now - simulation.time)
    for one in emulated:
        one.shaft.mechanics = shafts
    return shafts
