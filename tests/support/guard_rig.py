"""A guard on a mock bus, on virtual time, with everything that it wrote recorded."""

from collections.abc import Callable

import numpy as np

from bus_rig import four_servos
from faulty_bus import FaultKind, FaultyBus, MockFault
from hardware.arrays import FloatArray
from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from hardware.guard import CheckedGoal, Guard, Torque
from hardware.guard_state import GuardLimits, Stop, StopCause
from hardware.joint_map import JointMap
from retarget.safety.gate import Gate

MAP = JointMap(four_servos())
DT = 0.01
START = np.array([2148, 2000, 2048, 500])


class Recorder(FaultyBus):
    """A mock bus that keeps the order of what was asked of it."""

    def __init__(self, clock: VirtualClock, faults: tuple[MockFault, ...]) -> None:
        super().__init__(MAP.servos, clock, start=START, faults=faults)
        self.calls: list[str] = []
        self.drives: list[float] = []
        self.goals: list[FloatArray] = []

    def write(self, goals: ServoGoals) -> None:
        self.calls.append("write")
        super().write(goals)
        self.goals.append(MAP.to_radians(goals.ticks))

    def limit_drive(self, share: float) -> None:
        super().limit_drive(share)
        self.drives.append(share)

    def torque(self, on: bool) -> None:
        self.calls.append("torque on" if on else "torque off")
        super().torque(on)


class Rig:
    """A guard and a gate with everything around them, on virtual time."""

    def __init__(self, *faults: MockFault, limits: GuardLimits | None = None) -> None:
        self.clock = VirtualClock()
        self.bus = Recorder(self.clock, faults)
        self.gate = Gate(MAP, dt=DT)
        self.guard = Guard(bus=self.bus, joint_map=MAP, limits=limits)
        self.bus.open()

    def arm(self) -> FloatArray:
        """Switch torque on. Returns the present posture, rad (4,)."""
        present = self.guard.present()
        self.guard.arm(self.gate.begin(present))
        return present

    def run(self, ticks: int, next_goal: Callable[[], CheckedGoal] | None = None) -> None:
        """So many ticks, by default towards a goal for the first joint, always faster; braking once a stop is latched,
        nothing once torque is off."""
        for _ in range(ticks):
            if self.guard.torque is Torque.ON:
                self.clock.advance(DT)
                self.read()
            if self.guard.torque is Torque.ON:
                self.guard.write(self.brake() if self.guard.stop else (next_goal or self.faster)())

    def read(self) -> None:
        """Read the servos and check them, at the beginning of a tick."""
        self.guard.check(self.guard.read(), self.clock.now(), self.clock.idle())

    def stopped(self) -> Stop | None:
        """The latched stop, as it is now."""
        return self.guard.stop

    def cause(self) -> StopCause | None:
        """Of the latched stop."""
        return None if self.guard.stop is None else self.guard.stop.cause

    def reason(self) -> str:
        """Of the latched stop; there must be one."""
        assert self.guard.stop is not None
        return self.guard.stop.reason

    def stand(self) -> CheckedGoal:
        """The goal of a robot that stands where it was sent."""
        assert self.guard.goal is not None
        return self.gate.check(self.guard.goal, self.guard.goal.posture) or self.brake()

    def brake(self) -> CheckedGoal:
        """The next goal of a robot that brakes."""
        assert self.guard.goal is not None
        return self.gate.brake(self.guard.goal)

    def faster(self) -> CheckedGoal:
        """The next goal of the first joint, a little faster than the last."""
        last = self.guard.goal
        assert last is not None
        speed = np.minimum(np.abs(last.displacement / DT) + MAP.max_acceleration * DT, 2.0)
        return self.gate.check(last, last.joints + speed * DT * [-1, 0, 0, 0]) or self.brake()

    def check_goals(self) -> None:
        """Assert that what was written keeps speed and acceleration, but for the rounding to ticks."""
        goals = np.array(self.bus.goals)
        steps = np.diff(goals, axis=0)
        tick = np.abs(1.0 / np.array([servo.ticks_per_rad for servo in MAP.servos]))
        assert np.all(np.abs(steps) <= MAP.max_velocity * DT + tick)
        assert np.all(np.abs(np.diff(steps, axis=0)) <= MAP.max_acceleration * DT**2 + 2 * tick)


def moving(*faults: MockFault, limits: GuardLimits | None = None, ticks: int = 19) -> Rig:
    """A robot whose first joint moves since so many ticks."""
    rig = Rig(*faults, limits=limits)
    rig.arm()
    rig.run(ticks)
    return rig


def silent(*servos: int, first: int = 20, cycles: int = 1000) -> list[MockFault]:
    """These servos do not answer."""
    return [MockFault(FaultKind.MISSING, first, cycles, servo=servo) for servo in servos]
