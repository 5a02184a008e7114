"""`retarget run`: let a robot, or the virtual human alone, follow a performer, recorded or live."""

import shlex
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, cast

import typer
from rich.console import Console

from hardware.clock import Clock, MonotonicClock, PacedClock, VirtualClock
from hardware.guard_state import StopCause
from hardware.realtime import Scheduling, scheduled
from retarget.cli.application import Overwrite, progress_bar
from retarget.cli.buses import PhysicsBench
from retarget.cli.controls import (
    HELP,
    Clutch,
    DeadMan,
    Keys,
    LiveControls,
    Oversight,
    has_terminal,
    live_state,
    open_dead_man,
    refuse_oversight,
)
from retarget.cli.exit import DONE, STOPPED, detached_screens, stop_on_signals
from retarget.cli.view import viewing
from retarget.errors import UsageError
from retarget.frames import SensorFrames
from retarget.human.samples import Parts, Performance, Playback
from retarget.live.address import StreamAddress, parse_address
from retarget.live.begin import LiveOptions, begin_live, live_rate_hz
from retarget.live.open_stream import open_stream
from retarget.live.performer import LivePerformer
from retarget.live.playout import LIGHT
from retarget.live.raw_recording import RawTap
from retarget.model.robot import RobotBody
from retarget.recording.recorder import Recorder
from retarget.report.measure import measure, measure_latest
from retarget.report.outputs import Outputs, Written
from retarget.report.report import Report
from retarget.report.summary import show_summary
from retarget.run.control_socket import ControlSocket, socket_path
from retarget.run.loop import Watch
from retarget.run.options import PhysicsOptions, RunOptions
from retarget.run.prepare import Prepared, prepare, prepare_for
from retarget.run.run_result import RunResult
from retarget.run.supervisor import Supervisor
from retarget.schema.files import remove
from retarget.schema.performer import Performer
from retarget.schema.priorities import Steps
from retarget.sources.raw_record import RawWriter
from retarget.types import Notify

# Real-time ticks for a run without a robot, whose side else waits for each tick.


def in_time(look: Callable[[], bool], dt: float, clock: Clock) -> Callable[[], bool]:
    """`look`, called once every `dt` s."""
    deadline = clock.now()

    def waited() -> bool:
        nonlocal deadline
        deadline = max(deadline + dt, clock.now())
        clock.sleep_until(deadline)
        return look()

    return waited


# Shared by `run` and `demo`: prepare a run, play it, write its files, show a summary.


def follow_clip(read: Callable[[], SensorFrames], options: RunOptions, outputs: Outputs, *, source: str = "") -> int:
    """Run, write the files, show a summary. Returns the exit code: done, or stopped (also: a file is not written).

    read: opens the source, which a recording calls `source`. Raises RetargetError for what cannot be run; then nothing
    has moved and nothing is written.
    """
    clock: Clock = MonotonicClock()
    if options.simulated:  # a viewer shows it in real time
        clock = VirtualClock() if outputs.view is None else PacedClock()
    bench = PhysicsBench(options, _note)
    recorder = recorder_for(outputs, options, bench, clock=clock, goes_to_rest=options.has_mass)
    with detached_screens(), ExitStack() as signals:
        with prepare(
            read,
            options,
            clock=recorder.clock,
            make_bus=recorder.make_bus(bench.make_bus),
            goes_to_rest=options.has_mass,
            notify=recorder.recorded_notify(_note),
        ) as prepared:
            stop = signals.enter_context(stop_on_signals(moves=True))
            with (
                viewing(outputs.view, prepared, options, truth=bench.truth, notify=_note) as page,
                recorder.recording(prepared, source=source) as recorded,
                progress_bar(options.robot, prepared.samples.ticks) as show,
            ):
                asked = page.with_stop_button(bench.watching(stop, prepared), stop)
                if prepared.machine is None and outputs.view is not None:
                    asked = in_time(asked, prepared.samples.dt, clock)
                watch = Watch(show, asked, bench.watching(stop.forced_stop, prepared), stop.why)
                run = recorded.run(page.watch(recorder.watch(watch, prepared)))
        # Signals are still received and not raised, so that the files are written.
        return recorder.code(finished(bench.seen(run), outputs))


