"""`retarget servo home`: store the zero of each servo of a limp robot in a known posture."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import typer
from rich.table import Table

from hardware.arrays import BoolArray, FloatArray
from hardware.clock import MonotonicClock, VirtualClock, today
from hardware.dynamixel.serial_port import is_pseudo_terminal
from hardware.servo import Layout
from retarget.cli.application import answered, confirmed, console
from retarget.cli.buses import check_bus, make_bus
from retarget.cli.exit import echo
from retarget.errors import UsageError
from retarget.model.robot import RobotBody, load_uncalibrated
from retarget.run.options import RunOptions
from retarget.run.own_bus import is_own
from retarget.schema.catalogue import calibration_path
from retarget.schema.files import check_place, previous_path, refuse_existing
from retarget.schema.profile import RobotProfile
from retarget.schema.profile_parts import Postures
from retarget.schema.servo_calibration import (
    ServoCalibration,
    impossible_zeros,
    read_calibration,
    write_calibration,
)
from retarget.setup.homing import FAR, Homing, calibration_of, home_each, homed_columns
from retarget.setup.homing import home as home_servos


@dataclass(frozen=True)
class HomedFile:
    """The file of the zeros. path: None: nothing is kept. own: it is the calibration that later runs read. real: the
    servos are real. looks: a port that looks like an emulator's, in words, or "".
    """

    path: Path | None
    own: bool
    real: bool
    looks: str = ""

    @classmethod
    def of(
        cls, profile: RobotProfile, options: RunOptions, out: Path | None, *, overwrite: bool = False
    ) -> "HomedFile":
        """overwrite: a named file may be replaced. The robot's own calibration always may. Raises UsageError for a file
        that cannot be written or is there, and for simulated servos as the robot's own calibration."""
        check_bus(options.bus)
        if options.bus == "none":
            allowed = "profile, a port, emulator, mock"
            raise UsageError("there is no servo to read", where="--bus", found=options.bus, allowed=allowed)
        usual = calibration_path(profile.name)
        own = out is None or out.resolve() == usual.resolve()
        if out is not None and not own:
            check_place(out, option="--out")
            if not overwrite:
                refuse_existing(out, option="--out")
        if not options.simulated:
            ports = [bus.port for bus in profile.bus_specs()] if options.bus == "profile" else [options.bus]
            looks = "; ".join(
                f"{port} leads to a pseudo-terminal ({Path(port).resolve()}) and looks like an emulator"
                for port in ports
                if is_pseudo_terminal(port)
            )
            return cls(usual if own else out, own, True, looks)
        if out is not None and own:
            raise UsageError(
                "what simulated servos say is no calibration of the robot",
                where="--out",
                found=str(out),
                next_step="Name another file",
            )
        return cls(out, False, False)

    def write(self, calibration: ServoCalibration, agree: Callable[[str], bool]) -> None:
        """Write the file if the operator agrees. Raises UsageError."""
        if self.path is None:
            echo("nothing was kept: these servos are simulated; --out FILE keeps it in a file")
            return
        doubt = f", although {self.looks}" if self.looks and self.own else ""
        there = self.path.exists()
        replaced = ", which is there already" if there and not self.own else ""
        if not agree(f"Write this to {self.path}{replaced}{doubt}?"):
            echo("nothing was written")
            return
        echo(f"calibration: {write_calibration(calibration, None if self.own else self.path)}")
        if there and self.own:
            echo(f"the one before: {previous_path(self.path)}")


POSES = tuple(Postures.model_fields)


