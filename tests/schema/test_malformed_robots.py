"""Malformed robot files, of `malformed_robots.yaml`, from the command line: exit code 2, one message, no open port."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from hardware.dynamixel.serial_port import SerialPort
from retarget import cli
from retarget.cli.exit import REFUSED
from retarget.live import receivers
from retarget.schema.catalogue import Kind, find

URDF = '<robot name="odd">{}</robot>'
LINK = (
    '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial></link>"
)
JOINT = (
    '<joint name="{0}_{1}" type="revolute"><parent link="{0}"/><child link="{1}"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)
BOMB = [b"a0: &a0 [x, x]", *(b"a%d: &a%d [*a%d, *a%d]" % (k, k, k - 1, k - 1) for k in range(1, 40)), b""]


def swapped(text: bytes, old: str, new: str) -> bytes:
    """Replace one piece of text."""
    assert old.encode() in text, f"the robot's file has no {old!r}"
    return text.replace(old.encode(), new.encode(), 1)


def write(folder: Path, change: str, value: Any) -> Path:
    """Write the OP3 into `folder` with one change of the table; its path."""
    valid = find(Kind.ROBOT, "op3")
    profile, body = valid.read_bytes(), (valid.parent / "body.xml").read_bytes()
    match change, value:
        case "whole", _:
            profile = value.encode()
        case "append", _:
            profile += value.encode("latin-1")
        case "profile", _:
            profile = swapped(profile, *value)
        case "body", _:
            body = swapped(body, *value)
        case "urdf", [links, *joints]:
            parts = [*map(LINK.format, links), *(JOINT.format(*pair) for pair in joints)]
            (folder / "body.urdf").write_text(URDF.format("".join(parts)), encoding="utf-8")
            profile = swapped(profile, "body: body.xml", "body: body.urdf")
        case "make", "huge":
            profile += b"#" * (1 << 20)
        case "make", "bomb":
            profile = b"\n".join(BOMB) + profile
        case "make", "outside":  # a valid body outside of the folder
            (folder / "here").mkdir()
            profile = swapped(profile, "body: body.xml", f"body: here/../../{folder.name}/body.xml")
    (folder / "body.xml").write_bytes(body)
    (folder / "robot.yaml").write_bytes(profile)
    return folder / "robot.yaml"


MALFORMED = yaml.safe_load(Path(__file__).with_name("malformed_robots.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("row", MALFORMED, ids=lambda row: row["name"])
def test_a_malformed_file_is_refused(
    row: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    ((change, value),) = ((key, row[key]) for key in row if key not in ("name", "reason"))
    opened: list[object] = []
    monkeypatch.setattr(SerialPort, "open", lambda self, baud: opened.append(baud))
    monkeypatch.setattr(receivers, "open_socket", opened.append)
    path = write(tmp_path, change, value)
    words = ["run", "--robot", str(path), "--source", "json://127.0.0.1:14150", "--bus", str(tmp_path / "port")]
    with pytest.raises(SystemExit) as leaving:
        cli.main(words)
    message = capsys.readouterr().err
    assert (leaving.value.code, opened) == (REFUSED, [])
    assert message.startswith("error: ") and row["reason"] in message
    assert "Traceback" not in message