def recorder_for(
    outputs: Outputs, options: RunOptions, bench: PhysicsBench, *, clock: Clock, goes_to_rest: bool
) -> Recorder:
    """The recorder of a run, which records if `outputs` ask for it; its messages go to stderr."""
    truth, overwrite = bench.truth_numbers, outputs.overwrite
    return Recorder(
        outputs.record, options, clock=clock, goes_to_rest=goes_to_rest, notify=_note, overwrite=overwrite, truth=truth
    )


def finished(run: RunResult, outputs: Outputs) -> int:
    """Write the files of a run, show its summary, return the exit code. A run that was asked to stop, with no file that
    needs all metrics, is only measured in part, so that the command ends soon."""
    soon = run.stop is not None and run.stop.cause is StopCause.REQUESTED and not outputs.measured
    report = measure_latest(run) if soon else measure(run)
    written = outputs.write(run, report)
    _show(report, written)
    return STOPPED if run.reason is not None or report.fallen or written.problems else DONE


def _note(text: str) -> None:
    typer.echo(text, err=True)


def _show(report: Report, written: Written) -> None:
    """Show the summary, last of all, because a terminal may be gone or full."""
    show_summary(report, Console())
    for line in written.lines:
        typer.echo(line)
    for problem in written.problems:
        typer.echo(f"error: {problem}", err=True)


# A live run: open the stream, calibrate, follow until it is stopped; on virtual time where nothing is real.


def refuse_given(given: Mapping[str, object], whose: str) -> None:
    """Raise UsageError for options that only a source of another kind has."""
    found = [option for option, value in given.items() if value is not None]
    if found:
        raise UsageError(f"only a {whose} has this", where=", ".join(found), next_step="Leave it out")


def sides_are_checked(source: str, asked: bool | None, *, yes: bool) -> bool:
    """Whether the performer raises the left arm first: as asked, else for every live performer without --yes."""
    if asked and yes:
        raise UsageError("one asks, the other does not", where="--check-sides, --yes", next_step="Leave one out")
    return not yes and not source.startswith("replay:") if asked is None else asked


COUNTDOWN_S = 3.0


def countdown_of(source: str, asked: float | None) -> float:
    """Time to get into the pose, s: as asked, else none for a recording."""
    return (0.0 if source.startswith("replay:") else COUNTDOWN_S) if asked is None else asked


def _clock_of(address: StreamAddress, options: RunOptions, outputs: Outputs) -> Clock:
    """The clock of a live run. A recording on simulated servos is played as fast as it goes; a viewer shows it in real
    time."""
    if address.kind != "replay" or not options.simulated:
        return MonotonicClock()
    return VirtualClock() if outputs.view is None else PacedClock()


