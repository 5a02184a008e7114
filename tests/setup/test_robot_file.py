"""Body files that are broken, hostile or something else: one message each, and nothing that hangs."""

import re
import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest

from messages import Facts, refuses
from retarget.errors import InputError
from retarget.setup.robot_file import MAX_DEPTH, find_mesh, mesh_content, read_source
from unknown_robots import humanoid

LAUGHS = '<!DOCTYPE a [<!ENTITY x "ha"><!ENTITY y "&x;&x;&x;">]><robot name="&y;"/>'
BAD: dict[str, tuple[str, Facts]] = {
    "broken": (humanoid()[:500], "XML"),
    "text": ("hello", "XML"),
    "binary": ("\x00\x01\x02", "XML"),
    "svg": ("<svg/>", ("URDF", "MJCF", "<svg>")),
    "entities": (LAUGHS, ()),
    "external": ('<!DOCTYPE a SYSTEM "http://localhost/a.dtd"><robot/>', ()),
    "deep": ("<mujoco>" + "<body>" * (MAX_DEPTH + 1), MAX_DEPTH),
    "xacro": ('<robot xmlns:xacro="x"><xacro:macro name="a"></robot>', "xacro robot.xacro"),
    "xacro without its name": ('<robot><xacro:include filename="a"/></robot>', "xacro robot.xacro"),
    "xacro that is sound XML": (
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="a"/></robot>',
        ("<xacro:include>", "xacro robot.xacro"),
    ),
    "itself": ('<mujoco><include file="body.xml"/></mujoco>', ()),
    "absent": ('<mujoco><include file="other.xml"/></mujoco>', "other.xml"),
    "device": ('<mujoco><include file="/dev/zero"/></mujoco>', "/dev/zero"),
    "empty": ("", 0),
    "links": ("<robot>" + 3000 * '<link name="a"/>' + "</robot>", 3000),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_refused(case: str, tmp_path: Path) -> None:
    path = tmp_path / "body.xml"
    path.write_text(BAD[case][0], encoding="utf-8")
    with refuses(InputError, BAD[case][1]) as caught:
        read_source(path)
    assert len(caught.value.problems) == 1


def test_a_urdf_that_xacro_made_keeps_the_name_of_xacro(tmp_path: Path) -> None:
    path = tmp_path / "body.urdf"
    path.write_text('<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a"/>')
    assert read_source(path).name == "a"


def test_entities_are_found_in_any_encoding(tmp_path: Path) -> None:
    path = tmp_path / "body.urdf"
    path.write_bytes(('<?xml version="1.0" encoding="utf-16"?>' + LAUGHS).encode("utf-16"))
    with refuses(InputError):
        read_source(path)


@pytest.mark.parametrize("name", ["nosuch.urdf", ".", "/dev/zero", "a" * 5000, "a\0b"])
def test_what_is_no_file(name: str, tmp_path: Path) -> None:
    with refuses(InputError, varies=re.compile("a{9,}")):
        read_source(tmp_path / name if name != "/dev/zero" else Path(name))


def test_includes_that_include(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text('<mujoco><include file="b.xml"/></mujoco>')
    (tmp_path / "b.xml").write_text(f"<mujoco><worldbody><body/></worldbody>{'<!-- -->' * 3}</mujoco>")
    assert read_source(tmp_path / "a.xml").included
    (tmp_path / "b.xml").write_text(LAUGHS)
    with refuses(InputError, where="b.xml"):
        read_source(tmp_path / "a.xml")


def test_kind_and_name_are_by_content(tmp_path: Path) -> None:
    path = tmp_path / "thing.xml"
    path.write_text(humanoid())
    source = read_source(path)
    assert (source.kind, source.name, source.included) == ("urdf", "stranger", False)
    path.write_text("<mujoco/>")
    source = read_source(path)
    assert (source.kind, source.name) == ("mjcf", "thing")


TETRAHEDRON = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]])
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))


def text_stl() -> str:
    """As exporters write it."""
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {:e} {:e} {:e}\n".format(*TETRAHEDRON[corner]) for corner in face)
        + "endloop\nendfacet\n"
        for face in FACES
    )
    return f"solid made by hand\n{facets}endsolid made by hand\n"


def binary_stl(head: bytes = b"") -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *TETRAHEDRON[list(face)].ravel(), 0) for face in FACES]
    return head.ljust(80, b"\0") + struct.pack("<I", len(rows)) + b"".join(rows)


def compiled(content: bytes) -> mujoco.MjModel:
    text = '<mujoco><asset><mesh file="m.stl"/></asset><worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>'
    return mujoco.MjModel.from_xml_string(text, assets={"m.stl": content})


def test_an_stl_of_text_is_read_as_one_of_bytes(tmp_path: Path) -> None:
    """MuJoCo itself refuses it."""
    (tmp_path / "m.STL").write_text(text_stl())
    with refuses(ValueError, "ASCII"):
        compiled(text_stl().encode())
    found = find_mesh("m.STL", tmp_path / "body.urdf")
    assert found is not None and found.name == "m.STL"
    read, plain = compiled(mesh_content(found)), compiled(binary_stl())
    assert read.nmeshvert == 4 and read.mesh_vert == pytest.approx(plain.mesh_vert)


@pytest.mark.parametrize(
    "content", [binary_stl(), binary_stl(b"solid of bytes all the same"), b"solid\nvertex 1 2 x", b"solid", b"no mesh"]
)
def test_all_else_stays_as_it_is(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "m.stl").write_bytes(content)
    found = find_mesh("m.stl", tmp_path / "body.urdf")
    assert found is not None and mesh_content(found) == content


@pytest.mark.parametrize("name", ["m.dae", "package://robot/meshes/m.dae", "model://robot/meshes/m.dae"])
def test_of_another_kind_the_one_beside_it_is_read(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "robot" / "meshes"
    folder.mkdir(parents=True)
    body = folder / "body.urdf"
    (folder / "m.dae").write_text("<COLLADA/>")
    assert find_mesh(name, body) is None
    (folder / "m.obj").write_text("v 0 0 0\n")
    found = find_mesh(name, body)
    assert found is not None and found.name == "m.obj"


@pytest.mark.parametrize("name", ["", ".", "..", "package://", "/", "a\0b.stl", "m.stl/", "x" * 5000 + ".stl"])
def test_names_of_nothing(name: str, tmp_path: Path) -> None:
    assert find_mesh(name, tmp_path / "body.urdf") is None
