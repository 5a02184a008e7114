"""`retarget run`: let a robot, or the virtual human alone, follow a performer, recorded or live."""

import shlex
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import typer
from rich.table import Table
from rich.text import Text

from hardware.clock import Clock, MonotonicClock, PacedClock, VirtualClock
from hardware.guard_state import StopCause
from hardware.realtime import Scheduling, refuse_scheduling, scheduled
from retarget.cli.application import (
    FileOptions,
    Session,
    console,
    given,
    log,
    progress_bar,
    refuse_given,
)
from retarget.cli.buses import PhysicsBench, make_bus
from retarget.cli.controls import (
    GOES_ON,
    HELP,
    NEVER_GOES_ON,
    Control,
    ControlSocket,
    HeldKey,
    Keyboard,
    LiveStatus,
    Oversight,
    Pedal,
    StopFile,
    has_terminal,
    open_dead_man,
    open_stick,
    refuse_oversight,
)
from retarget.cli.exit import (
    DONE,
    STOPPED,
    StopRequest,
    detached_screens,
    echo,
    interruptible,
    memory_message,
    refuse_little_memory,
    stop_on_signals,
)
from retarget.cli.operator import Announcer, RunLines, RunOperator, live_state
from retarget.cli.stick import GAMEPAD_HELP, KEYS_HELP, Gamepad, KeyStick
from retarget.cli.stop import socket_path
from retarget.cli.view import opened_page, viewing
from retarget.cli.web.control import LABEL, PADS, PAGE, PageControl, opened_web
from retarget.errors import InputError, UsageError
from retarget.frames import SensorFrames
from retarget.human.samples import Performance, Playback
from retarget.live.address import StreamAddress, is_address, parse_address
from retarget.live.begin import LONGEST_COUNTDOWN_S, POLL_S, LiveOptions, begin_live, live_rate_hz
from retarget.live.open_stream import open_stream
from retarget.live.performer import LivePerformer
from retarget.live.playout import LIGHT
from retarget.live.raw_recording import RawTap
from retarget.model.robot import RobotBody, load_robot
from retarget.pictures.outputs import Outputs
from retarget.recording.recorder import Recorder
from retarget.report.findings import FOLLOWING, findings, heading, remarks, sentence
from retarget.report.measure import best_likeness, measure, measure_latest
from retarget.report.report import Report
from retarget.report.unfollowed import UnfollowedNotice
from retarget.robot.walking.gait import PLANTED
from retarget.run.loop import Progress, RowObserver, RunObserver
from retarget.run.options import SIMULATED, RunOptions
from retarget.run.prepare import Perform, Prepared, performance_of, prepare_for, stage_priorities
from retarget.run.run_result import RunResult
from retarget.run.supervisor import Supervisor
from retarget.schema.catalogue import HUMAN
from retarget.schema.files import remove
from retarget.schema.performer import Performer
from retarget.sources.open import open_source
from retarget.sources.streams.raw_record import RawWriter
from retarget.types import Notify, RunState
from retarget.web.feed import ViewFeed
from retarget.web.link import PoseReceiver

ANY_TIME = Scheduling()
"""Ticks as the system schedules them."""

# Parts of all runs: `run` from a file or a stream, `demo`, `replay --goals` and `servo stiffness`.