def follow_live(
    source: str,
    options: RunOptions,
    outputs: Outputs,
    live: LiveOptions,
    *,
    record_raw: Path | None = None,
    oversight: Oversight | None = None,
) -> int:
    """Run, write the files, show a summary. Returns the exit code.

    Raises RetargetError for what cannot be run; then nothing has moved and nothing is written. KeyboardInterrupt:
    stopped before anything moved.
    """
    _refuse_for_a_performer(options, live)
    oversight, address = oversight or Oversight(), parse_address(source)
    clock = _clock_of(address, options, outputs)
    refuse_oversight(oversight, virtual=type(clock) is VirtualClock)
    bench = PhysicsBench(options, _log)
    recorder = recorder_for(outputs, options, bench, clock=clock, goes_to_rest=True)
    notify = recorder.recorded_notify(_log)
    supervisor = Supervisor(notify=notify)
    with detached_screens(), ExitStack() as stack:
        operator = stack.enter_context(ExitStack())
        socket, dead_man = _opened(oversight, operator)
        tap = _raw_tap(record_raw, address, stack, overwrite=outputs.overwrite)

        def perform(performer: Performer, robot: RobotBody | None) -> Performance:
            stream = open_stream(address, performer, clock=clock, tap=tap, smoothing=live.smoothing, latest=live.latest)
            stack.callback(stream.receiver.close)
            begin = partial(begin_live, stream, live, clock=clock, rate_hz=live_rate_hz(robot), where=address.text)
            enter, late = partial(supervisor.enter, clock=clock), not options.simulated
            return begin(notify=notify, enter=enter, has_deadlines=late)

        prepare_live = partial(prepare_for, clock=recorder.clock, make_bus=recorder.make_bus(bench.make_bus))
        with prepare_live(perform, options, goes_to_rest=True, notify=notify, supervisor=supervisor) as prepared:
            stop, keys = stack.enter_context(stop_on_signals(moves=True)), stack.enter_context(Keys())
            performer, machine = prepared.samples, prepared.machine
            assert isinstance(performer, LivePerformer)
            clutch = Clutch(performer, clock=clock, notify=notify, dead_man=dead_man)
            file = oversight.stop_file
            controls = LiveControls(
                keys, stop, performer, clutch, notify=_log, clock=clock, machine=machine, stop_file=file, socket=socket
            )
            _show_keys(keys, dead_man)
            seen = viewing(outputs.view, prepared, options, controls.words, truth=bench.truth, notify=notify)
            page = stack.enter_context(seen)
            look = page.with_stop_button(controls.look, stop)
            _wait_until_engaged(clutch, look, performer, clock)
            with recorder.recording(prepared, source=address.text) as recorded:
                performer.catch_up()
                with live_state(options.robot, controls.words), scheduled(oversight.scheduling):
                    watch = _watch(recorded, look, controls, bench, clock)
                    run = recorded.run(page.watch(recorder.watch(watch, recorded)))
        operator.close()  # a stop that comes while the report is written finds no run
        run = replace(bench.seen(run), live=performer.report(address=address.text, person=live.person))
        return max(recorder.code(finished(run, outputs)), _followed(run, notify))


def _followed(run: RunResult, notify: Notify) -> int:
    """The exit code of a run by whether the performer was followed at all."""
    if run.ticks_followed > 0:
        return DONE
    if run.reason is None:
        notify("no tick followed the performer: the stream was over before following began")
    return STOPPED


def _raw_tap(path: Path | None, address: StreamAddress, stack: ExitStack, *, overwrite: bool) -> RawTap | None:
    if path is None:
        return None
    if overwrite and path.is_file():
        if address.path is not None and address.path.is_file() and path.samefile(address.path):
            raise UsageError(
                "this is the file that is played", where="--record-raw", found=str(path), next_step="Give another name"
            )
        remove(path, option="--record-raw")
    return stack.enter_context(RawTap(RawWriter(path, url=address.text), notify=_log))


def _opened(oversight: Oversight, stack: ExitStack) -> tuple[ControlSocket | None, DeadMan | None]:
    socket = dead_man = None
    if oversight.control_socket is not None:
        socket = stack.enter_context(ControlSocket(socket_path(oversight.control_socket)))
        _log(f"`retarget stop --socket {shlex.quote(str(socket.path))}` stops it")
    if oversight.dead_man is not None:
        dead_man = open_dead_man(oversight.dead_man, terminal=has_terminal())
        stack.callback(dead_man.close)
    return socket, dead_man


def _show_keys(keys: Keys, dead_man: DeadMan | None) -> None:
    """Say which keys do what."""
    if keys.listens:
        _log(HELP)
    if dead_man is not None:
        _log(f"hold {dead_man.label}: the robot moves only while it is held")


