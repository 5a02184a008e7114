"""Every layout of motion files: one made motion is written in each, read back, and compared with the truth."""

import ast
import json
import re
import struct
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import made_layouts
import motion_texts
from command_line import code_of
from made_layouts import (
    LAYOUTS,
    NO_LENGTHS,
    NO_RATE,
    NO_TURNS,
    STATURE_M,
    Made,
    glb_bytes,
    gltf_parts,
    made,
    named_rig,
    write_amass,
    write_glb,
    write_joints,
    write_kimodo,
    write_mvnx,
    write_trc,
)
from messages import Facts, refuses, shows
from pickles import convert, run_python
from retarget import rotations
from retarget.errors import InputError, UsageError
from retarget.frames import SensorFrames, stature
from retarget.human.calibration import calibrate
from retarget.sources.open import open_source, recognise
from retarget.sources.skeletons import SMPL_NAMES
from retarget.types import FloatArray

Writer = Callable[[Path, Made], Path]
TRACK = "global_joint_positions"
FPS: dict[str, Any] = {"fps": np.array(30.0)}
NO_TEXT = np.array([2**31], "<u4").view("<U1")
TOPLESS = ("UpperLeg_L", "Kimodo, SOMA-30", "Kimodo, SMPL", "GLB", "glTF", "VRMA")
"""Layouts without a top of the head: its middle is where it usually is."""


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def changed(path: Path, **changes: Any) -> Path:
    """The arrays of a file, some of them others; None takes one out."""
    arrays = dict(np.load(path)) | changes
    np.savez(path, **{name: values for name, values in arrays.items() if values is not None})
    return path


