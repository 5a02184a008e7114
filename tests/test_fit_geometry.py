"""The geometry of a link holds every geom of the link, whatever its kind."""

from typing import Any

import numpy as np
import pytest

from retarget.body_file import compile_body_text
from retarget.errors import InputError
from retarget.fitting.capsule import distances_to_segment, enclosing_capsule
from retarget.fitting.geometry import LinkGeometry, link_geometries
from retarget.rotations import FloatArray, rotate
from support.messages import refuses, shows

PLACE = 'pos="0.1 -0.2 0.3" quat="0.5 0.1 -0.7 0.3"'
KINDS = {
    "sphere": "0.03",
    "capsule": "0.02 0.1",
    "cylinder": "0.05 0.08",
    "box": "0.03 0.05 0.1",
    "ellipsoid": "0.03 0.06 0.12",
}


def model(geoms: str, extra: str = "") -> Any:
    text = f"""<mujoco>{extra}<worldbody><body name="base"><geom name="b" type="sphere" size="0.01" mass="1"/>
      <body name="arm"><joint name="j"/>{geoms}<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </body></worldbody></mujoco>"""
    return compile_body_text(text, source="test").model


def surface(kind: str, size: FloatArray, count: int = 4000) -> FloatArray:
    """Points on a geom, in its own frame."""
    rng = np.random.default_rng(0)
    n = rng.normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    if kind == "sphere":
        return np.asarray(n * size[0])
    if kind == "ellipsoid":
        return np.asarray(n * size)
    if kind == "capsule":
        return np.asarray(n * size[0] + np.sign(n[:, 2:]) * [0.0, 0.0, size[1]])
    box = np.sign(n) * (size if kind == "box" else 0.0)
    if kind == "cylinder":
        flat = n[:, :2] / np.linalg.norm(n[:, :2], axis=1)[:, None]
        box = np.hstack([flat * size[0], np.sign(n[:, 2:]) * size[1]])
    return np.asarray(box)


def arm(geoms: str, extra: str = "") -> LinkGeometry:
    return link_geometries(model(geoms, extra))[0][1]


@pytest.mark.parametrize("kind", KINDS)
def test_the_capsule_of_a_geom_holds_its_surface(kind: str) -> None:
    compiled = model(f'<geom name="g" type="{kind}" size="{KINDS[kind]}" {PLACE}/>')
    geometry = link_geometries(compiled)[0][1]
    capsule = enclosing_capsule(geometry.centres, geometry.radii)
    points = rotate(compiled.geom_quat[1], surface(kind, compiled.geom_size[1])) + compiled.geom_pos[1]
    assert distances_to_segment(points, capsule.start, capsule.end).max() <= capsule.radius + 1e-9
    assert geometry.name == "arm"


@pytest.mark.parametrize(
    ("kind", "volume"),
    [
        ("sphere", 4 / 3 * np.pi * 0.03**3),
        ("capsule", np.pi * 0.02**2 * (0.2 + 4 / 3 * 0.02)),
        ("cylinder", np.pi * 0.05**2 * 0.16),
        ("box", 8 * 0.03 * 0.05 * 0.1),
        ("ellipsoid", 4 / 3 * np.pi * 0.03 * 0.06 * 0.12),
    ],
)
def test_the_volume_is_that_of_the_geom(kind: str, volume: float) -> None:
    geometry = arm(f'<geom type="{kind}" size="{KINDS[kind]}" {PLACE}/>')
    assert geometry.hull_volume() == pytest.approx(volume, rel=0.02)


def test_a_mesh_counts_with_its_vertices_wherever_the_compiler_moved_it() -> None:
    corners = "0 0 0  0.2 0 0  0 0.1 0  0 0 0.05  0.01 0.01 0.01"
    geometry = arm('<geom type="mesh" mesh="m"/>', f'<asset><mesh name="m" vertex="{corners}"/></asset>')
    expected = np.array([[0, 0, 0], [0, 0, 0.05], [0, 0.1, 0], [0.2, 0, 0]])
    found = geometry.centres[np.lexsort(np.round(geometry.centres, 6).T[::-1])]
    assert np.allclose(found, expected, atol=1e-6)  # the inner one is not on the hull
    assert geometry.hull_volume() == pytest.approx(0.2 * 0.1 * 0.05 / 6.0, rel=1e-4)


def test_only_a_lone_named_box_or_cylinder_can_be_taken_over() -> None:
    box = '<geom name="g" type="box" size="1 1 1"/>'
    lone = arm(box).lone
    assert lone is not None and (lone.geom, lone.kind) == ("g", "box")
    assert arm(box.replace('name="g"', "")).lone is None
    assert arm(box + '<geom type="sphere" size="1"/>').lone is None
    assert arm('<geom name="g" type="ellipsoid" size="1 2 3"/>').lone is None


def test_planes_are_left_out_and_told() -> None:
    text = """<mujoco><worldbody><body name="base"><geom type="plane" size="1 1 1"/>
    <body name="arm"><joint/><geom size="0.1"/></body></body></worldbody></mujoco>"""
    found, notes = link_geometries(compile_body_text(text, source="test").model)
    assert [geometry.name for geometry in found] == ["arm"]
    assert notes == ("base: planes and height fields are left out",)


@pytest.mark.parametrize("name", ["", 'name="a b"', 'name="a/b"'])
def test_a_link_without_a_name_that_a_profile_can_hold_is_told(name: str) -> None:
    text = f"""<mujoco><worldbody><body {name}><joint/><geom size="1"/><body name="b"><geom size="1"/></body></body>
    </worldbody></mujoco>"""
    found, notes = link_geometries(compile_body_text(text, source="test").model)
    assert [geometry.name for geometry in found] == ["b"]
    shows(notes[0], 1)


def test_a_body_without_geometry_is_refused() -> None:
    text = """<mujoco><worldbody><body name="a"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </worldbody></mujoco>"""
    with refuses(InputError):
        link_geometries(compile_body_text(text, source="test").model)
