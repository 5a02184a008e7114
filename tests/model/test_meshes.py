"""Shapes of a body file as triangles: closed, turned outward, on the surfaces that MuJoCo knows, and not too many."""

import mujoco
import numpy as np
import pytest

from followers import ROBOTS, dimensions, op3, performer, shipped
from retarget.model.body import load_body_text
from retarget.model.human import build_human
from retarget.model.meshes import LEFT, MIDDLE, MOST_TRIANGLES, RIGHT, Mesh, link_meshes, shape_mesh, side_colours
from retarget.model.scene_shapes import ShapeKind

SHAPES = """
<mujoco><asset><mesh name="wedge" vertex="0 0 0  .1 0 0  0 .2 0  0 0 .3"/></asset><worldbody>
<geom type="plane" size="1 1 .1"/>
<body name="link" pos="0 0 1"><joint/>{}</body></worldbody></mujoco>"""
PLACED = 'pos="-.02 -.03 -.04" euler="10 20 30"'


def volume(mesh: Mesh) -> float:
    """By the divergence theorem, m3; right where all faces look outward and close."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float(np.einsum("fk,fk->", a, np.cross(b, c)) / 6.0)


def is_closed(mesh: Mesh) -> bool:
    """True if every edge of a face is one of another face, the other way round."""
    _, index = np.unique(np.round(mesh.vertices, 9), axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces]
    edges = [(int(face[i]), int(face[(i + 1) % 3])) for face in faces for i in range(3)]
    return len(edges) > 11 and sorted(edges) == sorted((b, a) for a, b in edges)


@pytest.mark.parametrize(("around", "least"), [(24, 0.93), (12, 0.85), (4, 0.3)])
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
    kind: ShapeKind, size: tuple[float, float, float], expected: float, around: int, least: float
) -> None:
    mesh = shape_mesh(kind, size, around=around)
    assert is_closed(mesh)
    assert least * expected < volume(mesh) <= expected * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("geom", "expected"),
    [
        (f'<geom type="box" size=".1 .2 .3" {PLACED}/>', 8 * 0.006),
        (f'<geom type="cylinder" size=".1 .3" {PLACED}/>', np.pi * 0.006),
        (f'<geom type="capsule" size=".1 .3" {PLACED}/>', np.pi * (0.006 + 4 / 3 * 1e-3)),
        (f'<geom type="ellipsoid" size=".1 .2 .3" {PLACED}/>', 4 / 3 * np.pi * 0.006),
        (f'<geom type="mesh" mesh="wedge" {PLACED}/>', 0.1 * 0.2 * 0.3 / 6),
        ('<geom type="sphere" size=".1"/><geom type="capsule" size=".1 .2" contype="0" conaffinity="0"/>', 0.01676),
    ],
)
def test_triangles_lie_on_the_surface_of_the_shape_that_is_for_looking_at(geom: str, expected: float) -> None:
    """Distances are MuJoCo's, of a tiny sphere; the middle of a face may be a sagitta inside, and edges of a box are
    round: a corner is 0.42 of their radius inside."""
    ((part, mesh),) = link_meshes(load_body_text(SHAPES.format(geom), source="test")).items()
    assert part == (1, None) and is_closed(mesh)
    assert 0.93 * expected < volume(mesh) <= 1.0001 * expected
    points = np.concatenate([mesh.vertices, mesh.vertices[mesh.faces].mean(axis=1)])
    spec = mujoco.MjSpec.from_string(SHAPES.format(geom))
    probe = spec.worldbody.add_body(name="probe", mocap=True)
    probe.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[1e-5, 0, 0])
    model = spec.compile()
    data, found = mujoco.MjData(model), list[float]()
    tip, shown = model.body("probe").geomadr[0], model.body("link").geomadr[0] + model.body("link").geomnum[0] - 1
    for point in points + np.array([0.0, 0.0, 1.0]):
        data.mocap_pos[0] = point
        mujoco.mj_forward(model, data)
        found.append(mujoco.mj_geomDistance(model, data, shown, tip, 1.0, None) + 1e-5)
    off, within = np.array(found), 0.011 if "box" in geom else 2e-4
    assert off.max() < 2e-4 and off[: len(mesh.vertices)].min() > -within and off.min() > -max(within, 0.006)


@pytest.mark.long
def test_bodies_to_draw_are_whole_and_small() -> None:
    human = build_human(dimensions(performer())).solid
    for solid in (*(shipped(name).solid for name in ROBOTS), human):
        drawn = solid.as_json()
        assert 300 < sum(len(mesh["faces"]) for mesh in drawn["meshes"]) / 3 <= MOST_TRIANGLES
        assert {mesh["link"] for mesh in drawn["meshes"]} == set(range(len(solid.links)))
        for mesh in drawn["meshes"]:
            assert max(mesh["faces"]) < len(mesh["vertices"]) / 3 and all(0.0 <= part <= 1.0 for part in mesh["colour"])
        assert len(solid.poses(np.zeros((0, 7)))) == 0
    assert 1.5 < human.height < 1.9


@pytest.mark.long
def test_a_dense_mesh_of_a_file_is_thinned_and_keeps_its_place() -> None:
    ball = shape_mesh(ShapeKind.CAPSULE, (0.1, 0.0, 0.0), around=120)
    vertices, faces = (" ".join(map(str, array.ravel().tolist())) for array in (ball.vertices, ball.faces))
    text = f"""<mujoco><asset><mesh name="ball" vertex="{vertices}" face="{faces}"/></asset><worldbody>
    <body><joint/><geom type="mesh" mesh="ball"/>
    <body pos="0 0 .5"><joint/><geom type="mesh" mesh="ball"/></body></body>
    </worldbody></mujoco>"""
    meshes = link_meshes(load_body_text(text, source="test"))
    assert len(ball.faces) > MOST_TRIANGLES > sum(len(mesh.faces) for mesh in meshes.values())
    assert volume(meshes[2, None]) == pytest.approx(4 / 3 * np.pi * 1e-3, rel=0.1)
    assert np.abs(np.linalg.norm(meshes[2, None].vertices, axis=1) - 0.1).max() < 0.01


def test_the_sides_of_a_robot_are_those_of_its_limbs() -> None:
    body = op3().body
    colours = side_colours(body, {name: op3().frame(name).body for name in op3().profile.frames})
    for colour, name in zip(colours, body.body_names, strict=True):
        assert colour == {"l_": LEFT, "r_": RIGHT}.get(name[:2], MIDDLE), name


LIMB = """<mujoco><worldbody><body name="base" pos="0 0 1"><joint/><geom type="box" size=".1 .1 .1"/>
<body name="upper" pos="0 .3 0"><joint axis="1 0 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="lower" pos="0 .3 0"><joint axis="1 0 0"/><geom type="sphere" size=".05" pos="0 .3 0"/>{}</body></body>
</body></worldbody></mujoco>"""


def test_what_joins_links_is_as_thick_as_the_body_is_tall_however_many_frames_are_fixed_to_it() -> None:
    frames = "".join(f'<body name="frame_{i}" pos="0 .1 .2"/>' for i in range(40))
    plain, framed = (load_body_text(LIMB.format(more), source="test") for more in ("", frames))
    meshes = link_meshes(framed)
    assert {link for link, _ in meshes} == {1, 2, 3}, "none to what is fixed, and moves by no joint"
    for part, mesh in link_meshes(plain).items():
        np.testing.assert_array_equal(mesh.vertices, meshes[part].vertices)
    rod = meshes[2, None].vertices
    assert 0.01 < rod[:, 2].max() < 0.03 and rod[:, 1].max() > 0.3, "from joint to joint"


def test_shapes_that_are_fixed_to_a_link_are_its_own_and_an_end_without_is_drawn_to_what_is_fixed_to_it() -> None:
    """A mesh on a link that is welded to one without any: nothing else joins it."""
    shell = '<body name="shell" pos="0 .15 0"><geom type="box" size=".02 .15 .02" contype="0" conaffinity="0"/></body>'
    text = LIMB.format("").replace('<joint axis="1 0 0"/>', '<joint axis="1 0 0"/>' + shell, 1)
    body = load_body_text(text, source="test")
    drawn = {body.body_names[link] for link, _ in link_meshes(body)}
    assert "shell" in drawn and "upper" not in drawn
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    hand = f'<body name="wrist" pos="0 .3 0"><joint/>{inertial}<body name="hand" pos="0 .1 0"/></body>'
    body = load_body_text(LIMB.format(hand), source="test")
    rod = link_meshes(body)[body.body_names.index("wrist"), None].vertices
    assert rod[:, 1].max() > 0.1 and rod[:, 1].min() < 0.0
