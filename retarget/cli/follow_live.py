"""A live run: open the stream, calibrate, follow until somebody stops it; on virtual time where nothing is real."""

import shlex
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import typer

from hardware.clock import Clock, MonotonicClock, PacedClock, VirtualClock
from hardware.realtime import scheduled
from retarget.cli.clutch import Clutch
from retarget.cli.control_socket import ControlSocket, socket_path
from retarget.cli.dead_man import DeadMan, open_dead_man
from retarget.cli.detached import detached_screens
from retarget.cli.follow_clip import finished, recorder_for
from retarget.cli.in_time import in_time
from retarget.cli.interrupt import stop_on_signals
from retarget.cli.keys import Keys
from retarget.cli.live_controls import HELP, LiveControls
from retarget.cli.live_state import live_state, words_for
from retarget.cli.outputs import Outputs
from retarget.cli.oversight import Oversight, has_terminal, refuse_oversight
from retarget.cli.physics_bench import PhysicsBench
from retarget.cli.viewing import viewing
from retarget.errors import UsageError
from retarget.live.address import StreamAddress, parse_address
from retarget.live.begin import LiveOptions, begin_live, live_rate_hz
from retarget.live.open_stream import open_stream
from retarget.live.performer import LivePerformer
from retarget.live.raw_tap import RawTap
from retarget.options import RunOptions
from retarget.outputs import remove
from retarget.performer import Performer
from retarget.pipeline import Watch
from retarget.prepare import Prepared, prepare_for
from retarget.record import Phase
from retarget.robot_body import RobotBody
from retarget.samples import Performance
from retarget.sources.raw_record import RawWriter

__all__ = ["follow_live", "refuse_for_file", "refuse_for_live", "sides_are_checked"]


def refuse_for_live(given: Mapping[str, object]) -> None:
    """Raise UsageError for options that only a file has."""
    found = [option for option, value in given.items() if value is not None]
    if found:
        raise UsageError("only a motion file has this", where=", ".join(found), next_step="Leave it out")


def refuse_for_file(given: Mapping[str, object]) -> None:
    """Raise UsageError for options that only a live stream has."""
    found = [option for option, value in given.items() if value is not None]
    if found:
        raise UsageError("only a live stream has this", where=", ".join(found), next_step="Leave it out")


def sides_are_checked(source: str, asked: bool | None, *, yes: bool) -> bool:
    """Whether the left arm is to be raised first: as asked, else for whoever is there and did not say --yes."""
    if asked and yes:
        raise UsageError("one asks, the other does not", where="--check-sides, --yes", next_step="Leave one out")
    return not yes and not source.startswith("replay:") if asked is None else asked


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
    _refuse_played(options)
    if live.recalibrate and live.person is None:
        raise UsageError("nobody is kept without a name", where="--recalibrate", next_step="Give it a --person")
    oversight, address = oversight or Oversight(), parse_address(source)
    clock: Clock = MonotonicClock()
    if address.kind == "replay" and options.simulated:  # whoever looks on sees it as fast as it was
        clock = VirtualClock() if outputs.view is None else PacedClock()
    refuse_oversight(oversight, virtual=type(clock) is VirtualClock)
    bench = PhysicsBench(options, _tell)
    recorder = recorder_for(outputs, options, bench, clock=clock, parks=True)
    tell = recorder.hears(_tell)
    with detached_screens(), ExitStack() as stack:
        socket, dead_man = _opened(oversight, stack)
        tap = _raw_tap(record_raw, address, stack, overwrite=outputs.overwrite)

        def perform(performer: Performer, robot: RobotBody | None) -> Performance:
            stream = open_stream(address, performer, clock=clock, tap=tap, smoothing=live.smoothing, latest=live.latest)
            stack.callback(stream.receiver.close)
            return begin_live(stream, live, clock=clock, rate_hz=live_rate_hz(robot), where=address.text, tell=tell)

        make_bus = recorder.make_bus(bench.make_bus)
        with prepare_for(perform, options, clock=recorder.clock, make_bus=make_bus, parks=True, tell=tell) as prepared:
            stop, keys = stack.enter_context(stop_on_signals(moves=True)), stack.enter_context(Keys())
            performer, guard = prepared.samples, None if prepared.side is None else prepared.side.guard
            assert isinstance(performer, LivePerformer)
            clutch = Clutch(performer, clock=clock, tell=tell, guard=guard, dead_man=dead_man)
            file = oversight.stop_file
            controls = LiveControls(
                keys, stop, performer, clutch, tell=_tell, clock=clock, guard=guard, stop_file=file, socket=socket
            )
            _tell_how(keys, dead_man)
            words = _words(prepared, controls)
            page = stack.enter_context(viewing(outputs.view, prepared, options, words, truth=bench.truth, tell=tell))
            look = page.heard(controls.look, stop)
            _wait_until_wanted(clutch, look, performer, clock)
            with recorder.recording(prepared, source=address.text) as recorded:
                performer.catch_up()
                with live_state(options.robot, words), scheduled(oversight.scheduling):
                    watch = _watch(recorded, look, controls, bench, clock)
                    run = recorded.run(page.watch(recorder.watch(watch, recorded)))
        if not run.ticks_followed and run.reason is None:
            tell("nobody was followed: the stream was over before following began")
        told = performer.report(address=address.text, person=live.person)
        return recorder.code(finished(replace(bench.seen(run), live=told), outputs))


