"""Rows of the fault table: malformed robot files, of `malformed.yaml`, and how each is judged: a run must refuse it
before it opens the performer's source or makes a bus."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import yaml

from hardware.clock import VirtualClock
from hardware.errors import RetargetError, TorqueError
from retarget.errors import InputError
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare_for
from retarget.schema.catalogue import Kind, find
from sim.faults.bench import ROBOT

Change = Callable[[bytes, Path], bytes]
"""From the valid file, and the folder of the new one, to the malformed file."""

_URDF = '<robot name="odd">{links}{joints}</robot>'
_LINK = (
    '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial></link>"
)
_JOINT = (
    '<joint name="{0}_{1}" type="revolute"><parent link="{0}"/><child link="{1}"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)


@dataclass(frozen=True)
class Malformed:
    """One malformed file. reason: what the refusal must name."""

    name: str
    change: Change
    reason: str

    def write(self, valid: Path, folder: Path) -> Path:
        """Write a robot into `folder`: that of the valid file `valid`, malformed. Return its path."""
        (folder / "body.xml").write_bytes((valid.parent / "body.xml").read_bytes())
        path = folder / "robot.yaml"
        path.write_bytes(self.change(valid.read_bytes(), folder))
        return path


def _swapped(old: str, new: str, text: bytes) -> bytes:
    """Replace one piece of text. Raises InputError where it is not there."""
    if old.encode() not in text:
        raise InputError("the robot's file has no such text", where="malformed files", found=old)
    return text.replace(old.encode(), new.encode(), 1)


def _with_body(old: str, new: str, valid: bytes, folder: Path) -> bytes:
    body = folder / "body.xml"
    body.write_bytes(_swapped(old, new, body.read_bytes()))
    return valid


def _with_urdf(links: str, joints: list[str], valid: bytes, folder: Path) -> bytes:
    text = _URDF.format(
        links="".join(_LINK.format(link) for link in links), joints="".join(_JOINT.format(*pair) for pair in joints)
    )
    (folder / "body.urdf").write_text(text, encoding="utf-8")
    return _swapped("body: body.xml", "body: body.urdf", valid)


def _bomb(valid: bytes, folder: Path) -> bytes:
    rows = [b"a0: &a0 [x, x]"] + [b"a%d: &a%d [*a%d, *a%d]" % (k, k, k - 1, k - 1) for k in range(1, 40)]
    return b"\n".join(rows) + b"\n" + valid


def _outside(valid: bytes, folder: Path) -> bytes:
    """Name a valid body outside of the folder."""
    (folder / "here").mkdir()
    return _swapped("body: body.xml", f"body: here/../../{folder.name}/body.xml", valid)


MADE: dict[str, Change] = {
    "huge": lambda valid, folder: valid + b"#" * (1 << 20),
    "bomb": _bomb,
    "outside": _outside,
}
CHANGES: dict[str, Callable[[Any], Change]] = {
    "whole": lambda text: lambda valid, folder: text.encode(),
    "append": lambda text: lambda valid, folder: valid + text.encode("latin-1"),
    "profile": lambda words: lambda valid, folder: _swapped(words[0], words[1], valid),
    "body": lambda words: partial(_with_body, *words),
    "urdf": lambda names: partial(_with_urdf, names[0], names[1:]),
    "make": MADE.__getitem__,
}
"""The changes of the table, by its keys."""


def _malformed(name: str, reason: str, **change: Any) -> Malformed:
    ((key, value),) = change.items()
    return Malformed(name, CHANGES[key](value), reason)


TABLE = Path(__file__).with_name("malformed.yaml")
MALFORMED: tuple[Malformed, ...] = tuple(
    _malformed(**entry) for entry in yaml.safe_load(TABLE.read_text(encoding="utf-8"))
)


BEGUN = "the run went on"


class _BegunError(Exception):
    """The run asked for the performer or the bus."""


def judged_file(file: Malformed) -> tuple[str, ...]:
    """Return the violations, a line each."""

    def begun(*_: object) -> NoReturn:
        raise _BegunError

    with tempfile.TemporaryDirectory() as folder:
        options = RunOptions(robot=str(file.write(find(Kind.ROBOT, ROBOT), Path(folder))))
        try:
            with prepare_for(begun, options, clock=VirtualClock(), make_bus=begun, goes_to_rest=True):
                return (BEGUN,)
        except _BegunError:
            return (BEGUN,)
        except TorqueError as error:
            return (f"not refused as a file: {error}",)
        except RetargetError as error:  # exit code 2, see `retarget.cli.exit`
            return () if file.reason in str(error) else (f"the refusal does not name {file.reason!r}: {error}",)
        except Exception as error:  # noqa: BLE001 - a traceback is what must not be
            return (f"it was not foreseen: {type(error).__name__}: {error}",)
