"""What the taps write into: the cycle that runs, its events, and what the guard made of it."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hardware.guard import Guard
from hardware.guard_state import GuardState, Stop
from retarget.record import Phase, Record
from retarget.recording.boundary import Boundary
from retarget.recording.cycles import Asked, Done
from retarget.recording.events import Event, Events, Level
from retarget.recording.ring import Ring
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["STATES", "Note"]

STATES = {state: place for place, state in enumerate(GuardState)}
"""Numbers of the guard's states."""


class Note:
    """Of one run. ring: None before it begins and after it has ended: nothing is noted. now: s, read last.

    truth: numbers of the truth about a simulated body, (t,); None: nobody knows it.
    """

    def __init__(self, truth: Callable[[], FloatArray | None] = lambda: None) -> None:
        self._truth = truth
        self.ring: Ring | None = None
        self.events = Events()
        self.now = 0.0
        self.rows = 0
        """That the pipeline kept."""
        self._boundary = Boundary(self._turn)
        self._guard: Guard | None = None
        self._stop: Stop | None = None
        self._state: GuardState | None = None
        self._phase: int = -1
        self._dt = 0.0
        self._names: tuple[str, ...] = ()  # of landmarks
        self._landmarks: list[int] = []  # which of them are asked
        self._servos: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._rest: NDArray[np.intp] = np.zeros(0, dtype=np.intp)

    def begin(self, ring: Ring, *, now: float, dt: float, robot: RobotBody | None, guard: Guard | None) -> None:
        """From now on everything is noted."""
        self.now, self._dt, self._guard = now, dt, guard
        if robot is not None:
            self._servos, self._names = robot.servo_columns, tuple(robot.profile.landmarks)
            self._rest = np.setdiff1d(np.arange(robot.body.nq), robot.servo_columns)
        ring.rows.time[ring.at] = now
        self.ring = ring

    def end(self) -> None:
        """The run has ended: finish the last cycle."""
        if self.ring is not None:
            self._turn()
            self.ring = None

    def before(self) -> None:
        """Somebody waits for the next tick, or is asked for a stop."""
        if self.ring is not None:
            self._boundary.before()

    def look(self) -> None:
        """The servos are read: a tick has begun."""
        if self.ring is not None:
            self._boundary.look()
            self.ring.rows.time[self.ring.at] = self.now

    def stop_asked(self, answer: bool, *, stop_before: Stop | None) -> None:
        """Somebody was asked for a stop. stop_before: the guard's, until then."""
        guard, asked = self._guard, Asked.STOP if answer else Asked(0)
        if guard is not None:
            if guard.paused:
                asked |= Asked.PAUSED
            stop = guard.stop_reason
            if stop is not None and stop is not stop_before:
                asked |= Asked.OUTSIDE
                self.say("outside", f"{stop.cause.value}: {stop.reason}", Level.ERROR)
        self._ask(asked)

    def cut_asked(self) -> None:
        """Somebody asked for torque off at once."""
        self._ask(Asked.CUT)

    def over(self) -> None:
        """The stream is at its end."""
        self._ask(Asked.OVER)

    def approach(self) -> None:
        """The robot goes on with its approach."""
        self._ask(Asked.APPROACH)

    def failed(self, who: str, what: str, error: Exception) -> None:
        """The bus failed to read, write or switch torque."""
        ring = self.ring
        if ring is not None:
            done = {"read": ring.rows.read, "write": ring.rows.written}.get(what)
            if done is not None:
                done[ring.at] = Done.FAILED
        self.say(f"{who} {what}", str(error), Level.ERROR)

    def say(self, who: str, text: str, level: Level = Level.INFO) -> None:
        """Something happened."""
        if self.ring is not None:
            self.events.add(Event(self.now, self.ring.index, level, who, text))

    def kept(self, record: Record, row: int) -> None:
        """The pipeline has a row of this tick."""
        ring = self.ring
        if ring is None:
            return
        self.rows += 1
        rows, at, human, robot = ring.rows, ring.at, record.human, record.robot
        rows.kept[at], rows.phase[at] = True, record.phase[row]
        rows.human_q[at], rows.human_joints[at] = human.q[row], human.joints[row]
        own, modes = rows.human_observer_modes[at], human.observer_modes[row]
        own[: modes.size] = modes[: own.size]
        timing, cost = record.timing, rows.cost[at]
        cost[0], cost[1], cost[2] = timing.reconstruct[row], timing.retarget[row], timing.cycle[row]
        if robot is None:
            rows.time[at] = self.now = self.now + self._dt
            self._boundary.look()
            return
        q = robot.q[row]
        rows.q[at], rows.rest[at] = q[self._servos], q[self._rest]
        if not self._landmarks:
            rows.landmarks[:] = np.nan
            self._landmarks = [self._names.index(name) for name in robot.landmark_names]
        rows.landmarks[at, self._landmarks] = robot.landmarks_asked[row]
        own, modes = rows.observer_modes[at], robot.observer_modes[row]
        own[: modes.size] = modes[: own.size]
        rows.gated[at], rows.unled[at] = robot.gated[row], robot.unled[row]
        if rows.truth.shape[1]:
            truth = self._truth()
            rows.truth[at] = np.nan if truth is None else truth
        if record.phase[row] != self._phase:
            self._phase = int(record.phase[row])
            self.say("run", Phase(self._phase).name.lower())

    def _ask(self, asked: Asked) -> None:
        if self.ring is not None:
            self.ring.rows.asked[self.ring.at] |= int(asked)

    def _turn(self) -> None:
        """A cycle is finished: note where the guard is, and go to the next."""
        ring, guard = self.ring, self._guard
        assert ring is not None, "nothing turns before it begins"
        if guard is not None:
            state, stop = guard.state, guard.stop_reason
            ring.rows.state[ring.at] = STATES[state]
            if stop is not self._stop and stop is not None:
                self._stop = stop
                self.say("guard", f"{stop.cause.value}: {stop.reason}", Level.ERROR)
            if state is not self._state:
                self._state = state
                self.say("guard", state.value)
        ring.turn()
