"""`retarget servo home`: a person places the limp robot in a posture, and the zero of each servo is written down."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from hardware.arrays import BoolArray, FloatArray
from hardware.bus import ServoBus
from hardware.clock import Clock, MonotonicClock, VirtualClock, today
from retarget.cli.ask import ask
from retarget.cli.buses import make_bus
from retarget.cli.overwrite import Overwrite
from retarget.cli.servo.homed_file import HomedFile
from retarget.errors import UsageError
from retarget.homing import FAR, Homing, calibration_of, homed_columns
from retarget.homing import home as home_servos
from retarget.options import RunOptions
from retarget.profile_parts import Postures
from retarget.robot_body import RobotBody, load_uncalibrated
from retarget.servo_calibration import ServoCalibration, impossible_zeros, read_calibration

POSES = tuple(Postures.model_fields)


def home(
    robot: Annotated[str, typer.Option(help="Robot by name or path.", metavar="NAME|PATH")],
    bus: Annotated[
        str,
        typer.Option(
            "--bus",
            "--port",
            help="Ports of the profile, one port, or an emulator.",
            metavar="profile|PORT|emulator|mock",
        ),
    ] = "profile",
    pose: Annotated[
        str, typer.Option(help="Posture of the profile to place it in.", metavar="|".join(POSES))
    ] = "neutral",
    joints: Annotated[str, typer.Option(help="Only these, with commas between.", metavar="A,B,...")] = "",
    force: Annotated[bool, typer.Option("--force", help=f"Also zeros more than {FAR} rad off the profile's.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Write this file, and not the robot's calibration.", metavar="FILE")
    ] = None,
    overwrite: Overwrite = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be done, and touch nothing.")] = False,
) -> None:
    """Find the zero of each servo: with torque off a person places the robot in a known posture, and keeps it still.

    Opening the bus switches the servos' power on where a device does that, and brings servos without torque to the
    profile's settings. What is read is shown, and written only when you agree; the last calibration is kept beside it.
    Of an emulator or mock servos nothing is kept, unless --out names a file.
    """
    body = load_uncalibrated(robot)
    posture = _posture(body, pose)
    names = [name for name in joints.split(",") if name]
    chosen = homed_columns(body.joint_map, names)
    old = _old(body, names)
    options = RunOptions(robot=robot, bus=bus)
    _refuse_no_bus(bus)
    file = HomedFile.of(body.profile, options, out, overwrite=overwrite)
    if dry_run:
        _say_all(body, posture, chosen, options, file, pose)
        return

    def agree(question: str, enter: bool) -> bool:
        return ask(question, enter=enter or options.simulated, where="servo home")

    if file.notice:
        typer.echo(file.notice)
    opening = [] if options.simulated else [f"The bus is opened: {_opening(body)}. Go on?"]
    if not all(agree(question, False) for question in [*file.doubts, *opening]):
        typer.echo("nothing was written")
        return
    clock = VirtualClock() if options.simulated else MonotonicClock()
    homing = _read(make_bus(bus, body, clock), body, posture, agree, clock=clock, chosen=chosen, pose=pose)
    if homing is None:
        typer.echo("nothing was written")
        return
    Console().print(_table(body, homing))
    new = calibration_of(body.profile.name, body.joint_map, homing, posture, name=pose, date=today())
    if old is not None:
        new = ServoCalibration(robot=new.robot, servos=old.servos | new.servos)
    _refuse(body, homing, new, force=force)
    file.write(new, lambda question: agree(question, False))


def _refuse_no_bus(bus: str) -> None:
    if bus == "none":
        raise UsageError(
            "there is no servo to read", where="--bus", found=bus, allowed="profile, a port, emulator, mock"
        )


def _say_all(
    body: RobotBody, posture: FloatArray, chosen: BoolArray, options: RunOptions, file: HomedFile, pose: str
) -> None:
    """What would be done."""
    typer.echo(f"would open the bus {options.bus!r}: {_opening(body)};")
    typer.echo(f"then, after a question each, switch torque off on all {len(chosen)} servos,")
    typer.echo(f"read {int(chosen.sum())} of them in the posture {pose!r}: {_angles(body, posture)},")
    typer.echo(file.promise)


def _opening(body: RobotBody) -> str:
    """What opening the bus of a robot does to its servos."""
    buses = body.profile.bus_specs()
    power = [f"device {bus.power.id} switches the servos' power on" for bus in buses if bus.power is not None]
    old = ", status return level" if any(bus.protocol == 1 for bus in buses) else ""
    text = f"servos without torque get the profile's operating mode, return delay{old} (EEPROM) and gains (RAM)"
    return ", ".join([*power, text + " where they have others"])


def _read(
    bus: ServoBus,
    body: RobotBody,
    posture: FloatArray,
    agree: Callable[[str, bool], bool],
    *,
    clock: Clock,
    chosen: BoolArray,
    pose: str,
) -> Homing | None:
    """Open the bus, home, close it whatever happens."""
    try:
        bus.open()
        return home_servos(bus, body.joint_map, posture, agree, typer.echo, clock=clock, chosen=chosen, name=pose)
    finally:
        bus.close()


def _posture(body: RobotBody, pose: str) -> FloatArray:
    """Angles (n,) of a posture of the profile. Raises UsageError for an unknown one."""
    if pose not in POSES:
        raise UsageError("unknown posture", where="--pose", found=repr(pose[:80]), allowed=", ".join(POSES))
    angles: FloatArray = body.posture(getattr(body.profile.postures, pose))[body.servo_columns]
    return angles


def _old(body: RobotBody, names: list[str]) -> ServoCalibration | None:
    """The calibration of the joints that are not homed now; one of another robot is replaced only as a whole."""
    return read_calibration(body.profile) if names else None


def _angles(body: RobotBody, posture: FloatArray) -> str:
    bent = [f"{joint} {angle:g}" for joint, angle in zip(body.joint_map.joints, posture, strict=True) if angle]
    return (", ".join(bent) + " rad, the others 0") if bent else "all joints at 0"


def _table(body: RobotBody, homing: Homing) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in ("joint", "id", "tick", "zero", "profile's zero", "off by, rad", ""):
        table.add_column(heading, justify="left" if heading == "joint" else "right")
    for index, servo in enumerate(body.joint_map.servos):
        if homing.chosen[index]:
            numbers = (servo.id, homing.ticks[index], homing.zero[index], servo.zero_tick)
            mark = "far off" if homing.far[index] else ""
            table.add_row(servo.joint, *map(str, numbers), f"{homing.off[index]:+.3f}", mark)
    return table


def _refuse(body: RobotBody, homing: Homing, new: ServoCalibration, *, force: bool) -> None:
    """Raise UsageError for zeros that nobody asked for, or that no servo can serve."""
    servos = body.joint_map.servos
    if homing.far.any() and not force:
        names = ", ".join(
            f"{servos[index].joint} {homing.off[index]:+.3f} rad" for index in np.flatnonzero(homing.far).tolist()
        )
        raise UsageError(
            f"far from the profile's zero, by more than {FAR} rad",
            where="servo home",
            found=names,
            next_step="Was the robot in the posture, and are ids and directions right? If so: --force",
        )
    impossible = impossible_zeros(servos, new)
    if impossible:
        raise UsageError(
            "with these zeros the servos cannot reach the joints' limits",
            where="servo home",
            found="; ".join(text for _, text in impossible),
            next_step="Turn the horns of these servos on their shafts, or narrow the limits in the profile",
        )
