"""Physics below the bytes: the robot's own driver, emulated registers, simulated shafts."""

import numpy as np
import pytest

from hardware.bus import ServoBus, ServoGoals
from hardware.clock import VirtualClock
from hardware.servo import loop_lag
from physics_rig import DT, op3, standing
from sim.buses import physics_wire_bus, simulation_of
from sim.emulator.shaft import Shaft
from sim.physics.bus import SimulatedShafts
from sim.physics.witness import Witness


class WireRig:
    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.start = standing()
        bus = physics_wire_bus(simulation_of(op3(), start=self.start), self.clock)
        self.bus: ServoBus = bus
        self.witness: Witness = bus.witness
        self.bus.open()
        self.bus.write(ServoGoals(self.bus.read().position))
        self.bus.torque(True)
        self.due = self.clock.now()

    def run(self, seconds: float, goal: np.ndarray[tuple[int], np.dtype[np.int64]] | None = None) -> float:
        """Largest error at the end, rad."""
        asked = self.start if goal is None else goal
        for _ in range(round(seconds / DT)):
            self.due += DT
            self.clock.sleep_until(self.due)
            states = self.bus.read()
            self.bus.write(ServoGoals(asked))
        return float(np.abs(op3().joint_map.turned(states.position - asked)).max())


def test_it_stands_through_the_wire_as_without() -> None:
    rig = WireRig()
    error = rig.run(2.0)
    assert rig.witness.fall is None
    assert rig.witness.log.slip_m.max() < 5e-4
    assert error == pytest.approx(0.0245, abs=0.004)  # the sag of the knees, as on the bus without a wire
    assert rig.witness.state.load.sum() == pytest.approx(rig.witness.simulation.world.weight, rel=0.02)


def sag(*, softer: float = 1.0, drive_limit: float = 1.0) -> float:
    """How far the knee of a standing robot hangs back, rad, when its registers say this."""
    simulation, start = simulation_of(op3(), start=standing()), standing()
    specs = op3().joint_map.servos
    tops = [spec.model.no_load_speed / spec.model.tick_rad for spec in specs]
    shafts = [Shaft(float(tick), top) for tick, top in zip(start, tops, strict=True)]
    mechanics = SimulatedShafts(simulation, shafts, begun=10.0)
    for shaft, spec in zip(shafts, specs, strict=True):
        shaft.mechanics, shaft.torque = mechanics, True
        shaft.lag = softer * loop_lag(spec)
        shaft.drive_limit = drive_limit
        shaft.refresh()
    for tick in range(250):
        for shaft in shafts:
            shaft.advance(10.0 + tick * DT)
    knee = [spec.joint for spec in specs].index("l_knee")
    assert shafts[knee].effort() != 0.0
    return abs(shafts[knee].position - float(start[knee])) * specs[knee].model.tick_rad


def test_the_registers_say_how_stiff_and_how_strong_a_servo_is() -> None:
    usual = sag()
    assert usual == pytest.approx(0.0245, abs=0.006)
    assert sag(softer=2.0) == pytest.approx(2.0 * usual, rel=0.25)
    assert sag(drive_limit=0.05) > 5.0 * usual  # 0.2 N m hold no knee
