"""`retarget view FILE`: a recorded run on a web page that only this machine reaches."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event

from retarget.cli.application import note
from retarget.cli.exit import echo, stop_on_signals
from retarget.live.address import VIEW_PORT
from retarget.live.performer import LivePerformer
from retarget.model.scene_state import obstacle_poses
from retarget.pictures.outputs import RUN_NAME
from retarget.run.loop import RowObserver, RunObserver
from retarget.run.options import SERVOLESS, RunOptions
from retarget.run.prepare import Prepared
from retarget.run.run_result import Extras
from retarget.types import FloatArray, Notify, RunState
from retarget.web.feed import STATE_WORDS, PageSetup, Settings, ViewFeed, needing_websockets, open_feed


def view(
    file: Path,
    port: int = VIEW_PORT,
    body: Path | None = None,
) -> None:
    """Show a recorded run on a web page: performer, robot, goals and joints, at any speed. Ctrl-C ends it.

    Open the address that is printed; its key keeps other pages and users out.

    Arguments:
        file FILE|DIR: A run that was saved or recorded: FILE.npz, FILE.mcap, or a folder with run.npz.

    Options:
        port PORT 0..65535: Port of the page, on this machine; 0: any.
    """
    with needing_websockets():
        from retarget.web.recorded import open_recorded, page_files
        from retarget.web.serving import serve_files
    inside = file / RUN_NAME
    name = file.resolve().name
    file = inside if inside.is_file() else file
    run = open_recorded(file, body=body)
    for text in run.notes:
        note(f"{file}: {text}")
    files = page_files(run, name)

    def opened(address: str) -> None:
        echo(f"{file.name}: {len(run)} ticks. Open {address} ; Ctrl-C ends it")

    with stop_on_signals() as stop:
        serve_files(files, port, opened=opened, over=lambda: bool(stop()))


# `--view`: the page of a run.


@contextmanager
def opened_page(
    port: int | None, options: RunOptions, notify: Notify, *, stick: bool = False
) -> Iterator[ViewFeed | None]:
    """Open the page of a run on a port of this machine; None: there is none. notify: receives its address. stick: with
    pads by which the robot walks. Raises RefusedError."""
    if port is None:
        yield None
        return
    settings = Settings(listen=False, port=port, robot=options.robot, performs=False, stick=stick)
    with open_feed(settings) as feed:
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
) -> Iterator[RunObserver]:
    """Put robot and performer on the page of a run, if it has one, and yield the observer that shows each tick there.
    words: state and reason of a live run. truth: the state of a simulated body. Raises RefusedError."""
    if feed is None:
        yield RunObserver()
        return
    machine = prepared.machine
    setup = PageSetup(
        robot=None if machine is None else str(machine.robot.profile.path),
        root=None if machine is None else options.root,
        scene=options.scene,
        human_mjcf=prepared.human.mjcf,
        sensors=tuple(prepared.performer.sensors),
        landmarks=() if machine is None else tuple(machine.robot.profile.landmarks),
        servos_measure=options.bus not in SERVOLESS,
    )
    feed.begin(setup, rate_hz=1.0 / prepared.samples.dt)
    shows, over = RowObserver(feed.on_row), Event()
    feed.extras = _extras(prepared, over, words, truth)
    try:
        yield shows
    finally:
        over.set()
        if shows.failure:
            notify(f"warning: the page showed nothing any more: {shows.failure}")


def _extras(
    prepared: Prepared,
    over: Event,
    words: Callable[[], tuple[str, str]] | None,
    truth: Callable[[], FloatArray | None],
) -> Extras:
    """Data of the page beside the rows of the record. over: set once the run has ended."""
    machine, scene_obstacles = prepared.machine, prepared.scene_obstacles

    def obstacles() -> FloatArray | None:
        if scene_obstacles is None or scene_obstacles.now is None:
            return None
        return obstacle_poses(scene_obstacles.shapes, scene_obstacles.now)

    if machine is None:
        return Extras(words=lambda: ("ended" if over.is_set() else "following", ""), obstacles=obstacles)

    def now() -> tuple[str, str]:
        stop, supervisor = machine.guard.stop, machine.supervisor
        if stop is not None:
            return "stopped" if supervisor.over else "stopping", stop.reason
        if over.is_set() or not supervisor.torque:
            return "ended", ""
        known = (STATE_WORDS.get(supervisor.state, supervisor.state.value), "") if words is None else words()
        held = supervisor.hold_reason if supervisor.state is RunState.HOLD else ""
        strategies = machine.follower.strategies
        by = strategies.strategy.words if strategies is not None and supervisor.state is RunState.FOLLOW else ""
        return known[0], known[1] or held or machine.guard.health.heat_words or by

    def current() -> FloatArray | None:
        states = machine.guard.states
        return None if states is None else states.current

    samples = prepared.samples
    latency = samples.latency.recent if isinstance(samples, LivePerformer) else lambda: None
    return Extras(words=now, current=current, obstacles=obstacles, truth=truth, latency=latency)
