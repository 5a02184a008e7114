"""The operator of a run of the command line.

`RunOperator.poll` polls all that may stop or hold the robot, each tick. `RunLines` prints what is said.
"""

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
from retarget.cli.controls import Asked, Control, LiveStatus
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
"""Longest hold on purpose, s: servos that hold get warm, and the operator may have left."""
ON_THE_PAGE = "stopped on the web page"
ENDS = {Asked.GRIP: Asked.RELEASE, Asked.PAGE_GO_ON: Asked.PAGE_HOLD}
"""What ends each of these holds."""
STOPS = (RunState.STOPPING.value, RunState.RETURN_TO_STANCE.value, RunState.GO_TO_REST.value)
"""States of a run that ends."""


@runtime_checkable
class Clutched(Protocol):
    """Whom the operator may hold: a live performer, or what sends joint targets."""

    @property
    def following(self) -> bool:
        """Whether the robot follows now."""

    @property
    def hold_reason(self) -> str:
        """Why the robot holds, in a few words."""

    def clutch(self, *, engaged: bool) -> None:
        """Follow again from where the robot is, or hold it."""

    def reset_heading(self) -> bool:
        """Take the present direction as straight ahead. Whether there is one."""


def walking_words(asked: Request | None) -> str:
    """The velocity that a stick asks for, in words; "" for none."""
    if asked is None or asked == Request():
        return ""
    ways = (
        (asked.forward, "m/s forward", "m/s back"),
        (asked.left, "m/s to the left", "m/s to the right"),
        (asked.turn, "rad/s to the left", "rad/s to the right"),
    )
    parts = [f"{abs(value):.2f} {more if value > 0.0 else less}" for value, more, less in ways if value]
    return f"the stick asks for {', '.join(parts)}"


