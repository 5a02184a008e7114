"""Skeleton files: what is read, and one clear error with file and line for everything that is wrong."""

from pathlib import Path

import numpy as np
import pytest

from motion_texts import BONES, asf_text
from retarget import rotations
from retarget.errors import InputError
from retarget.sources.asf import MAX_BONES, read_asf
from support.messages import refuses


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
    x, y, z = (
        rotations.from_axis_angle(axis, np.radians(a)) for axis, a in zip(np.eye(3), (180, -30, -90), strict=True)
    )
    expected = rotations.multiply(z, rotations.multiply(y, x))
    actual = asf.frames[asf.tree.names.index("lradius")]
    assert abs(float(np.dot(actual, expected))) == pytest.approx(1.0)


def test_radians_line_ends_and_latin_letters_are_read(tmp_path: Path) -> None:
    text = asf_text().replace("angle deg", "angle rad").replace("axis 0 0 20", "axis 0 0 0.3490658504")
    path = tmp_path / "07.ASF"
    path.write_bytes(text.replace("made for a test", "für einen Test").replace("\n", "\r\n").encode("latin-1"))
    asf = read_asf(path)
    np.testing.assert_allclose(
        rotations.log(asf.frames[asf.tree.names.index("lfemur")]), [0, 0, np.radians(20)], atol=1e-9
    )


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
    assert old in text
    path = write(tmp_path, text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_asf(path)
    assert what in str(caught.value)
    assert str(path) in caught.value.problems[0].where
    if offset is not None:
        line = text[: text.index(old)].count("\n") + 1 + offset
        assert caught.value.problems[0].where == f"{path}:{line}"


def test_a_misspelt_bone_brings_the_nearest_names(tmp_path: Path) -> None:
    with refuses(InputError, next_step="ltibia"):
        read_asf(write(tmp_path, asf_text().replace("lfemur ltibia\n", "lfemur ltibai\n")))


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3, 0.6, 0.9, 0.97])
def test_a_file_cut_short_is_refused(tmp_path: Path, share: float) -> None:
    text = asf_text()
    with pytest.raises(InputError):
        read_asf(write(tmp_path, text[: int(share * len(text))]))


def test_other_files_are_refused(tmp_path: Path) -> None:
    with refuses(InputError, "ASF"):
        read_asf(write(tmp_path, "hello\n"))
    bone = "begin\nname b{}\ndirection 0 1 0\nlength 1\nend\n"
    with refuses(InputError):
        read_asf(write(tmp_path, ":bonedata\n" + "".join(bone.format(i) for i in range(MAX_BONES + 1))))


def test_a_deep_skeleton_needs_no_recursion(tmp_path: Path) -> None:
    count = MAX_BONES
    bones = "".join(f"begin\nname b{i}\ndirection 0 1 0\nlength 1\nend\n" for i in range(count))
    links = "root b0\n" + "".join(f"b{i} b{i + 1}\n" for i in range(count - 1))
    asf = read_asf(write(tmp_path, f":bonedata\n{bones}:hierarchy\nbegin\n{links}end\n"))
    assert len(asf.tree.names) == count + 1


def test_endorphin_and_cmu_skeletons(shared: Path) -> None:
    assert len(read_asf(shared / "mocap/other/skeleton.asf").tree.names) == 34
    for name in ("01", "02", "05", "49"):
        asf = read_asf(shared / f"mocap/cmu_asfamc/{name}.asf")
        assert len(asf.tree.names) == 31 and sum(map(len, asf.dof)) == 62