@contextmanager
def within(mib: int) -> Iterator[None]:
    """Python takes no more memory than this."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < mib * 2**20
    finally:
        tracemalloc.stop()


def off(frames: SensorFrames, motion: Made) -> dict[str, float]:
    """Greatest distance, m, of each joint (of a sensor, where there are none) from the truth."""
    if frames.joints is not None:
        tracks = {joint: frames.joints.of(joint) for joint in frames.joints.names}
    else:
        tracks = {sensor: frames.position[:, at] for at, sensor in enumerate(frames.names)}
    return {
        name: float(np.nanmax(np.linalg.norm(track - motion.joints[name], axis=-1))) for name, track in tracks.items()
    }


@pytest.mark.parametrize("rate", made_layouts.RATES_HZ)
@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_is_read_as_the_motion(tmp_path: Path, name: str, rate: float) -> None:
    if "splines" in name and rate < 100.0:
        pytest.skip("keys that are 0.1 s apart are another motion")
    motion = made(rate)
    frames = open_source(
        LAYOUTS[name](tmp_path, motion), rate=rate if name.startswith((*NO_RATE, "Kimodo", "GLB,")) else None
    )
    assert len(frames) == len(motion.time) and frames.rate_hz == rate
    wrong = off(frames, motion)
    if name.startswith(TOPLESS):
        assert wrong.pop("head") < 0.01
    assert max(wrong.values()) < (0.05 if name in NO_LENGTHS else 0.001), wrong
    for at, sensor in enumerate(frames.names):
        turned = rotations.angle_between(frames.orientation[:, at], motion.sensor_turn(sensor))
        assert np.isnan(turned).all() if name in NO_TURNS else np.degrees(turned).max() < 0.1, sensor
    if frames.skeleton is not None:
        size = calibrate(frames).stature
        assert size == pytest.approx(1.7 if name in NO_LENGTHS and "markers" not in name else STATURE_M, rel=0.02)


FOLLOWED = [name for name in LAYOUTS if not name.startswith(("GLB,", "glTF"))]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name == "GLB" else pytest.mark.long) for name in FOLLOWED]
)
def test_op3_follows_every_layout_to_the_end(tmp_path: Path, name: str) -> None:
    path = LAYOUTS[name](tmp_path, made(30.0))
    rate = ["--rate", "30"] if name in NO_RATE else []
    assert code_of("run", "--robot", "op3", "--source", path, *rate) == 0


def test_lengths_come_from_markers_then_from_the_stature_then_from_the_average(tmp_path: Path) -> None:
    motion, ends = made(30.0), (("knee", "ankle"), ("elbow", "wrist"))

    def limbs(path: Path, stature: float | None = None) -> list[float]:
        skeleton = open_source(path, stature=stature).skeleton
        assert skeleton is not None
        return [skeleton.distance(f"l_{a}", f"l_{b}") for a, b in ends]

    truth = [float(np.linalg.norm(motion.rest[f"l_{a}"] - motion.rest[f"l_{b}"])) for a, b in ends]
    marked = write_amass(tmp_path, motion, markers=True)
    for given_stature in (None, 1.9):
        np.testing.assert_allclose(limbs(marked, given_stature), truth, atol=1e-6)
    plain = write_amass(tmp_path, motion)
    np.testing.assert_allclose(limbs(plain, 1.9), [0.246 * 1.9, 0.146 * 1.9], atol=1e-9)
    np.testing.assert_allclose(limbs(plain), [0.246 * 1.7, 0.146 * 1.7], atol=1e-9)
    shows(" ".join(open_source(plain).notes), "--stature")
    unseen = {"marker_data": np.full((91, 2, 3), np.nan), "marker_labels": np.array(["LKNE", "LANK"])}
    np.testing.assert_allclose(limbs(changed(plain, **unseen)), [0.246 * 1.7, 0.146 * 1.7], atol=1e-9)


SMPL_POSES = made_layouts.smpl_arrays(made(30.0))[0]


@pytest.mark.parametrize(
    "changes",
    [
        *(
            {"gender": name, "betas": np.full(16, 3.0)}
            for name in (np.array("male"), np.array(b"male"), np.array(["x"]))
        ),
        {"gender": np.array(["x"], object), "betas": np.full(16, 3.0)},
        *({"poses": np.hstack([SMPL_POSES, np.ones((91, width - 66))])} for width in (66, 72, 156, 165)),
        {"marker_data": np.zeros((91, 2, 3)), "marker_labels": np.array(["LKNE", "LANK"], object)},
    ],
    ids=range(9),
)
def test_gender_shape_fingers_and_labels_that_are_objects_do_not_matter(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    """The body of every model of the family."""
    plain = open_source(write_amass(tmp_path, made(30.0)), stature=1.9)
    other = open_source(write_amass(tmp_path, made(30.0), **changes), stature=1.9)
    np.testing.assert_array_equal(other.position, plain.position)
    if "marker_labels" in changes:
        shows(" ".join(other.notes), "marker_labels", "--stature")


def test_an_amass_file_in_cm_is_refused_until_its_unit_is_said(tmp_path: Path) -> None:
    path = write_amass(tmp_path, made(30.0))
    path = changed(path, trans=100.0 * np.load(path)["trans"])
    with pytest.raises(InputError, match="--unit"):
        open_source(path)
    assert len(open_source(path, unit="cm").time) == 91


def y_up_smpl(motion: Made) -> dict[str, FloatArray]:
    """A motion in SMPL's own words, y up."""
    poses, trans = made_layouts.smpl_arrays(motion)
    turn = rotations.from_matrix(made_layouts.Y_UP.T)
    root = rotations.multiply(turn, rotations.from_rotation_vector(poses[:, :3]))
    shift = np.array([0.0, -0.22, 0.03])
    transl = rotations.rotate(turn, trans + shift) - shift
    return {"global_orient": rotations.log(root), "body_pose": poses[:, 3:], "transl": transl}


def test_what_gvhmr_converts_to_is_y_up(tmp_path: Path) -> None:
    motion = made(30.0)
    np.savez(tmp_path / "a.npz", allow_pickle=False, **y_up_smpl(motion), betas=np.zeros((91, 10)), fps=np.array(30.0))
    frames = open_source(tmp_path / "a.npz", stature=STATURE_M)
    assert max(off(frames, motion).values()) < 0.01
    assert np.degrees(rotations.angle_between(frames.orientation[:, 1], motion.sensor_turn("l_wrist"))).max() < 0.1


def test_joints_with_names_may_come_in_any_order_and_others_beside_them(tmp_path: Path) -> None:
    motion, order = made(30.0), np.random.default_rng(1).permutation(22).tolist()
    mujoco = [re.sub(r"^(left|right)_", lambda side: f"{side[1][0].upper()}_", name) for name in SMPL_NAMES[:22]]
    mujoco = [{"L_collar": "L_Thorax", "R_collar": "R_Thorax"}.get(name, name) for name in mujoco]
    for known, more in ((SMPL_NAMES, []), (SMPL_NAMES, ["thing0", "thing1"]), (mujoco, [])):
        names, columns = [known[at] for at in order] + more, [*order, *([0] * len(more))]
        path = changed(
            write_joints(tmp_path, motion), **{TRACK: TRACKS[:, columns], "joint_names": np.array(names)} | FPS
        )
        frames = open_source(path)
        assert max(off(frames, motion).values()) < 0.01 and frames.rate_hz == 30.0


