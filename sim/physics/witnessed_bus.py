"""Any bus above a simulated robot, with somebody who watches the robot at each read."""

from dataclasses import replace

from hardware.bus import ServoBus, ServoGoals, ServoStates
from sim.physics.witness import Witness

__all__ = ["WitnessedBus"]


class WitnessedBus:
    """A `hardware.bus.ServoBus` that hands everything on to another. `witness`: has what the report needs."""

    def __init__(self, bus: ServoBus, witness: Witness) -> None:
        self._bus = bus
        self._seen_out = False
        self.witness = witness

    def open(self) -> None:
        """Open the other bus. Raises BusError as it does."""
        self._bus.open()

    def read(self) -> ServoStates:
        """Read it, look at the robot, and feel its soles. Raises BusError as it does."""
        states = self._bus.read()
        self.witness.look()
        return replace(states, soles=self.witness.soles)

    def write(self, goals: ServoGoals) -> None:
        """Write to it. Raises BusError as it does."""
        self._bus.write(goals)

    def torque(self, on: bool) -> None:
        """Switch its torque. Raises BusError as it does."""
        try:
            self._bus.torque(on)
        finally:
            self.witness.switched(on)

    def close(self) -> None:
        """Close it; then the robot is watched for a while, whether it falls. Raises BusError as it does."""
        try:
            self._bus.close()
        finally:
            if not self._seen_out:
                self._seen_out = True
                self.witness.switched(False)
                self.witness.see_it_out()
