"""Motions of robots from other programs: layouts that export does not write, and what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from messages import refuses
from pickles import convert, run_python
from recordings import moved, op3
from retarget.errors import InputError, UsageError
from retarget.model.robot import RobotBody, load_robot
from retarget.recording.exports.formats import FORMATS, export_motion
from retarget.recording.exports.reader import read_motion
from retarget.recording.motion import Motion
from retarget.rotations import from_rotation_vector

ROWS = 30


@pytest.fixture(scope="module")
def robot() -> RobotBody:
    return load_robot("op3")


@pytest.fixture(scope="module")
def motion() -> Motion:
    """Upright, so that the order of quaternions can be told."""
    found = moved(op3(), rows=ROWS)
    found.q[:, 3:7] = from_rotation_vector(np.outer(np.linspace(0.0, 1.0, ROWS), [0.1, 0.2, 0.9]))
    return found


def arrays(path: Path, motion: Motion, **other: Any) -> Path:
    """A GMR twin; `other` replaces keys, None leaves one out."""
    kept = {
        "fps": 30.0,
        "root_pos": motion.q[:, :3],
        "root_rot": motion.q[:, [4, 5, 6, 3]],
        "dof_pos": motion.joints,
        **other,
    }
    np.savez(path, **{key: value for key, value in kept.items() if value is not None})
    return path


def same(found: Motion, motion: Motion) -> None:
    np.testing.assert_allclose(found.q, motion.q, atol=1e-6)


def test_a_twin_of_gmr_without_names(motion: Motion, robot: RobotBody, tmp_path: Path) -> None:
    layout, found = read_motion(arrays(tmp_path / "a.npz", motion), robot)
    same(found, motion)
    assert layout == "gmr-npz" and found.rate_hz == 30.0 and not found.notes


def test_names_of_joints_go_before_their_order(motion: Motion, robot: RobotBody, tmp_path: Path) -> None:
    order = np.random.default_rng(1).permutation(len(motion.joint_names))
    names = np.array(motion.joint_names)[order]
    path = arrays(tmp_path / "a.npz", motion, dof_pos=motion.joints[:, order], joint_names=names)
    same(read_motion(path, robot)[1], motion)
    some = arrays(
        tmp_path / "b.npz", motion, dof_pos=motion.joints[:, 1:], joint_names=np.array(motion.joint_names[1:])
    )
    assert motion.joint_names[0] in read_motion(some, robot)[1].notes[0]


def test_the_qpos_of_holosoma(motion: Motion, robot: RobotBody, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", qpos=motion.q, fps=30)
    same(read_motion(tmp_path / "a.npz", robot)[1], motion)


@pytest.mark.parametrize("name", ["npz", "beyondmimic"])
def test_without_names_the_order_is_that_which_has_the_links_there(
    name: str, motion: Motion, robot: RobotBody, tmp_path: Path
) -> None:
    path = tmp_path / "a.npz"
    export_motion(motion, FORMATS[name], path)
    with np.load(path) as file:
        kept: dict[str, Any] = {key: values for key, values in file.items() if "names" not in key}
    np.savez(path, **kept)
    same(read_motion(path, robot)[1], motion)
    kept["joint_pos"] = kept["joint_pos"] + 0.5
    np.savez(path, **kept)
    with refuses(InputError, where="a.npz", found="mm", varies=str(tmp_path)):
        read_motion(path, robot)


def test_another_order_of_quaternions_can_be_said(motion: Motion, robot: RobotBody, tmp_path: Path) -> None:
    path = arrays(tmp_path / "a.npz", motion, root_rot=motion.q[:, 3:7])
    with refuses(InputError, where="a.npz", next_step="--quaternion wxyz"):
        read_motion(path, robot)
    same(read_motion(path, robot, quaternion="wxyz")[1], motion)


def test_a_layout_without_rate_needs_one(motion: Motion, robot: RobotBody, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    export_motion(motion, FORMATS["unitree"], path)
    with refuses(InputError, where="a.csv", next_step=("--fps", 30)):
        read_motion(path, robot)
    assert read_motion(path, robot, fps=60.0)[1].rate_hz == 60.0
    with refuses(InputError, found="nan"):
        read_motion(path, robot, fps=float("nan"))


@pytest.mark.parametrize(("name", "option"), [("csv", "fps"), ("csv", "quaternion"), ("bones", "quaternion")])
def test_what_the_layout_says_itself_cannot_be_given(
    name: str, option: str, motion: Motion, robot: RobotBody, tmp_path: Path
) -> None:
    export_motion(motion, FORMATS[name], tmp_path / "a.csv")
    value: Any = {"fps": 60.0, "quaternion": "wxyz"}[option]
    with refuses(UsageError, where=f"--{option}", found=value, next_step="Leave it out"):
        read_motion(tmp_path / "a.csv", robot, **{option: value})


def bad_number(motion: Motion) -> dict[str, Any]:
    joints = motion.joints.copy()
    joints[3, 2] = np.nan
    return {"dof_pos": joints}


WRONG: dict[str, Any] = {
    "columns": (lambda motion: {"dof_pos": motion.joints[:, 1:]}, {"found": 19, "allowed": ("20", "head_pan")}),
    "rows": (lambda motion: {"root_pos": motion.q[1:, :3]}, {"found": "29", "allowed": "30"}),
    "degrees": (lambda motion: {"dof_pos": np.rad2deg(motion.joints)}, {"found": "_", "next_step": "deg2rad"}),
    "centimetres": (lambda motion: {"root_pos": 100.0 * motion.q[:, :3]}, {"allowed": "metres"}),
    "quaternion": (lambda motion: {"root_rot": 2.0 * motion.q[:, 3:7]}, {"found": "row 1"}),
    "number": (bad_number, {"found": "row 4"}),
    "name": (
        lambda motion: {"joint_names": np.array(["head_pam", *motion.joint_names[1:]])},
        {"found": "head_pam", "next_step": "head_pan"},
    ),
    "rate": (lambda motion: {"fps": None}, {"next_step": "--fps"}),
    "key": (lambda motion: {"root_rot": None}, {"found": "dof_pos", "allowed": "root_rot"}),
    "object": (lambda motion: {"dof_pos": np.array([None], dtype=object)}, {"where": "dof_pos"}),
    "short": (
        lambda motion: {"root_pos": np.zeros((1, 3)), "root_rot": motion.q[:1, 3:7], "dof_pos": motion.joints[:1]},
        {"found": 1, "allowed": 3},
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_cannot_be_this_robot_is_refused(wrong: str, motion: Motion, robot: RobotBody, tmp_path: Path) -> None:
    change, facts = WRONG[wrong]
    path = arrays(tmp_path / "a.npz", motion, **change(motion))
    with refuses(InputError, **facts):
        read_motion(path, robot)


TEXTS: dict[str, tuple[str, dict[str, Any]]] = {
    "a header": ("x,y,z\n1,2,3\n", {"found": "x, y, z", "allowed": "bones"}),
    "a ragged row": ("0," * 26 + "0\n" + "0,0\n", {"where": "line 2", "found": 2, "allowed": 27}),
    "a word": ("0," * 26 + "high\n", {"where": ("line 1", "column 27"), "found": "high"}),
    "nothing": ("", {"found": "empty"}),
    "no root": ("1,2\n", {"found": 2}),
}


@pytest.mark.parametrize("text", TEXTS)
def test_a_text_that_is_no_motion(text: str, robot: RobotBody, tmp_path: Path) -> None:
    written, facts = TEXTS[text]
    (tmp_path / "a.csv").write_text(written)
    with refuses(InputError, **facts):
        read_motion(tmp_path / "a.csv", robot, fps=30.0)


@pytest.mark.parametrize("name", ["a.pkl", "a.csv"])
def test_a_pickle_is_refused_with_the_lines_that_convert_it(
    name: str, motion: Motion, robot: RobotBody, tmp_path: Path
) -> None:
    """By its name or by its first bytes."""
    path = tmp_path / name
    export_motion(motion, FORMATS["gmr"], path)
    with refuses(InputError, where=name, next_step=("pickle.load", "numpy.savez")) as caught:
        read_motion(path, robot)
    convert(caught.value, tmp_path)
    same(read_motion(tmp_path / "a_motion.npz", robot)[1], motion)


PICKLES = {
    "phc.pkl": "joblib.dump({'walk': {'root_trans_offset': p['root_pos'], 'root_rot': p['root_rot'], 'fps': 30, "
    "'dof': p['dof_pos'][:, :, None], 'pose_aa': None}}, open(name, 'wb'))",
    "phuma.npy": "numpy.save(name, {'root_trans': p['root_pos'], 'root_ori': p['root_rot'], 'dof_pos': p['dof_pos'], "
    "'fps': 30})",
}
"""Name of a pickle of a robot's motion -> how others write it."""


@pytest.mark.parametrize("name", PICKLES)
def test_the_lines_that_convert_a_pickle_make_what_is_read(
    name: str, motion: Motion, robot: RobotBody, tmp_path: Path
) -> None:
    arrays(tmp_path / "truth.npz", motion)
    loaded = "import joblib, numpy; p = dict(numpy.load('truth.npz'))"
    run_python(f"{loaded}\nname = {name!r}\n{PICKLES[name]}", tmp_path)
    with refuses(InputError, where=name) as caught:
        read_motion(tmp_path / name, robot)
    convert(caught.value, tmp_path)
    same(read_motion(tmp_path / f"{Path(name).stem}_motion.npz", robot)[1], motion)