def _wait_until_engaged(clutch: Clutch, look: Callable[[], bool], performer: LivePerformer, clock: Clock) -> None:
    """Wait, without torque, until the operator holds what must be held. Raises KeyboardInterrupt if a stop was asked
    for, also before this call."""
    while True:
        if look():
            raise KeyboardInterrupt
        if clutch.engaged:
            return
        performer.poll()
        clock.sleep_until(clock.now() + performer.dt)


def _watch(
    prepared: Prepared, look: Callable[[], bool], controls: LiveControls, bench: PhysicsBench, clock: Clock
) -> Watch:
    """The callbacks of the run; without a robot they also wait for each tick."""
    if prepared.machine is None:
        look = in_time(look, prepared.samples.dt, clock)
    asked = bench.watching(look, prepared, live=True)
    forced = bench.watching(controls.forced_stop, prepared, live=True)
    return Watch(stop_asked=asked, torque_off_asked=forced, why=controls.why)


def _refuse_for_a_performer(options: RunOptions, live: LiveOptions) -> None:
    """Raise UsageError for options that a live performer does not have, and for a person to be measured anew without a
    name."""
    playback = options.playback
    if playback.speed != 1.0 or playback.loop:
        raise UsageError(
            "a live performer moves in real time", where="--speed, --loop", next_step="Leave them out, or play a file"
        )
    if live.recalibrate and live.person is None:
        raise UsageError("only a named person can be measured anew", where="--recalibrate", next_step="Give a --person")


def _log(text: str) -> None:
    typer.echo(text, err=True)


LIVE = "Live streams"
PHYSICS = "Physics"
"""Headings of their options in the help."""


