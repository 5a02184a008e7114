"""Emulated servos whose shafts the simulation turns: registers and bytes from the emulator, motion with mass.

The registers decide as they do without physics: P gain, Goal PWM, torque, profile. Only position modes have a motor
here; in the others the shaft is free. A reversed Drive Mode is not known to it.
"""

from collections.abc import Mapping, Sequence
from math import inf

import numpy as np

from hardware.arrays import FloatArray
from hardware.servo import ServoSpec
from sim.emulator.body import ServoBody
from sim.emulator.line import Line
from sim.emulator.motion import Law, Shaft
from sim.physics.simulation import BATCH_S, Simulation

__all__ = ["SimulatedShafts", "drive_shafts"]

SAME_TICK = 1e-3
"""Goals closer than this, ticks, are one."""


class SimulatedShafts:
    """A `sim.emulator.motion.Mechanics` for all shafts (n,) of a robot, in servo order. `begun`: s on the line's clock
    when the simulation's time is 0."""

    def __init__(self, simulation: Simulation, shafts: Sequence[Shaft], *, begun: float) -> None:
        self._simulation, self._shafts, self._begun = simulation, tuple(shafts), begun
        self._row = {id(shaft): row for row, shaft in enumerate(self._shafts)}
        self._tick_rad = np.array([drive.servo.model.tick_rad for drive in simulation.world.drives])
        stall = [drive.numbers.stall_torque(drive.servo.model.voltage) for drive in simulation.world.drives]
        self._stall = np.array(stall)
        self._seen = self._ticks()  # (n,) where each shaft last heard that it is
        self._told = self._seen.copy()  # (n,) goals
        self._settings: tuple[tuple[float, float, bool], ...] = ()
        simulation.electrics.trips = False  # the emulated servo protects itself

    def follow(self, shaft: Shaft, now: float) -> tuple[float, float]:
        """Go on to `now` (s); return the position of the shaft, tick, and its velocity, tick/s.

        Whatever counts the shaft's turns anew (homing offset, one turn) keeps doing so: what is added is how far it
        turned.
        """
        self._advance(now - self._begun)
        row = self._row[id(shaft)]
        angle, speed = self._simulation.motors.shaft(self._simulation.data, row)
        tick = angle / float(self._tick_rad[row])
        position = shaft.position + tick - float(self._seen[row])
        self._seen[row] = tick
        return position, speed / float(self._tick_rad[row])

    def effort(self, shaft: Shaft) -> float:
        """Return the torque of the motor as a share of its stall torque, signed."""
        row = self._row[id(shaft)]
        simulation = self._simulation
        return float(simulation.motors.torque(simulation.data)[row] / self._stall[row])

    def _advance(self, to: float) -> None:
        simulation = self._simulation
        while to - simulation.time >= simulation.world.step:
            self._take_settings()
            self._take_goals()
            simulation.advance(min(to, simulation.time + BATCH_S))

    def _take_settings(self) -> None:
        """Torque, gain and limit of drive, as the registers have them."""
        settings = tuple((shaft.lag * shaft.full, shaft.drive_limit, _driven(shaft)) for shaft in self._shafts)
        if settings == self._settings:
            return
        self._settings = settings
        reach, limit, driven = (np.array(column) for column in zip(*settings, strict=True))
        stiff = np.where((reach > 0.0) & (reach < inf), 1.0 / np.maximum(reach * self._tick_rad, 1e-9), 0.0)
        self._simulation.motors.tune(proportional=stiff, limit=limit)
        self._simulation.switch(driven.astype(np.bool_))

    def _take_goals(self) -> None:
        simulation = self._simulation
        errors = [shaft.trajectory()[0] - shaft.position for shaft in self._shafts]
        goals = self._seen + np.array(errors)
        if np.abs(goals - self._told).max() > SAME_TICK:
            self._told = goals
            simulation.aim(goals * self._tick_rad, simulation.time)

    def _ticks(self) -> FloatArray:
        return np.asarray(self._simulation.motors.angle(self._simulation.data) / self._tick_rad)


def drive_shafts(
    simulation: Simulation, servos: Sequence[ServoSpec], lines: Mapping[str, Line], *, now: float
) -> SimulatedShafts:
    """Let a simulation turn the shafts of the emulated servos on these lines, from `now` on, s."""
    emulated = [
        next(one for one in lines[servo.bus].devices if isinstance(one, ServoBody) and one.id == servo.id)
        for servo in servos
    ]
    shafts = SimulatedShafts(simulation, [one.shaft for one in emulated], begun=now - simulation.time)
    for one in emulated:
        one.shaft.mechanics = shafts
    return shafts


def _driven(shaft: Shaft) -> bool:
    return shaft.torque and shaft.law is Law.POSITION
