"""Meshes of files for pictures: few triangles of the same silhouette, and edges that are sharp only where they are."""

import numpy as np
import pytest

from retarget.model.meshes import Mesh, joined, shape_mesh
from retarget.model.scene_shapes import ShapeKind
from retarget.model.thinning import creased, thinned
from retarget.types import FloatArray


def soup(mesh: Mesh) -> FloatArray:
    return mesh.vertices[mesh.faces]


def halved(triangles: FloatArray) -> FloatArray:
    """Each triangle as four."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    return np.concatenate([np.stack(one, axis=1) for one in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def volume(triangles: FloatArray) -> float:
    a, b, c = np.moveaxis(triangles, 1, 0)
    return float(np.einsum("fk,fk->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize("most", [200, 1000])
def test_a_ball_stays_round(most: int) -> None:
    ball = soup(shape_mesh(ShapeKind.CAPSULE, (0.1, 0.0, 0.0), around=160))
    few = thinned(ball, most)
    assert len(ball) > 100 * 200 and 0.8 * most < len(few) <= most
    assert np.abs(np.linalg.norm(few.reshape(-1, 3), axis=1) - 0.1).max() < 0.005
    assert volume(few) == pytest.approx(4 / 3 * np.pi * 1e-3, rel=0.08)


def test_a_box_keeps_its_corners_however_many_triangles_it_has() -> None:
    box = plain = soup(shape_mesh(ShapeKind.BOX, (0.1, 0.2, 0.3)))
    assert thinned(plain, 12) is plain, "few triangles stay as they are"
    for _ in range(4):
        box = halved(box)
    few = thinned(box, 60)
    assert len(box) == 12 * 256 and len(few) <= 60
    np.testing.assert_allclose(np.abs(few.reshape(-1, 3)).max(axis=0), (0.1, 0.2, 0.3), atol=1e-3)
    assert volume(few) == pytest.approx(8 * 0.006, rel=0.01)


def test_an_open_sheet_keeps_its_edge_and_sheets_on_each_other_are_thinned_too() -> None:
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=np.float64)
    for _ in range(5):
        square = halved(square)
    few = thinned(square, 20)
    assert len(few) <= 20
    corners = few.reshape(-1, 3)
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[0, 0, 0], [1, 1, 0]], atol=0.02)
    twice = np.concatenate([square, square[:, ::-1] + (0.0, 0.0, 1e-4)])
    assert len(thinned(twice, 100)) <= 100


def test_a_thin_shell_gets_no_hole() -> None:
    """Its walls, nearer to each other than its triangles are long, and joined at the rim, stay two."""
    angle, radius = np.linspace(0.0, 2.0 * np.pi, 100, endpoint=False), np.linspace(0.0, 0.1, 30)
    r, z = np.r_[radius, radius[::-1]], np.r_[0.1 * radius, 0.1 * radius[::-1] + 1e-3]
    ring = np.stack([np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle)), np.tile(z[:, None], 100)], axis=-1)
    a, b = ring[:-1], np.roll(ring, -1, axis=1)[:-1]
    c, d = np.roll(ring, -1, axis=1)[1:], ring[1:]
    shell = np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)
    few = thinned(shell, 200)
    assert len(shell) > 11_000 and 150 < len(few) <= 200
    # Sides that one triangle has, and no other one the other way round.
    corners = np.unique(few.reshape(-1, 3).round(9), axis=0, return_inverse=True)[1].reshape(-1, 3)
    sides = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2).tolist()
    assert len({(a, b) for a, b in sides} - {(b, a) for a, b in sides}) <= 4
    np.testing.assert_allclose(np.abs(few.reshape(-1, 3)).max(axis=0)[:2], 0.1, atol=0.005)


@pytest.mark.parametrize(("kind", "vertices"), [(ShapeKind.BOX, 24), (ShapeKind.CYLINDER, 4 * 24 + 2)])
def test_edges_are_sharp_where_faces_meet_at_an_angle_and_round_elsewhere(kind: ShapeKind, vertices: int) -> None:
    """A box has three vertices at each corner; a cylinder two on each rim, and one amid each end."""
    one = soup(shape_mesh(kind, (0.1, 0.2, 0.3)))
    places, faces = creased(one)
    assert len(places) == vertices
    np.testing.assert_array_equal(places[faces], one)
    both = creased(np.concatenate([one, one + 1.0]))[0]
    assert len(both) == 2 * vertices, "what does not touch shares nothing"
    line = joined([Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))])
    assert len(creased(soup(line))[1]) == 0, "a mesh of no triangle is none"