class CommandRun:
    """Options, clock, bus and recorder of one run. A run of a `recorded` performer on simulated servos is on
    virtual time, unless a page shows it."""

    def __init__(self, options: RunOptions, outputs: Outputs, *, recorded: bool) -> None:
        """Raises UsageError for a place where nothing can be recorded."""
        self.options, self.outputs = options, outputs
        self.clock: Clock = MonotonicClock()
        if recorded and options.simulated:
            self.clock = VirtualClock() if outputs.view is None else PacedClock()
        self.lines = RunLines(verbose=outputs.verbose)
        self.bench = PhysicsBench(options, self.lines.notify)
        self.recorder = Recorder(
            outputs.record,
            options,
            clock=self.clock,
            notify=self.lines.log,
            overwrite=outputs.overwrite,
            truth=self.bench.truth,
        )
        self.notify = self.recorder.recorded_notify(self.lines.notify)
        self.feed: ViewFeed | None = None
        self.receiver: PoseReceiver | None = None
        self.control: PageControl | None = None
        """Poses of the page of `web://`, and the control of this page or of one with a stick; else None."""

    def prepared(
        self, perform: Perform, supervisor: Supervisor | None = None, *, robot: RobotBody | None = None
    ) -> AbstractContextManager[Prepared]:
        """The run, ready to start, with its bus open. robot: see `prepare_for`."""
        return prepare_for(
            perform,
            self.options,
            clock=self.clock,
            make_bus=self.bench.make_bus,
            goes_to_rest=True,
            notify=self.notify,
            supervisor=supervisor,
            robot=robot,
        )

    @contextmanager
    def page(self, *, stick: bool = False) -> Iterator[None]:
        """Show the page of the run, if it has one. stick: with pads by which the robot walks."""
        with opened_page(self.outputs.view, self.options, self.notify, stick=stick) as self.feed:
            yield

    def enter(self, supervisor: Supervisor, state: RunState) -> None:
        """Enter a state in which nothing moves yet, and show it on the page."""
        supervisor.enter(state, self.clock)
        if self.feed is not None:
            self.feed.announce(state.value)

    @contextmanager
    def live_page(self, address: StreamAddress, live: "StreamOptions") -> Iterator[None]:
        """Show the page of a live run. The page of `web://` shows its messages, too."""
        if address.kind != "web":
            with self.page(stick=live.oversight.stick == PAGE):
                if self.feed is not None and live.oversight.stick == PAGE:
                    self.control = PageControl(self.feed, self.notify)
                yield
            return
        with opened_web(
            address,
            self.options.robot,
            listen=live.listen,
            dead_man=live.oversight.dead_man == PAGE,
            stick=live.oversight.stick == PAGE,
            notify=self.notify,
        ) as (self.feed, self.receiver):
            log, show = self.notify, self.feed.note

            def notify(text: str) -> None:
                log(text)
                show(text)

            self.notify = notify
            self.control = PageControl(self.feed, log)
            yield

    def operator(self, prepared: Prepared, stop: StopRequest) -> RunOperator:
        """The operator of a run without controls."""
        return RunOperator(prepared, stop, bench=self.bench, page=self.feed)

    def viewing(
        self, prepared: Prepared, words: Callable[[], tuple[str, str]] | None = None
    ) -> AbstractContextManager[RunObserver]:
        """Show robot and performer on the page of the run, if it has one. words: the state and its reason."""
        return viewing(self.feed, prepared, self.options, words, truth=self.bench.truth, notify=self.notify)

    def play(self, recorded: Prepared, operator: RunOperator, *observers: RunObserver) -> RunResult:
        """Let the robot follow. Raises KeyboardInterrupt for a stop that was requested before."""
        machine, samples = recorded.machine, recorded.samples
        self.lines.moving = True
        observing = [self.recorder.observer, *observers]
        if isinstance(samples, LivePerformer):
            latency = samples.latency
            observing.insert(0, RowObserver(lambda record, row: latency.note(self.clock.now())))
        if machine is None:
            result = recorded.run(operator, observing)
        else:
            if operator.poll(machine.supervisor.state).stop is not None:  # torque is not on yet
                raise KeyboardInterrupt
            # A run on virtual time has its report at once, and needs no notice.
            if machine.robot.stands and recorded.parts == "whole" and type(self.clock) is not VirtualClock:
                size, dt = recorded.human.dimensions, samples.motion_dt
                observing.append(RowObserver(UnfollowedNotice(size, dt=dt, notify=self.notify)))
            announcer = Announcer(machine, operator.stop, may_topple=self.bench.may_topple, notify=self.lines.log)
            result = recorded.run(operator, [*observing, announcer])
            if recorded.has_bus:
                announcer.notify_end()
        return result


