"""A run in a thread of its own, for programs with another loop: they leave targets and copy readings."""

import atexit
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, replace

from hardware.bus import ServoStates
from hardware.clock import Clock
from hardware.errors import GuardError, RetargetError
from hardware.guard import Torque
from retarget.run.loop import Operator, RunObserver, Tick
from retarget.run.prepare import Prepared
from retarget.run.supervisor import LONGEST_STOP_S, OperatorInput
from retarget.run.tick import Machine
from retarget.types import FloatArray, Notify, RunState

JOIN_S = LONGEST_STOP_S + 5.0
"""Longest wait, s, for the stop of a run and the close of its bus."""
FORCED_S = 2.0
"""Longest wait, s, after a request for torque off."""
WAKE_S = 0.1
"""Longest time, s, until the waiting main thread notices Ctrl-C."""
SWITCH_S = 5e-4
"""Time, s, after which Python interrupts another thread for a tick. The usual 5 ms are more than half a tick."""
DISCONNECTED = "disconnected"
HOLD_IT = "the robot stands, torque is on: support it, then press Ctrl-C to switch torque off"
CUT_POWER = "torque may be on: support the robot and cut its power"
Begins = Callable[[], bool]
"""True once the robot may be armed. Called in every tick before."""


@dataclass(frozen=True, eq=False)
class Reading:
    """The robot at one tick.

    present, goal (n,): rad, servo order, as read and as sent, without deflection compensation. time: s. reason: why it
    holds or has stopped.
    """

    present: FloatArray
    goal: FloatArray
    time: float
    state: RunState = RunState.ARMING
    reason: str = ""


class StopRequested(Operator):
    """Adds the stop request of another thread to an operator. why: "" for none; torque_off: at once."""

    def __init__(self) -> None:
        self.why, self.torque_off, self.other = "", False, Operator()

    def poll(self, state: RunState | None) -> OperatorInput:
        """The present requests; see `Operator.poll`."""
        return self._with(self.other.poll(state))

    def requested(self) -> OperatorInput:
        """The requests so far."""
        return self._with(self.other.requested())

    def _with(self, found: OperatorInput) -> OperatorInput:
        return replace(found, stop=found.stop or self.why or None, torque_off=found.torque_off or self.torque_off)


