"""`retarget view FILE`: a recorded run on a web page that only this machine reaches."""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from hardware.clock import MonotonicClock
from retarget.cli.application import note
from retarget.cli.exit import StopRequest, echo, stop_on_signals
from retarget.live.performer import LivePerformer
from retarget.run.loop import ObserverCallback, Watch
from retarget.run.options import SERVOLESS, RunOptions
from retarget.run.prepare import Prepared
from retarget.run.record import Record
from retarget.run.run_result import Extras
from retarget.types import FloatArray, Notify
from retarget.viewer.feed import LIVE_PAGE, PageSetup, ViewFeed, open_feed
from retarget.viewer.page import RecordedPage
from retarget.viewer.recorded import open_recorded
from retarget.viewer.server import PORT, close_server, open_server
from retarget.viewer.snapshot import STATE_WORDS, obstacle_poses

SHOWN_HZ = 30.0
"""Pictures a second of a recording: as smooth as video, and little for a browser."""


def view(
    file: Path,
    port: Annotated[
        int, typer.Option(help="Of the page, on this machine; 0: any.", metavar="PORT", min=0, max=65535)
    ] = PORT,
    body: Path | None = None,
) -> None:
    """Show a recorded run on a web page: performer, robot, goals and joints, at any speed. Ctrl-C ends it.

    Open the address that is printed; its key keeps other pages and users out.

    Arguments:
        file FILE: A run that was saved or recorded: FILE.npz, FILE.mcap.

    Options:
        body FILE: The robot's MJCF or URDF, where FILE names none that is there.
    """
    run = open_recorded(file, body=body)
    for text in run.notes:
        note(f"{file}: {text}")
    server, address = open_server(port, title=f"retarget: {file.name}")
    try:
        page, clock = RecordedPage(server, run, MonotonicClock()), MonotonicClock()
        echo(f"{file.name}: {len(run.times)} ticks. Open {address} ; Ctrl-C ends it")
        with stop_on_signals() as stop:
            while not stop():
                page.tick()
                clock.sleep_until(clock.now() + 1.0 / SHOWN_HZ)
    finally:
        close_server(server)


# `--view`: a run on a web page while it goes on.

ON_THE_PAGE = "stopped on the web page"


class Viewing:
    """The page of a run; without one it changes nothing."""

    def __init__(self, feed: ViewFeed | None, notify: Notify = lambda text: None) -> None:
        self._feed, self._notify = feed, notify
        self.over = False
        """Whether the run has ended."""
        self._shows = ObserverCallback(lambda record, row: None if feed is None else feed.on_row(record, row))

    def with_stop_button(self, asked: Callable[[], bool], stop: StopRequest) -> Callable[[], bool]:
        """A `stop_asked` for every tick that also receives the stop button of the page."""
        feed = self._feed
        if feed is None:
            return asked

        def either() -> bool:
            if feed.stop_asked() and not stop():
                stop.ask(ON_THE_PAGE)
            return asked()

        return either

    def watch(self, watch: Watch) -> Watch:
        """The watch, which also shows every tick on the page."""
        feed = self._feed
        if feed is None:
            return watch
        on_row, show = watch.on_row, self._shows

        def both(record: Record, row: int) -> None:
            on_row(record, row)
            show(record, row)

        return replace(watch, on_row=both)

    def close(self) -> None:
        """The run has ended: report why the page stopped before, if it did."""
        self.over = True
        if self._shows.failure:
            self._notify(f"warning: the page showed nothing any more: {self._shows.failure}")


@contextmanager
def opened_page(port: int | None, options: RunOptions, notify: Notify) -> Iterator[ViewFeed | None]:
    """The page of a run on a port of this machine, before anything is known of the performer; None: there is none.
    notify: receives its address. Raises RefusedError for a page that does not open."""
    if port is None:
        yield None
        return
    with open_feed(LIVE_PAGE, str(port), f"retarget: {options.robot}") as feed:
        notify(f"Look at it: {feed.address}")
        yield feed


@contextmanager
def viewing(
    feed: ViewFeed | None,
    prepared: Prepared,
    options: RunOptions,
    words: Callable[[], tuple[str, str]] | None = None,
    *,
    truth: Callable[[], FloatArray | None] = lambda: None,
    notify: Notify,
) -> Iterator[Viewing]:
    """Put robot and performer on the page of a run; None: there is none. words: the present state and its reason, where
    the phase of its tick does not say enough. truth: the state of a simulated body. Raises RefusedError for what cannot
    be shown."""
    if feed is None:
        yield Viewing(None)
        return
    machine = prepared.machine
    setup = PageSetup(
        robot=None if machine is None else str(machine.robot.profile.path),
        root=None if machine is None else options.physics.root,
        scene=options.scene,
        human_mjcf=prepared.human.mjcf,
        sensors=tuple(prepared.performer.sensors),
        landmarks=() if machine is None else tuple(machine.robot.profile.landmarks),
        servos_measure=options.bus not in SERVOLESS,
    )
    feed.begin(setup, rate_hz=1.0 / prepared.samples.dt)
    with closing(Viewing(feed, notify)) as view:
        feed.extras = _extras(prepared, view, words, truth)
        yield view


def _extras(
    prepared: Prepared,
    view: Viewing,
    words: Callable[[], tuple[str, str]] | None,
    truth: Callable[[], FloatArray | None],
) -> Extras:
    """What the page shows in addition to the rows of the record."""
    machine, scene_obstacles = prepared.machine, prepared.scene_obstacles

    def obstacles() -> FloatArray | None:
        if scene_obstacles is None or scene_obstacles.now is None:
            return None
        return obstacle_poses(scene_obstacles.shapes, scene_obstacles.now)

    if machine is None:
        return Extras(words=lambda: ("ended" if view.over else "following", ""), obstacles=obstacles)

    def now() -> tuple[str, str]:
        stop, supervisor = machine.guard.stop, machine.supervisor
        if stop is not None:
            return "stopped" if supervisor.over else "stopping", stop.reason
        if view.over or not supervisor.torque:
            return "ended", ""
        return (STATE_WORDS.get(supervisor.state, supervisor.state.value), "") if words is None else words()

    def current() -> FloatArray | None:
        states = machine.guard.states
        return None if states is None else states.current

    samples = prepared.samples
    latency = samples.latency.recent if isinstance(samples, LivePerformer) else lambda: None
    return Extras(words=now, current=current, obstacles=obstacles, truth=truth, latency=latency)