def follow_clip(
    read: Callable[[], SensorFrames],
    options: RunOptions,
    outputs: Outputs,
    *,
    source: str = "",
    scheduling: Scheduling = ANY_TIME,
) -> int:
    """Run, write the files, show a summary. Returns the exit code.

    read: opens the source, whose name in a recording is `source`. scheduling: of the ticks. Raises RetargetError before
    anything moves or is written.
    """
    refuse_little_memory()
    refuse_scheduling(scheduling)
    run = CommandRun(options, outputs, recorded=True)
    with detached_screens(), ExitStack() as signals:
        with run.prepared(performance_of(read, options.playback)) as prepared:
            stop = signals.enter_context(stop_on_signals(moves=True))
            with (
                run.page(),
                run.viewing(prepared) as page,
                run.recorder.recording(prepared, source=source) as recorded,
                progress_bar(options.robot, prepared.samples.ticks) as show,
                scheduled(scheduling),
            ):
                result = run.play(recorded, run.operator(prepared, stop), page, Progress(show))
        # Signals still do not raise, so that the files are written.
        return run.recorder.code(finished(run.bench.seen(result), outputs, run.lines))


def finished(run: RunResult, outputs: Outputs, lines: RunLines | None = None) -> int:
    """Write the files of a run, show its summary, and return the exit code. A run that was stopped on request is only
    measured in part where no file needs more."""
    soon = run.stop is not None and run.stop.cause is StopCause.REQUESTED and not outputs.measured
    try:
        report = measure_latest(run) if soon else measure(run)
        if outputs.best_likeness:
            report = replace(report, best_likeness_deg=best_likeness(run))
        written = outputs.write(run, report, progress=_watched)
        show_summary(run, report, lines or RunLines(verbose=outputs.verbose))
    except MemoryError:
        echo(f"error: the run is over, its results are not written: {memory_message()}", err=True)
        return STOPPED
    # Printed last, because a terminal may be gone or full.
    if written.files:
        echo(f"written: {written.listed(every=outputs.verbose)}")
    for problem in written.problems:
        echo(f"error: {problem}", err=True)
    look = written.first
    makes_page = "--report DIR makes a page of it" + ("" if outputs.verbose else ", --verbose prints every figure")
    next_step = makes_page if look is None else f"{'Open' if look.suffix == '.html' else 'Look at'} {look}"
    echo(f"{sentence(run, report)}. {next_step}")
    return STOPPED if run.reason is not None or report.fallen or written.problems else DONE