def _raw_tap(path: Path | None, address: StreamAddress, stack: ExitStack, *, overwrite: bool) -> RawTap | None:
    if path is None:
        return None
    if overwrite and path.is_file():
        if address.path is not None and address.path.is_file() and path.samefile(address.path):
            raise UsageError(
                "this file is what is played", where="--record-raw", found=str(path), next_step="Give another name"
            )
        remove(path, option="--record-raw")
    return stack.enter_context(RawTap(RawWriter(path, url=address.text), tell=_tell))


def _opened(oversight: Oversight, stack: ExitStack) -> tuple[ControlSocket | None, DeadMan | None]:
    socket = dead_man = None
    if oversight.control_socket is not None:
        socket = stack.enter_context(ControlSocket(socket_path(oversight.control_socket)))
        _tell(f"`retarget stop --socket {shlex.quote(str(socket.path))}` stops it")
    if oversight.dead_man is not None:
        dead_man = open_dead_man(oversight.dead_man, terminal=has_terminal())
        stack.callback(dead_man.close)
    return socket, dead_man


def _tell_how(keys: Keys, dead_man: DeadMan | None) -> None:
    """Which keys do what."""
    if keys.listens:
        _tell(HELP)
    if dead_man is not None:
        _tell(f"hold {dead_man.told}: the robot moves only while it is held")


def _wait_until_wanted(clutch: Clutch, look: Callable[[], bool], performer: LivePerformer, clock: Clock) -> None:
    """Nothing has torque before somebody holds what must be held. Raises KeyboardInterrupt if it is to stop instead,
    which may have been asked for long ago."""
    while True:
        if look():
            raise KeyboardInterrupt
        if clutch.engaged:
            return
        performer.listen()
        clock.sleep_until(clock.now() + performer.dt)


def _words(prepared: Prepared, controls: LiveControls) -> Callable[[], str]:
    """What the run does now."""
    side = prepared.side
    return lambda: words_for(controls.status(), approaching=side is not None and side.phase is Phase.APPROACH)


def _watch(
    prepared: Prepared, look: Callable[[], bool], controls: LiveControls, bench: PhysicsBench, clock: Clock
) -> Watch:
    """Who stops it; in time, also where there is no robot whose side keeps it."""
    if prepared.side is None:
        look = in_time(look, prepared.samples.dt, clock)
    asked = bench.watching(look, prepared, live=True)
    return Watch(stop_asked=asked, cut_asked=controls.insisted, why=controls.why)


def _refuse_played(options: RunOptions) -> None:
    playback = options.playback
    if playback.speed != 1.0 or playback.loop:
        raise UsageError(
            "a live performer moves in real time", where="--speed, --loop", next_step="Leave them out, or play a file"
        )


def _tell(text: str) -> None:
    typer.echo(text, err=True)
