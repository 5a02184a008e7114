"""BVH motions: kinematics against geometry, every naming style, and one clear error for everything that is wrong."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from messages import Facts, refuses, shows, shows_lines
from motion_texts import JOINTS, bvh_text
from people import limbs_lie_along_their_bones, limbs_rest_as_one
from recordings import moved, op3, slider
from retarget import rotations
from retarget.errors import InputError, UsageError
from retarget.frames import SENSORS
from retarget.model.body import BodyModel, load_body_text
from retarget.model.human import PostureReader
from retarget.model.human_dimensions import POINTS
from retarget.recording.exports.bvh_writer import write_bvh
from retarget.recording.motion import Motion, links_of
from retarget.rotations import to_matrix
from retarget.sources.bvh import MAX_JOINTS, MAX_SKELETON_DEPTH, read_bvh, read_motion
from retarget.sources.files import ReadOptions
from retarget.sources.skeletons import posed
from retarget.types import FloatArray
from rig import person

RECORDINGS = ("cmu_bvh_hahne", "cmu_bvh_daz", "other")


def write(folder: Path, text: str) -> Path:
    path = folder / "motion.bvh"
    path.write_text(text)
    return path


def test_rest_pose_is_a_person_facing_x_in_metres(tmp_path: Path) -> None:
    frames = read_bvh(write(tmp_path, bvh_text()))
    assert frames.names == SENSORS and len(frames) == 3 and frames.rate_hz == 120.0
    limbs_lie_along_their_bones(frames)
    limbs_rest_as_one(frames)
    np.testing.assert_allclose(frames.orientation[:, frames.index("head"), 0], 1.0)
    at = {name: frames.position[0, i] for i, name in enumerate(frames.names)}
    np.testing.assert_allclose(at["pelvis"], [0.0, 0.0, 0.98], atol=1e-12)
    np.testing.assert_allclose(at["l_wrist"], [0.0, 0.73, 1.35], atol=1e-12)
    np.testing.assert_allclose(at["head"], [0.0, 0.0, 0.98 + 0.45 + 0.09], atol=1e-12)
    np.testing.assert_allclose(at["r_toe"], [0.13, -0.09, 0.0], atol=1e-12)
    assert frames.skeleton is not None
    np.testing.assert_allclose(frames.skeleton.of("l_ankle"), [0.0, 0.09, -0.92], atol=1e-12)
    shows(frames.notes)


def test_the_roots_offset_is_not_added_and_six_channels_replace_an_offset(tmp_path: Path) -> None:
    text = bvh_text(1).replace("OFFSET 0 0 0", "OFFSET 5 50 500", 1)
    six = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
    at = text.index("JOINT LeftUpLeg")
    text = text[:at] + text[at:].replace("CHANNELS 3 Zrotation Xrotation Yrotation", six, 1)
    lines = text.splitlines()
    values = lines[-1].split()
    lines[-1] = " ".join([*values[:6], "10", "-8", "2", *values[6:]])
    frames = read_bvh(write(tmp_path, "\n".join(lines)))
    np.testing.assert_allclose(frames.position[0, frames.index("pelvis")], [0.0, 0.0, 0.98], atol=1e-12)
    np.testing.assert_allclose(frames.position[0, frames.index("l_hip")], [0.02, 0.10, 0.90], atol=1e-12)


def test_one_of_several_performers_is_read_as_if_alone(tmp_path: Path) -> None:
    """Both may have joints of the same names, also their roots."""
    texts = [bvh_text(root=(at, 98.0, 0.0), names=names) for at, names in ((0.0, {}), (80.0, {"Head": "head"}))]
    (one, moves), (other, moved) = (text.split("MOTION") for text in texts)
    header, rows = moves.rsplit("0.008333\n", 1)
    rows = "\n".join(
        " ".join(pair) for pair in zip(rows.split("\n"), moved.split("0.008333\n")[1].split("\n"), strict=True)
    )
    both = write(tmp_path, one + other.removeprefix("HIERARCHY\n") + "MOTION" + header + "0.008333\n" + rows)
    second = 1 + both.read_text().split("\n").index("ROOT Hips", 2)
    both.write_text(both.read_text().replace("ROOT ", "ROOT\t"))
    with refuses(InputError, ("Hips", "Hips (2)"), where=f"{both}:{second}", next_step="--performer-root"):
        read_bvh(both)
    with refuses(UsageError, found="hip", allowed="Hips (2)"):
        read_bvh(both, ReadOptions(performer_root="hip"))
    found = [read_bvh(both, ReadOptions(performer_root=name)) for name in ("Hips", "Hips (2)")]
    for frames, text in zip(found, texts, strict=True):
        alone = read_bvh(write(tmp_path, text))
        np.testing.assert_allclose(frames.position, alone.position, atol=1e-12)
        np.testing.assert_allclose(frames.orientation, alone.orientation, atol=1e-12)


def test_z_up_is_seen_in_the_rest_pose_and_the_heading_is_kept(tmp_path: Path) -> None:
    frames = read_bvh(write(tmp_path, bvh_text(z_up=True, root=(0.0, 0.0, 98.0))))
    assert frames.position[0, frames.index("head"), 2] == pytest.approx(1.52)
    assert frames.position[0, frames.index("l_wrist"), 1] == pytest.approx(-0.73), "the figure looks along -x"
    limbs_lie_along_their_bones(frames)
    limbs_rest_as_one(frames)
    half_turn = rotations.log(frames.orientation[0, frames.index("pelvis")])
    np.testing.assert_allclose(np.abs(half_turn), [0.0, 0.0, np.pi], atol=1e-9)
    assert frames.skeleton is not None
    np.testing.assert_allclose(frames.skeleton.of("l_wrist"), [0.0, 0.73, 0.37], atol=1e-12)


@pytest.mark.parametrize(
    ("scale", "unit"), [(1.0, "cm"), (0.01, "m"), (10.0, "mm"), (0.393701, "inch"), (0.177165, "cmu")]
)
def test_units_are_guessed_and_can_be_said(tmp_path: Path, scale: float, unit: str) -> None:
    path = write(tmp_path, bvh_text(scale=scale))
    for said in (None, unit, unit.upper()):
        frames = read_bvh(path, ReadOptions(unit=said))
        assert frames.position[0, frames.index("pelvis"), 2] == pytest.approx(0.98, rel=1e-3)
    shows_lines(read_bvh(path).notes, unit)


@pytest.mark.parametrize(
    ("written", "rate"), [("0.008333", 120.0), (".0083333", 120.0), ("0.033333", 30.0), ("0.0123", 1 / 0.0123)]
)
def test_rates_of_few_digits_are_tidied(tmp_path: Path, written: str, rate: float) -> None:
    path = write(tmp_path, bvh_text(frame_time=written))
    assert read_bvh(path).rate_hz == pytest.approx(rate, abs=1e-9)
    assert read_bvh(path, ReadOptions(rate=50.0)).time[1] == pytest.approx(0.02)


def test_unknown_names_are_read_by_shape_with_left_and_right_in_place(tmp_path: Path) -> None:
    plain = read_bvh(write(tmp_path, bvh_text()))
    names = {name: f"node {i}" for i, (name, _, _) in enumerate(JOINTS)}
    other = read_bvh(write(tmp_path, bvh_text(names=names)))
    shows(other.notes)
    limbs = ("l_wrist", "r_wrist", "l_ankle", "r_ankle", "l_knee", "l_elbow", "r_hip", "l_shoulder")
    for name in ("head", "pelvis", *limbs):
        at = other.position[:, other.index(name)]
        np.testing.assert_allclose(at, plain.position[:, plain.index(name)], atol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ("old", "new", "facts"),
    [
        ("Frames: 3", "Frames: 5", (3, 5)),
        ("Frames: 3", "Frames: 1", (3, 1)),
        ("Frames: 3", "Frames: 0", ()),
        ("Frames: 3", "Frames: -3", ()),
        ("Frames: 3", "Frames: 300000", ()),
        ("Frames: 3", "Frames: 9999999999999999999999", ()),
        ("Frames: 3", "Count: 3", "MOTION"),
        ("Frame Time: 0.008333", "Frame Time: 0", ()),
        ("Frame Time: 0.008333", "Frame Time: -0.01", ()),
        ("Frame Time: 0.008333", "Frame Time: 1e-300", ()),
        ("Frame Time: 0.008333", "Frame Time: nan", ()),
        ("Frame Time: 0.008333", "Frame Time:", ()),
        ("HIERARCHY", "ANARCHY", "BVH"),
        ("CHANNELS 3 Zrotation", "CHANNELS 4 Zrotation", ()),
        ("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS three", ()),
        ("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS", ()),
        ("CHANNELS 3 Zrotation Xrotation", "CHANNELS 3 Zrotation Xrotatoin", ("xrotatoin", "xrotation")),
        ("CHANNELS 3 Zrotation Xrotation", "CHANNELS 3 Zrotation Zrotation", ()),
        ("JOINT LeftLeg", "JOINT LeftUpLeg", "LeftUpLeg"),
        ("JOINT LeftLeg", "JOINT", ()),
        ("JOINT LeftLeg", "ROOT LeftLeg", "ROOT"),
        ("OFFSET 9 -9 0", "OFFSET 9 -9", "OFFSET"),
        ("OFFSET 9 -9 0", "OFFSET 9 nan 0", ()),
        ("OFFSET 9 -9 0", "OFFSET 9 x 0", ()),
        ("OFFSET 9 -9 0", "OFSET 9 -9 0", ()),
        ("MOTION", "}\nMOTION", "'}'"),
        ("MOTION", "ROOT second\n{\nOFFSET 0 0 0\n}\nMOTION", "ROOT"),
        ("Frame Time: 0.008333", "Frame Time: 1e-320", "10000 Hz"),  # its inverse is infinite
    ],
)
def test_each_fault_has_its_line(tmp_path: Path, old: str, new: str, facts: Facts) -> None:
    text = bvh_text()
    assert old in text
    path = write(tmp_path, text.replace(old, new, 1))
    with refuses(InputError, facts) as caught:
        read_bvh(path)
    place, _, number = caught.value.problems[0].where.rpartition(":")
    assert place == str(path)
    assert int(number) == text[: text.index(old)].count("\n") + 1


@pytest.mark.parametrize("declared", [2, 4])
def test_one_frame_beside_the_declared_is_read_with_a_note(tmp_path: Path, declared: int) -> None:
    frames = read_bvh(write(tmp_path, bvh_text().replace("Frames: 3", f"Frames: {declared}")))
    assert len(frames) == 3
    shows_lines(frames.notes, ("declares", declared, 3))


def test_decimal_commas_are_read(tmp_path: Path) -> None:
    plain, comma = (read_bvh(write(tmp_path, text)) for text in (bvh_text(), bvh_text().replace(".", ",")))
    np.testing.assert_array_equal(comma.position, plain.position)
    assert comma.rate_hz == plain.rate_hz


@pytest.mark.parametrize("share", [0.5, 0.0])
def test_a_motion_cut_in_its_last_line_is_refused_as_cut_short(tmp_path: Path, share: float) -> None:
    lines = bvh_text().rstrip().splitlines()
    lines[-1] = lines[-1][: int(share * len(lines[-1]))] + " -"
    with refuses(InputError, where=f":{len(lines)}"):
        read_bvh(write(tmp_path, "\n".join(lines)))


def test_every_recording_is_a_human_with_constant_bones(shared: Path) -> None:
    paths = [path for folder in RECORDINGS for path in sorted((shared / "mocap" / folder).glob("*.bvh"))]
    assert len(paths) == 13
    for path in paths:
        frames = read_bvh(path)
        assert frames.names == SENSORS, path.name
        assert frames.joints is not None and frames.skeleton is not None
        for side in "lr":
            for a, b in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist")):
                length = np.linalg.norm(frames.joints.of(f"{side}_{a}") - frames.joints.of(f"{side}_{b}"), axis=1)
                np.testing.assert_allclose(length, frames.skeleton.distance(f"{side}_{a}", f"{side}_{b}"), atol=1e-6)
            assert (frames.skeleton.of("l_wrist") - frames.skeleton.of("r_wrist"))[1] > 0.2, "left is left"
        head, ankle = (frames.position[:, frames.index(name), 2] for name in ("head", "l_ankle"))
        assert 1.1 < np.median(head - ankle) < 1.8, path.name
        assert -0.1 < ankle.min() < 0.2, path.name


TURNS = "CHANNELS 3 Zrotation Xrotation Yrotation"
JOINED = [f"JOINT j{i}\n{{\nOFFSET 0 1 0\n" for i in range(MAX_JOINTS + 1)]
HEAD = "HIERARCHY\nROOT tail\n{\nOFFSET 0 0 0\n"


@pytest.mark.parametrize(
    ("text", "facts"),
    [
        (HEAD + "".join(JOINED), MAX_SKELETON_DEPTH),
        (HEAD + "}\n".join(JOINED) + "}\n}\nMOTION\n", MAX_JOINTS),
        (HEAD + f"{TURNS}\nEnd Site\n{{\nOFFSET 0 1 0\n}}\n}}\nMOTION\nFrames: 1\nFrame Time: 0.01\n0 0 0\n", ()),
    ],
    ids=["deep", "wide", "no human"],
)
def test_a_skeleton_that_is_absurd_or_no_human_is_refused(tmp_path: Path, text: str, facts: Facts) -> None:
    with refuses(InputError, facts):
        read_bvh(write(tmp_path, text))


def test_the_right_names_on_the_wrong_tree_are_read_by_shape(tmp_path: Path) -> None:
    swapped = bvh_text(names={"LeftLeg": "LeftForeArm", "LeftForeArm": "LeftLeg"})
    shows(read_bvh(write(tmp_path, swapped)).notes)


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
    pose = posed(motion.tree, motion.channels, motion.values)
    turn = TO_WORLD @ to_matrix(pose.orientation) @ TO_WORLD.T
    return motion.tree.names, pose.position @ TO_WORLD.T / 100.0, turn


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


def test_a_stranger_reads_the_same(tmp_path: Path) -> None:
    """Matrices from the text alone, as the format is described everywhere: no code of ours but the writer."""
    motion = moved(slider(), rows=5)
    text = written(motion, tmp_path).read_text().split("MOTION")
    stack: list[int] = []
    joints: list[tuple[str, int, list[float], list[str]]] = []
    for word, *words in (line.split() for line in text[0].splitlines()):
        if word in ("ROOT", "JOINT"):
            joints.append((words[0], stack[-1] if stack else -1, [], []))
            stack.append(len(joints) - 1)
        elif word == "End":
            stack.append(-9)
        elif word == "OFFSET" and stack[-1] >= 0:
            joints[stack[-1]][2].extend(map(float, words))
        elif word == "CHANNELS":
            joints[stack[-1]][3].extend(words[1:])
        elif word == "}":
            stack.pop()
    assert [name for name, *_ in joints] == ["base", "my_arm", "tip", "my_arm_"]
    links = links_of(motion)
    for row, line in enumerate(text[1].strip().splitlines()[2:]):
        values = iter(map(float, line.split()))
        world: list[FloatArray] = []
        for _, parent, offset, channels in joints:
            local, place = np.eye(4), np.array(offset)
            for channel in channels:
                value, axis = next(values), "XYZ".index(channel[0])
                if channel.endswith("position"):
                    place[axis] = value
                else:
                    local[:3, :3] = local[:3, :3] @ Rotation.from_euler("xyz"[axis], value, degrees=True).as_matrix()
            local[:3, 3] = place
            world.append(local if parent < 0 else world[parent] @ local)
        found = np.array([matrix[:3, 3] for matrix in world]) @ TO_WORLD.T / 100.0
        np.testing.assert_allclose(found, links.position[row], atol=CLOSE)


def test_a_human_comes_back_as_a_performer(tmp_path: Path) -> None:
    human = person()
    motion = moved(load_body_text(human.mjcf, source="human"), robot="human", rows=20)
    motion.q[:, 7:] *= 0.2
    motion.q[:, 3:7] = [1.0, 0.0, 0.0, 0.0]
    motion.q[:, 2] += 0.6
    frames = read_bvh(written(motion, tmp_path))
    assert frames.joints is not None and frames.rate_hz == 50.0
    truth = PostureReader(human).joints(motion.q)
    shared = [name for name in POINTS if name in frames.joints.names]
    assert len(shared) >= 20
    for name in shared:
        np.testing.assert_allclose(frames.joints.of(name), truth[:, POINTS.index(name)], atol=CLOSE, err_msg=name)


def test_angles_do_not_leap(tmp_path: Path) -> None:
    motion = moved(op3(), rows=200)
    motion.q[:, 7:] = 0.0
    motion.q[:, 3:7] = rotations.from_axis_angle([0.0, 0.0, 1.0], np.linspace(0, 14, 200))
    values = read_motion(written(motion, tmp_path)).values
    assert np.abs(np.diff(values[:, 3:], axis=0)).max() < 10.0
