"""The robot's half of a tick: follow, gate, guard, bus; and its rows of the record."""

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from hardware.bus import ServoStates
from hardware.clock import Clock
from hardware.errors import TorqueError
from hardware.guard import FOLLOWING, FindGoal, Guard
from hardware.guard_state import GoalFilter, GuardState, StopCause
from retarget.ik.base_pose import plant_root
from retarget.model.robot import RobotBody
from retarget.run.record import Phase, RobotRecord
from retarget.run.rest_trajectory import RestTrajectory
from retarget.run.stages import FollowingStage
from retarget.run.trajectory import (
    SpeedOverrideTrajectory,
    SpeedShare,
    approach_trajectory,
    require_finite,
    slower_in_line,
)
from retarget.safety.clearance import PathClearance
from retarget.types import FloatArray, HumanPosture, ModeArray, Notify, RobotPosture

FORCED_STOP = "torque off before the robot stood, forced by the user"
GATED_RAD = 1e-8
"""The filter changed a goal if the one sent differs from the one asked by more than this, rad."""


class RobotSide:
    """A robot that follows. goals: the filter through which the guard sends every goal.

    clearance: the gate's collision check, which this class keeps up to date. passes: whether the gate would pass a
    goal; where it would not, the follower halts the whole robot on its soles, before the gate brakes each joint on its
    own. goes_to_rest: a stop ends in the profile's rest posture, else where the robot has braked. notify: receives
    warnings about servos, a sentence each.
    """

    def __init__(
        self,
        *,
        robot: RobotBody,
        follower: FollowingStage,
        goals: GoalFilter,
        guard: Guard,
        clock: Clock,
        dt: float,
        clearance: PathClearance | None = None,
        passes: Callable[[FloatArray], bool] | None = None,
        goes_to_rest: bool = False,
        notify: Notify = lambda text: None,
    ) -> None:
        self.robot, self.guard = robot, guard
        self.phase = Phase.APPROACH
        """The purpose of the last tick."""
        self._follower, self._goals = follower, goals
        self._clearance, self._passes = clearance, passes
        self._clock, self._dt = clock, dt
        self._deadline, self._awake = clock.now(), False
        self._kinematics = robot.body.solver_body()
        self._share = SpeedShare(robot, dt=dt)
        self._change = robot.joint_map.max_acceleration * dt**2  # (n,) [rad]
        self._q = robot.body.qpos0.copy()
        self._before = self._q.copy()
        self._velocity = np.zeros(robot.body.nv)  # at `_before`
        self._start = self._sent = self._moved = np.zeros(0)
        self._first: RobotPosture
        self._trajectory: SpeedOverrideTrajectory
        self._started = False
        # Of the current tick: what is asked, whether its root is known, and whether exactly that was sent.
        self._goal: FloatArray | None = None
        self._asked: FloatArray | None = None
        self._modes: ModeArray = np.zeros(0, dtype=np.uint8)
        self._rooted = self._passed = False
        self._lost = 0  # ticks in a row in which no posture was found
        self._goes_to_rest, self._notify = goes_to_rest, notify
        self._rest_trajectory = RestTrajectory(robot, follower, dt=dt, notify=notify)

    @property
    def stopping_ticks(self) -> int:
        """Most ticks from the beginning of a stop to its end."""
        limits = self.guard.limits
        return limits.max_brake_ticks + (limits.max_brake_ticks + limits.max_rest_ticks if self._goes_to_rest else 0)

    @property
    def following(self) -> bool:
        """Whether the guard still lets the robot follow."""
        return self.guard.state in FOLLOWING

    @property
    def braking(self) -> bool:
        """Whether the robot is stopping."""
        return self.guard.state is GuardState.STOPPING

    @property
    def approaching(self) -> bool:
        """Whether the robot is still approaching the posture from which to follow."""
        return not (self._started or self._trajectory.done)

    def begin(self, human: HumanPosture) -> int:
        """Arm. Returns the least number of ticks of `approach` to the posture from which to follow.

        Raises GuardError or BusError when the robot cannot be armed, RetargetError where that posture is not known.
        """
        posture = self._follower.start(human)
        path = self._follower.settle(human, self._dt)
        require_finite(posture, *path)
        if path:
            # Following begins at rest there, for a tick.
            self._first = path[-1]
            self._follower.reseed(self._first.q, np.zeros(self.robot.body.nv))
        else:
            self._first = posture
        self._q[:] = self._before[:] = posture.q
        self._start = self._sent = present = self.guard.arm()
        self._moved = np.zeros_like(present)
        if self._clearance is not None:
            self._clearance.begin(self._before, present)
        self._deadline = self._clock.now()
        self._trajectory = approach_trajectory(
            self.robot, present, [one.joint_positions for one in (posture, *path)], dt=self._dt
        )
        return self._trajectory.ticks

    def new_record(self, rows: int) -> RobotRecord:
        """Room for so many ticks of this run, after `begin`."""
        names = self._first.landmark_names
        modes = self._first.observer_modes.size
        nq = self.robot.body.nq
        return RobotRecord.empty(rows, nq=nq, start=self._start, landmark_names=names, observers=modes)

    def follow(self, human: HumanPosture, *, settled: float = 1.0) -> FloatArray | None:
        """The goal, rad (n,), for the human's posture; in the first tick, the posture from which to follow. settled:
        how much of its speed the robot may use beyond that of the approach, 0 to 1."""
        self._follower.set_speed_override(min(self.guard.health.speed_override, self._share.speed_override(settled)))
        posture = self._follower.step(human, self._dt) if self._started else self._first
        self.phase = Phase.FOLLOW
        self._lost = 0 if np.isfinite(posture.q).all() else self._lost + 1
        if self._lost > 1:  # a single one is left to the gate, which refuses it
            self._follower.reseed(self._before.copy(), self._velocity.copy())
            return None
        self._asked, self._modes = posture.landmarks_asked, posture.observer_modes
        may_yield, self._started = self._started, True
        if not may_yield:  # it is at rest there
            self._before[:] = posture.q
        wanted, moved = posture.q, self._share.limited(self._before, posture.q, self._moved, settled=settled)
        if moved is not None:
            wanted = self._kinematics.integrate(self._before, moved)
            self._follower.reseed(wanted.copy(), moved / self._dt)
        goal = wanted[self.robot.servo_columns]
        if may_yield and self._passes is not None and not self._passes(goal):
            self._follower.reseed(self._before.copy(), self._velocity.copy())
            q = self._follower.halt(self._dt)
            if q is not None:
                return self._take(q)
        return self._take(wanted)

    def wait(self) -> None:
        """Wait until the next tick is due; a late tick is not made up for."""
        if not self._awake:
            self._deadline = max(self._deadline + self._dt, self._clock.now())
            self._clock.sleep_until(self._deadline)
        self._awake = True

    def approach(self) -> FloatArray | None:
        """The next goal, rad (n,), of the approach trajectory; None while the operator pauses the robot, and until it
        has braked after that."""
        if self.guard.paused or (self._trajectory.left and not self._goals.at_rest):
            return None
        self.phase = Phase.APPROACH
        self._goal = self._trajectory.next(self.guard.health.speed_override, here=self._sent)
        return self._goal

    def act(self, find_goal: FindGoal) -> bool:
        """One tick of the guard, when it is due: read the servos, call `find_goal`, send its goal through the filter.
        Returns whether anything was sent."""
        self.wait()
        self._awake = False
        self._goal, self._asked, self._rooted = None, None, False
        before = self.guard.sent

        def measured(states: ServoStates) -> FloatArray | None:
            self._measure()
            return find_goal(states)

        self.guard.tick(measured, self._halt)
        with suppress(OSError):  # a lost terminal must not keep the robot from a stop
            for text in self.guard.health.warnings.take_news():
                self._notify(text)
        sent = self.guard.sent is not before
        if sent:
            self._after_sending()
        return sent

    def stop(self, reason: str) -> None:
        """Stop as requested."""
        self.guard.stop(reason, StopCause.REQUESTED)

    def force_stop(self, asked: Callable[[], bool]) -> bool:
        """Switch torque off without braking if that is `asked` for. Returns whether it was."""
        forced_stop = asked()
        if forced_stop:
            self.guard.force_torque_off(FORCED_STOP)
        return forced_stop

    def finish(self, torque_off_asked: Callable[[], bool] = lambda: False) -> None:
        """Stop and switch torque off, also after a failure or an interrupt, which the guard has latched."""
        try:
            self.guard.rest()
            while self.braking and not self.force_stop(torque_off_asked):
                self.act(lambda states: None)
        finally:
            with suppress(Exception):
                self.guard.release()

    def give_up(self, error: BaseException, torque_off_asked: Callable[[], bool]) -> None:
        """Stop and switch torque off because of an `error` outside of a tick, which the caller raises again.

        Raises TorqueError from it where torque could not be switched off.
        """
        if self.guard.state is not GuardState.IDLE:
            self.stop(str(error) or type(error).__name__)
            self.finish(torque_off_asked)
        stop = self.guard.stop_reason
        if stop is not None and stop.powered:
            raise TorqueError(stop.reason) from error

    def keep(self, record: RobotRecord, row: int) -> None:
        """Write what was asked and sent in this tick into its row."""
        record.q[row] = self._q
        followed = self.phase is Phase.FOLLOW and self._asked is not None
        record.landmarks_asked[row] = self._asked if followed else np.nan
        if followed:
            record.observer_modes[row] = self._modes
        record.gated[row] = self._goal is not None and not self._passed
        record.no_command[row] = self._goal is None
        states = self.guard.states
        assert self.guard.sent is not None and states is not None, "only what was sent is kept"
        record.goals[row], record.goal_ticks[row] = self._goals.sent, self.guard.sent
        record.keep_servos(row, states, self.robot.joint_map)

    def _after_sending(self) -> None:
        """Keep the posture that was sent; reseed the follower where it differs from what was asked."""
        sent, goal = self._goals.position, self._goal
        self._moved, self._sent = sent - self._sent, sent
        self._passed = goal is not None and np.count_nonzero(np.abs(sent - goal) <= GATED_RAD) == sent.size  # not NaN
        self._q[self.robot.servo_columns] = sent
        if not (self._passed and self._rooted):
            plant_root(self.robot, self._before, self._q)
        if (self._started or self._rest_trajectory.returns_to_stance) and not self._passed:
            moved = self._kinematics.difference(self._before, self._q)  # (nv,)
            self._follower.reseed(self._q.copy(), moved / self._dt)
        if self.phase is not Phase.APPROACH:  # until then, `_before` is where the robot will stand
            self._velocity = self._kinematics.difference(self._before, self._q) / self._dt
            self._before[:] = self._q
        if self._clearance is not None:
            self._clearance.sent(sent, self._before)

    def _measure(self) -> None:
        """Pass the present positions to the gate's collision check, and the soles' contact state to the follower."""
        states = self.guard.states
        self._follower.set_contact_state(None if states is None else states.soles)
        if self._clearance is not None and states is not None:
            self._clearance.measure(self.robot.joint_map.to_radians(states.position))

    def _halt(self) -> FloatArray | None:
        """The next goal, rad (n,), while stopping: a stop on the soles, or in the line of the approach; then the move
        to rest. None: brake each joint on its own."""
        self.phase = Phase.BRAKE
        self._measure()
        if self._goals.at_rest or self._rest_trajectory.begun:
            if self._goes_to_rest and self.guard.state is GuardState.STOPPING and self.guard.may_go_to_rest:
                return self._next_to_rest()
            if self._goals.at_rest or not self._rest_trajectory.returns_to_stance:
                return None
        if self._goal is not None:  # found in this tick and not sent: it lies on a trajectory as well
            return self._goal
        if not (self._started or self._rest_trajectory.returns_to_stance):
            self._trajectory.leave()
            self._goal = self._sent + slower_in_line(self._moved, self._change)
            return self._goal
        q = self._follower.halt(self._dt)
        return None if q is None else self._take(q)

    def _next_to_rest(self) -> FloatArray | None:
        """The next goal of the move to rest; None: the robot is at rest, or cannot go on."""
        # On the straight first part of the approach the robot goes to rest in a straight line too, without a stance.
        returns_to_stance = self._started or not self._trajectory.straight
        q = self._rest_trajectory.next(
            self._q,
            passed=self._passed,
            stands=self._goals.at_rest,
            returns_to_stance=returns_to_stance,
            speed_override=self.guard.health.speed_override,
        )
        return None if q is None else self._take(q)

    def _take(self, q: FloatArray) -> FloatArray:
        """Keep posture (nq,) as what is asked in this tick. Returns its servo joints, rad (n,)."""
        self._q[:], self._rooted = q, True
        self._goal = goal = q[self.robot.servo_columns]
        return goal
