"""The operator of a run of the command line, and the lines that are printed for them."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import inf
from typing import Protocol, runtime_checkable

from hardware.guard import Torque
from hardware.guard_state import Stop, StopCause
from retarget.cli.application import console, log
from retarget.cli.buses import PhysicsBench
from retarget.cli.controls import Control, ControlRequest, LiveStatus
from retarget.cli.exit import REASONS, SUSPENDED, StopRequest
from retarget.cli.stick import Stick, velocity_of
from retarget.robot.walking.pattern import Request
from retarget.run.loop import Operator, RunObserver, Tick
from retarget.run.prepare import Prepared
from retarget.run.supervisor import AT_RISK, OperatorInput
from retarget.run.tick import Failure, Machine, caught
from retarget.types import News, Notify, RunState
from retarget.web.feed import ViewFeed

LONGEST_S = 300.0
"""Longest hold on purpose, s: servos that hold get warm."""
ON_THE_PAGE = "stopped on the web page"
ENDS = {ControlRequest.GRIP: ControlRequest.RELEASE, ControlRequest.PAGE_GO_ON: ControlRequest.PAGE_HOLD}
"""The hold that each of these requests ends."""
ENDING = (RunState.STOPPING.value, RunState.RETURN_TO_STANCE.value, RunState.GO_TO_REST.value)
"""States of a run that is ending."""


@runtime_checkable
class Clutched(Protocol):
    """A live performer, or a sender of joint targets, that the operator may hold."""

    @property
    def following(self) -> bool:
        """True if the robot follows now."""

    @property
    def hold_reason(self) -> str:
        """The reason why the robot holds, in a few words."""

    def clutch(self, *, engaged: bool) -> None:
        """Follow again from where the robot is, or hold it."""

    def reset_heading(self) -> bool:
        """Take the present direction as straight ahead. True if there is one."""


def walking_words(velocity: Request | None) -> str:
    """The velocity that a stick requests, in words; "" for none."""
    if velocity is None or velocity == Request():
        return ""
    axes = (
        (velocity.forward, "m/s forward", "m/s back"),
        (velocity.left, "m/s to the left", "m/s to the right"),
        (velocity.turn, "rad/s to the left", "rad/s to the right"),
    )
    parts = [f"{abs(value):.2f} {more if value > 0.0 else less}" for value, more, less in axes if value]
    return f"the stick asks for {', '.join(parts)}"


class RunOperator(Operator):
    """Gathers the requests of signals, page and controls, and the fall of a simulated robot.

    stop: set by signals and by this operator. dead_man: the robot holds until a control grips. A request is carried out
    before it is reported.
    """

    def __init__(
        self,
        prepared: Prepared,
        stop: StopRequest,
        *,
        bench: PhysicsBench | None = None,
        page: ViewFeed | None = None,
        controls: Sequence[Control] = (),
        dead_man: bool = False,
        stick: Stick | None = None,
        notify: Notify = lambda text: None,
    ) -> None:
        self.stop = stop
        self._samples, self._machine, self._clock = prepared.samples, prepared.machine, prepared.clock
        self._bench, self._page, self._controls, self._notify = bench, page, controls, notify
        self._holds = frozenset[ControlRequest]()
        self._since: float | None = None  # [s] since when it holds on purpose
        legs = None if self._machine is None else self._machine.follower.legs
        self._stick, self._velocity = stick, None if stick is None else Request()
        self._fastest = Request() if legs is None else legs.fastest(prepared.samples.dt)
        if dead_man:
            self._engage(frozenset({ControlRequest.RELEASE}))

    def poll(self, state: RunState | None) -> OperatorInput:
        """The present requests; see `Operator.poll`."""
        now, fault, failures = self._clock.now(), None, list[Failure]()
        with caught(failures, StopCause.SOURCE):
            if self._page is not None and self._page.stop_requested():
                self.stop.request(ON_THE_PAGE)
        for control in self._controls:  # one that fails stops the robot, and hides no other
            with caught(failures, StopCause.SOURCE):
                for request, reason in control.poll(now):
                    self._carry_out(request, reason)
        if self._stick is not None:
            self._velocity = Request()
            with caught(failures, StopCause.SOURCE):
                self._velocity = velocity_of(self._stick.shares(now), self._fastest)
        if self._since is not None and now - self._since > LONGEST_S:
            self.stop.request(f"paused by the operator for {LONGEST_S:g} s")
        if self._bench is not None and self._machine is not None:
            fault = self._bench.look(self._machine, self._samples)
        if failures and fault is None:
            fault = StopCause.SOURCE, failures[0].reason
        return replace(self.requested(), fault=fault)

    def requested(self) -> OperatorInput:
        """The requests so far, also of signals."""
        return OperatorInput(self.stop.why or None, self.stop.torque_off, velocity=self._velocity)

    @property
    def engaged(self) -> bool:
        """True if nothing holds the robot on purpose."""
        return not self._holds

    def status(self) -> LiveStatus:
        """The state of a live run, as the control socket reports it."""
        machine, following = self._machine, self._performer.following
        reason = None if machine is None or machine.guard.stop is None else machine.guard.stop.reason
        state = None if machine is None else machine.supervisor.state.value
        return LiveStatus(state, following, not self.engaged, reason)

    def words(self) -> str:
        """The state of a live run, in a few words."""
        status = self.status()
        if status.state == RunState.STANDING.value:
            return "standing, with torque"
        if status.stop is not None or status.state in ENDING:
            return "stopping"
        if status.let_go:
            return "paused: holding"
        if status.state == RunState.APPROACH.value:
            return "approaching the performer"
        if status.state == RunState.HOLD.value:
            return "holding"
        return "following" if status.followed else "holding"

    def state_and_reason(self) -> tuple[str, str]:
        """The state of a live run, in a few words, and its reason: why the performer is not followed, or the velocity
        that a stick requests, or ""."""
        words, stop = self.words(), self.status().stop
        held = self._performer.hold_reason or ("" if self._machine is None else self._machine.supervisor.hold_reason)
        reasons = {"holding": held, "following": walking_words(self._velocity)}
        return words, stop or reasons.get(words, "")

    @property
    def _performer(self) -> Clutched:
        assert isinstance(self._samples, Clutched), "only a live run has controls"
        return self._samples

    def _carry_out(self, request: ControlRequest, reason: str) -> None:
        if request is ControlRequest.STOP:
            self.stop.request(reason)
        elif request is ControlRequest.STOP_TOO_SOON:
            self.stop.too_soon += 1
        elif request is ControlRequest.TORQUE_OFF:
            self.stop.force(reason)
        elif request is ControlRequest.HEADING:
            found = self._performer.reset_heading()
            self._notify("straight ahead is where you face now" if found else "left and right are lost")
        elif request is ControlRequest.PAUSE and ControlRequest.HOLD in self._holds:
            self._engage(self._holds - {ControlRequest.HOLD})
            self._notify("going on" if self.engaged else "no pause any more: it goes on when it is held")
        else:
            begins, before = ControlRequest.HOLD if request is ControlRequest.PAUSE else request, self._holds
            self._engage(before - {ENDS[request]} if request in ENDS else before | {begins})
            # A pedal that is lost is reported although it changes nothing.
            if self._holds != before or request in (ControlRequest.GRIP, ControlRequest.RELEASE):
                self._notify(reason)

    def _engage(self, holds: frozenset[ControlRequest]) -> None:
        if holds != self._holds:
            self._holds = holds
            self._performer.clutch(engaged=self.engaged)
            self._since = None if self.engaged else self._clock.now() if self._since is None else self._since


# The lines of a run.

MOST_LINES, LAST_LINES = 12, 5
"""Lines of a run, and of them those of its summary."""
MOST_BEFORE = 2
"""Most notes before anything moves."""


class RunLines:
    """The lines of one run, which may last for hours: `MOST_LINES`, and more only where the operator must read them.

    Messages that are no `News` are always printed. Before the robot is `moving`, news beyond `MOST_BEFORE` waits for
    the summary. Then the first news of a kind is printed while there is room, and the rest is counted.
    """

    def __init__(self, *, verbose: bool = False, moving: bool = False) -> None:
        self.verbose, self.moving = verbose, moving
        self.kept_back = 0
        """News that was counted and not printed."""
        self.said, self.later = list[str](), list[str]()
        """Messages before anything moved: printed, and not yet."""
        self._count = 0
        self._kinds = set[str]()

    @property
    def room(self) -> int:
        """Lines that are left before the summary."""
        return max(MOST_LINES - LAST_LINES - self._count, 0)

    def try_again(self) -> None:
        """Count anew for another attempt of a performer who was refused."""
        self._count = 0

    def log(self, text: str) -> None:
        """Print a message that the operator must read now."""
        self._count += 1 + text.count("\n")
        log(text)

    def notify(self, text: str) -> None:
        """Print a message. News may be counted or kept for the summary instead."""
        shown = True
        if isinstance(text, News):
            known, before = text.kind in self._kinds, sum(isinstance(one, News) for one in self.said)
            self._kinds.add(text.kind)
            room = self.room if self.moving else MOST_BEFORE - before
            shown = self.verbose or (not known and (text.is_due or room > 0))
        if shown:
            if not self.moving:
                self.said.append(text)
            self.log(text)
        elif self.moving:
            self.kept_back += 1
        elif text not in (*self.said, *self.later):
            self.later.append(text)


# Messages while a robot stops.

REMINDER_S = 30.0
"""Time, s, between reminders that a robot stands with torque after its run: its servos get warm."""
TORQUE_OFF_COMMAND = "retarget stop --torque-off, where there is a control socket"
TOO_SOON = "pressed again too soon, as a held key repeats: torque stays on. Wait a second, then press once more"
HOLD_IT = "hold the robot before torque goes off: at rest it may go down without torque"
TORQUE_WORDS = {
    Torque.OFF: "torque is off",
    Torque.ON: "torque is on: cut the power by hand",
    Torque.UNCONFIRMED: "torque is not confirmed to be off: cut the power by hand",
}
"""Messages about torque after a run."""


class Announcer(RunObserver):
    """Notifies the operator while a robot stops: of the reason and the next step, of a stop key that was pressed too
    soon, and of a robot that may topple and must be held. Every `REMINDER_S` s it reminds of torque.
    """

    def __init__(self, machine: Machine, stop: StopRequest, *, may_topple: bool = False, notify: Notify) -> None:
        self.reason = ""
        """Reason of the stop, once it was notified."""
        self._machine, self._stop, self._notify = machine, stop, notify
        self._topples, self._ignored, self._reminded = may_topple, False, -inf

    def see(self, tick: Tick) -> None:
        """Notify of the news of a tick."""
        assert tick.given is not None, "a robot has inputs"
        machine, stop, forced = self._machine, self._machine.guard.stop, tick.given.operator.torque_off
        state = machine.supervisor.state
        if state in AT_RISK or machine.supervisor.over:
            return
        if self._stop.too_soon and not (self._ignored or forced):
            self._ignored = True
            self._notify_safely(TOO_SOON)
        if stop is not None and not self.reason:
            self.reason = stop.reason
            then = machine.end_plan.end.value if machine.guard.may_go_to_rest else "it brakes, and torque goes off"
            next_step = "torque goes off at once" if forced else f"{then} (Ctrl-C {_again(stop)}: torque off at once)"
            self._notify_safely(f"stopping: {stop.reason}: {next_step}")
        if self._topples:
            self._topples = False
            self._notify_safely(HOLD_IT)
        if state is RunState.STANDING and machine.waits and tick.given.now - self._reminded >= REMINDER_S:
            self._reminded = tick.given.now
            self._notify_safely(
                f"torque is on: hold the robot, then press Ctrl-C {_again(stop)} (or: {TORQUE_OFF_COMMAND})"
            )

    def _notify_safely(self, text: str) -> None:
        with caught([], StopCause.SOURCE):  # a terminal that is lost for a moment
            self._notify(text)

    def notify_end(self) -> None:
        """Notify of torque after a run where the operator may have to act: on real servos, and where it is not off.
        Adds the reason of a stop that was not notified before."""
        machine, stop = self._machine, self._machine.guard.stop
        if machine.waits or (machine.guard.torque is not Torque.OFF and machine.supervisor.over):
            torque = TORQUE_WORDS[machine.guard.torque]
            self._notify_safely(torque if stop is None or stop.reason == self.reason else f"{torque}: {stop.reason}")


def _again(stop: Stop | None) -> str:
    """The number of presses of Ctrl-C that switch torque off, in words."""
    pressed = stop is not None and stop.reason in (*REASONS.values(), *SUSPENDED.values())
    return "once more" if pressed else "twice, 1.2 s or more apart"


@contextmanager
def live_state(what: str, words: Callable[[], str]) -> Iterator[None]:
    """Show state and duration of a live run on a terminal. words: the state, read by another thread."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.progress import Progress, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn
    from rich.text import Text

    class Words(ProgressColumn):
        """The state when the line is drawn."""

        def render(self, task: Task) -> Text:
            return Text(words())

    columns = (SpinnerColumn(), TextColumn("{task.description}"), Words(), TimeElapsedColumn())
    with Progress(*columns, console=console(err=True), transient=True) as line:
        line.add_task(what, total=None)
        yield
