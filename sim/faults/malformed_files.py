"""Rows of the fault table: malformed robot files. Each must be refused before a port is opened."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from retarget.errors import InputError

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


def _swap(old: str, new: str) -> Change:
    """Replace one piece of text."""

    def change(valid: bytes, folder: Path) -> bytes:
        if old.encode() not in valid:
            raise InputError("the robot's file has no such text", where="malformed files", found=old)
        return valid.replace(old.encode(), new.encode(), 1)

    return change


def _all(text: bytes) -> Change:
    """Replace the whole file."""
    return lambda valid, folder: text


def _more(text: bytes) -> Change:
    """Append text."""
    return lambda valid, folder: valid + text


def _body(old: str, new: str) -> Change:
    """Replace one piece of text of the body file."""

    def change(valid: bytes, folder: Path) -> bytes:
        body = folder / "body.xml"
        body.write_text(body.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
        return valid

    return change


def _urdf(links: str, *joints: str) -> Change:
    """Replace the body by a URDF of these links, and of joints named by parent and child."""

    def change(valid: bytes, folder: Path) -> bytes:
        text = _URDF.format(
            links="".join(_LINK.format(link) for link in links), joints="".join(_JOINT.format(*pair) for pair in joints)
        )
        (folder / "body.urdf").write_text(text, encoding="utf-8")
        return valid.replace(b"body: body.xml", b"body: body.urdf", 1)

    return change


def _bomb(valid: bytes, folder: Path) -> bytes:
    rows = [b"a0: &a0 [x, x]"] + [b"a%d: &a%d [*a%d, *a%d]" % (k, k, k - 1, k - 1) for k in range(1, 40)]
    return b"\n".join(rows) + b"\n" + valid


def _outside(valid: bytes, folder: Path) -> bytes:
    """Name a valid body outside of the folder."""
    (folder / "here").mkdir()
    return valid.replace(b"body: body.xml", b"body: here/../../" + folder.name.encode() + b"/body.xml", 1)


_HEAD = "head_pan:    {id: 19"
_HEAD_SERVO = (
    "head_pan:    {id: 19, model: XM430-W350, bus: main, direction: 1, zero_tick: 2048, limits: [-2.356194, 2.356194]"
)
_SPEED = "max_velocity: 4.5"
MALFORMED: tuple[Malformed, ...] = (
    Malformed("empty", _all(b""), "empty"),
    Malformed("not UTF-8", _more(b"\n# \xff\xfe\n"), "UTF-8"),
    Malformed("tab", _swap("  head_pan:", "\thead_pan:"), "not valid YAML"),
    Malformed("unclosed quote", _swap("name: op3", 'name: "op3'), "not valid YAML"),
    Malformed("over 1 MiB", _more(b"#" * (1 << 20)), "too large"),
    Malformed("alias bomb", _bomb, "anchor"),
    Malformed("tag", _swap("name: op3", "name: !!python/name:os.system op3"), "tag"),
    Malformed("duplicate key", _more(b"\nname: op4\n"), "duplicate key"),
    Malformed("unknown key", _more(b"\nnmae: op3\n"), "nmae"),
    Malformed("missing key", _swap("  rate_hz: 125", "  # rate_hz: 125"), "rate_hz"),
    Malformed("wrong type", _swap("  rate_hz: 125", "  rate_hz: fast"), "rate_hz"),
    Malformed("comma as decimal point", _swap(_SPEED, "max_velocity: '4,5'"), "max_velocity"),
    Malformed("NaN", _swap(_SPEED, "max_velocity: .nan"), "not finite"),
    Malformed("infinite", _swap(_SPEED, "max_velocity: .inf"), "not finite"),
    Malformed("no", _swap("  rate_hz: 125", "  rate_hz: no"), "rate_hz"),
    Malformed("012", _swap("l_hip_pitch: {id: 12", "l_hip_pitch: {id: 012"), "012"),
    Malformed("sexagesimal", _swap("  rate_hz: 125", "  rate_hz: 2:05"), "rate_hz"),
    Malformed("negative speed", _swap(_SPEED, "max_velocity: -4.5"), "max_velocity"),
    Malformed(
        "inverted limits",
        _swap(_HEAD_SERVO, _HEAD_SERVO.replace("[-2.356194, 2.356194]", "[2.356194, -2.356194]")),
        "inverted",
    ),
    Malformed("home outside limits", _swap("{l_sho_pitch: -0.3,", "{l_sho_pitch: -3.2,"), "stand.l_sho_pitch"),
    Malformed("degrees for radians", _swap(_HEAD_SERVO, _HEAD_SERVO.replace("2.356194", "90")), "head_pan"),
    Malformed("duplicate id", _swap(_HEAD, "head_pan:    {id: 20"), "20"),
    Malformed("id 254", _swap(_HEAD, "head_pan:    {id: 254"), "254"),
    Malformed("unknown joint", _swap("head_pan:    {id", "head_pam:    {id"), "head_pam"),
    Malformed("cycle", _urdf("abcd", "ab", "bc", "cd", "db"), "the body cannot be used"),
    Malformed("two roots", _urdf("abcd", "ab", "cd"), "no single root"),
    Malformed("axis of zeros", _body('name="head_pan" axis="0 0 1"', 'name="head_pan" axis="0 0 0"'), "axis too small"),
    Malformed(
        "bad quaternion", _swap("pos: [0, 0, -0.0285]}", "pos: [0, 0, -0.0285], quat: [0, 0, 0, 0]}"), "quaternion"
    ),
    Malformed("sign 0", _swap("direction: 1", "direction: 0"), "direction"),
    Malformed("path traversal", _outside, "leaves the profile's folder"),
)
