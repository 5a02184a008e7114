"""The rest skeleton of a joint tree: any rig of one motion is read as that motion, and what is no body is refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from messages import refuses, shows
from retarget import rotations
from retarget.errors import InputError
from retarget.frames import SENSORS, SensorFrames
from retarget.human.calibration import calibrate
from retarget.model.human import build_human
from retarget.sources.axes import UP_AXES
from retarget.sources.canonical import canonical_frames
from retarget.sources.files import ReadOptions
from retarget.sources.rest_skeleton import canonical_joints, true_offsets
from retarget.sources.skeletons import Channel, JointPoses, JointTree, joints_by_shape, posed
from rigs import along, body, carried, differences, in_axes, moved, rest_turned


def read(tree: JointTree, pose: JointPoses, *, unit: float | None = None) -> SensorFrames:
    return canonical_frames(tree, pose, unit=unit, rate=30.0, source="here")


PLAIN = read(body(), moved(body()))


@settings(max_examples=20, deadline=None)
@given(
    bones=st.sampled_from((None, *UP_AXES)),
    noise=st.sampled_from((0.0, 1e-5)),
    prefix=st.sampled_from(("", "Bip01 ", "mixamorig:", "Ann_")),
    carriers=st.integers(0, 2),
    up=st.sampled_from(tuple(UP_AXES)),
    mirrored=st.booleans(),
    heading=st.sampled_from((0.0, 0.6, -2.0)),
    unit=st.sampled_from((1.0, 0.01, 0.001)),
    lean=st.sampled_from((0.0, 0.0, 0.35, 0.75)) | st.floats(0.0, np.pi),
    about=st.tuples(*[st.integers(-2, 2)] * 3).filter(any),
)
@example("x", 1e-5, "", 0, "y", False, 0.0, 0.01, 0.0, (1, 0, 0))
@example(None, 0.0, "", 0, "y", True, 0.0, 0.01, 0.0, (1, 0, 0))
@example(None, 0.0, "", 0, "y", False, 0.0, 0.01, 0.873, (1, 0, -1))
@example(None, 0.0, "", 0, "z", False, 0.0, 1.0, 0.35, (1, 0, 0))
def test_every_rig_of_a_motion_is_read_as_that_motion(
    bones: str | None,
    noise: float,
    prefix: str,
    carriers: int,
    up: str,
    mirrored: bool,
    heading: float,
    unit: float,
    lean: float,
    about: tuple[int, int, int],
) -> None:
    """The rest pose may be turned as a whole: where that is not to an axis of the file, a frame takes its place."""
    tree, pose = body(), moved(body())
    if bones is not None:
        tree, pose = along(tree, pose, UP_AXES[bones], noise)
    tree, pose = carried(tree, pose, prefix, carriers)
    tree, pose = in_axes(tree, pose, UP_AXES[up], mirrored=mirrored, heading=heading, unit=unit)
    axis = np.array(about, dtype=float)
    tree, pose = rest_turned(tree, pose, rotations.from_axis_angle(axis / np.linalg.norm(axis), lean))
    frames = read(tree, pose)
    mm, degrees = differences(frames, PLAIN)
    assert mm < 25.0 and degrees < (22.0 if lean else 15.0)
    assert frames.skeleton is not None
    assert frames.skeleton.distance("l_shoulder", "r_shoulder") == pytest.approx(0.36, abs=2e-3)
    assert any("mirrored" in note for note in frames.notes) == mirrored
    build_human(calibrate(frames))


def test_a_tree_that_stands_in_no_frame_is_refused() -> None:
    tree, pose = along(body(), moved(body()), UP_AXES["x"], 1e-5)
    lying = rotations.from_axis_angle([1.0, 0.0, 0.0], np.pi / 2)
    position = rotations.rotate(lying, pose.position) + np.array([0.0, 0.1, 0.0])
    fallen = JointPoses(position, rotations.multiply(lying, pose.orientation))
    with refuses(InputError, where="here", next_step="T-pose"):
        canonical_frames(tree, fallen, unit=1.0, rate=30.0, source="here", options=ReadOptions(up=UP_AXES["y"]))
    arms = [f"{side}{part}" for part in ("Arm", "ForeArm", "Hand") for side in ("Left", "Right")]
    others = dict(zip(arms, [arms[at ^ 1] for at in range(6)], strict=True))
    swapped = tuple(others.get(name, name) for name in body().names)
    with refuses(InputError, where="here", next_step="arm"):
        read(replace(body(), names=swapped), moved(body()))


def test_feet_without_length_have_no_toes() -> None:
    for toe in ((0.0, -0.08, 0.0), (0.004, -0.08, 0.006)):
        tree = body(toe=toe)
        frames = read(tree, moved(tree))
        assert "l_toe" not in frames.names and frames.skeleton is not None and "l_toe" not in frames.skeleton.names
        shows(frames.notes[-1])
        person = calibrate(frames)
        assert person.of("l_toe")[0] > 0.1 and np.isfinite(build_human(person).body.qpos0).all()
        assert differences(frames, PLAIN)[1] < 15.0


# A performer without an arm.


@pytest.mark.parametrize(("there", "lacking"), [("Left", "r"), ("Right", "l")])
def test_an_arm_that_is_not_there_hangs_beside_the_trunk(there: str, lacking: str) -> None:
    tree = body(arms=(there,))
    frames = read(tree, moved(tree))
    assert set(frames.names) == set(SENSORS) and frames.joints is not None
    assert f"{lacking}_wrist" not in frames.joints.names, "the file does not know where it is"
    shows(frames.notes[-1])
    wrist, shoulder = (frames.position[0, frames.index(f"{lacking}_{part}")] for part in ("wrist", "shoulder"))
    np.testing.assert_allclose(wrist - shoulder, [0.0, 0.0, -0.53], atol=0.02)
    trunk, hand = frames.orientation[:, frames.index("chest")], frames.orientation[:, frames.index(f"{lacking}_wrist")]
    np.testing.assert_allclose(rotations.angle_between(trunk, hand), 0.0, atol=1e-6)
    person = calibrate(frames)
    assert person.length("l_wrist") == pytest.approx(person.length("r_wrist"))


def test_an_arm_by_another_name_is_no_missing_arm() -> None:
    names = tuple("Thing" if name == "RightForeArm" else name for name in body().names)
    stick, _ = along(body(), moved(body()), UP_AXES["x"], 0.0)
    with refuses(InputError, "r_elbow"):
        canonical_joints(replace(stick, names=names), where="here")
    by_shape, notes = canonical_joints(replace(body(), names=names), where="here")
    assert names[by_shape["r_elbow"].joint] == "Thing"
    shows(notes[0])


# Bodies that are recognised by their shape.


def test_a_root_on_the_floor_and_bones_of_the_face_do_not_change_the_shape() -> None:
    tree, _ = carried(body(), moved(body()), "n", 2)
    numbers = tuple(f"n{at}" for at in range(len(tree.names)))
    found = joints_by_shape(replace(tree, names=numbers))
    assert found is not None
    for name, joint in (("head", "Head"), ("l_ankle", "LeftFoot"), ("r_wrist", "RightHand"), ("l_hip", "LeftUpLeg")):
        assert tree.names[found[name]] == f"n{joint}"
    head = tree.names.index("nHead")
    faces = ((0.03, 0.08, 0.09), (-0.03, 0.08, 0.09), (0.0, 0.0, 0.07), (0.0, 0.21, 0.0))
    count = len(faces)
    for name in ("n", "Head"):
        with_face = JointTree(
            (*numbers[:head], name, *numbers[head + 1 :], *(f"f{i}" for i in range(count))),
            (*tree.parents, *(head,) * count),
            np.concatenate((tree.offsets, faces)),
            (*tree.ends[:head], (), *tree.ends[head + 1 :], *((),) * count),
        )
        found = joints_by_shape(with_face)
        assert found is not None and found["head"] == head and found["head_top"] == len(tree.names) + count - 1


# Offsets and position channels that do not agree.


@settings(max_examples=30, deadline=None)
@given(
    kind=st.sampled_from(("absolute", "differences", "zero offsets", "other offsets")),
    stretch=st.floats(0.0, 0.1),
    carriers=st.integers(0, 1),
    scale=st.sampled_from((1.0, 100.0)),
)
def test_bones_are_as_long_as_in_the_frames(kind: str, stretch: float, carriers: int, scale: float) -> None:
    tree, _ = carried(body(), moved(body()), "", carriers)
    offsets, hips = scale * tree.offsets, carriers
    channels: list[list[Channel]] = [[("t", 0), ("t", 1), ("t", 2)] for _ in tree.names]
    rows = np.tile(offsets, (5, 1, 1))
    rows[:, hips + 1 :] *= 1.0 + stretch * np.linspace(-1.0, 1.0, 5)[:, None, None]
    rows[:, hips] = scale * np.array([0.3, 0.9, 0.2])
    right = replace(tree, offsets=offsets, ends=tuple(tuple(scale * end for end in ends) for ends in tree.ends))
    truth = posed(right, channels, rows.reshape(5, -1))
    values, written = rows.copy(), right
    if kind == "differences":
        below = slice(hips + 1 if carriers == 0 else 1, None)
        values[:, below] -= offsets[below]
    elif kind != "absolute":
        factor = 0.0 if kind == "zero offsets" else 3.0
        written = replace(right, offsets=factor * offsets)
    found, given_values, notes = true_offsets(written, channels, values.reshape(5, -1))
    again = posed(found, channels, given_values)
    from_hips, expected = (p.position[:, hips:] - p.position[:, hips : hips + 1] for p in (again, truth))
    np.testing.assert_allclose(from_hips, expected, atol=1e-9 * scale)
    np.testing.assert_allclose(found.offsets[hips + 1 :], offsets[hips + 1 :], atol=1e-9 * scale)
    assert len(notes) == (kind != "absolute")
