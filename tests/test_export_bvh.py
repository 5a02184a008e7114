"""BVH: forward kinematics of the file finds every link where the body has it, for any reader."""

import io
from pathlib import Path

import numpy as np
import pytest

from exported import moved, op3, slider
from retarget.body import BodyModel, load_body_text
from retarget.errors import InputError
from retarget.exporting.bvh_file import write_bvh
from retarget.exporting.links import links_of
from retarget.exporting.motion import Motion
from retarget.human_posture import PostureReader
from retarget.rotations import FloatArray, to_matrix
from retarget.sources.bvh import pose_of, read_bvh, read_motion
from rig import person
from support.messages import refuses

TO_WORLD = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""x forward is the file's z, y left its x, z up its y."""
CLOSE = 1e-4
"""m"""


def written(motion: Motion, folder: Path) -> Path:
    path = folder / "motion.bvh"
    with path.open("wb") as stream:
        write_bvh(motion, stream)
    return path


def read_back(path: Path) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Names, world positions (T, b, 3) m and rotation matrices (T, b, 3, 3) by our own reader."""
    motion = read_motion(path)
    pose = pose_of(motion)
    turn = TO_WORLD @ to_matrix(pose.orientation) @ TO_WORLD.T
    return motion.hierarchy.tree.names, pose.position @ TO_WORLD.T / 100.0, turn


@pytest.mark.parametrize("body", [op3(), slider()], ids=["op3", "slider"])
def test_every_link_is_where_the_body_has_it(body: BodyModel, tmp_path: Path) -> None:
    motion = moved(body)
    names, position, turn = read_back(written(motion, tmp_path))
    links = links_of(motion)
    assert len(names) == len(links.names)
    np.testing.assert_allclose(position, links.position, atol=CLOSE)
    # From rest on, every joint has turned as its link has.
    rest = np.zeros((1, body.nq))
    rest[0, 3] = 1.0
    stands = to_matrix(body.solver_body().orientations(rest, list(range(1, len(body.body_names))))[0])
    np.testing.assert_allclose(turn @ stands, to_matrix(links.orientation), atol=1e-6)


def test_at_rest_the_skeleton_is_the_body_with_all_joints_at_zero(tmp_path: Path) -> None:
    body = op3()
    tree = read_motion(written(moved(body, rows=3), tmp_path)).hierarchy.tree
    rest = np.zeros((1, body.nq))
    rest[0, 3] = 1.0
    points = body.solver_body().points(rest, list(range(1, len(body.body_names))), np.zeros((20 + 1, 3)))[0]
    np.testing.assert_allclose(tree.rest_positions() @ TO_WORLD.T / 100.0, points, atol=CLOSE)


def test_a_stranger_reads_the_same(tmp_path: Path) -> None:
    """Matrices from the text alone, as the format is described everywhere: no code of ours but the writer."""
    motion = moved(slider(), rows=5)
    text = written(motion, tmp_path).read_text().split("MOTION")
    stack: list[int] = []
    joints: list[tuple[str, int, list[float], list[str]]] = []
    for words in (line.split() for line in text[0].splitlines()):
        if words[:1] in (["ROOT"], ["JOINT"]):
            joints.append((words[1], stack[-1] if stack else -1, [], []))
            stack.append(len(joints) - 1)
        elif words[:1] == ["End"]:
            stack.append(-9)
        elif words[:1] == ["OFFSET"] and stack[-1] >= 0:
            joints[stack[-1]][2].extend(map(float, words[1:]))
        elif words[:1] == ["CHANNELS"]:
            joints[stack[-1]][3].extend(words[2:])
        elif words[:1] == ["}"]:
            stack.pop()
    assert [name for name, *_ in joints] == ["base", "my_arm", "tip", "my_arm_"]
    links = links_of(motion)
    for row, line in enumerate(text[1].strip().splitlines()[2:]):
        values = iter(map(float, line.split()))
        world: list[FloatArray] = []
        for _, parent, offset, channels in joints:
            local, place = np.eye(4), np.array(offset)
            for channel in channels:
                value = next(values)
                axis = "XYZ".index(channel[0])
                if channel.endswith("position"):
                    place[axis] = value
                else:
                    local = local @ turn_about(axis, np.deg2rad(value))
            local[:3, 3] = place
            world.append(local if parent < 0 else world[parent] @ local)
        found = np.array([matrix[:3, 3] for matrix in world]) @ TO_WORLD.T / 100.0
        np.testing.assert_allclose(found, links.position[row], atol=CLOSE)


def turn_about(axis: int, angle: float) -> FloatArray:
    matrix = np.eye(4)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i], matrix[i, j] = np.sin(angle), -np.sin(angle)
    return matrix


def test_a_human_comes_back_as_a_performer(tmp_path: Path) -> None:
    human = person()
    motion = moved(load_body_text(human.mjcf, source="human"), robot="human", rows=20)
    motion.q[:, 7:] *= 0.2
    motion.q[:, 3:7] = [1.0, 0.0, 0.0, 0.0]
    motion.q[:, 2] += 0.6
    frames = read_bvh(written(motion, tmp_path))
    assert frames.joints is not None and frames.rate_hz == 50.0
    reader = PostureReader(human)
    truth = reader.joints(motion.q)
    from retarget.human_dimensions import POINTS

    shared = [name for name in POINTS if name in frames.joints.names]
    assert len(shared) >= 20
    for name in shared:
        track = frames.joints.position[:, frames.joints.names.index(name)]
        np.testing.assert_allclose(track, truth[:, POINTS.index(name)], atol=CLOSE, err_msg=name)


def test_angles_do_not_leap(tmp_path: Path) -> None:
    body = op3()
    motion = moved(body, rows=200)
    motion.q[:, 7:] = 0.0
    motion.q[:, 3:7] = np.column_stack(
        [np.cos(np.linspace(0, 7, 200)), np.zeros(200), np.zeros(200), np.sin(np.linspace(0, 7, 200))]
    )
    values = read_motion(written(motion, tmp_path)).values
    assert np.abs(np.diff(values[:, 3:], axis=0)).max() < 10.0


def test_uneven_rows_are_refused() -> None:
    motion = moved(slider())
    motion.time[10:] += 0.005
    with refuses(InputError, "--fps"):
        write_bvh(motion, io.BytesIO())