def run(
    robot: Annotated[
        str, typer.Option(help="Robot by name or path; 'human' only reconstructs the performer.", metavar="NAME|PATH")
    ],
    source: Annotated[
        str,
        typer.Option(
            help="Motion file of the performer (AMC, BVH or C3D), 'sample', which comes with the program, or a live "
            "stream: vmc://:39539, mvn://:9763, natnet://HOST, json://:14150, replay://FILE.",
            metavar="FILE|sample|ADDRESS",
        ),
    ],
    bus: Annotated[
        str,
        typer.Option(
            help="Where goals go: servos in this process, an emulator that talks as they do, a robot with mass that "
            "can fall (with the emulator's bytes: +wire), nowhere; or real servos on the ports of the profile, or on "
            "this one.",
            metavar="mock|emulator|physics|physics+wire|none|profile|PORT",
        ),
    ] = "mock",
    faults: Annotated[
        Path | None, typer.Option(help="What goes wrong on the emulator's wire.", metavar="FILE.yaml")
    ] = None,
    performer: Annotated[
        str,
        typer.Option(
            help="The performer's sensors: five, five_head, three, six, ten, all, avatar, optitrack, "
            "optitrack_skeleton, or a file.",
            metavar="NAME|FILE",
        ),
    ] = "five",
    priorities: Annotated[
        str | None, typer.Option(help="Priority file of the robot (of 'human': its own).", metavar="NAME|FILE")
    ] = None,
    scene: Annotated[
        str | None, typer.Option(help="The scene: table, wall, ..., or a file.", metavar="NAME|FILE")
    ] = None,
    allow_contact: Annotated[
        bool, typer.Option("--allow-contact", help="Run also where the body touches the scene at the start.")
    ] = False,
    n_ik: Annotated[
        int | None, typer.Option("--n-ik", help="Iterations per frame at most, both stages.", metavar="N")
    ] = None,
    parts: Annotated[
        str, typer.Option(help="What follows; 'upper' keeps the legs still.", metavar="whole|upper")
    ] = "whole",
    steps: Annotated[
        str | None,
        typer.Option(
            help="When the performer lifts a foot: stay, or step in place once the mass is over the other; 'follow' "
            "for a robot that hangs. Usually as the priority file says: planted.",
            metavar="planted|shift|follow",
        ),
    ] = None,
    mirror: Annotated[bool, typer.Option("--mirror", help="Swap left and right.")] = False,
    speed: Annotated[float, typer.Option(help="1 is the performer's speed.", metavar="X")] = 1.0,
    start: Annotated[float | None, typer.Option(help="Begin at this time of the recording.", metavar="S")] = None,
    end: Annotated[
        float | None, typer.Option(help="End at this time of the recording; live: after so long.", metavar="S")
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Again and again until Ctrl-C, 10 minutes at most.")] = False,
    no_gate: Annotated[bool, typer.Option("--no-gate", help="Send goals unchecked; on simulated servos only.")] = False,
    skeleton: Annotated[
        Path | None, typer.Option(help="The ASF of an AMC, where it does not lie beside it.", metavar="FILE.asf")
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Length unit of the file, where it states none.", metavar="m|cm|mm|inch|cmu")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Frames per second instead of the file's.", metavar="HZ")] = None,
    mount: Annotated[
        str | None,
        typer.Option(
            help="What the robot is on; usually as its profile's root says.",
            metavar="floor|stand|gantry",
            rich_help_panel=PHYSICS,
        ),
    ] = None,
    hook: Annotated[
        str | None,
        typer.Option(
            help="Frame of the profile by which a gantry holds it; usually 'hook'.",
            metavar="FRAME",
            rich_help_panel=PHYSICS,
        ),
    ] = None,
    perturbations: Annotated[
        list[str] | None,
        typer.Option(
            "--perturb",
            help="Another mass (+-10 %), a centre of mass 10 mm off, friction from 0.5 to 1, 30 ms of latency, a push "
            "of 3 N for 0.2 s; drawn by the seed. Also several times.",
            metavar="mass|centre_of_mass|friction|latency|push",
            rich_help_panel=PHYSICS,
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(help="Of all random choices; the same seed gives the same run.", rich_help_panel=PHYSICS)
    ] = 0,
    countdown: Annotated[
        float | None,
        typer.Option(
            help="Time to get into the pose of the calibration; usually 3, and 0 for replay://.",
            metavar="S",
            rich_help_panel=LIVE,
        ),
    ] = None,
    person: Annotated[
        str | None,
        typer.Option(
            help="Keep the performer's size under this name, and use it in later runs.",
            metavar="NAME",
            rich_help_panel=LIVE,
        ),
    ] = None,
    recalibrate: Annotated[
        bool,
        typer.Option("--recalibrate", help="Measure a --person anew who was measured before.", rich_help_panel=LIVE),
    ] = False,
    check_sides: Annotated[
        bool | None,
        typer.Option(
            "--check-sides/--no-check-sides",
            help="Raise your left arm to the front first; it proves sides and axes. Usual, but not for replay://.",
            show_default=False,
            rich_help_panel=LIVE,
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="The sides are known to be right: no --check-sides.", rich_help_panel=LIVE)
    ] = False,
    smoothing: Annotated[
        str,
        typer.Option(
            help="Of the sensors: by a One-Euro filter, or by the mean of a window, which delays by 60 ms.",
            metavar="off|light|strong|window",
            rich_help_panel=LIVE,
        ),
    ] = LIGHT,
    latest: Annotated[
        bool,
        typer.Option("--latest", help="The newest poses at once, without a playout buffer.", rich_help_panel=LIVE),
    ] = False,
    record_raw: Annotated[
        Path | None,
        typer.Option("--record-raw", help="Keep every datagram, for replay://.", metavar="FILE", rich_help_panel=LIVE),
    ] = None,
    dead_man: Annotated[
        str | None,
        typer.Option(
            "--dead-man",
            help="The robot moves only while this key of the terminal, or pedal, is held.",
            metavar="KEY|pedal:DEVICE",
            rich_help_panel=LIVE,
        ),
    ] = None,
    stop_file: Annotated[
        Path | None,
        typer.Option("--stop-file", help="Stop when this file appears.", metavar="FILE", rich_help_panel=LIVE),
    ] = None,
    control_socket: Annotated[
        str | None,
        typer.Option(
            "--control-socket",
            help="Be stopped or held by other programs, see `retarget stop`; in XDG_RUNTIME_DIR without a PATH.",
            metavar="[PATH]",
            rich_help_panel=LIVE,
        ),
    ] = None,
    realtime: Annotated[
        int | None,
        typer.Option(
            help="Real-time priority of the ticks (SCHED_FIFO), 1 to 99; 40 if none is given.",
            metavar="[PRIORITY]",
            rich_help_panel=LIVE,
        ),
    ] = None,
    core: Annotated[
        int | None, typer.Option(help="The only core on which the ticks run.", metavar="N", rich_help_panel=LIVE)
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(help="Write the numbers of the run; into a folder, with a page.", metavar="FILE.json|DIR"),
    ] = None,
    save: Annotated[Path | None, typer.Option(help="Write every tick, for other tools.", metavar="FILE.npz")] = None,
    plots: Annotated[Path | None, typer.Option(help="Write pictures.", metavar="DIR")] = None,
    view: Annotated[
        int | None,
        typer.Option(help="Show the run on a web page of this machine.", metavar="[PORT]", min=0, max=65535),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(help="Keep the run while it goes on, for Foxglove and `retarget replay`.", metavar="FILE.mcap"),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Let a robot follow a performer, recorded or live, and say how well it did.

    Exit code 0: done; 1: stopped by the guard or by Ctrl-C, or a file not written; 2: refused before anything
    moved; 130: Ctrl-C before anything moved.
    """
    options = RunOptions(
        robot=robot,
        bus=bus,
        performer=performer,
        priorities=priorities,
        iterations=n_ik,
        parts=cast(Parts, parts),  # RunOptions refuses any other
        steps=cast(Steps | None, steps),
        gate=not no_gate,
        scene=scene,
        allow_contact=allow_contact,
        faults=faults,
        physics=PhysicsOptions(mount=mount, hook=hook, seed=seed, perturbations=tuple(perturbations or ())),
        playback=Playback(speed=speed, start=start, end=end, loop=loop, mirror=mirror),
    )
    outputs = Outputs.checked(report=report, save=save, plots=plots, record=record, overwrite=overwrite)
    outputs = replace(outputs, view=view)

    given: dict[str, object] = {"--person": person, "--recalibrate": recalibrate or None, "--check-sides": check_sides}
    given |= {"--record-raw": record_raw, "--stop-file": stop_file, "--dead-man": dead_man}
    given |= {"--control-socket": control_socket, "--realtime": realtime, "--core": core}
    if "://" in source:
        refuse_given({"--skeleton": skeleton, "--unit": unit, "--rate": rate, "--start": start}, "motion file")
        live = LiveOptions(
            countdown=countdown_of(source, countdown),
            duration=end,
            mirror=mirror,
            smoothing=smoothing,
            latest=latest,
            person=person,
            recalibrate=recalibrate,
            check_sides=sides_are_checked(source, check_sides, yes=yes),
        )
        ticks = Scheduling(priority=realtime, core=core)
        oversight = Oversight(stop_file=stop_file, dead_man=dead_man, control_socket=control_socket, scheduling=ticks)
        raise typer.Exit(follow_live(source, options, outputs, live, record_raw=record_raw, oversight=oversight))
    refuse_given(given, "live stream")

    def read() -> SensorFrames:
        from retarget.sources.open import open_source

        return open_source(source, skeleton=skeleton, unit=unit, rate=rate)

    raise typer.Exit(follow_clip(read, options, outputs, source=source))