# The refusals.


TRACKS = made_layouts.smpl_rig().poses(made(30.0), made_layouts.Z_UP)[0]


def lost(gaps: dict[int, slice]) -> FloatArray:
    """Joints (T, 22, 3) of which those of these columns are NaN in these frames."""
    tracks = TRACKS.copy()
    for column, rows in gaps.items():
        tracks[rows, column] = np.nan
    return tracks


WRONG_ARRAYS: list[tuple[Writer, dict[str, Any], Facts]] = [
    (write_amass, {"mocap_framerate": None}, "--rate"),
    (write_amass, {"mocap_framerate": np.array(0.0)}, "0 Hz"),
    (write_amass, {"mocap_framerate": np.array([30.0, 30.0])}, "mocap_framerate"),
    (write_amass, {"poses": np.zeros((91, 100))}, ("poses", "(91, 100)", 156)),
    (write_amass, {"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))}, "200000"),
    (write_amass, {"poses": np.full((91, 156), np.nan)}, ("poses", "nan")),
    (write_amass, {"poses": np.full((91, 156), 1e12)}, "1e9"),
    (write_amass, {"poses": np.array([["a"]])}, "poses"),
    (write_amass, {"marker_data": np.ones((91, 1, 3)), "marker_labels": NO_TEXT}, "marker_labels"),
    (write_amass, {"trans": np.zeros((90, 3))}, ("trans", "(90, 3)")),
    (write_amass, {"trans": None}, "poses"),
    (write_amass, {"poses": np.array([[{}]], object)}, ("pickle", "poses", "numpy.asarray")),
    (write_joints, {}, "--rate"),
    (write_joints, {TRACK: TRACKS[:, [*range(22), 0]]} | FPS, (23, 22, 24, 52)),
    (write_joints, {TRACK: TRACKS[:, :0]} | FPS, (0, 22, 24, 52)),
    (write_joints, {"height": np.array(170.0)} | FPS, ("height", 170)),
    (write_joints, {TRACK: lost({4: slice(None)})} | FPS, "l_knee"),
    (write_joints, {TRACK: lost({4: slice(0, 40), 7: slice(40, None)})} | FPS, "l_knee to l_ankle"),
    (write_joints, {TRACK: lost({1: slice(0, 40), 2: slice(40, None)})} | FPS, "trunk"),
    (write_joints, {TRACK: np.roll(TRACKS, 1, axis=1)} | FPS, ("order", "joint_names")),
    (write_joints, {"joint_names": np.array([f"marker{i}" for i in range(22)])} | FPS, ("joint_names", "marker0")),
    (write_joints, {"joint_names": np.array(["left_hip"])} | FPS, "joint_names"),
    (write_joints, {TRACK: None, "height": None, "qpos": np.zeros((3, 36))} | FPS, ("qpos", "fps", TRACK)),
    (write_kimodo, {"posed_joints": np.zeros((91, 40, 3))}, (40, 77, 30, 22)),
    (write_kimodo, {"posed_joints": np.zeros((91, 34, 3)), "global_rot_mats": np.ones((91, 34, 3, 3))}, (34, "G1", 77)),
    (write_kimodo, {"global_rot_mats": 2.0 * np.tile(np.eye(3), (91, 77, 1, 1))}, "global_rot_mats"),
]


@pytest.mark.parametrize(("write", "changes", "facts"), WRONG_ARRAYS, ids=range(len(WRONG_ARRAYS)))
def test_arrays_that_are_wrong_are_named(tmp_path: Path, write: Writer, changes: dict[str, Any], facts: Facts) -> None:
    path = changed(write(tmp_path, made(30.0)), **changes)
    with refuses(InputError, facts, where=str(path)):
        open_source(path)


def test_joints_that_are_lost_for_a_while_are_read_as_lost_markers_are(tmp_path: Path) -> None:
    motion = made(30.0)
    gaps = lost({0: slice(3, 5), 4: slice(0, 40, 9), 15: slice(2, 9)})
    path = changed(write_joints(tmp_path, motion), global_joint_positions=gaps)
    frames = open_source(path, rate=30.0)
    unseen = {name: np.flatnonzero(~frames.valid[:, at]).tolist() for at, name in enumerate(frames.names)}
    expected = {"pelvis": [3, 4], "l_knee": [0, 9, 18, 27, 36], "head": list(range(2, 9))}
    assert {name: rows for name, rows in unseen.items() if rows} == expected
    assert max(off(frames, motion).values()) < 0.001
    assert calibrate(frames).stature == pytest.approx(STATURE_M, rel=0.02)
    shows(" ".join(frames.notes), "head lost in 7 of", "l_knee lost in 5 of")
    assert code_of("run", "--robot", "op3", "--source", path, "--rate", "30") == 0


@pytest.mark.parametrize(
    ("name", "content", "facts"),
    [
        ("hmr4d.pt", b"PK\3\4", ("torch.load", "numpy.savez", "hmr4d_motion.npz", "smpl_params_global")),
        ("wham_output.pkl", b"\x80\x03}joblib", ("joblib.load", "numpy.savez", "pose_world")),
        ("a.joblib", b"x\x9c\x01", "joblib.load"),
        ("packed.pkl", b"x\x9c\x01", "joblib.load"),
        ("noname", b"\x80\x04\x95", "pickle.load"),
        ("track.npy", b"\x93NUMPY\1\0", ("numpy.load", "global_joint_positions")),
        ("a.fbx", b"Kaydara FBX Binary  \0", ("BVH", "GLB")),
        ("ascii.fbx", b"; FBX 7.7.0 project file", ("BVH", "GLB")),
        ("a.npz", b"PK\3\4", "a.npz"),
        ("a.npz", b"nothing", "a.npz"),
    ],
)
def test_what_is_never_read_is_refused_with_what_converts_it(
    tmp_path: Path, name: str, content: bytes, facts: Facts
) -> None:
    path = written(tmp_path / name, content)
    with refuses(InputError, facts, where=str(path)):
        open_source(path)


LOADED = "import pickle, joblib, torch, numpy as np\np = dict(np.load('truth.npz'))\n"
SMPL_PICKLES = {
    "wham_output.pkl": "kept = np.hstack([p['global_orient'], p['body_pose'], np.zeros((len(p['transl']), 6))])\n"
    "joblib.dump({0: {'pose': 0 * kept, 'pose_world': kept, 'trans_world': p['transl']}}, open(name, 'wb'))",
    "hmr4d_results.pt": "kept = {key: torch.Tensor(value) for key, value in p.items()}\n"
    "torch.dump({'smpl_params_incam': {}, 'smpl_params_global': kept}, open(name, 'wb'))",
    "dance.pkl": "pickle.dump({**p, 'fps': 30, 'name': 'dance', 'more': {}}, open(name, 'wb'))",
    "dance.npy": "np.save(name, {**p, 'fps': 30.0, 'name': 'dance'})",
}
"""Name of a pickle of the SMPL family -> how others write it."""


@pytest.mark.parametrize("name", SMPL_PICKLES)
def test_the_lines_that_convert_a_pickle_make_what_is_read(tmp_path: Path, name: str) -> None:
    motion = made(30.0)
    np.savez(tmp_path / "truth.npz", allow_pickle=False, **y_up_smpl(motion))
    run_python(f"{LOADED}name = {name!r}\n{SMPL_PICKLES[name]}", tmp_path)
    with refuses(InputError, next_step="docs/motion-files.md" if "dance" in name else "numpy.savez") as caught:
        open_source(tmp_path / name)
    convert(caught.value, tmp_path)
    frames = open_source(tmp_path / f"{Path(name).stem}_motion.npz", stature=STATURE_M)
    assert frames.rate_hz == 30.0
    assert max(off(frames, motion).values()) < 0.01


def test_the_lines_that_name_an_array_make_what_is_read(tmp_path: Path) -> None:
    motion = made(30.0)
    np.save(tmp_path / "track.npy", np.load(write_joints(tmp_path, motion))["global_joint_positions"])
    with refuses(InputError, next_step="numpy.savez") as caught:
        open_source(tmp_path / "track.npy")
    convert(caught.value, tmp_path)
    assert max(off(open_source(tmp_path / "track_motion.npz", rate=30.0), motion).values()) < 0.01


@pytest.mark.parametrize("suffix", ["pt", "pkl", "npy"])
def test_a_file_s_name_is_a_text_in_the_lines_that_convert_it(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path / f'w"); import os; os.abort(); ("{suffix}.{suffix}', b"?")
    with refuses(InputError, "numpy.savez") as caught:
        open_source(path)
    tree = list(ast.walk(ast.parse("\n".join(str(caught.value).splitlines()[1:-1]))))
    assert not any(isinstance(node, ast.alias) and node.name == "os" for node in tree)
    assert any(isinstance(node, ast.Constant) and node.value == path.name for node in tree)


def test_what_torch_saves_is_known_by_its_content(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("archive/data.pkl", b"\x80\x02.")
    with refuses(InputError, "torch.load"):
        recognise(tmp_path / "a.npz")


def test_an_array_that_unpacks_to_too_much_is_not_unpacked(tmp_path: Path) -> None:
    header = BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 156)})
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("trans.npy", b"")
        with archive.open("poses.npy", "w", force_zip64=True) as stream:
            stream.write(header.getvalue())
            for _ in range(300):
                stream.write(bytes(2**20))
    assert (tmp_path / "a.npz").stat().st_size < 2 * 2**20
    with refuses(InputError, allowed=256 * 2**20):
        open_source(tmp_path / "a.npz")


