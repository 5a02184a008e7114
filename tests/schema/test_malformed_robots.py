"""Malformed robot files, of `malformed_robots.yaml`, from the command line: exit code 2, one message, no open port."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml

from hardware.dynamixel.serial_port import SerialPort
from retarget import cli
from retarget.cli.exit import REFUSED
from retarget.live import receivers
from retarget.schema.catalogue import Kind, find

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
    """Replace one piece of text."""
    assert old.encode() in text, f"the robot's file has no {old!r}"
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


TABLE = Path(__file__).with_name("malformed_robots.yaml")
MALFORMED: tuple[Malformed, ...] = tuple(
    _malformed(**entry) for entry in yaml.safe_load(TABLE.read_text(encoding="utf-8"))
)


@pytest.mark.parametrize("file", MALFORMED, ids=lambda one: one.name)
def test_a_malformed_file_is_refused(
    file: Malformed, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[object] = []
    monkeypatch.setattr(SerialPort, "open", lambda self, baud: opened.append(baud))
    monkeypatch.setattr(receivers, "open_socket", opened.append)
    path = file.write(find(Kind.ROBOT, "op3"), tmp_path)
    words = ["run", "--robot", str(path), "--source", "json://127.0.0.1:14150", "--bus", str(tmp_path / "port")]
    with pytest.raises(SystemExit) as leaving:
        cli.main(words)
    message = capsys.readouterr().err
    assert (leaving.value.code, opened) == (REFUSED, [])
    assert message.startswith("error: ") and file.reason in message
    assert "Traceback" not in message
