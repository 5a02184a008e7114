"""A bus without wires: servos with speed limit, first-order lag and encoder."""

from collections.abc import Sequence

import numpy as np

from hardware.arrays import FloatArray, TickArray
from hardware.bus import ServoGoals, ServoStates, check_open
from hardware.clock import Clock
from hardware.joint_map import JointMap
from hardware.servo import ServoSpec, loop_lag
from retarget.model.robot import RobotBody
from sim.imu import PlantedMotion, sample_of
from sim.servo_model import saturated_lag

VELOCITY_UNIT = 0.229 * 2.0 * np.pi / 60.0  # [rad/s] register step
ALERT_BIT = np.uint8(0x80)  # of the error byte


def mock_bus(robot: RobotBody, clock: Clock, *, start: TickArray | None = None) -> "MockBus":
    """Make the bus of a robot whose servos begin at `start`, ticks (n,); None: in its posture `stand`."""
    if start is None:
        start = robot.joint_map.to_ticks(robot.posture(robot.profile.postures.stand)[robot.servo_columns])
    return MockBus(robot.joint_map.servos, clock, start=start, imu_of=robot)


class MockBus:
    """A `hardware.bus.ServoBus` without wires and without load: with torque off a servo does not move.

    A servo goes to its goal at the speed `clip((goal - position) / lag, -top, top)`, exact over any time: a P gain
    whose drive saturates at the no-load speed. start: ticks (n,). imu_of: the robot whose IMU moves with its link, over
    soles that never leave the floor.
    """

    def __init__(
        self,
        servos: Sequence[ServoSpec],
        clock: Clock,
        *,
        start: TickArray | None = None,
        imu_of: RobotBody | None = None,
    ) -> None:
        count = len(servos)
        self._clock = clock
        self._map = JointMap(servos)
        models = [servo.model for servo in servos]
        self._tick_rad = np.array([model.tick_rad for model in models])  # (n,) [rad]
        self._top = np.array([model.no_load_speed / model.tick_rad for model in models])  # (n,) [tick/s]
        self._lag = np.array([loop_lag(servo) for servo in servos])  # (n,) [s]
        zero = np.array([servo.zero_tick for servo in servos], dtype=np.int64)
        first = zero if start is None else start
        self._position: FloatArray = np.array(first, dtype=np.float64)  # (n,) exact shaft [tick]
        centres = [model.centre_tick for model in models]
        self._goal: FloatArray = np.array(centres, dtype=np.float64)  # (n,) register [tick]
        self._velocity = np.zeros(count)  # (n,) [rad/s]
        self._torque = np.zeros(count, dtype=np.bool_)
        self._time = clock.now()
        self._open, self._motion = False, None
        if imu_of is not None and imu_of.profile.imu is not None:
            self._motion = PlantedMotion(imu_of, lambda: self._map.to_radians(self._position), clock)

    def open(self) -> None:
        """Open the bus; torque is off."""
        self._open = True
        self._time = self._clock.now()

    def read(self) -> ServoStates:
        """Move time on and return the state of the servos. Raises BusError when closed."""
        check_open(self._open, where="mock bus, read")
        self._catch_up()
        return self._registers()

    def write(self, goals: ServoGoals) -> None:
        """Set the goal registers. Raises BusError when closed and on a goal that a servo does not have."""
        check_open(self._open, where="mock bus, write")
        self._catch_up()
        self._map.check_goals(goals.ticks, where="mock bus, write")
        self._goal = goals.ticks.astype(np.float64)

    def limit_drive(self, share: float) -> None:
        """Do nothing: no load needs drive. Raises BusError when closed."""
        check_open(self._open, where="mock bus, limit_drive")

    def torque(self, on: bool) -> None:
        """Switch torque. The goal registers keep their goals. Raises BusError when closed."""
        check_open(self._open, where="mock bus, torque")
        self._catch_up()
        self._torque = np.full(len(self._map), on)

    def close(self) -> None:
        """Switch torque off; no further call but `open`."""
        try:
            if self._open:
                self.torque(False)
        finally:
            self._open = False

    @property
    def torque_on(self) -> bool:
        """True if any servo has torque."""
        return bool(self._torque.any())

    def _catch_up(self) -> None:
        elapsed = self._clock.now() - self._time
        self._time += elapsed
        if elapsed <= 0.0:
            return
        turns = self._torque
        moved, velocity = saturated_lag(self._goal - self._position, lag=self._lag, top=self._top, elapsed=elapsed)
        self._position = self._position + turns * moved
        self._velocity = turns * velocity * self._tick_rad

    def _registers(self) -> ServoStates:
        count = len(self._map)
        return ServoStates(
            time=self._time,
            position=np.rint(self._position).astype(np.int64),
            velocity=np.rint(self._velocity / VELOCITY_UNIT) * VELOCITY_UNIT,
            current=np.full(count, np.nan),
            voltage=np.full(count, np.nan),
            temperature=np.full(count, np.nan),
            error=np.zeros(count, dtype=np.uint8),
            alert=np.zeros(count, dtype=np.uint8),
            age=np.zeros(count),
            valid=np.ones(count, dtype=np.bool_),
            driven=self._torque.copy(),
            imu=None if self._motion is None else sample_of(self._motion(), self._time),
        )