def home(
    robot: str,
    bus: str = "profile",
    pose: str = "neutral",
    joints: str = "",
    each: bool = False,
    force: bool = False,
    out: Path | None = None,
    overwrite: bool = False,
    dry_run: bool = False,
) -> None:
    """Find the zero of each servo: with torque off the operator places the robot in a known posture, and keeps it
    still.

    Opening the bus switches the servos' power on where a device does that, and brings servos without torque to the
    profile's settings. The zeros are shown, and written only when you agree; the last calibration is kept beside them.
    Emulated and mock servos stand in that posture already; of them nothing is kept, unless --out names a file.

    If you cannot hold the whole robot, home it with --each, joint after joint: the others may hang. It can be ended
    after any joint, and gone on with by --joints.

    Options:
        bus (--bus, --port) profile|PORT|emulator|mock: Ports of the profile, one port, an emulator, or module:Class.
        pose neutral|stand|rest|attractor: Posture of the profile to place it in.
        joints A,B,...: Only these, with commas between.
        each: Joint after joint.
        force: Also zeros more than 0.35 rad off the profile's.
        out FILE: Write this file, and not the robot's calibration.
        dry_run: Say what would be done, and touch nothing.
    """
    body = load_uncalibrated(robot)
    posture = _posture(body, pose)
    names = [name for name in joints.split(",") if name]
    chosen = homed_columns(body.joint_map, names)
    old = read_calibration(body.profile) if names or each else None  # of the joints that are not homed now
    options = RunOptions(robot=robot, bus=bus)
    file = HomedFile.of(body.profile, options, out, overwrite=overwrite)
    if dry_run:
        _print_plan(body, posture, chosen, options, file, pose)
        return
    homed = partial(home_each, choose=_choose, force=force) if each else partial(home_servos, name=pose)
    homing = _homed(body, options, file, pose, partial(homed, joint_map=body.joint_map, posture=posture, chosen=chosen))
    if homing is None:
        echo("nothing was written")
        return
    console().print(_table(body, homing))
    new = calibration_of(body.profile.name, body.joint_map, homing, posture, name=pose, date=today())
    if old is not None:
        new = ServoCalibration(robot=new.robot, servos=old.servos | new.servos)
    _refuse(body, homing, new, force=force)
    file.write(new, lambda question: _agree(question, False))
    left = ",".join(np.array(body.joint_map.joints)[chosen & ~homing.chosen])
    if left:
        echo(f"to go on: retarget servo home --robot {robot} --each --joints {left}")


def _homed(
    body: RobotBody, options: RunOptions, file: HomedFile, pose: str, homed: Callable[..., Homing | None]
) -> Homing | None:
    """Open the bus if the operator agrees, and home its servos by `homed`; else None."""
    doubts: list[str] = []
    if not file.real:
        kept = "nothing is kept; --out FILE keeps it in a file" if file.path is None else f"only {file.path} is written"
        echo(f"These servos are simulated: all steps run, and {kept}.")
    elif not file.own:
        echo(f"What is found is written to {file.path} alone.")
    elif file.looks:
        doubts = [f"{file.looks}. What an emulator says is no calibration of the real robot. Go on all the same?"]
    opening = [] if options.simulated else [f"The bus is opened: {_opening(body, options.bus)}. Go on?"]
    if not all(_agree(question, False) for question in [*doubts, *opening]):
        return None
    clock = VirtualClock() if options.simulated else MonotonicClock()
    with closing(make_bus(options.bus, body, clock, posture=pose)) as servos:
        servos.open()
        return homed(servos, confirm=_agree, notify=typer.echo, clock=clock)


def _agree(question: str, enter: bool) -> bool:
    return confirmed(question, enter=enter, where="servo home")


def _choose(question: str) -> str:
    while True:
        word = answered(f"{question}. ENTER reads it (s: leave it out, e: end): ", where="servo home").lower()
        if word in ("", "s", "e"):
            return word


def _print_plan(
    body: RobotBody, posture: FloatArray, chosen: BoolArray, options: RunOptions, file: HomedFile, pose: str
) -> None:
    bent = [f"{joint} {angle:g}" for joint, angle in zip(body.joint_map.joints, posture, strict=True) if angle]
    angles = f"{', '.join(bent)} rad, the others 0" if bent else "all joints at 0"
    echo(f"would open the bus {options.bus!r}: {_opening(body, options.bus)};")
    echo(f"then, after a question each, switch torque off on all {len(chosen)} servos,")
    echo(f"read {int(chosen.sum())} of them in the posture {pose!r}: {angles},")
    kept = "keep nothing, because these servos are simulated; --out FILE keeps it in a file"
    echo(f"and {kept}" if file.path is None else f"and, after a question, write {file.path}")


def _opening(body: RobotBody, bus: str) -> str:
    if is_own(bus):
        return f"{bus} does it"
    buses = body.profile.bus_specs()
    power = [f"device {bus.power.id} switches the servos' power on" for bus in buses if bus.power is not None]
    old = ", status return level" if Layout.OLDER in body.profile.layouts().values() else ""
    text = f"servos without torque get the profile's operating mode, return delay{old} (EEPROM) and gains (RAM)"
    return ", ".join([*power, text + " where they have others"])


def _posture(body: RobotBody, pose: str) -> FloatArray:
    if pose not in POSES:
        raise UsageError("unknown posture", where="--pose", found=repr(pose[:80]), allowed=", ".join(POSES))
    angles: FloatArray = body.posture(getattr(body.profile.postures, pose))[body.servo_columns]
    return angles


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
    """Raise UsageError for zeros that are far off (without --force), or that no servo can serve."""
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
