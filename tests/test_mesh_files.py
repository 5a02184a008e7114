"""Meshes beside a body, in its package, of another kind, and as text."""

import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest

from retarget.importing.mesh_files import find_mesh
from support.messages import refuses

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
    assert found is not None and not found.twin
    read, plain = compiled(found.content()), compiled(binary_stl())
    assert read.nmeshvert == 4 and read.mesh_vert == pytest.approx(plain.mesh_vert)


@pytest.mark.parametrize(
    "content", [binary_stl(), binary_stl(b"solid of bytes all the same"), b"solid\nvertex 1 2 x", b"solid", b"no mesh"]
)
def test_all_else_stays_as_it_is(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "m.stl").write_bytes(content)
    found = find_mesh("m.stl", tmp_path / "body.urdf")
    assert found is not None and found.content() == content


@pytest.mark.parametrize("name", ["m.dae", "package://robot/meshes/m.dae", "model://robot/meshes/m.dae"])
def test_of_another_kind_the_one_beside_it_is_read(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "robot" / "meshes"
    folder.mkdir(parents=True)
    body = folder / "body.urdf"
    (folder / "m.dae").write_text("<COLLADA/>")
    assert find_mesh(name, body) is None
    (folder / "m.obj").write_text("v 0 0 0\n")
    found = find_mesh(name, body)
    assert found is not None and found.twin and found.path.name == "m.obj"


@pytest.mark.parametrize("name", ["", ".", "..", "package://", "/", "a\0b.stl", "m.stl/", "x" * 5000 + ".stl"])
def test_names_of_nothing(name: str, tmp_path: Path) -> None:
    assert find_mesh(name, tmp_path / "body.urdf") is None