class BackgroundRun(RunObserver):
    """One run of one robot: `start`, read `reading`, and `end` it.

    The robot has no torque until `begins` returns True. error: why the run did not start or has failed, or None.
    """

    def __init__(
        self,
        prepared: Callable[[], AbstractContextManager[Prepared]],
        *,
        operator: Callable[[Prepared], Operator],
        begins: Begins,
        clock: Clock,
        notify: Notify,
    ) -> None:
        """prepared: the run, with its bus open; entered and left in the thread."""
        self._prepared, self._operator, self._begins = prepared, operator, begins
        self._clock, self._notify = clock, notify
        self._reading: Reading | None = None
        self._stop = StopRequested()
        self._ready, self._over = threading.Event(), threading.Event()
        self._machine: Machine | None = None
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="retarget", daemon=True)

    @property
    def reading(self) -> Reading:
        """The newest reading, after `start`."""
        assert self._reading is not None, "the run has started"
        return self._reading

    @property
    def began(self) -> bool:
        """True if there is a reading."""
        return self._reading is not None

    @property
    def over(self) -> bool:
        """True if the run has ended."""
        return self._over.is_set()

    def start(self) -> None:
        """Start the thread and wait for the first reading. Raises the error of a run that does not start."""
        sys.setswitchinterval(min(sys.getswitchinterval(), SWITCH_S))
        self._thread.start()
        while not self._ready.wait(WAKE_S):
            pass
        if self.error is not None:
            raise self.error

    def refuse_ended(self) -> None:
        """Raise KeyboardInterrupt if `end` was called, for waits before the run begins."""
        if self._stop.why:
            raise KeyboardInterrupt

    def end(self, why: str) -> bool:
        """Brake, go to rest, switch torque off, and wait for `JOIN_S` s at most. True if the thread has ended. Raises
        nothing. Ctrl-C while it waits switches torque off at once."""
        self._stop.why = self._stop.why or why
        deadline, ended, interrupted, notified = self._clock.now() + JOIN_S, False, False, False
        while True:
            try:
                if interrupted:
                    interrupted, self._stop.torque_off = False, True
                    deadline = min(deadline, self._clock.now() + FORCED_S)
                ended = not self._thread.is_alive()
                if ended or self._clock.now() >= deadline:
                    machine = self._machine
                    if not ended or (machine is not None and machine.guard.torque is not Torque.OFF):
                        self._notify_safely(CUT_POWER)
                    return ended
                self._thread.join(WAKE_S)
                if self._stands and not notified:
                    notified = True
                    self._notify_safely(HOLD_IT)
            except KeyboardInterrupt:
                interrupted = True

    @property
    def _stands(self) -> bool:
        return self._machine is not None and self._machine.supervisor.state is RunState.STANDING

    def _notify_safely(self, text: str) -> None:
        with suppress(Exception):  # a terminal that is gone
            self._notify(text)

    # In the thread of the run.

    def _run(self) -> None:
        try:
            with self._prepared() as prepared:
                self._perform(prepared)
        except Exception as error:  # noqa: BLE001 - the thread that waits for the run, or uses it, raises it
            self.error = error
        except KeyboardInterrupt:
            self.error = RetargetError("interrupted before the robot was ready")
        finally:
            self._over.set()
            self._ready.set()

    def _perform(self, prepared: Prepared) -> None:
        machine = prepared.machine
        assert machine is not None, "a robot has servos"
        self._machine, self._stop.other = machine, self._operator(prepared)
        loop, due = prepared.loop(self._stop, (self,)), self._clock.now()
        machine.guard.health.refuse_unhealthy(self._read(machine))
        self._ready.set()
        while not self._begins():
            if self._stop.poll(None).stop is not None:
                return
            due = max(due + machine.dt, self._clock.now())
            self._clock.sleep_until(due)
            prepared.samples.poll()
            self._read(machine)
        ending = loop.run(nullcontext)  # other threads of this program make cycles
        if ending.reason is not None and not self._stop.why:
            self.error = RetargetError(ending.reason)
            self._notify_safely(f"stopped: {ending.reason}")

    def _read(self, machine: Machine) -> ServoStates:
        states = machine.guard.read()
        present = machine.robot.joint_map.to_radians(states.position)
        self._reading = Reading(present, present, self._clock.now())
        return states

    def see(self, tick: Tick) -> None:
        """Keep the reading of a tick."""
        machine, states, before = self._machine, tick.given.servos, self.reading
        assert machine is not None, "a run has a machine"
        present = before.present if states is None else machine.robot.joint_map.to_radians(states.position)
        goal, stop, supervisor = machine.guard.goal, machine.guard.stop, machine.supervisor
        held = supervisor.hold_reason if supervisor.state is RunState.HOLD else ""
        reason = held if stop is None else stop.reason
        posture = before.goal if goal is None else goal.posture
        self._reading = Reading(present, posture, self._clock.now(), supervisor.state, reason)


class Connection:
    """The run of a device from `connect` to `disconnect`, or to the end of the program.

    A run whose thread does not end stays its run, so that its bus never has a second one. close: called after the run.
    """

    def __init__(self, name: str, close: Callable[[], object] = lambda: None) -> None:
        self._name, self._close = name, close
        self._run: BackgroundRun | None = None

    @property
    def is_connected(self) -> bool:
        """True if there are readings, also of a run that has ended, until `close`."""
        return self._run is not None and self._run.began

    @property
    def state(self) -> RunState:
        """The state of the run; OFF without one."""
        run = self._run
        return RunState.OFF if run is None or run.over or not run.began else run.reading.state

    def run(self, what: str) -> BackgroundRun:
        """The run. what: the call, for the message. Raises GuardError without a run."""
        if self._run is None or not self._run.began:
            raise GuardError(f"the {self._name} is not connected", where=what, then="Call connect() first")
        return self._run

    def open(self, run: BackgroundRun) -> None:
        """Start the run. Raises GuardError if there is one, RetargetError if it cannot start."""
        if self._run is not None:
            raise GuardError(f"the {self._name} is connected already", where="connect", then="Disconnect it first")
        self._run = run
        atexit.register(self.close)
        try:
            run.start()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the run, within `JOIN_S`. Raises nothing. Call it again if the run has not ended by then."""
        if self._run is not None and self._run.end(DISCONNECTED):
            self._close()
            atexit.unregister(self.close)
            self._run = None
