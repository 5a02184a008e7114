"""Judges what a run makes of a malformed robot file: refused before the performer is heard and a bus is made."""

import tempfile
from pathlib import Path

from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from hardware.errors import RetargetError, TorqueError
from retarget.catalogue import Kind, find
from retarget.options import RunOptions
from retarget.performer import Performer
from retarget.prepare import prepare_for
from retarget.robot_body import RobotBody
from retarget.samples import Performance
from sim.faults.bench import ROBOT
from sim.faults.malformed_files import Malformed

BEGUN = "the run went on"


class _BegunError(Exception):
    """The run asked for the performer or the bus."""


def judged_file(file: Malformed) -> tuple[str, ...]:
    """What was not as it has to be, a line each."""

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        raise _BegunError

    def bus(robot: RobotBody, clock: Clock) -> ServoBus:
        raise _BegunError

    with tempfile.TemporaryDirectory() as folder:
        path = file.write(find(Kind.ROBOT, ROBOT), Path(folder))
        try:
            with prepare_for(perform, RunOptions(robot=str(path)), clock=VirtualClock(), make_bus=bus, parks=True):
                return (BEGUN,)
        except _BegunError:
            return (BEGUN,)
        except TorqueError as error:
            return (f"not refused as a file: {error}",)
        except RetargetError as error:  # exit code 2, see `retarget.cli.boundary`
            return () if file.told in str(error) else (f"the refusal does not name {file.told!r}: {error}",)
        except Exception as error:  # noqa: BLE001 - a traceback is what must not be
            return (f"it was not foreseen: {type(error).__name__}: {error}",)
