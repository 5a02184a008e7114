"""Each layout is read back as it is published, by readers of this file alone, and MuJoCo finds the links of the run."""

import csv
import io
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recordings import RATE, moved, op3
from retarget.model.robot import load_robot
from retarget.recording.exports.formats import FORMATS, export_motion, format_table
from retarget.recording.exports.trainers import tracking_arrays
from retarget.recording.motion import Motion, resampled

Array = NDArray[Any]
ROWS = 60
MM = 1e-3
ROOT = Path(__file__).resolve().parents[3]


@dataclass(frozen=True)
class Played:
    """A motion as a trainer has it: root (T, 3) m and (T, 4) wxyz, joints (T, n) rad in the order of MuJoCo."""

    position: Array
    quaternion: Array
    joints: Array
    fps: float


@pytest.fixture(scope="module")
def model() -> Any:
    return mujoco.MjModel.from_xml_path(str(load_robot("op3").profile.body_path))


@pytest.fixture(scope="module")
def motion() -> Motion:
    found = moved(op3(), rows=ROWS)
    found.q[20:, 3:7] *= -1.0  # the same orientations; a sign that flips is the writer's to mend
    return found


def joints_of(model: Any) -> list[str]:
    return [model.joint(index).name for index in range(1, model.njnt)]


def isaac_order(model: Any) -> tuple[list[str], list[str]]:
    """Links and joints level by level of the tree."""
    level, links = [1], list[int]()
    while level:
        links += level
        level = [child for link in level for child in range(2, model.nbody) if model.body_parentid[child] == link]
    joints = [joint for link in links for joint in range(1, model.njnt) if model.jnt_bodyid[joint] == link]
    return [model.body(link).name for link in links], [model.joint(joint).name for joint in joints]


def links_of(model: Any, played: Played) -> tuple[Array, Array]:
    """Origins (T, b, 3) and orientations (T, b, 4) of all links but the world."""
    data, places, turns = mujoco.MjData(model), [], []
    for row in range(len(played.joints)):
        data.qpos[:] = np.concatenate([played.position[row], played.quaternion[row], played.joints[row]])
        mujoco.mj_kinematics(model, data)
        places.append(data.xpos[1:].copy())
        turns.append(data.xquat[1:].copy())
    return np.array(places), np.array(turns)


def of_run(motion: Motion) -> Played:
    return Played(motion.q[:, :3], motion.q[:, 3:7], motion.q[:, 7:], motion.rate_hz)


def loaded(path: Path) -> dict[str, Array]:
    with np.load(path, allow_pickle=False) as file:
        return dict(file)


def wxyz(quaternion: Array) -> Array:
    return quaternion[:, [3, 0, 1, 2]]


def numbers(path: Path) -> tuple[list[str], Array]:
    head, *rows = csv.reader(io.StringIO(path.read_text()))
    return head, np.array(rows, dtype=float)


# The readers: from the published layouts.


def read_mjlab(path: Path, model: Any) -> Played:
    file = loaded(path)
    assert file["fps"].dtype == np.int64 and str(file["quaternion_order"]) == "wxyz"
    assert file["joint_names"].tolist() == joints_of(model) and file["body_names"][0] == "body_link"
    shapes = {
        "joint_pos": (20,),
        "joint_vel": (20,),
        "body_pos_w": (21, 3),
        "body_quat_w": (21, 4),
        "body_lin_vel_w": (21, 3),
        "body_ang_vel_w": (21, 3),
    }
    assert {key: file[key].shape[1:] for key in shapes} == shapes
    assert {array.dtype for array in file.values() if array.ndim > 1} == {np.dtype(np.float32)}
    whole = Played(file["body_pos_w"][:, 0], file["body_quat_w"][:, 0], file["joint_pos"], 0.0)
    places, turns = links_of(model, whole)
    np.testing.assert_allclose(file["body_pos_w"], places, atol=1e-6)
    np.testing.assert_allclose(np.abs(np.sum(file["body_quat_w"] * turns, axis=2)), 1.0, atol=1e-6)
    return Played(file["body_pos_w"][:, 0], file["body_quat_w"][:, 0], file["joint_pos"], float(file["fps"][0]))


def read_beyondmimic(path: Path, model: Any) -> Played:
    file, (links, joints) = loaded(path), isaac_order(model)
    assert file["body_names"].tolist() == links and file["joint_names"].tolist() == joints
    assert joints != joints_of(model)
    order = [joints.index(name) for name in joints_of(model)]
    rows = [links.index(model.body(body).name) for body in range(1, model.nbody)]
    joint_pos, played = file["joint_pos"][:, order], file["body_pos_w"][:, rows]
    found = Played(file["body_pos_w"][:, 0], file["body_quat_w"][:, 0], joint_pos, float(file["fps"][0]))
    np.testing.assert_allclose(played, links_of(model, found)[0], atol=MM)
    return found


