"""The robot's half of a tick: follow, gate, guard, bus; and what was sent, kept row by row."""

from contextlib import suppress

import numpy as np

from hardware.bus import ServoStates
from hardware.clock import Clock
from hardware.errors import BusError
from hardware.goal_filter import GoalFilter
from hardware.guard import Guard, Think
from hardware.guard_state import GuardState, StopCause
from retarget.approach import approach
from retarget.human_posture import HumanPosture
from retarget.planted_root import plant_root
from retarget.record import RobotRecord
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.stages import FollowingStage

__all__ = ["GATED_RAD", "RobotSide"]

GATED_RAD = 1e-8
"""A goal that is sent differs from the one asked by more than this, rad, where the filter changed it."""


class RobotSide:
    """A robot that follows. `goals` is the filter that the guard sends everything through: the gate, or none."""

    def __init__(
        self, *, robot: RobotBody, follower: FollowingStage, goals: GoalFilter, guard: Guard, clock: Clock, dt: float
    ) -> None:
        self.robot = robot
        self.guard = guard
        self._follower = follower
        self._goals = goals
        self._clock = clock
        self._dt = dt
        self._deadline = clock.now()
        self._q = robot.body.qpos0.copy()
        self._before = self._q.copy()
        self._asked: FloatArray = np.zeros((0, 3))
        self._goal: FloatArray | None = None
        self._kinematics = robot.body.solver_body()
        self._started = False

    @property
    def following(self) -> bool:
        """Whether the guard still lets the robot follow."""
        return self.guard.state in (GuardState.ARMED, GuardState.MOVING)

    def begin(self, human: HumanPosture) -> tuple[FloatArray, tuple[str, ...]]:
        """Arm, and go slowly to where following begins. Returns that posture, rad (n,), and the landmarks' names.

        Raises GuardError or BusError when the robot cannot be armed.
        """
        posture = self._follower.start(human)
        self._q[:] = self._before[:] = posture.q
        self._asked = posture.landmarks_asked
        present = self.guard.arm()
        speed = self.robot.profile.safety.speed_caps.approach
        self._deadline = self._clock.now()
        for goal in approach(present, posture.joint_positions, self.robot.joint_map, speed=speed, dt=self._dt):
            if not self.following:
                break
            self._tick(_ask(goal))
        return self._goals.position, posture.landmark_names

    def follow(self, human: HumanPosture) -> FloatArray:
        """Think: the goal, rad (n,), for the human's posture. The first time, the posture from which to follow."""
        posture = self._follower.step(human, self._dt) if self._started else self._follower.start(human)
        self._started = True
        self._q[:] = posture.q
        self._asked = posture.landmarks_asked
        self._goal = posture.joint_positions
        return self._goal

    def act(self, think: Think) -> None:
        """One tick of the guard: read the servos, let `think` find a goal, send what the filter makes of it."""
        self._goal = None
        self._tick(think)

    def brake(self) -> None:
        """One tick without a goal: the robot brakes along the last verified trajectory."""
        self.act(_nothing)

    def finish(self) -> None:
        """Come to rest and switch torque off, where the bus still takes it; the guard has latched it if not."""
        self.guard.come_to_rest(self._dt)
        with suppress(BusError):
            self.guard.release()

    def stop(self, reason: str) -> None:
        """Stop because somebody asked for it."""
        self.guard.stop(reason, StopCause.REQUESTED)

    def keep(self, record: RobotRecord, tick: int) -> None:
        """Write what this tick asked and sent into its row; tell the follower where something else was sent."""
        sent = self._goals.position
        passed = self._goal is not None and bool(np.abs(sent - self._goal).max() <= GATED_RAD)  # False for NaN
        self._q[self.robot.servo_columns] = sent
        if not passed:
            plant_root(self.robot, self._before, self._q)
            moved = self._kinematics.difference(self._before, self._q)  # (nv,)
            self._follower.reseed(self._q.copy(), moved / self._dt)
        self._before[:] = self._q
        record.q[tick] = self._q
        record.landmarks_asked[tick] = self._asked
        record.gated[tick] = not passed
        if self.guard.sent is not None:
            record.goal_ticks[tick] = self.guard.sent
        states = self.guard.states
        if states is not None:
            record.present[tick] = self.robot.joint_map.to_radians(states.position)
            record.faults[tick] = np.count_nonzero(~states.valid | (states.alert != 0))

    def _tick(self, think: Think) -> None:
        self._deadline += self._dt
        self._clock.sleep_until(self._deadline)
        self.guard.tick(think)


def _ask(goal: FloatArray) -> Think:
    """A thought that is already finished."""
    return lambda states: goal


def _nothing(states: ServoStates) -> None:
    """No goal."""
