"""URDF files with what no servo drives, without mass, and with meshes here, elsewhere and nowhere."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest

from messages import Facts, refuses, shows
from retarget.errors import InputError
from retarget.setup.body_draft import BodyDraft, draft_body
from retarget.setup.robot_file import Relaxed, read_source, stated_speeds
from unknown_robots import HUMANOID, Part, humanoid

FOOT = '<box size="0.07 0.14 0.02"/>'


def finger(**changes: str) -> Part:
    return Part("finger", "q9", (0, 0.1, 0), (0, 0, 1), (0, 1), (0.01, 0.03, 0.01), **changes)  # type: ignore[arg-type]


def drafted(text: str, folder: Path, *, freeze: bool = False, no_meshes: bool = False) -> BodyDraft:
    path = folder / "body.urdf"
    path.write_text(text, encoding="utf-8")
    return draft_body(read_source(path), Relaxed(freeze=freeze, no_meshes=no_meshes))


def stl(size: tuple[float, float, float]) -> bytes:
    """A box as a binary STL."""
    corners = np.array(np.meshgrid(*[[-0.5 * side, 0.5 * side] for side in size])).reshape(3, -1).T
    faces = [
        (0, 1, 3),
        (0, 3, 2),
        (4, 6, 7),
        (4, 7, 5),
        (0, 4, 5),
        (0, 5, 1),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
    ]
    faces += [(1, 5, 7), (1, 7, 3)]
    triangles = [struct.pack("<12fH", 0, 0, 0, *corners[list(face)].ravel().tolist(), 0) for face in faces]
    return b"\0" * 80 + struct.pack("<I", len(faces)) + b"".join(triangles)


@pytest.mark.parametrize("kind", ["mimic", "planar", "floating", "prismatic"])
def test_joints_that_no_servo_drives(kind: str, tmp_path: Path) -> None:
    part = finger(extra='<mimic joint="j_q8"/>') if kind == "mimic" else finger(kind=kind)
    text = humanoid([*HUMANOID, part])
    with refuses(InputError, kind, "j_finger", "--freeze"):
        drafted(text, tmp_path)
    body = drafted(text, tmp_path, freeze=True)
    assert body.model.njnt == len(HUMANOID) and body.model.body("finger").id > 0
    assert body.notes == (f"{kind} joints made rigid: j_finger",) and body.file == "body.xml"


def test_a_place_that_is_no_number(tmp_path: Path) -> None:
    text = humanoid([*HUMANOID, finger()])
    at = re.search(r'<joint name="j_finger".*?xyz="([^"]*)"', text, re.DOTALL)
    assert at is not None
    for wrong in ("0 nan 0", "0 inf 0"):
        with refuses(InputError):
            drafted(text[: at.start(1)] + wrong + text[at.end(1) :], tmp_path)


def test_a_joint_of_no_known_type(tmp_path: Path) -> None:
    with refuses(InputError, "j_finger", "'rubber'"):
        drafted(humanoid([*HUMANOID, finger(kind="rubber")]), tmp_path)


def test_all_problems_are_reported_at_once(tmp_path: Path) -> None:
    text = re.sub("<inertial>.*?</inertial>", "", humanoid([*HUMANOID, finger(kind="planar")]))
    with refuses(InputError, 2):
        drafted(text, tmp_path)


def test_without_any_mass(tmp_path: Path) -> None:
    with refuses(InputError, 22):
        drafted(re.sub("<inertial>.*?</inertial>", "", humanoid()), tmp_path)


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        (r"<inertia [^>]*/>", "", ("<inertia>", "chest")),
        (r'ixx="[^"]*"', 'ixx="heavy"', ("<inertia>", "chest")),
        (r'<mass value="[^"]*"', '<mass value="nan"', ("<mass>", 0, "chest")),
        (r'<mass value="[^"]*"', '<mass value="-1"', ("<mass>", 0, "chest")),
        (r"<mass [^>]*/>", "", ("<mass>", 0, "chest")),
    ],
)
def test_an_invalid_inertia_is_reported_with_its_link(wrong: str, right: str, message: Facts, tmp_path: Path) -> None:
    """Not in the words of a parser, which knows no links."""
    with refuses(InputError, message):
        drafted(re.sub(wrong, right, humanoid(), count=1), tmp_path)


def test_a_mass_of_nothing_everywhere(tmp_path: Path) -> None:
    with refuses(InputError, 22, "<inertial>", 0):
        drafted(re.sub(r'<mass value="[^"]*"', '<mass value="0"', humanoid()), tmp_path)


def test_one_link_without_mass_has_a_note(tmp_path: Path) -> None:
    body = drafted(re.sub("<inertial>.*?</inertial>", "", humanoid(), count=1), tmp_path)
    assert body.notes == ("links with a shape but without <inertial> weigh nothing here: chest",)


def test_a_plain_urdf_is_copied_as_it_is(tmp_path: Path) -> None:
    body = drafted(humanoid(), tmp_path)
    assert body.file == "body.urdf" and body.content == humanoid().encode() and not body.notes


def test_meshes_that_are_missing(tmp_path: Path) -> None:
    text = humanoid().replace(FOOT, '<mesh filename="package://r/meshes/foot.stl"/>')
    with refuses(InputError, "package://r/meshes/foot.stl", "--no-meshes"):
        drafted(text, tmp_path)
    body = drafted(text, tmp_path, no_meshes=True)
    shows(body.notes[0], "package://r/meshes/foot.stl")
    assert body.model.ngeom == len(HUMANOID) + 1 - 2


@pytest.mark.parametrize("name", ["foot.stl", "meshes/foot.stl", "package://r/meshes/foot.stl", "file://{}/foot.stl"])
def test_meshes_that_are_found_become_simple_shapes(name: str, tmp_path: Path) -> None:
    """A mesh beside the file, below it, or in its package; what is written needs no other file."""
    folder = tmp_path / "r" / "urdf"
    folder.mkdir(parents=True)
    for place in (folder, folder / "meshes", tmp_path / "r" / "meshes"):
        place.mkdir(exist_ok=True)
        (place / "foot.stl").write_bytes(stl((0.07, 0.14, 0.02)))
    body = drafted(humanoid().replace(FOOT, f'<mesh filename="{name.format(folder)}"/>'), folder)
    plain = drafted(humanoid(), tmp_path)
    assert b"<mesh" not in body.content and b"foot.stl" not in body.content
    assert body.model.nmesh == 2 and body.model.body_mass == pytest.approx(plain.model.body_mass)
    assert body.notes == ("meshes of 2 links are capsules and boxes around them in the body that is written",)


def test_a_picture_that_is_missing_is_no_loss(tmp_path: Path) -> None:
    shown = '<visual><geometry><mesh filename="nice.dae"/></geometry></visual></link>'
    body = drafted(humanoid().replace("</link>", shown), tmp_path)
    assert body.model.ngeom == len(HUMANOID) + 1


@pytest.mark.parametrize("first", [True, False], ids=["before the other shape", "after it"])
def test_a_dropped_collision_mesh_is_reported_with_its_link(first: bool, tmp_path: Path) -> None:
    """Of a link that has another shape; the picture of another link goes without a word."""
    mesh = '<collision><geometry><mesh filename="gone/foot.stl"/></geometry></collision>'
    shape = re.search(r"<collision>(?:(?!</collision>).)*" + re.escape(FOOT) + ".*?</collision>", humanoid(), re.DOTALL)
    assert shape is not None
    text = humanoid().replace(shape[0], mesh + shape[0] if first else shape[0] + mesh, 1)
    shown = '<visual><geometry><mesh filename="nice.dae"/></geometry></visual></link>'
    body = drafted(text.replace("</link>", shown), tmp_path)
    left_out = "collision meshes that cannot be read are left out, these links have other shapes: "
    assert body.notes == (f"{left_out}p5 (gone/foot.stl)",)
    assert body.model.ngeom == len(HUMANOID) + 1


def test_speeds_that_are_stated(tmp_path: Path) -> None:
    path = tmp_path / "body.urdf"
    path.write_text(
        humanoid().replace('velocity="5.0"', 'velocity="fast"', 1).replace('velocity="5.0"', 'velocity="0"', 1)
    )
    speeds = stated_speeds(read_source(path))
    assert len(speeds) == len(HUMANOID) - 2 and set(speeds.values()) == {5.0}