def read_holosoma(path: Path, model: Any) -> Played:
    file = loaded(path)
    assert file["body_names"].tolist() == [model.body(body).name for body in range(model.nbody)]
    assert file["joint_names"].tolist() == joints_of(model)
    assert file["joint_pos"].shape == (ROWS, 27) and file["joint_vel"].shape == (ROWS, 26)
    assert {values.dtype for key, values in file.items() if values.ndim > 1} == {np.dtype(np.float64)}
    whole = file["joint_pos"]
    found = Played(whole[:, :3], whole[:, 3:7], whole[:, 7:], float(file["fps"][0]))
    np.testing.assert_allclose(file["body_pos_w"][:, 1:], links_of(model, found)[0], atol=MM)
    assert not file["body_pos_w"][:, 0].any() and (file["body_quat_w"][:, 0] == [1.0, 0.0, 0.0, 0.0]).all()
    return found


def read_unitree(path: Path, model: Any) -> Played:
    rows = np.loadtxt(path, delimiter=",")
    return Played(rows[:, :3], wxyz(rows[:, 3:7]), rows[:, 7:], 30.0)


def read_gmr(path: Path, model: Any) -> Played:
    """As GMR's users do it, in a program of their own: nothing of this project reads a pickle."""
    script = (
        "import sys, pickle, numpy\n"
        "class Numpy(pickle.Unpickler):\n"
        "    def find_class(self, module, name):\n"
        "        assert (module, name) in {('numpy', 'ndarray'), ('builtins', 'bytearray')}, (module, name)\n"
        "        return super().find_class(module, name)\n"
        "kept = Numpy(open(sys.argv[1], 'rb')).load()\n"
        "assert type(kept) is dict and type(kept['fps']) is float\n"
        "numpy.savez(sys.argv[2], allow_pickle=False, **{key: numpy.array(one) for key, one in kept.items()})\n"
    )
    twin = path.with_suffix(".twin.npz")
    subprocess.run([sys.executable, "-I", "-c", script, str(path), str(twin)], check=True, timeout=60)
    return read_gmr_npz(twin, model)


def read_gmr_npz(path: Path, model: Any) -> Played:
    file = loaded(path)
    found = Played(file["root_pos"], wxyz(file["root_rot"]), file["dof_pos"], float(file["fps"]))
    assert file["link_body_list"].tolist() == [model.body(body).name for body in range(1, model.nbody)]
    turned = Rotation.from_quat(file["root_rot"])
    places = np.stack([turned.apply(file["local_body_pos"][:, link]) for link in range(model.nbody - 1)], axis=1)
    np.testing.assert_allclose(places + found.position[:, None], links_of(model, found)[0], atol=MM)
    return found


UNEVEN = """
import io
from dataclasses import replace
from recordings import moved, op3
from retarget.errors import InputError
from retarget.recording.exports.trainers import write_bones, write_unitree

motion = moved(op3(), rows=9)
for write in (write_unitree, write_bones):
    try:
        write(replace(motion, time=motion.time**2), io.BytesIO())
    except InputError:
        continue
    raise SystemExit(f"{write.__name__} wrote uneven rows")
"""


def test_uneven_rows_are_refused_where_assertions_are_off() -> None:
    paths = os.pathsep.join(map(str, (ROOT, ROOT / "tests" / "support")))
    command = [sys.executable, "-O", "-c", UNEVEN]
    subprocess.run(command, check=True, timeout=60, env=os.environ | {"PYTHONPATH": paths})


def read_bones(path: Path, model: Any) -> Played:
    head, rows = numbers(path)
    of = dict(zip(head, rows.T, strict=True))
    assert head[0] == "Frame" and of["Frame"].tolist() == list(range(len(rows)))
    position = np.stack([of[f"root_translate{axis}"] for axis in "XYZ"], axis=1) / 100.0
    angles = np.stack([of[f"root_rotate{axis}"] for axis in "XYZ"], axis=1)
    fixed_axes = Rotation.from_euler("xyz", angles, degrees=True)  # small letters: about fixed axes, in this order
    joints = np.deg2rad(np.stack([of[f"{name}_dof"] for name in joints_of(model)], axis=1))
    return Played(position, fixed_axes.as_quat(scalar_first=True), joints, 120.0)


def read_sonic(path: Path, model: Any) -> Played:
    head, joint_pos = numbers(path / "joint_pos.csv")
    assert head == isaac_order(model)[1] and numbers(path / "joint_vel.csv")[1].shape == joint_pos.shape
    lines = (path / "metadata.txt").read_text().splitlines()
    assert "[0]" in lines and lines[-1].split(": ")[1] == str(len(joint_pos))
    order = [head.index(name) for name in joints_of(model)]
    place, turned = (numbers(path / name)[1] for name in ("body_pos.csv", "body_quat.csv"))
    return Played(place, turned, joint_pos[:, order], 50.0)


READERS: dict[str, Callable[[Path, Any], Played]] = {
    "npz": read_mjlab,
    "beyondmimic": read_beyondmimic,
    "holosoma": read_holosoma,
    "unitree": read_unitree,
    "gmr": read_gmr,
    "gmr-npz": read_gmr_npz,
    "bones": read_bones,
    "sonic": read_sonic,
}


