"""A live run: open the stream, calibrate, follow until somebody stops it; on virtual time where nothing is real."""

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

import typer

from hardware.clock import Clock, MonotonicClock, VirtualClock
from retarget.cli.buses import make_bus
from retarget.cli.follow_clip import finished
from retarget.cli.interrupt import stop_on_signals
from retarget.cli.outputs import Outputs
from retarget.cli.progress import progress_bar
from retarget.errors import UsageError
from retarget.live.address import parse_address
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.open_stream import open_stream
from retarget.live.raw_tap import RawTap
from retarget.options import RunOptions
from retarget.performer import Performer
from retarget.pipeline import Watch
from retarget.prepare import prepare_for
from retarget.robot_body import RobotBody
from retarget.samples import Performance
from retarget.sources.raw_record import RawWriter

__all__ = ["follow_live", "refuse_for_live"]

HUMAN_RATE_HZ = 100.0
"""Ticks per second where there is no robot whose profile says it."""


def refuse_for_live(given: Mapping[str, object]) -> None:
    """Raise UsageError for options that only a file has."""
    found = [option for option, value in given.items() if value is not None]
    if found:
        raise UsageError("only a motion file has this", where=", ".join(found), next_step="Leave it out")


def follow_live(
    source: str, options: RunOptions, outputs: Outputs, live: LiveOptions, *, record_raw: Path | None = None
) -> int:
    """Run, write the files, show a summary. Returns the exit code.

    Raises RetargetError for what cannot be run; then nothing has moved and nothing is written.
    """
    _refuse_played(options)
    address = parse_address(source)
    virtual = address.kind == "replay" and options.simulated
    clock: Clock = VirtualClock() if virtual else MonotonicClock()
    with ExitStack() as stack:
        tap = None if record_raw is None else stack.enter_context(RawTap(RawWriter(record_raw, url=address.text)))

        def perform(performer: Performer, robot: RobotBody | None) -> Performance:
            stream = open_stream(address, performer, clock=clock, tap=tap, smoothing=live.smoothing, latest=live.latest)
            stack.callback(stream.receiver.close)
            rate = HUMAN_RATE_HZ if robot is None else robot.profile.safety.rate_hz
            return begin_live(stream, live, clock=clock, rate_hz=rate, where=address.text, tell=_tell)

        with prepare_for(
            perform,
            options,
            clock=clock,
            make_bus=lambda robot, clock: make_bus(options.bus, robot, clock, faults=options.faults),
            parks=True,
        ) as prepared:
            stop = stack.enter_context(stop_on_signals())
            with progress_bar(options.robot, _ticks(live, prepared.samples.dt)) as show:
                run = prepared.run(Watch(show, stop, stop.insisted))
        return finished(run, outputs)


def _refuse_played(options: RunOptions) -> None:
    playback = options.playback
    if playback.speed != 1.0 or playback.loop:
        raise UsageError(
            "a live performer moves in real time", where="--speed, --loop", next_step="Leave them out, or play a file"
        )


def _ticks(live: LiveOptions, dt: float) -> int | None:
    return None if live.duration is None else round(live.duration / dt)


def _tell(text: str) -> None:
    typer.echo(text, err=True)
