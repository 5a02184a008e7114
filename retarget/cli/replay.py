"""`retarget replay`: run a recording again and compare, or send its goals to a bus."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from retarget.cli.application import log, note, progress_bar
from retarget.cli.exit import DONE, STOPPED, echo
from retarget.errors import UsageError
from retarget.run.options import PhysicsOptions, RunOptions
from retarget.run.record import Phase

if TYPE_CHECKING:
    from retarget.model.robot import RobotBody
    from retarget.pictures.outputs import Outputs
    from retarget.recording.configs import Configs
    from retarget.recording.reading import Recording
    from retarget.run.run_result import RunResult


SPEEDS = (0.05, 1.0)
"""Range of `--speed`, a share of the recorded speed."""


def replay(
    file: Path,
    goals: bool = False,
    bus: str | None = None,
    speed: float | None = None,
    robot: str | None = None,
    report: Path | None = None,
    save: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Run a recording again: its sensor, servo and clock data through this version, and say which goals differ.

    With --goals nothing is computed: the robot goes slowly to the first of the recorded goals, then along them, then
    to rest; gate and guard check every goal. Exit code 0: all goals are the same, or were sent; 1: they differ, the
    recording is not whole, or the guard stopped; 2: a file that is no such recording.

    Arguments:
        file FILE.mcap: A recording of `retarget run --record`.

    Options:
        goals: Send the goals that were sent then, as they are, to --bus.
        bus mock|emulator|physics|physics+wire|none|profile|PORT: Bus of --goals, as of `run`.
        speed X: Speed of --goals; 1 is as fast as they were recorded.
        robot NAME|PATH: Use this robot as it is now, instead of that of then.
        report FILE.json|DIR: Write the numbers of the run as it is now.
        save FILE.npz: Write every tick of it, for other tools.
    """
    from retarget.pictures.outputs import Outputs
    from retarget.recording.cycles import now_of
    from retarget.recording.reading import read_recording

    if goals != (bus is not None):
        raise UsageError("goals need a bus, and nothing else does", where="--goals, --bus", next_step="Give both")
    if speed is not None and not goals:
        raise UsageError("only goals are sent slower", where="--speed", next_step="Leave it out, or add --goals")
    if goals and (report or save):
        raise UsageError("goals alone have no report", where="--report, --save", next_step="Leave them out")
    outputs = Outputs(report=report, save=save, overwrite=overwrite).checked()
    found = read_recording(file)
    cycles = found.cycles
    if found.damage:
        times = now_of(cycles)
        seconds = float(times[-1] - times[0])
        until = f"its first {seconds:.2f} s are read, up to cycle {cycles.index[-1]}"
        note(f"{found.path}: {found.damage}; {until}")
    if found.missing:
        note(f"{found.path}: {found.missing} ticks were never written: from there on goals may differ")
    if bus is not None:
        raise typer.Exit(_send(found, bus, 1.0 if speed is None else speed, robot))
    raise typer.Exit(_again(found, outputs, robot))


def _again(found: "Recording", outputs: "Outputs", robot: str | None) -> int:
    from retarget.recording.configs import as_recorded
    from retarget.recording.replay import replay as run_again
    from retarget.report.measure import measure
    from retarget.run.loop import Progress

    session = found.session
    with as_recorded(found, robot=robot) as configs:
        with progress_bar(session.robot, found.last_tick + 1) as show:
            again = run_again(found, configs, observers=[Progress(show)])
        for changed in again.changed:
            note(changed)
        echo(f"{found.path}: {session.source or 'a run'} on {configs.options.robot}, --bus {session.bus}")
        for line in again.difference.lines():
            echo(line)
        if again.result.reason and found.whole:
            echo(f"it stops again: {again.result.reason}")
        problems: tuple[str, ...] = ()
        if outputs.report or outputs.save:
            result = again.result if outputs.save is None else _with_its_body(again.result, configs, outputs.save)
            written = outputs.write(result, measure(result))
            problems = written.problems
            for what, path in written.files:
                echo(f"{what}: {path}")
    compared = again.difference.compared
    if not found.whole:
        problems = (f"{found.path}: only {compared} goals are in it and were compared: it is not whole", *problems)
    for problem in problems:
        echo(f"error: {problem}", err=True)
    return DONE if again.difference.none and not problems else STOPPED


def _with_its_body(run: "RunResult", configs: "Configs", save: Path) -> "RunResult":
    """The run, with its body written beside the saved file if only the recording has it."""
    from retarget.schema.files import write_atomic

    if run.robot is None or not configs.body_attached:
        return run
    profile = run.robot.profile
    body = save.with_name(f"{save.stem}_body{profile.body_path.suffix}")
    write_atomic(body, profile.body_path.read_bytes(), option="--save")
    profile = profile.model_copy(update={"body": str(body.resolve())})
    return replace(run, robot=replace(run.robot, profile=profile))


def _send(found: "Recording", bus: str, speed: float, robot: str | None) -> int:
    from retarget.recording.configs import as_recorded

    low, high = SPEEDS
    if not low <= speed <= high:
        raise UsageError("impossible speed", where="--speed", found=f"{speed:g}", allowed=f"{low:g} to {high:g}")
    options = found.session.options
    physics = options.physics if bus.startswith("physics") else PhysicsOptions()  # only a simulation has such options
    options = replace(options, bus=bus, physics=physics, gate=True)
    if robot is None and not (options.simulated or options.is_human):
        robot = options.robot  # real servos are those of the robot as it is now
    with as_recorded(found, options=options, robot=robot) as configs:
        for text in configs.notes:
            note(text)
        return _sent(found, configs.options, configs.robot, speed)


def _sent(found: "Recording", options: RunOptions, robot: "RobotBody | None", speed: float) -> int:
    from contextlib import ExitStack

    from retarget.cli.exit import detached_screens, stop_on_signals
    from retarget.cli.run import CommandRun
    from retarget.pictures.outputs import Outputs
    from retarget.recording.goal_playback import goal_playback
    from retarget.run.loop import Progress

    command = CommandRun(options, Outputs(), recorded=True)
    clock, make_bus = command.clock, command.bench.make_bus
    with detached_screens(), ExitStack() as signals:
        with goal_playback(
            found, options, speed=speed, clock=clock, make_bus=make_bus, notify=log, robot=robot
        ) as prepared:
            stop = signals.enter_context(stop_on_signals(moves=True))
            with progress_bar(options.robot, prepared.samples.recorded().ticks) as show:
                run = command.play(prepared, command.operator(prepared, stop), Progress(show))
        sent = run.record.robot
        assert sent is not None, "goals are a robot's"
        gated = int(sent.gated.sum())
        phases = [int((run.record.phase == phase).sum()) for phase in (Phase.APPROACH, Phase.BRAKE)]
        more = "{} during the approach and {} while braking and going to rest".format(*phases)
        echo(f"{run.ticks_followed} goals sent along the recording to --bus {options.bus}, {more}")
        echo(f"the gate changed {gated} of these {len(run.record)}")
        echo(f"end: {run.state}" + (f": {run.reason}" if run.reason else ""))
        return DONE if run.reason is None else STOPPED