@pytest.fixture(scope="module")
def written(motion: Motion, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All formats at the rate of the run."""
    folder = tmp_path_factory.mktemp("exports")
    for name in READERS:
        export_motion(motion, FORMATS[name], folder / f"run{FORMATS[name].ending}")
    return folder


@pytest.mark.parametrize("name", READERS)
def test_who_reads_a_layout_has_the_links_of_the_run(name: str, written: Path, motion: Motion, model: Any) -> None:
    played = READERS[name](written / f"run{FORMATS[name].ending}", model)
    for found, true in zip(links_of(model, played), links_of(model, of_run(motion)), strict=True):
        if found.shape[-1] == 4:
            true = true * np.sign(np.sum(found * true, axis=-1, keepdims=True))
        np.testing.assert_allclose(found, true, atol=MM)


@pytest.mark.parametrize("name", ["npz", "holosoma", "unitree", "gmr-npz", "sonic"])
def test_quaternions_do_not_change_their_sign(name: str, written: Path, model: Any) -> None:
    turned = READERS[name](written / f"run{FORMATS[name].ending}", model).quaternion
    assert (np.sum(turned[1:] * turned[:-1], axis=1) > 0.0).all()


@pytest.mark.parametrize("name", READERS)
def test_the_rate_is_that_which_readers_expect(name: str, motion: Motion, model: Any, tmp_path: Path) -> None:
    form = FORMATS[name]
    assert form.conventions.fps in (30.0, 50.0, 120.0)
    again = resampled(motion, form.conventions.fps)
    export_motion(again, form, tmp_path / f"run{form.ending}")
    if name != "holosoma":  # whose reader of this file counts rows
        played = READERS[name](tmp_path / f"run{form.ending}", model)
        assert played.fps == form.conventions.fps
        assert len(played.joints) == int((ROWS - 1) / RATE * form.conventions.fps + 1e-9) + 1


def test_velocities_of_holosoma_are_those_of_root_and_centres_of_mass(written: Path, model: Any) -> None:
    """A velocity of a joint is the central difference; MuJoCo, at those velocities, moves centres of mass so."""
    file, row, dt = loaded(written / "run_holosoma.npz"), 31, 1.0 / RATE
    whole, data, centres = file["joint_pos"], mujoco.MjData(model), []
    for at in (row - 1, row + 1):
        data.qpos[:] = whole[at]
        mujoco.mj_kinematics(model, data)
        centres.append(data.xipos[1:].copy())
    np.testing.assert_allclose(file["body_lin_vel_w"][row, 1:], (centres[1] - centres[0]) / (2.0 * dt), atol=1e-6)
    np.testing.assert_allclose(file["joint_vel"][row, 6:], (whole[row + 1] - whole[row - 1])[7:] / (2.0 * dt))
    turns = Rotation.from_quat(whole[[row - 1, row + 1], 3:7], scalar_first=True)
    np.testing.assert_allclose(file["joint_vel"][row, 3:6], (turns[1] * turns[0].inv()).as_rotvec() / (2.0 * dt))


def test_velocities_of_mjlab_are_those_of_its_links(motion: Motion) -> None:
    arrays, row, link = tracking_arrays(motion), 31, 7
    step = np.diff(motion.joints, axis=0) * RATE
    np.testing.assert_allclose(arrays["joint_vel"][1:-1], (step[1:] + step[:-1]) / 2.0, rtol=1e-4, atol=1e-4)
    turns = Rotation.from_quat(arrays["body_quat_w"][[row - 1, row + 1], link].astype(float), scalar_first=True)
    world = (turns[1] * turns[0].inv()).as_rotvec() * RATE / 2.0
    np.testing.assert_allclose(arrays["body_ang_vel_w"][row, link], world, atol=1e-3)


def test_a_turning_root_has_its_speed_at_every_row_also_at_the_ends() -> None:
    motion = moved(op3(), rows=30)
    turn = Rotation.from_rotvec(np.outer(motion.time, [0.3, -0.4, 1.2]))
    motion.q[:, 3:7] = turn.as_quat(scalar_first=True)
    np.testing.assert_allclose(tracking_arrays(motion)["body_ang_vel_w"][:, 0], [[0.3, -0.4, 1.2]] * 30, atol=1e-5)


def test_sonic_velocities_are_those_of_its_positions(written: Path) -> None:
    for of, speed in (("joint_pos", "joint_vel"), ("body_pos", "body_lin_vel")):
        place, rate = (numbers(written / f"run_sonic/{name}.csv")[1] for name in (of, speed))
        np.testing.assert_allclose(rate[1:-1], (place[2:] - place[:-2]) * RATE / 2.0, atol=1e-6)


def test_the_table_of_the_site_has_every_format() -> None:
    assert [line.split("`")[1] for line in format_table().splitlines()[2:]] == list(FORMATS)
