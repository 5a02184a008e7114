"""Where the zeros of a homed robot are kept: its own calibration, a file that was named, or nowhere."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import typer

from retarget.catalogue import calibration_path
from retarget.errors import UsageError
from retarget.options import RunOptions
from retarget.outputs import check_place, refuse_existing
from retarget.profile import RobotProfile
from retarget.servo_calibration import ServoCalibration, previous_path, write_calibration

_PSEUDO_TERMINAL = re.compile(r"/dev/pts/\d+")
"""What no adapter of real servos is, and every emulator on a port."""


@dataclass(frozen=True)
class HomedFile:
    """path: None: nothing is kept. own: it is what every later run reads. real: whether there are servos at all.

    looks: what looks like an emulator although a port was named; empty where nothing does.
    """

    path: Path | None
    own: bool
    real: bool
    looks: str = ""

    @classmethod
    def of(
        cls, profile: RobotProfile, options: RunOptions, out: Path | None, *, overwrite: bool = False
    ) -> "HomedFile":
        """overwrite: a file that was named and is there may be replaced; the robot's own calibration always may, as the
        one before is kept beside it. Raises UsageError for a file that cannot be written or is there, and for emulated
        servos as the robot's calibration."""
        usual = calibration_path(profile.name)
        own = out is None or out.resolve() == usual.resolve()
        if out is not None and not own:
            check_place(out, option="--out")
            if not overwrite:
                refuse_existing(out, option="--out")
        if not options.simulated:
            ports = [bus.port for bus in profile.bus_specs()] if options.bus == "profile" else [options.bus]
            looks = "; ".join(filter(None, map(_pseudo_terminal, ports)))
            return cls(usual if own else out, own, True, looks)
        if out is not None and own:
            raise UsageError(
                "what simulated servos say is no calibration of the robot",
                where="--out",
                found=str(out),
                next_step="Name another file",
            )
        return cls(out, False, False)

    @property
    def notice(self) -> str:
        """What a person has to know before anything is opened; empty where all is as usual."""
        if self.real:
            return "" if self.own else f"What is found is written to {self.path} alone."
        kept = "nothing is kept; --out FILE keeps it in a file" if self.path is None else f"only {self.path} is written"
        return f"These servos are simulated: everything is walked through, and {kept}."

    @property
    def doubts(self) -> list[str]:
        """Questions before the bus is opened."""
        if not self.looks or not self.own:
            return []
        return [f"{self.looks}. What an emulator says is no calibration of the real robot. Go on all the same?"]

    @property
    def promise(self) -> str:
        """The last line of a dry run."""
        if self.path is None:
            return "and keep nothing, because these servos are simulated; --out FILE keeps it in a file"
        return f"and, after a question, write {self.path}"

    def write(self, calibration: ServoCalibration, agree: Callable[[str], bool]) -> None:
        """Write the file if the person agrees, and say what became of it. Raises UsageError."""
        if self.path is None:
            typer.echo("nothing was kept: these servos are simulated; --out FILE keeps it in a file")
            return
        doubt = f", although {self.looks}" if self.looks and self.own else ""
        there = self.path.exists()
        replaced = ", which is there already" if there and not self.own else ""
        if not agree(f"Write this to {self.path}{replaced}{doubt}?"):
            typer.echo("nothing was written")
            return
        typer.echo(f"calibration: {write_calibration(calibration, None if self.own else self.path)}")
        if there and self.own:
            typer.echo(f"the one before: {previous_path(self.path)}")


def _pseudo_terminal(port: str) -> str:
    """What a port that looks like an emulator's leads to; empty for any other."""
    target = str(Path(port).resolve())
    if not _PSEUDO_TERMINAL.fullmatch(target):
        return ""
    return f"{port} leads to a pseudo-terminal ({target}) and looks like an emulator"