class RunOperator(Operator):
    """Asks for what signals, the page, the controls and the fall of a simulated robot ask for.

    stop: signals ask it for a stop, and so does `ask`. page: of the run, if it has one. controls, dead_man: of a live
    run, and whether one of them grips, without which the robot holds. stick: asks for a velocity, of a robot that
    walks. Each request is carried out before it is reported.
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
        self._holds = frozenset[Asked]()
        self._since: float | None = None  # [s] when the robot began to hold on purpose
        legs = None if self._machine is None else self._machine.follower.legs
        self._stick, self._velocity = stick, None if stick is None else Request()
        self._fastest = Request() if legs is None else legs.fastest(prepared.samples.dt)
        if dead_man:
            self._engage(frozenset({Asked.RELEASE}))

    def poll(self, state: RunState | None) -> OperatorInput:
        """What is asked for now, as `Operator.poll` says."""
        now, fault, failures = self._clock.now(), None, list[Failure]()
        with caught(failures, StopCause.SOURCE):
            if self._page is not None and self._page.stop_asked():
                self.stop.ask(ON_THE_PAGE)
        for control in self._controls:  # one that fails stops the robot, and hides no other
            with caught(failures, StopCause.SOURCE):
                for asked, reason in control.poll(now):
                    self._carry_out(asked, reason)
        if self._stick is not None:
            self._velocity = Request()
            with caught(failures, StopCause.SOURCE):
                self._velocity = velocity_of(self._stick.shares(now), self._fastest)
        if self._since is not None and now - self._since > LONGEST_S:
            self.stop.ask(f"paused by the operator for {LONGEST_S:g} s")
        if self._bench is not None and self._machine is not None:
            fault = self._bench.look(self._machine, self._samples)
        if failures and fault is None:
            fault = StopCause.SOURCE, failures[0].reason
        return replace(self.requested(), fault=fault)

    def requested(self) -> OperatorInput:
        """What was asked for so far, by signals too."""
        return OperatorInput(self.stop.why or None, self.stop.torque_off, velocity=self._velocity)

    @property
    def engaged(self) -> bool:
        """Whether the performer is to be followed."""
        return not self._holds

    def status(self) -> LiveStatus:
        """The present state of a live run, as the control socket reports it."""
        machine, following = self._machine, self._performer.following
        reason = None if machine is None or machine.guard.stop is None else machine.guard.stop.reason
        state = None if machine is None else machine.supervisor.state.value
        return LiveStatus(state, following, not self.engaged, reason)

    def words(self) -> str:
        """The present state of a live run, in a few words."""
        status = self.status()
        if status.state == RunState.STANDING.value:
            return "standing, with torque"
        if status.stop is not None or status.state in STOPS:
            return "stopping"
        if status.let_go:
            return "paused: holding"
        if status.state == RunState.APPROACH.value:
            return "approaching the performer"
        if status.state == RunState.HOLD.value:
            return "holding"
        return "following" if status.followed else "holding"

    def state_and_reason(self) -> tuple[str, str]:
        """The present state of a live run, in a few words, and why the performer is not followed; where he is, what a
        stick asks for, or ""."""
        words, stop = self.words(), self.status().stop
        held = self._performer.hold_reason or ("" if self._machine is None else self._machine.supervisor.hold_reason)
        asked = {"holding": held, "following": walking_words(self._velocity)}
        return words, stop or asked.get(words, "")

    @property
    def _performer(self) -> Clutched:
        assert isinstance(self._samples, Clutched), "only a live run has controls"
        return self._samples

    def _carry_out(self, asked: Asked, reason: str) -> None:
        if asked is Asked.STOP:
            self.stop.ask(reason)
        elif asked is Asked.STOP_TOO_SOON:
            self.stop.too_soon += 1
        elif asked is Asked.TORQUE_OFF:
            self.stop.force(reason)
        elif asked is Asked.HEADING:
            found = self._performer.reset_heading()
            self._notify("straight ahead is where you face now" if found else "left and right are lost")
        elif asked is Asked.PAUSE and Asked.HOLD in self._holds:
            self._engage(self._holds - {Asked.HOLD})
            self._notify("going on" if self.engaged else "no pause any more: it goes on when it is held")
        else:
            begins, before = Asked.HOLD if asked is Asked.PAUSE else asked, self._holds
            self._engage(before - {ENDS[asked]} if asked in ENDS else before | {begins})
            if self._holds != before or asked in (Asked.GRIP, Asked.RELEASE):  # a pedal that is lost says so
                self._notify(reason)

    def _engage(self, holds: frozenset[Asked]) -> None:
        """Follow the performer while there is no reason to hold."""
        if holds != self._holds:
            self._holds = holds
            self._performer.clutch(engaged=self.engaged)
            self._since = None if self.engaged else self._clock.now() if self._since is None else self._since


# What is printed of a run.

MOST_LINES, LAST_LINES = 12, 5
"""Lines of a run, and those at its end: torque, what was played, what was kept back, files, the sentence."""
MOST_BEFORE = 2
"""Notes before anything moves."""


class RunLines:
    """The lines of one run, which may last for hours: `MOST_LINES`, but for what must be said.

    What is no `News` is printed: instructions, warnings about servos, answers to the operator, how the robot ends;
    with limits that were not kept these may be more than 12, and so they are where a performer is refused and tries
    again, which counts anew. While the robot is `moving`, the first news of a kind is printed where there is room, and
    later ones are counted; before, notes beyond `MOST_BEFORE` wait for the summary. verbose: all are printed.
    """

    def __init__(self, *, verbose: bool = False, moving: bool = False) -> None:
        self.verbose, self.moving = verbose, moving
        self.kept_back = 0
        """News that was counted."""
        self.said, self.later = list[str](), list[str]()
        """Messages before anything moved: printed, and not yet."""
        self._count = 0
        self._kinds = set[str]()

    @property
    def room(self) -> int:
        """Lines that are left before those at the end."""
        return max(MOST_LINES - LAST_LINES - self._count, 0)

    def try_again(self) -> None:
        """Begin with another attempt of a performer who was refused: its lines are counted anew."""
        self._count = 0

    def log(self, text: str) -> None:
        """Print what the operator must read now."""
        self._count += 1 + text.count("\n")
        log(text)

    def notify(self, text: str) -> None:
        """Print a message; or, of news, count it or keep it for later."""
        if not isinstance(text, News) or self._fits(text) or self.verbose:
            if not self.moving:
                self.said.append(text)
            self.log(text)
        elif self.moving:
            self.kept_back += 1
        elif text not in (*self.said, *self.later):
            self.later.append(text)

    def _fits(self, news: News) -> bool:
        """Whether this is the first of its kind, and has room or is due."""
        known, before = news.kind in self._kinds, sum(isinstance(text, News) for text in self.said)
        self._kinds.add(news.kind)
        return not known and (news.is_due or (self.room if self.moving else MOST_BEFORE - before) > 0)


# What is said while a robot stops.

REMINDER_S = 30.0
"""Time, s, between two reminders of a robot that stands with torque at the end of its run: its servos get warm."""
TORQUE_OFF_COMMAND = "retarget stop --torque-off, where there is a control socket"
TOO_SOON = "pressed again too soon, as a held key repeats: torque stays on. Wait a second, then press once more"
HOLD_IT = "hold the robot before torque goes off: at rest it may go down without torque"
TORQUE_WORDS = {
    Torque.OFF: "torque is off",
    Torque.ON: "torque is on: cut the power by hand",
    Torque.UNCONFIRMED: "torque is not confirmed to be off: cut the power by hand",
}
"""What is said of the torque of a robot when its run has ended."""


class Announcer(RunObserver):
    """Says while a robot stops what the summary would say too late.

    Once: why it stops and what comes next; that a stop key was pressed too soon to count; that a robot that
    `may_topple` is to be held. Every `REMINDER_S`: how a robot that stands gets its torque switched off.
    """

    def __init__(self, machine: Machine, stop: StopRequest, *, may_topple: bool = False, notify: Notify) -> None:
        self.reason = ""
        """Why the robot stops, once that was said."""
        self._machine, self._stop, self._notify = machine, stop, notify
        self._topples, self._ignored, self._reminded = may_topple, False, -inf

    def see(self, tick: Tick) -> None:
        """Say what has come up in a tick of a robot that stops."""
        assert tick.given is not None, "a robot has inputs"
        machine, stop, forced = self._machine, self._machine.guard.stop, tick.given.operator.torque_off
        state = machine.supervisor.state
        if state in AT_RISK or machine.supervisor.over:
            return
        if self._stop.too_soon and not (self._ignored or forced):
            self._ignored = True
            self._say(TOO_SOON)
        if stop is not None and not self.reason:
            self.reason = stop.reason
            then = machine.end_plan.end.value if machine.guard.may_go_to_rest else "it brakes, and torque goes off"
            next_step = "torque goes off at once" if forced else f"{then} (Ctrl-C {_again(stop)}: torque off at once)"
            self._say(f"stopping: {stop.reason}: {next_step}")
        if self._topples:
            self._topples = False
            self._say(HOLD_IT)
        if state is RunState.STANDING and machine.waits and tick.given.now - self._reminded >= REMINDER_S:
            self._reminded = tick.given.now
            self._say(f"torque is on: hold the robot, then press Ctrl-C {_again(stop)} (or: {TORQUE_OFF_COMMAND})")

    def _say(self, text: str) -> None:
        with caught([], StopCause.SOURCE):  # a terminal that is lost for a moment is spoken to again
            self._notify(text)

    def say_end(self) -> None:
        """Say of a run that has ended how torque is, where somebody may have to act on it: on real servos, and where it
        should be off and is not; and the reason of a stop that was not said before."""
        machine, stop = self._machine, self._machine.guard.stop
        if machine.waits or (machine.guard.torque is not Torque.OFF and machine.supervisor.over):
            torque = TORQUE_WORDS[machine.guard.torque]
            self._say(torque if stop is None or stop.reason == self.reason else f"{torque}: {stop.reason}")


def _again(stop: Stop | None) -> str:
    """How often Ctrl-C is to be pressed now to switch torque off."""
    pressed = stop is not None and stop.reason in (*REASONS.values(), *SUSPENDED.values())
    return "once more" if pressed else "twice, a second apart"


# The state and duration of a live run on a terminal; nothing in a pipe.


@contextmanager
def live_state(what: str, words: Callable[[], str]) -> Iterator[None]:
    """Show a line on stderr. words: the present state, read by a thread of its own some times a second."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.progress import Progress, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn
    from rich.text import Text

    class Words(ProgressColumn):
        """The present state, whenever the line is drawn."""

        def render(self, task: Task) -> Text:
            return Text(words())

    columns = (SpinnerColumn(), TextColumn("{task.description}"), Words(), TimeElapsedColumn())
    with Progress(*columns, console=console(err=True), transient=True) as line:
        line.add_task(what, total=None)
        yield
