"""`retarget servo stiffness`: measure the stiffness of a servo on the robot, by held goals under a known load."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import typer

from hardware.guard_state import StopCause
from hardware.servo import DEFAULT_P_GAIN, p_gain
from retarget.cli.application import progress_bar
from retarget.cli.exit import detached_screens, echo, stop_on_signals
from retarget.cli.servo.places import agreed
from retarget.errors import InputError, UsageError
from retarget.human.samples import Playback
from retarget.model.robot import RobotBody, load_robot
from retarget.run.options import PHYSICS, PhysicsOptions, RunOptions
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.schema.catalogue import Kind, shipped_folder, user_folder
from retarget.setup.servo_stiffness import HeldGoals, Hung, MeasuredStiffness, held_goals, measured

WEIGHTS_KG = (0.05, 5.0)
"""[kg] Range of a weight: less is not seen, and no servo of the table carries more."""


def stiffness(
    robot: str,
    joint: str,
    bus: str = "profile",
    weight: float | None = None,
    at: str | None = None,
    yes: bool = False,
    dry_run: bool = False,
) -> None:
    """Measure how stiff a servo is: its joint is held at several goals, and stays behind them by load / stiffness.

    The robot hangs or is bolted down, trunk upright and still, limbs free. All joints go slowly to `stand`, one through
    its range and back, all to `rest`; gate and guard check every goal, and Ctrl-C brakes, as in a run. The load is what
    the limb weighs by the body file, and what hangs on it. Writes nothing: what belongs into the profile is shown.

    Options:
        joint NAME: Joint of the servo: a hip's pitch bears the whole leg.
        bus (--bus, --port) profile|PORT|emulator|physics|physics+wire: Ports of the profile, one port, or simulated
            servos.
        weight KG: Object that hangs on the limb.
        at FRAME: Frame of the profile at which it hangs.
        dry_run: Say what would be done, and touch nothing.
    """
    options = _options(robot, bus)
    body = load_robot(robot, root="fixed")
    hung = _hung(body, weight, at)
    held = held_goals(body, joint, hung, dt=1.0 / body.profile.safety.rate_hz)
    (low, high), (least, most), servo = held.range, held.torques, held.servo
    echo(
        f"{servo.label}, {servo.model.name}: {low:.2f} to {high:.2f} rad and back, load {least:.2f} to {most:.2f} N m; "
        "all other joints stand"
    )
    if dry_run:
        echo("dry run: nothing was moved")
        return
    if not options.simulated and not agreed(
        "The robot hangs, its trunk is upright and held still, its limbs are free, a power cut is within reach. Go on?",
        yes=yes,
    ):
        return
    run = _play(body, options, held, hung)
    record, sent = run.record, run.record.robot
    if run.reason is not None or sent is None:
        soft = run.stop is not None and run.stop.cause is StopCause.FOLLOWING_ERROR
        lighter = f". {joint} may be softer than expected: take a joint that carries less" if soft else ""
        echo(f"no measurement: {run.reason}{lighter}", err=True)
        raise typer.Exit(1)
    rows = record.phase == Phase.FOLLOW
    goals = body.joint_map.to_radians(sent.goal_ticks[rows])
    found = measured(body, held, goals, sent.present[rows], hung, dt=1.0 / body.profile.safety.rate_hz)
    if found is None:
        echo("no measurement: the shaft does not stay behind its goals in proportion to the load", err=True)
        raise typer.Exit(1)
    voltage = float(sent.voltage[rows, held.column].mean())
    for line in _result(body, held, found, voltage):
        echo(line)


def _options(robot: str, bus: str) -> RunOptions:
    """The run of a measurement. Emulated servos carry no load, so a simulated body turns their shafts."""
    bus = "physics+wire" if bus == "emulator" else bus
    if bus in ("mock", "none"):
        allowed = "profile, a port, emulator, physics, physics+wire"
        raise UsageError("these servos carry nothing", where="--bus", found=bus, allowed=allowed)
    physics = PhysicsOptions(mount="stand") if bus in PHYSICS else PhysicsOptions()
    return RunOptions(robot=robot, bus=bus, physics=physics)


def _hung(body: RobotBody, weight: float | None, frame: str | None) -> Hung | None:
    if (weight is None) != (frame is None):
        raise UsageError("a weight hangs somewhere", where="--weight, --at", next_step="Give both, or none")
    if weight is None or frame is None:
        return None
    low, high = WEIGHTS_KG
    if not low <= weight <= high:
        raise UsageError("impossible weight", where="--weight", found=f"{weight:g}", allowed=f"{low:g} to {high:g} kg")
    if frame not in body.profile.frames:
        raise UsageError("no such frame", where="--at", found=repr(frame[:80]), allowed=", ".join(body.profile.frames))
    return Hung(weight, frame)


def _play(body: RobotBody, options: RunOptions, held: HeldGoals, hung: Hung | None) -> RunResult:
    """Play the goals as a run plays recorded ones. Nothing follows the performer."""
    from retarget.cli.run import CommandRun
    from retarget.pictures.outputs import Outputs
    from retarget.recording.goal_playback import held_performance, playing_back
    from retarget.run.loop import Progress
    from retarget.run.prepare import performance_of
    from sim.performer import synthetic_performer

    recorded = performance_of(synthetic_performer, Playback())
    command = CommandRun(options, Outputs(), recorded=True)
    with detached_screens(), ExitStack() as signals:
        prepared = signals.enter_context(
            command.prepared(
                lambda performer, robot: held_performance(recorded(performer, robot), len(held.goals)), robot=body
            )
        )
        if prepared.machine is None:
            raise InputError("a human has no servos", where="--robot")
        if hung is not None:
            command.bench.hang(hung.mass, hung.frame)
            # The weight is a press to a contact detector, which knows the body file alone.
            prepared = replace(prepared, machine=replace(prepared.machine, contact=None))
        stop = signals.enter_context(stop_on_signals(moves=True))
        prepared = playing_back(prepared, held.goals)
        with progress_bar(options.robot, len(held.goals)) as show:
            return command.play(prepared, command.operator(prepared, stop), Progress(show))


def _result(body: RobotBody, held: HeldGoals, found: MeasuredStiffness, voltage: float) -> list[str]:
    servo, planned = held.servo, body.profile
    table, gain = servo.model.stiffness, servo.gains.position_p
    of_gain = table.scaled(p_gain(servo) / DEFAULT_P_GAIN)
    within = "within" if of_gain.lowest <= found.value <= of_gain.highest else "outside of"
    p = "" if gain is None else f", p: {gain}"
    entry = f"{{nominal: {found.value:.3g}, range: [{found.lowest:.3g}, {found.highest:.3g}]{p}}}"
    return [
        f"stiffness: {found.value:.1f} N m/rad ({found.lowest:.1f} to {found.highest:.1f}), friction "
        f"{found.friction:.2f} N m, from {found.count} held goals at {voltage:.1f} V",
        f"goals are planned for {of_gain.nominal:.1f}; this is {within} the expected {of_gain.lowest:.1f} to "
        f"{of_gain.highest:.1f}",
        f"into {_written_into(planned.path)}:",
        "stiffness:",
        f"  {servo.model.name}: {entry}",
    ]


def _written_into(profile: Path) -> str:
    """The profile to edit, in words. A shipped one is copied first."""
    if not profile.is_relative_to(shipped_folder()):
        return str(profile)
    folder = profile.parent
    return f"{profile.name} of a copy of {folder}, which takes its place in {user_folder() / Kind.ROBOT.value}"