def test_options_of_one_format_are_refused_elsewhere_and_the_common_ones_work(tmp_path: Path) -> None:
    motion = made(30.0)
    for name in ("GLB", "MVNX", "Kimodo, SOMA-77", "SOMA, 3 channels"):
        path = LAYOUTS[name](tmp_path, motion)
        plain = open_source(path)
        tall = open_source(path, stature=1.9)
        assert plain.skeleton is not None and tall.skeleton is not None
        assert stature(tall.skeleton) == pytest.approx(1.9)
        half = open_source(path, unit="cm") if name != "SOMA, 3 channels" else plain
        assert np.allclose(half.position, 0.01 * plain.position) or name == "SOMA, 3 channels"
        lying = open_source(path, up="x")
        shows(" ".join(lying.notes), "--up")
        with refuses(UsageError, where=("--stature", "--unit")):
            open_source(path, stature=1.9, unit="m")
        with refuses(UsageError, next_step="--markers"):
            open_source(path, markers="table.yaml")
        if name != "SOMA, 3 channels":
            with refuses(UsageError, next_step="--performer-root"):
                open_source(path, performer_root="Hips")
    trc = write_trc(tmp_path, motion)
    (tmp_path / "table.yaml").write_text("markers:\n  chest: [LSHO, RSHO]\n")
    assert "chest" in open_source(trc, markers=tmp_path / "table.yaml").names
    assert open_source(trc, rate=60.0).rate_hz == 60.0
    metres = open_source(write_trc(tmp_path, motion, unit="m"))
    assert max(off(metres, motion).values()) < 0.001


