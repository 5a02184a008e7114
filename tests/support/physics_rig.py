"""A simulated OP3 for tests."""

import numpy as np

from followers import op3 as op3
from hardware.arrays import TickArray
from hardware.bus import ServoGoals, ServoStates
from hardware.clock import VirtualClock
from retarget.schema.scene import Scene
from sim.buses import physics_bus, simulation_of
from sim.physics.mount import Mount
from sim.physics.perturbation import Perturbation

DT = 0.008


def ticks(posture: dict[str, float]) -> TickArray:
    robot = op3()
    return robot.joint_map.to_ticks(robot.posture(posture)[robot.servo_columns])


def standing() -> TickArray:
    return ticks(op3().profile.postures.stand)


class PhysicsRig:
    """A bus that is open, without torque, beginning in posture `stand` or at `start` ticks (n,)."""

    def __init__(
        self,
        *,
        start: TickArray | None = None,
        mount: Mount | None = None,
        perturbation: Perturbation | None = None,
        scene: Scene | None = None,
        seed: int = 0,
    ) -> None:
        self.clock = VirtualClock()
        self.start = standing() if start is None else start
        simulation = simulation_of(
            op3(), start=self.start, mount=mount, perturbation=perturbation, scene=scene, seed=seed
        )
        self.bus = physics_bus(simulation, self.clock)
        self.bus.open()

    def arm(self) -> None:
        """As the guard does: goal to present, then torque."""
        self.bus.write(ServoGoals(self.bus.read().position))
        self.bus.torque(True)

    def run(self, seconds: float, goal: TickArray | None = None) -> ServoStates:
        """Ticks that ask for `goal` (n,), the start by default."""
        states = self.bus.read()
        for _ in range(round(seconds / DT)):
            self.clock.advance(DT)
            states = self.bus.read()
            self.bus.write(ServoGoals(self.start if goal is None else goal))
        return states

    def error(self, states: ServoStates, goal: TickArray | None = None) -> float:
        """Largest distance of a joint from its goal, rad."""
        turned = op3().joint_map.turned(states.position - (self.start if goal is None else goal))
        return float(np.abs(turned).max())