@contextmanager
def _watched(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show the progress of a file, which any signal interrupts."""
    with interruptible(), progress_bar(what, total) as show:
        yield show


def show_summary(run: RunResult, report: Report, lines: RunLines) -> None:
    """Print the summary in the room that is left, without notes that were printed before. verbose: every figure."""
    known = dict.fromkeys((*lines.later, *(f"note: {note}" for note in report.notes)))
    notes = [text.removeprefix("note: ") for text in known if text not in lines.said]
    echo(heading(run, report))
    if not lines.verbose:
        for line in remarks(run, report, notes, room=lines.room, kept_back=lines.kept_back):
            echo(line)
        return
    if report.tracking_mm:
        console().print(_tracking_table(report))
    facts = Table("", "", box=None, pad_edge=False, show_header=False)
    for finding in findings(run, report):
        bounded = finding.allowed and not finding.kept and finding.name != FOLLOWING
        facts.add_row(finding.name, Text(finding.measured + f" [allowed: {finding.allowed}]" * bool(bounded)))
    console().print(facts)
    for text in notes:
        echo(f"note: {text}")


def _tracking_table(report: Report) -> Table:
    """Tracking errors, mm, of goals and of the servos that have measured theirs."""
    table, servos = Table(box=None, pad_edge=False), report.servo_tracking_mm
    table.add_column("tracking, mm" if servos is None else "tracking, mm: sent")
    for column in ("mean", "p95", "max", *(() if servos is None else ("servos: mean", "p95", "max"))):
        table.add_column(column, justify="right", min_width=7)
    rows = [(name, spread, (servos or {}).get(name)) for name, spread in report.tracking_mm.items()]
    if report.robot != HUMAN:
        rows += [(f"human {name}", spread, None) for name, spread in report.sensors_mm.items()]
    for name, *spreads in rows:
        known = [(spread.mean, spread.p95, spread.max) for spread in spreads if spread is not None]
        table.add_row(name, *(f"{value:.1f}" for spread in known for value in spread))
    return table


# A live run: open the stream, calibrate, follow until it is stopped.

COUNTDOWN_S = 3.0
"""Time, s, to get into the pose, for a source that is no recording."""
WITHOUT_EFFECT = ("countdown", "yes", "smoothing", "latest")
"""Options of a live source that a motion file ignores."""


SCHEDULING = ("realtime", "core")
"""Options of `Oversight` that any run has."""


@dataclass(frozen=True, kw_only=True)
class StreamOptions:
    """Options that only a live source has.

    Live streams:
        countdown S: To get into the pose; usually 3, for replay:// 0.
        person NAME: Keep the performer's size under this name.
        recalibrate: Measure a --person anew who was measured before.
        check_sides: Raise your left arm first (not of replay://).
        yes: The sides are known to be right: no check.
        smoothing off|light|strong: One-Euro filter of the sensors.
        latest: The newest poses at once, no playout buffer.
        record_raw FILE: Keep every datagram, for replay://.
        listen: web:// for the network, over HTTPS.
        use_generated_legs: web:// uses legs that a headset makes up.
        mirrored_camera: The camera shows a mirror image.
    """

    countdown: float | None = None
    person: str | None = None
    recalibrate: bool = False
    check_sides: bool | None = None
    yes: bool = False
    smoothing: str = LIGHT
    latest: bool = False
    record_raw: Path | None = None
    listen: bool = False
    use_generated_legs: bool = False
    mirrored_camera: bool = False
    oversight: Oversight = field(default_factory=Oversight)

    def begins(self, source: str, playback: Playback, stature: float | None) -> LiveOptions:
        """The options of the beginning of a live run. stature: m, of the performer, or None. Raises UsageError."""
        if playback.speed != 1.0 or playback.loop:
            raise UsageError(
                "a live performer moves in real time",
                where="--speed, --loop",
                next_step="Leave them out, or play a file",
            )
        if self.recalibrate and self.person is None:
            raise UsageError(
                "only a named person can be measured anew", where="--recalibrate", next_step="Give a --person"
            )
        if self.check_sides and self.yes:
            raise UsageError("one asks, the other does not", where="--check-sides, --yes", next_step="Leave one out")
        is_replay = source.startswith("replay:")
        usual, usual_check = 0.0 if is_replay else COUNTDOWN_S, not (self.yes or is_replay)
        return LiveOptions(
            patience=LONGEST_COUNTDOWN_S if source.startswith("web:") else LiveOptions.patience,
            countdown=usual if self.countdown is None else self.countdown,
            duration=playback.end,
            mirror=playback.mirror,
            smoothing=self.smoothing,
            use_generated_legs=self.use_generated_legs,
            mirrored_camera=self.mirrored_camera,
            latest=self.latest,
            person=self.person,
            recalibrate=self.recalibrate,
            stature=stature,
            check_sides=usual_check if self.check_sides is None else self.check_sides,
        )

    def refuse_pages(self, source: str, view: int | None) -> None:
        """Raise UsageError for options of the page of `web://` without it, and for a second page beside it."""
        if source.startswith("web:"):
            if view is not None:
                raise UsageError("web:// has a page of its own", where="--view", next_step="Leave it out")
            if self.oversight.dead_man not in (None, PAGE):
                step = f"Use --dead-man {PAGE}, on a second device if need be"
                raise UsageError("web:// has a dead-man control of its own", where="--dead-man", next_step=step)
            return
        if self.oversight.stick == PAGE and view is None:
            step = "Add --view, or use web://"
            raise UsageError("this run has no page", where=f"--stick {PAGE}", next_step=step)
        of_web = {
            "--listen": self.listen,
            "--use-generated-legs": self.use_generated_legs and not source.startswith("replay:"),
            f"--dead-man {PAGE}": self.oversight.dead_man == PAGE,
        }
        for option in filter(of_web.__getitem__, of_web):
            raise UsageError("only web:// has this", where=option, next_step="Leave it out")


def follow_live(
    source: str, options: RunOptions, outputs: Outputs, live: StreamOptions, *, stature: float | None = None
) -> int:
    """Run, write the files, show a summary. stature: m, of the performer, or None. Returns the exit code.

    Raises RetargetError before anything moves or is written. KeyboardInterrupt: stopped before anything moved.
    """
    refuse_little_memory()
    begins = live.begins(source, options.playback, stature)
    address = parse_address(source)
    run = CommandRun(options, outputs, recorded=address.kind == "replay")
    refuse_oversight(live.oversight, virtual=type(run.clock) is VirtualClock)
    with detached_screens(), ExitStack() as stack:
        controls = stack.enter_context(ExitStack())
        devices, dead_man, stick = _opened(live.oversight, controls, run.lines.log, status=lambda: operator.status())
        tap = _raw_tap(live.record_raw, address, stack, overwrite=outputs.overwrite)
        stack.enter_context(run.live_page(address, live))
        notify = run.notify
        with ExitStack() as robot:
            prepared = _begun(address, begins, run, tap, stack, robot)
            stop, performer = stack.enter_context(stop_on_signals(moves=True)), prepared.samples
            assert isinstance(performer, LivePerformer)
            operator = RunOperator(
                prepared,
                stop,
                bench=run.bench,
                page=run.feed,
                controls=[_keyboard(dead_man, stick, stack, run.lines.log), *devices, *filter(None, [run.control])],
                dead_man=live.oversight.dead_man is not None,
                stick=run.control if live.oversight.stick == PAGE else stick,
                notify=notify,
            )
            page = stack.enter_context(run.viewing(prepared, operator.state_and_reason))
            _wait_until_engaged(operator, performer, run.clock)
            with run.recorder.recording(prepared, source=address.text) as recorded:
                performer.catch_up()
                with live_state(options.robot, operator.words), scheduled(live.oversight.scheduling):
                    result = run.play(recorded, operator, page)
        controls.close()  # no run listens while the report is written
        times = {} if run.control is None else run.control.times()
        stream_report = performer.report(address=address.text, person=begins.person, times=times)
        result = replace(run.bench.seen(result), live=stream_report)
        code = run.recorder.code(finished(result, outputs, run.lines))
        if result.ticks_followed > 1:  # the approach ends at the first sample
            return code
        if result.reason is None:
            notify("no tick followed the performer: the stream was over before following began")
        return max(code, STOPPED)


AGAIN_S = 5.0
"""Time, s, for which the page shows why a performer was refused."""


def _begun(
    address: StreamAddress,
    begins: LiveOptions,
    run: CommandRun,
    tap: RawTap | None,
    stack: ExitStack,
    robot: ExitStack,
) -> Prepared:
    """The run that can start. `robot` closes its bus. On simulated servos a performer who is refused on the page tries
    again there. Raises RetargetError. KeyboardInterrupt: STOP on the page."""
    while True:
        began, supervisor = run.clock.now(), Supervisor()
        try:
            return robot.enter_context(
                run.prepared(_performing(address, begins, run, tap, supervisor, stack), supervisor)
            )
        except InputError as error:
            opened = run.clock.now() - began < begins.patience  # the page was opened in time
            if run.control is None or run.receiver is None or not run.options.simulated or not opened:
                raise
            run.notify(f"{error} It begins again in {AGAIN_S:g} s.")
            run.lines.try_again()
            until = run.clock.now() + AGAIN_S
            while run.clock.now() < until:
                run.control.look()
                run.clock.sleep_until(run.clock.now() + POLL_S)


def _performing(
    address: StreamAddress,
    begins: LiveOptions,
    run: CommandRun,
    tap: RawTap | None,
    supervisor: Supervisor,
    stack: ExitStack,
) -> Perform:
    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        stream = open_stream(
            address,
            performer,
            receiver=run.receiver,
            tap=tap,
            smoothing=begins.smoothing,
            latest=begins.latest,
            use_generated_legs=begins.use_generated_legs,
            mirrored_camera=begins.mirrored_camera,
        )
        stack.callback(stream.receiver.close)
        return begin_live(
            stream,
            begins,
            clock=run.clock,
            rate_hz=live_rate_hz(robot),
            where=address.text,
            notify=run.notify,
            enter=partial(run.enter, supervisor),
            look=run.control.look if run.control is not None else lambda: None,
            has_deadlines=not run.options.simulated,
        )

    return perform


def _raw_tap(path: Path | None, address: StreamAddress, stack: ExitStack, *, overwrite: bool) -> RawTap | None:
    if path is None:
        return None
    if overwrite and path.is_file():
        if address.path is not None and address.path.is_file() and path.samefile(address.path):
            raise UsageError(
                "this is the file that is played", where="--record-raw", found=str(path), next_step="Give another name"
            )
        remove(path, option="--record-raw")
    return stack.enter_context(RawTap(RawWriter(path, url=address.text), notify=log))


def _opened(
    oversight: Oversight, stack: ExitStack, notify: Notify, *, status: Callable[[], LiveStatus]
) -> tuple[list[Control], HeldKey | Pedal | None, KeyStick | Gamepad | None]:
    """Open the controls except the keyboard. Returns them, the dead-man control, and the stick."""
    opened: list[Control] = []
    if oversight.control_socket is not None:
        goes_on = GOES_ON if has_terminal() else NEVER_GOES_ON
        socket = ControlSocket(socket_path(oversight.control_socket), status=status, goes_on=goes_on)
        stack.callback(socket.close)
        opened.append(socket)
        notify(f"`retarget stop {shlex.quote(str(socket.path))}` stops it")
    dead_man = None
    if oversight.dead_man == PAGE:
        notify(f"hold {LABEL}: the robot moves only while it is held")
    elif oversight.dead_man is not None:
        dead_man = open_dead_man(oversight.dead_man, terminal=has_terminal())
        if isinstance(dead_man, Pedal):
            stack.callback(dead_man.close)
            opened.append(dead_man)
    stick = None
    if oversight.stick == PAGE:
        notify(f"stick: {PADS}")
    elif oversight.stick is not None:
        stick = open_stick(oversight.stick, terminal=has_terminal(), notify=notify)
        if isinstance(stick, Gamepad):
            stack.callback(stick.close)
            notify(f"stick: {GAMEPAD_HELP}")
    if oversight.stop_file is not None:
        opened.append(StopFile(oversight.stop_file))
    return opened, dead_man, stick


def _keyboard(
    dead_man: HeldKey | Pedal | None, stick: KeyStick | Gamepad | None, stack: ExitStack, notify: Notify
) -> Keyboard:
    """Open the keyboard until `stack` closes, and explain its keys."""
    walks = stick if isinstance(stick, KeyStick) else None
    keyboard = Keyboard(dead_man=dead_man if isinstance(dead_man, HeldKey) else None, stick=walks)
    stack.callback(keyboard.close)
    if has_terminal():
        notify(HELP if walks is None else f"{HELP}, {KEYS_HELP}")
    if dead_man is not None:
        notify(f"hold {dead_man.label}: the robot moves only while it is held")
    return keyboard


def _wait_until_engaged(operator: RunOperator, performer: LivePerformer, clock: Clock) -> None:
    """Wait without torque until the operator holds the dead-man control. Raises KeyboardInterrupt for a stop."""
    while True:
        if operator.poll(None).stop is not None:
            raise KeyboardInterrupt
        if operator.engaged:
            return
        performer.poll()
        clock.sleep_until(clock.now() + performer.dt)


# The command.

USUAL_OPTIONS = {
    "run": ("--robot", "--source", "--bus", "--speed", "--report", "--plots", "--animate", "--view", "--verbose")
}
"""Options that `--help` of a command lists, so that it fits a screen of 80 by 24. `--help-all` lists all."""


@dataclass(frozen=True, kw_only=True)
class RunRequest:
    """The options of `retarget run`, typed or from a session file.

    Robot:
        source FILE|ADDRESS: Motion file (AMC BVH C3D GLB VRMA MVNX NPZ TRC), 'sample', or a live stream: vmc://:39539,
            mvn://:9763, natnet://HOST, json://:14150, web://, replay://FILE.
        no_gate: Send goals unchecked; on simulated servos only.
    """

    options: RunOptions
    source: str
    file: FileOptions
    live: StreamOptions
    no_gate: bool = False
    outputs: Outputs

    def checked(self) -> tuple[RunOptions, Outputs]:
        """The options of the run, and its files. Raises UsageError for options that exclude each other."""
        usual = "web" if self.source.startswith("web:") else self.options.performer_name
        options = replace(self.options, gate=not self.no_gate, performer=self.options.performer or usual)
        outputs = self.outputs.checked()
        if is_address(self.source):
            played = options.playback
            start = [] if played.start is None else ["--start"]
            pose = ["--keep-calibration-frame"] if played.keep_calibration_frame else []
            refuse_given([*given(self.file, but=("stature",)), *start, *pose], "motion file")
            self.live.refuse_pages(self.source, outputs.view)
            if self.live.oversight.stick is not None:
                _refuse_planted(options)
        else:
            streams = [*given(self.live, but=WITHOUT_EFFECT), *given(self.live.oversight, but=SCHEDULING)]
            refuse_given(streams, "live stream")
        return options, outputs


def _refuse_planted(options: RunOptions) -> None:
    robot = None if options.is_human else load_robot(options.robot, root=options.root)
    _, priorities, notes = stage_priorities(robot, options)
    if priorities is not None and priorities.steps == "walk":
        return
    found, step = (
        "no --steps" if options.steps is None else f"--steps {options.steps}",
        "Add --steps walk, or leave it out",
    )
    for note in notes:
        if note.startswith(PLANTED):
            found, step = note, "Leave it out"
    raise UsageError("a stick is for a robot that walks", where="--stick", found=found, next_step=step)


def run(request: RunRequest, session: Session = None) -> None:
    """Let a robot follow a performer, recorded or live, and say how well it did.

    Examples:
        retarget run --robot op3 --source sample --view
        retarget run --robot op3 --source vmc://:39539 --bus profile
        retarget run session.yaml --speed 0.5
    """
    options, outputs = request.checked()
    source, live = request.source, request.live
    if is_address(source):
        raise typer.Exit(follow_live(source, options, outputs, live, stature=request.file.stature))
    read = partial(request.file.open, source)
    raise typer.Exit(follow_clip(read, options, outputs, source=source, scheduling=live.oversight.scheduling))


def check_request(request: RunRequest, session: Session = None) -> None:
    """Refuse what `run` would refuse before anything moves, without opening ports and sockets. The sample stands in for
    a live performer. Results of an earlier run may be there."""
    options, outputs = replace(request, outputs=replace(request.outputs, overwrite=True)).checked()
    refuse_scheduling(request.live.oversight.scheduling)
    command = CommandRun(options, outputs, recorded=True)
    perform = performance_of(partial(request.file.open, request.source), options.playback)
    if is_address(request.source):
        request.live.begins(request.source, options.playback, request.file.stature)
        parse_address(request.source)
        perform = performance_of(partial(request.file.open, "sample"), Playback())
    make = command.bench.make_bus if options.simulated else partial(make_bus, "none")
    with prepare_for(perform, options, clock=VirtualClock(), make_bus=make):
        pass


DEMO_FOLDER, DEMO_ROBOT = Path("out/demo"), "op3"


def demo_folder(robot: str) -> Path:
    """The folder of the demo of a robot, by name or path: out/demo, or out/demo-NAME where it is not the usual one."""
    path = Path(robot).resolve()
    name = path.parent.name if path.suffix == ".yaml" else path.name
    return DEMO_FOLDER if robot == DEMO_ROBOT else DEMO_FOLDER.with_name(f"{DEMO_FOLDER.name}-{name}")


def demo(
    folder: Path | None = None,
    out: Path | None = None,
    robot: str = DEMO_ROBOT,
    bus: str = "emulator",
    overwrite: bool = False,
) -> None:
    """See it work: a recorded performer waves, reaches and squats, and a robot follows on an emulated bus.

    Writes a report, its page, every tick and pictures into a folder; needs no data and no hardware.

    Arguments:
        folder: Folder of the files; usually out/demo, of another robot out/demo-NAME, where they are replaced.

    Options:
        out DIR: The same.
        bus mock|emulator|physics|physics+wire|none: Bus of the goals, as of `run`.
    """
    options = RunOptions(robot=robot, bus=bus)
    if not options.simulated:
        raise UsageError(
            "a demo moves no real servos",
            where="--bus",
            found=bus,
            allowed=", ".join(SIMULATED),
            next_step="See `retarget run`",
        )
    folder, own = folder if out is None else out, demo_folder(robot)
    outputs = Outputs.in_folder(folder or own)
    if not overwrite and folder not in (None, own):
        outputs.refuse_existing("folder")
    raise typer.Exit(follow_clip(partial(open_source, "sample"), options, outputs))