def test_a_left_handed_file_is_read_with_a_note(tmp_path: Path) -> None:
    motion = made(30.0)
    path = changed(write_joints(tmp_path, motion), global_joint_positions=TRACKS * [1.0, -1.0, 1.0])
    frames = open_source(path, rate=30.0)
    assert max(off(frames, motion).values()) < 0.001
    shows(" ".join(frames.notes), "--mirror")


# glTF.


Document = dict[str, Any]
PARTS = gltf_parts(named_rig("bandai"), made(30.0))


def edited(change: Callable[[Document], object]) -> bytes:
    document = json.loads(json.dumps(PARTS[0]))
    change(document)
    return glb_bytes(document, PARTS[1])


BROKEN: dict[str, tuple[Callable[[Document], object], Facts]] = {
    "no animation": (lambda d: d.pop("animations"), "animation"),
    "glTF 1": (lambda d: d["asset"].update(version="1.0"), "2.0"),
    "a circle of nodes": (lambda d: d["nodes"][-1].update(children=[0]), "nodes"),
    "a child that is not there": (lambda d: d["nodes"][0].update(children=[9999]), 9999),
    "a channel of no node": (lambda d: d["animations"][0]["channels"][0]["target"].update(node=9999), "channels.0"),
    "a sampler of no accessor": (lambda d: d["animations"][0]["samplers"][0].update(input=9999), "accessors.9999"),
    "another interpolation": (lambda d: d["animations"][0]["samplers"][0].update(interpolation="X"), "interpolation"),
    "a channel twice": (lambda d: d["animations"][0]["channels"].append(d["animations"][0]["channels"][1]), "node 0"),
    "more keys than bytes": (lambda d: d["accessors"][0].update(count=2**31), "accessors.0"),
    "another type": (lambda d: d["accessors"][0].update(type="MAT4"), "accessors.0"),
    "integers as they are": (lambda d: d["accessors"][1].update(componentType=5122), "accessors.1"),
    "sparse": (lambda d: d["accessors"][1].update(sparse={}), "accessors.1"),
    "meshopt": (lambda d: d["bufferViews"][1].update(extensions={"EXT_meshopt_compression": {}}), "meshopt"),
    "a file elsewhere": (lambda d: d["buffers"][0].update(uri="../../etc/passwd"), "passwd"),
    "an absolute path": (lambda d: d["buffers"][0].update(uri="/etc/passwd"), "passwd"),
    "a hidden path": (lambda d: d["buffers"][0].update(uri="a/%2e%2e/%2e%2e/x.bin"), "x.bin"),
    "an address": (lambda d: d["buffers"][0].update(uri="http://x/y.bin"), "y.bin"),
    "no base64": (lambda d: d["buffers"][0].update(uri="data:;base64,%%%"), "base64"),
    "a rotation of nothing": (lambda d: d["nodes"][0].update(rotation=[0, 0, 0, 0]), "nodes.0"),
    "numbers that are none": (lambda d: d["nodes"][0].update(translation=[0, "x", 0]), "translation"),
    "a mirror": (lambda d: d["nodes"][0].update(matrix=[-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), "matrix"),
    "a flat joint": (lambda d: d["nodes"][0].update(scale=[1, 2, 1]), "nodes.0"),
    "no human": (lambda d: [node.update(name="x") for node in d["nodes"]] and d["nodes"].clear(), "channels.0"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_parts_of_a_gltf_that_are_wrong_are_named(tmp_path: Path, name: str) -> None:
    change, facts = BROKEN[name]
    path = written(tmp_path / "a.glb", edited(change))
    with refuses(InputError, facts, where=str(path)):
        open_source(path)


@pytest.mark.parametrize("shared", ["one sampler", "the same bytes"])
def test_many_channels_of_few_bytes_take_little_memory(tmp_path: Path, shared: str) -> None:
    """900 more joints turn by the values of one sampler, or each by its own view of the same bytes."""
    keys, more = 20_000, range(900)
    times, turns = np.arange(keys, dtype="<f4") / 30.0, np.tile(np.array([0.0, 0.0, 0.0, 1.0], "<f4"), (keys, 1))
    data, document = times.tobytes() + turns.tobytes(), json.loads(json.dumps(PARTS[0]))
    views = [(0, times.nbytes), (times.nbytes, turns.nbytes)]
    document["bufferViews"] = [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in views]
    kinds = ["SCALAR", *(["VEC4"] * (len(more) if shared == "the same bytes" else 1))]
    document["accessors"] = [
        {"bufferView": min(at, 1), "componentType": 5126, "count": keys, "type": kind} for at, kind in enumerate(kinds)
    ]
    document["nodes"][0]["children"] += [len(document["nodes"]) + at for at in more]
    first = len(document["nodes"])
    document["nodes"] += [{} for _ in more]
    channels = [{"sampler": at % (len(kinds) - 1), "target": {"node": first + at, "path": "rotation"}} for at in more]
    samplers = [{"input": 0, "output": at} for at in range(1, len(kinds))]
    document["animations"] = [{"channels": channels, "samplers": samplers}]
    document["buffers"] = [{"byteLength": len(data)}]
    path = written(tmp_path / "a.glb", glb_bytes(document, data))
    assert path.stat().st_size < 600_000  # and yet more than 900 joints
    with within(300 if shared == "the same bytes" else 20), refuses(InputError, where=str(path)):  # 20,000 frames
        open_source(path)


def test_a_spline_through_no_rotation_is_refused(tmp_path: Path) -> None:
    """From q to -q the middle is zero, which is no rotation."""
    data, document = np.array([0.0, 1.0], "<f4").tobytes(), json.loads(json.dumps(PARTS[0]))
    keys = np.zeros((2, 3, 4), "<f4")
    keys[:, 1, 3] = 1.0, -1.0
    document["bufferViews"] = [{"buffer": 0, "byteLength": 8}, {"buffer": 0, "byteOffset": 8, "byteLength": 96}]
    for at, (count, kind) in enumerate(((2, "SCALAR"), (6, "VEC4"))):
        document["accessors"][at] = {"bufferView": at, "componentType": 5126, "count": count, "type": kind}
    document["animations"][0]["channels"] = [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}]
    document["animations"][0]["samplers"] = [{"input": 0, "output": 1, "interpolation": "CUBICSPLINE"}]
    document["buffers"] = [{"byteLength": 104}]
    with refuses(InputError, where="nodes.0.rotation"):
        open_source(written(tmp_path / "a.glb", glb_bytes(document, data + keys.tobytes())))


def test_a_file_of_bytes_must_be_there_and_whole(tmp_path: Path) -> None:
    path = made_layouts.write_gltf(tmp_path, made(30.0), beside=True)
    (tmp_path / "take.bin").write_bytes(PARTS[1][:-8])
    with refuses(InputError, "buffers.0"):
        open_source(path)
    (tmp_path / "take.bin").unlink()
    with refuses(InputError, where="take.bin"):
        open_source(path)


def test_a_motion_that_is_too_long_is_refused_before_it_is_sampled(tmp_path: Path) -> None:
    data, end = bytearray(PARTS[1]), PARTS[0]["bufferViews"][0]["byteLength"]
    data[end - 4 : end] = struct.pack("<f", 1e8)
    with refuses(InputError, allowed=200_000):
        open_source(written(tmp_path / "a.glb", glb_bytes(PARTS[0], bytes(data))))


def test_nodes_with_scales_above_a_matrix_and_a_twin_animation_are_read(tmp_path: Path) -> None:
    """An armature in centimetres, as Blender and Mixamo have it; a second animation and another tree beside it."""

    def change(document: Document) -> None:
        for node in document["nodes"]:
            node["translation"] = [100.0 * x for x in node["translation"]]
        for channel in document["animations"][0]["channels"]:
            if channel["target"]["path"] == "translation":
                channel["target"]["path"] = "weights"
        matrix = [0.01 * x for x in np.eye(4).reshape(-1)[:15]] + [1.0]
        document["nodes"] += [{"name": "Armature", "children": [0], "matrix": matrix}, {"name": "Camera"}]
        document["animations"].append({"name": "other", "channels": [], "samplers": []})

    frames, motion = open_source(written(tmp_path / "a.glb", edited(change))), made(30.0)
    shows(" ".join(frames.notes), "made")
    assert frames.joints is not None
    still = frames.joints.of("l_knee") - frames.joints.of("pelvis")
    np.testing.assert_allclose(still, motion.joints["l_knee"] - motion.joints["pelvis"], atol=1e-3)


# MVNX and TRC.


@pytest.mark.parametrize(
    ("write", "old", "new", "facts"),
    [
        (write_mvnx, "<mvnx", "<!DOCTYPE a [<!ENTITY b 'c'>]><mvnx", "DOCTYPE"),
        (write_mvnx, "</frames></subject></mvnx>", "", "XML"),
        (write_mvnx, "mvnx", "other", ()),
        (write_mvnx, 'frameRate="30"', 'frameRate="x"', "frameRate"),
        (write_mvnx, 'frameRate="30"', "", "frameRate"),
        (write_mvnx, 'type="normal"', 'type="tpose"', 200_000),
        (write_mvnx, "<position>", "<position>1 ", 69),
        (write_mvnx, "<position>", "<position>nan ", ()),
        (write_mvnx, "<segment label=", "<segment name=", ()),
        (write_mvnx, 'label="Pelvis"', 'label="Prop1"', "Prop1"),
        (write_mvnx, "orientation>", "velocity>", "position"),
        (write_mvnx, "</frames>", '</frames><segment label="Late"/>', "Late"),
        (write_trc, "DataRate", "Other", "--rate"),
        (write_trc, "\t91\t", "\t60\t", (91, 60)),
        (write_trc, "\t91\t", "\tx\t", "'x'"),
        (write_trc, "\tmm\t", "\tfurlong\t", "furlong"),
        (write_trc, "Frame#", "Number", "Frame#"),
        (write_trc, "\n5\t", "\n5\tx\t", ()),
        (write_trc, "\n5\t", "\n5 ", ()),
        (write_trc, "\t\t\t", "\t\t", ()),
    ],
    ids=range(20),
)
def test_faults_of_an_mvnx_and_a_trc_are_named(tmp_path: Path, write: Writer, old: str, new: str, facts: Facts) -> None:
    path = write(tmp_path, made(30.0))
    path.write_text(path.read_text().replace(old, new))
    with refuses(InputError, facts, where=str(path)):
        open_source(path)


def test_an_mvnx_in_utf_16_cannot_hide_definitions(tmp_path: Path) -> None:
    path = write_mvnx(tmp_path, made(30.0))
    text = path.read_text().replace("UTF-8", "UTF-16").replace("<mvnx", "<!DOCTYPE a [<!ENTITY b 'c'>]><mvnx")
    path.write_text(text, encoding="utf-16")
    with refuses(InputError, where=str(path), allowed="UTF-8"):
        open_source(path)


def test_a_trc_of_many_markers_and_short_lines_takes_no_memory(tmp_path: Path) -> None:
    head = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tUnits\n30\tmm\nFrame#\tTime\t"
    path = tmp_path / "a.trc"
    path.write_text(head + "\t\t\t".join(f"m{at}" for at in range(1000)) + "\n\n" + 20_000 * "1\t1\n")
    with within(20), refuses(InputError, where=str(path), found=(20_000, 1000), allowed=5_000_000):
        open_source(path)


def test_markers_of_a_trc_without_known_names_are_refused_as_those_of_a_c3d(tmp_path: Path) -> None:
    path = write_trc(tmp_path, made(30.0))
    head, _, rest = path.read_text().partition("Frame#")
    names, _, data = rest.partition("\n")
    unknown = "\t".join(f"m{at}" if cell.strip() and at > 1 else cell for at, cell in enumerate(names.split("\t")))
    path.write_text(f"{head}Frame#{unknown}\n{data}")
    with refuses(InputError, next_step="--markers"):
        open_source(path)


# Whatever a file holds, it is read or refused.


FEW = made(30.0)
FEW = Made(
    30.0, FEW.time[:4], {n: t[:4] for n, t in FEW.joints.items()}, {n: t[:4] for n, t in FEW.turns.items()}, FEW.rest
)
WHOLE: dict[str, Writer] = {
    "amass.npz": partial(write_amass, markers=True),
    "joints.npz": write_joints,
    "kimodo.npz": write_kimodo,
    "take.glb": write_glb,
    "take.gltf": made_layouts.write_gltf,
    "take.mvnx": write_mvnx,
    "trial.trc": write_trc,
    "take.bvh": LAYOUTS["SOMA, 6 channels"],
    "a.bvh": lambda folder, _: written(folder / "a.bvh", motion_texts.bvh_text(2).encode()),
    "a.c3d": lambda folder, _: written(folder / "a.c3d", motion_texts.c3d_bytes(3)),
    "07_01.amc": lambda folder, _: motion_texts.write_amc(folder, motion_texts.amc_text(2)),
    "07.asf": lambda folder, _: motion_texts.write_amc(folder, motion_texts.amc_text(2)),
}
EDIT = st.tuples(
    st.floats(0.0, 1.0, exclude_max=True), st.binary(max_size=8), st.integers(0, 40) | st.none(), st.booleans()
)
"""Where, what, instead of how many bytes (None: of as many), and whether in the first KiB, which decides the format."""


@pytest.mark.parametrize("name", WHOLE)
@given(edits=st.lists(EDIT, min_size=1, max_size=5), inside=st.booleans())
def test_mangled_files_raise_input_errors_only(
    tmp_path_factory: pytest.TempPathFactory,
    name: str,
    edits: list[tuple[float, bytes, int | None, bool]],
    inside: bool,
) -> None:
    folder = tmp_path_factory.getbasetemp() / f"mangled-{name}"
    path, good = folder / name, folder / "good"
    if not folder.is_dir():
        folder.mkdir()
        WHOLE[name](folder, FEW)
        good.write_bytes(path.read_bytes())
    content, members = good.read_bytes(), dict[str, bytes]()
    if inside and name.endswith(".npz"):
        with zipfile.ZipFile(good) as archive:
            members = {member: archive.read(member) for member in archive.namelist()}
    hurt = sorted(members)[int(edits[0][0] * len(members))] if members else ""
    content = members.get(hurt, content)
    for share, new, cut, in_head in edits:
        at = int(share * (min(len(content), 1024) if in_head else len(content)))
        content = content[:at] + new + content[at + (len(new) if cut is None else cut) :]
    path.write_bytes(content)
    if members:
        with zipfile.ZipFile(path, "w") as archive:
            for member, data in (members | {hurt: content}).items():
                archive.writestr(member, data)
    try:
        with np.errstate(all="ignore"):
            frames = open_source(
                folder / "07_01.amc" if name == "07.asf" else path, rate=30.0 if name.endswith(".npz") else None
            )
    except InputError:
        return
    assert np.isfinite(frames.position[frames.valid]).all() and np.isnan(frames.position[~frames.valid]).all()


@pytest.mark.parametrize("name", ["amass.npz", "take.glb", "take.mvnx", "trial.trc", "07.asf"])
def test_files_cut_short_anywhere_are_refused_or_a_little_shorter(tmp_path: Path, name: str) -> None:
    WHOLE[name](tmp_path, FEW)
    content = (path := tmp_path / name).read_bytes()
    for share in np.linspace(0.0, 0.99, 40):
        path.write_bytes(content[: int(share * len(content))])
        try:
            frames = open_source(path.with_name("07_01.amc") if name == "07.asf" else path)
        except InputError:
            continue
        assert name == "trial.trc" and len(frames) >= 3
