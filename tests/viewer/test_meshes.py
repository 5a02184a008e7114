"""Shapes of a body file as triangles: closed, turned outward, and as large as MuJoCo says."""

import mujoco
import numpy as np
import pytest

from retarget.model.scene_shapes import ShapeKind
from retarget.viewer.meshes import Mesh, link_meshes, shape_mesh

SHAPES = """
<mujoco><asset><mesh name="wedge" vertex="0 0 0  .1 0 0  0 .2 0  0 0 .3"/></asset><worldbody>
<geom type="plane" size="1 1 .1"/>
<body name="link" pos="0 0 1"><joint/>{}</body></worldbody></mujoco>"""


def is_closed(mesh: Mesh) -> bool:
    """Whether every edge of a face is one of another face, the other way round."""
    vertices, index = np.unique(np.round(mesh.vertices, 9), axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces]
    edges = [(int(face[i]), int(face[(i + 1) % 3])) for face in faces for i in range(3)]
    edges = [edge for edge in edges if edge[0] != edge[1]]
    return len(vertices) > 3 and sorted(edges) == sorted((b, a) for a, b in edges)


@pytest.mark.parametrize(
    ("kind", "size", "expected"),
    [
        (ShapeKind.BOX, (0.1, 0.2, 0.3), 8 * 0.1 * 0.2 * 0.3),
        (ShapeKind.CYLINDER, (0.1, 0.2, 0.0), np.pi * 0.01 * 0.4),
        (ShapeKind.CAPSULE, (0.1, 0.2, 0.0), np.pi * 0.01 * 0.4 + 4 / 3 * np.pi * 1e-3),
        (ShapeKind.CAPSULE, (0.1, 0.0, 0.0), 4 / 3 * np.pi * 1e-3),
    ],
)
def test_shapes_are_closed_and_of_their_volume(
    kind: ShapeKind, size: tuple[float, float, float], expected: float
) -> None:
    mesh = shape_mesh(kind, size)
    assert is_closed(mesh)
    assert 0.93 * expected < mesh.volume <= expected * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("geom", "expected"),
    [
        ('<geom type="box" size=".1 .2 .3" quat="1 1 0 0"/>', 8 * 0.006),
        ('<geom type="ellipsoid" size=".1 .2 .3" euler="10 20 30"/>', 4 / 3 * np.pi * 0.006),
        ('<geom type="mesh" mesh="wedge" pos=".1 .2 .3" euler="0 0 90"/>', 0.1 * 0.2 * 0.3 / 6),
        ('<geom type="sphere" size=".1"/><geom type="capsule" size=".1 .2" contype="0" conaffinity="0"/>', 0.01676),
    ],
)
def test_geoms_of_a_file_are_placed_on_their_link(geom: str, expected: float) -> None:
    model = mujoco.MjModel.from_xml_string(SHAPES.format(geom))
    ((link, mesh),) = link_meshes(model).items()
    assert link == 1
    assert mesh.volume == pytest.approx(expected, rel=0.07)
    shown = model.ngeom - 1  # the last one is for looking at, or the only one
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    placed = mesh.vertices + np.array([0.0, 0.0, 1.0])
    lowest, highest = placed.min(axis=0), placed.max(axis=0)
    assert (np.abs(0.5 * (lowest + highest) - data.geom_xpos[shown]) < 0.16).all()
    assert np.linalg.norm(highest - lowest) <= 2.0 * model.geom_rbound[shown] * np.sqrt(3.0) + 1e-9
