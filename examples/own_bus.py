"""A bus of your own for servos of another make, also for `retarget run --bus own_bus:MyBus` in this folder."""

import numpy as np

from hardware.bus import ServoBus, ServoGoals, ServoStates
from hardware.clock import Clock, VirtualClock
from retarget import RunOptions, measure, open_source
from retarget.model.robot import RobotBody
from retarget.run.prepare import prepare


class MyBus(ServoBus):
    """Put the maker's SDK where these servos are at their goals at once. Arrays (n,), in the profile's order."""

    def __init__(self, robot: RobotBody, clock: Clock) -> None:
        self._clock, self._ticks = clock, robot.joint_map.to_ticks(np.zeros(len(robot.joint_map)))

    def open(self) -> None:  # open the port, and see that all servos answer; torque stays as it is
        self._on = False

    def read(self) -> ServoStates:  # a servo that is silent: valid False, its last values, and their age in s
        zero, unknown, healthy = np.zeros(n := len(self._ticks)), np.full(n, np.nan), np.zeros(n, np.uint8)
        measured = (self._ticks, zero, unknown, unknown, unknown)  # position, velocity, current, voltage, temperature
        return ServoStates(self._clock.now(), *measured, healthy, healthy, zero, np.full(n, True), np.full(n, self._on))

    def write(self, goals: ServoGoals) -> None:  # the guard alone calls it, with what the gate has passed
        self._ticks = goals.ticks if self._on else self._ticks

    def torque(self, on: bool) -> None:  # raise BusError where a servo does not confirm
        self._on = on

    def close(self) -> None:
        self.torque(False)


if __name__ == "__main__":
    options = RunOptions(robot="op3", bus="own_bus:MyBus")
    with prepare(lambda: open_source("sample"), options, clock=VirtualClock(), make_bus=MyBus) as prepared:
        print(f"l_hand is {measure(prepared.run()).tracking_mm['l_hand'].mean:.0f} mm off on average")
