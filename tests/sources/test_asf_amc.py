"""AMC motions: kinematics against geometry and recordings, speed, and one clear error for everything that is wrong."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from messages import Facts, refuses
from motion_texts import BONES, amc_text, asf_text, write_amc
from people import limbs_lie_along_their_bones, limbs_rest_as_one
from retarget import rotations
from retarget.errors import InputError
from retarget.frames import JOINTS, SENSORS
from retarget.sources.asf_amc import MAX_BONES, find_skeleton, pose_of, read_amc, read_asf, read_values
from retarget.sources.bvh import read_motion
from retarget.sources.canonical import CMU_METRES
from retarget.sources.files import ReadOptions, read_lines
from retarget.sources.skeletons import posed
from retarget.types import FloatArray


def write(folder: Path, text: str) -> Path:
    path = folder / "07.asf"
    path.write_text(text)
    return path


def test_the_tree_follows_the_hierarchy_and_dummy_bones_carry_no_dof(tmp_path: Path) -> None:
    asf = read_asf(write(tmp_path, asf_text()))
    assert asf.tree.names[0] == "root" and len(asf.tree.names) == len(BONES) + 1
    assert all(parent < child for child, parent in enumerate(asf.tree.parents))
    dof = dict(zip(asf.tree.names, asf.dof, strict=True))
    assert dof["lhipjoint"] == () and dof["rclavicle"] == ("ry", "rz") and dof["root"][:3] == ("tx", "ty", "tz")
    assert asf.degrees and asf.length_unit == 0.45
    head = asf.tree.names.index("head")
    np.testing.assert_allclose(asf.tree.ends[head][0], [0.0, 1.6, 0.0])
    np.testing.assert_allclose(asf.tree.offsets[head], [0.0, 1.6, 0.0])


def test_axes_apply_their_angles_in_the_order_listed(tmp_path: Path) -> None:
    asf = read_asf(write(tmp_path, asf_text()))
    expected = np.roll(Rotation.from_euler("xyz", (180, -30, -90), degrees=True).as_quat(), 1)
    actual = asf.frames[asf.tree.names.index("lradius")]
    assert abs(float(np.dot(actual, expected))) == pytest.approx(1.0)


def test_radians_line_ends_and_latin_letters_are_read(tmp_path: Path) -> None:
    text = asf_text().replace("angle deg", "angle rad").replace("axis 0 0 20", "axis 0 0 0.3490658504")
    path = tmp_path / "07.ASF"
    path.write_bytes(text.replace("made for a test", "für einen Test").replace("\n", "\r\n").encode("latin-1"))
    asf = read_asf(path)
    turn = rotations.log(asf.frames[asf.tree.names.index("lfemur")])
    np.testing.assert_allclose(turn, [0, 0, np.radians(20)], atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "what", "offset"),
    [
        ("name rfemur", "name lfemur", "bone defined twice", -2),
        ("dof rx ry rz", "dof rx ry rw", "unknown or repeated dof", 0),
        ("dof rx ry rz", "dof rx rx", "unknown or repeated dof", 0),
        ("length 7.5", "length long", "not a usable number", 0),
        ("length 7.5", "length -7.5", "a bone's length is needed", 0),
        ("length 7.5", "length", "a bone's length is needed", 0),
        ("length 7.5", "length nan", "not a usable number", 0),
        ("direction 0.0 -1.0 0.0", "direction 0.0 inf 0.0", "not a usable number", 0),
        ("direction 0.0 -1.0 0.0", "direction 0.0 -1.0", "three numbers are needed", 0),
        ("    direction 0.0 -1.0 0.0\n", "", "incomplete bone", -3),
        ("axis 0 0 20 XYZ", "axis 0 0 20 XYY", "unknown axis order", 0),
        ("order TX TY TZ RX RY RZ", "order TX TY TZ RX RY", "wrong root order", 0),
        ("angle deg", "angle gon", "unknown angle unit", 0),
        ("    lfemur ltibia\n", "    lfemur ltibai\n", "unknown bone in the hierarchy", None),
        ("    lfemur ltibia\n", "    lfemur ltibia rtibia\n", "a bone with two parents", None),
        ("    lfemur ltibia\n", "    ltibia lfemur\n", "a bone with two parents", None),
        ("    lfemur ltibia\n", "", "bones that the hierarchy does not connect", None),
        ("  end\n  begin\n    id 2", "  begin\n    id 2", "a bone begins inside another", None),
        (":bonedata\n", ":bonedata\n  loose text\n", "text outside of a bone", 1),
    ],
)
def test_each_fault_has_its_line(tmp_path: Path, old: str, new: str, what: str, offset: int | None) -> None:
    text = asf_text()
    path = write(tmp_path, text.replace(old, new, 1))
    with pytest.raises(InputError, match=what) as caught:
        read_asf(path)
    line = text[: text.index(old)].count("\n") + 1 + (offset or 0)
    where = caught.value.problems[0].where
    assert where == f"{path}:{line}" if offset is not None else str(path) in where


def test_a_deep_skeleton_needs_no_recursion(tmp_path: Path) -> None:
    count = MAX_BONES
    bones = "".join(f"begin\nname b{i}\ndirection 0 1 0\nlength 1\nend\n" for i in range(count))
    links = "root b0\n" + "".join(f"b{i} b{i + 1}\n" for i in range(count - 1))
    asf = read_asf(write(tmp_path, f":bonedata\n{bones}:hierarchy\nbegin\n{links}end\n"))
    assert len(asf.tree.names) == count + 1


def test_rest_pose_is_a_person_facing_x(tmp_path: Path) -> None:
    frames = read_amc(write_amc(tmp_path, amc_text(4)))
    assert frames.names == SENSORS and len(frames) == 4 and frames.rate_hz == 120.0
    assert frames.joints is not None and frames.joints.names == JOINTS
    limbs_lie_along_their_bones(frames)
    limbs_rest_as_one(frames)
    np.testing.assert_allclose(frames.orientation[0, frames.index("chest")], rotations.IDENTITY, atol=1e-12)
    at = {name: frames.position[0, i] / CMU_METRES for i, name in enumerate(frames.names)}
    np.testing.assert_allclose(at["pelvis"], [0.0, 0.0, 17.0], atol=1e-9)
    np.testing.assert_allclose(at["head"], [0.0, 0.0, 17.0 + 6 + 3.2 + 0.8], atol=1e-9)
    np.testing.assert_allclose(at["l_wrist"], [0.0, 3.5 + 5 + 3.4 + 1.7, 17.0 + 6], atol=1e-9)
    np.testing.assert_allclose(at["r_knee"], [0.0, -1.5, 17.0 - 2 - 7.5], atol=1e-9)
    np.testing.assert_allclose(at["l_toe"], [2.2 * 0.96, 1.5, 17.0 - 2 - 14.5 - 2.2 * 0.28], atol=1e-9)
    step = frames.position[1] - frames.position[0]
    np.testing.assert_allclose(step, np.broadcast_to([0.1 * CMU_METRES, 0, 0], step.shape), atol=1e-12)


def test_rate_and_unit_can_be_said(tmp_path: Path) -> None:
    path = write_amc(tmp_path, amc_text(5))
    frames = read_amc(path, ReadOptions(rate=60.0, unit="cm"))
    assert frames.rate_hz == 60.0 and frames.time[1] == pytest.approx(1 / 60) and frames.notes == ()
    assert frames.position[0, frames.index("pelvis"), 2] == pytest.approx(0.17)
    assert any("120 Hz" in note for note in read_amc(path).notes)
    for rate in (0.0, -1.0, float("nan"), float("inf"), 1e-300):
        with refuses(InputError):
            read_amc(path, ReadOptions(rate=rate))


def test_the_skeleton_is_found_by_subject_then_by_name_in_any_case(tmp_path: Path) -> None:
    (tmp_path / "07.ASF").write_text(asf_text())
    (tmp_path / "walk.asf").write_text(asf_text())
    assert find_skeleton(tmp_path / "07_12.amc").name == "07.ASF"
    assert find_skeleton(tmp_path / "walk.AMC").name == "walk.asf"
    with refuses(InputError, "07.ASF", "--skeleton", allowed="99.asf"):
        find_skeleton(tmp_path / "99_01.amc")
    with refuses(InputError, "ASF"):
        find_skeleton(tmp_path / "nowhere" / "99_01.amc")


@pytest.mark.parametrize(
    ("old", "new", "facts"),
    [
        ("ltibia 0\n", "ltibai 0\n", "ltibia"),
        ("ltibia 0\n", "ltibia\n", ("'ltibia'", 0, 1, "rx")),
        ("ltibia 0\n", "ltibia 0 0\n", ()),
        ("ltibia 0\n", "lhipjoint 0\n", ()),
        ("ltibia 0\n", "", ("ltibia", 2)),
        ("ltibia 0\n", "ltibia 0\nltibia 0\n", ()),
        ("ltibia 0\n", "ltibia nan\n", "'nan'"),
        ("ltibia 0\n", "ltibia -inf\n", "'-inf'"),
        ("ltibia 0\n", "ltibia 1e300\n", "1e300"),
        ("ltibia 0\n", "ltibia zero\n", "'zero'"),
        ("\n3\n", "\n5\n", (5, 3)),
        ("\n3\n", "\n2\n", (2, 3)),
    ],
)
def test_each_fault_of_a_frame_has_its_line(tmp_path: Path, old: str, new: str, facts: Facts) -> None:
    text = amc_text(3)
    second = text.index("\n2\n")
    at = text.index(old, second)
    path = write_amc(tmp_path, text[:at] + new + text[at + len(old) :])
    with refuses(InputError, facts) as caught:
        read_amc(path)
    line = int(caught.value.problems[0].where.removeprefix(f"{path}:"))
    expected = text[:at].count("\n") + 1 + new.count("\n") - 1
    if new:
        assert line in (expected, expected + (old == "\n3\n"))


@pytest.mark.parametrize("text", ["", "\n\n", ":DEGREES\n", "# nothing\n", "hello\n", "0\x000\n", "1\n", "1\n2\n"])
def test_texts_that_are_no_motion(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError):
        read_amc(write_amc(tmp_path, text))


def test_02_06_agrees_with_its_bvh_but_for_the_lost_thorax(shared: Path) -> None:
    amc = shared / "mocap/cmu_asfamc/02_06.amc"
    asf = read_asf(find_skeleton(amc))
    values, degrees = read_values(read_lines(amc), asf, amc)
    truth, names = pose_of(asf, values, degrees=degrees).position, asf.tree.names
    motion = read_motion(shared / "mocap/cmu_bvh_hahne/02_06.bvh")
    other, others = posed(motion.tree, motion.channels, motion.values).position[1:], motion.tree.names

    def separation(bone: str, joint: str) -> FloatArray:
        return np.asarray(np.linalg.norm(truth[:, names.index(bone)] - other[:, others.index(joint)], axis=1))

    below = {"root": "Hips", "upperback": "Spine", "thorax": "Spine1"}
    for side, word in (("l", "Left"), ("r", "Right")):
        for bone, joint in (("femur", "UpLeg"), ("tibia", "Leg"), ("foot", "Foot"), ("toes", "ToeBase")):
            below[side + bone] = word + joint
    for bone, joint in below.items():
        assert separation(bone, joint).max() < 1e-4, bone
    above = {"lowerneck": "Neck", "upperneck": "Neck1", "head": "Head"}
    for bone, joint in (above | {"lhumerus": "LeftArm", "rradius": "RightForeArm"}).items():
        np.testing.assert_allclose(separation(bone, joint), 2.068, atol=1e-3, err_msg=bone)


def test_endorphin_is_read_in_metres_with_its_skeleton_named(shared: Path) -> None:
    other = shared / "mocap/other"
    with refuses(InputError, "skeleton.asf"):
        read_amc(other / "walking.amc")
    frames = read_amc(other / "walking.amc", ReadOptions(skeleton=other / "skeleton.asf"))
    assert len(frames) == 1741 and frames.names == SENSORS
    assert 0.8 < frames.position[0, frames.index("pelvis"), 2] < 1.0
    with refuses(InputError):
        read_amc(other / "walking.amc", ReadOptions(skeleton=shared / "mocap/cmu_asfamc/02.asf"))
