"""One made motion of the virtual human in every layout of motion files: arms up, a squat, a step, a turn, in 3 s.

Positions and orientations come from the human's own model. A layout's joint is a point on a part of the human; its
frame is that part's, turned so that all frames are parallel in the layout's T-pose.
"""

import base64
import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget import rotations
from retarget.model.body import BodyModel
from retarget.model.human import build_human
from retarget.model.human_dimensions import POINTS, proportional_dimensions
from retarget.sources.skeletons import TABLES, layout
from retarget.types import FloatArray
from sim.performer import minimum_jerk

STATURE_M, SECONDS = 1.66, 3.0
Y_UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Axes of the world (rows: forward, left, up) in a file that is x left, y up, z forward."""
Z_UP = np.eye(3)

PARTS = {"head": "neck", "l_hand": "l_wrist", "r_hand": "r_wrist", "l_toe": "l_ankle", "r_toe": "r_ankle"}
"""Points that no joint carries, and the part that they are on."""


@dataclass(frozen=True, eq=False)
class Made:
    """The truth. time (T,) s. joints: position (T, 3) m of each canonical joint, world. turns: orientation (T, 4) of
    the part that each joint carries, the identity standing upright with hanging arms. rest: T-pose positions (3,)."""

    rate: float
    time: FloatArray
    joints: Mapping[str, FloatArray]
    turns: Mapping[str, FloatArray]
    rest: Mapping[str, FloatArray]

    def sensor_turn(self, sensor: str) -> FloatArray:
        return self.turns[PARTS.get(sensor, sensor)]


def _postures(body: BodyModel, time: FloatArray) -> FloatArray:
    """Postures (T, nq) of the human over time (T,) s, before its feet are put on the ground."""

    def curve(*keys: tuple[float, float]) -> FloatArray:
        times, values = zip(*keys, strict=True)
        return minimum_jerk(time, np.array(times), np.array(values))

    q = np.tile(body.qpos0, (len(time), 1))
    _, address = body.scalar_joints()
    squat = curve((0.0, 0.0), (0.9, 0.0), (1.3, 1.0), (1.7, 0.0), (3.0, 0.0))
    step = curve((0.0, 0.0), (1.8, 0.0), (2.1, 1.0), (2.4, 0.0), (3.0, 0.0))
    up = curve((0.0, 0.0), (0.1, 0.0), (0.5, 1.0), (0.9, 0.2), (3.0, 0.0))
    degrees = {
        "shoulder_elevation": 130.0 * up + 20.0 * squat,
        "elbow_flexion": 15.0 + 30.0 * squat,
        "elbow_pronation": 25.0 * up,
        "wrist_flexion": 10.0 * up,
        "hip_flexion": 60.0 * squat,
        "knee_flexion": 5.0 + 80.0 * squat,
        "ankle_dorsiflexion": 5.0 + 25.0 * squat,
        "l_hip_flexion": 35.0 * step,
        "l_knee_flexion": 40.0 * step,
        "spine_flexion": 15.0 * squat,
        "chest_rotation": 10.0 * up,
        "neck_flexion": 10.0 * squat,
    }
    for motion, angle in degrees.items():
        for name in [motion] if motion in body.dof_names else [f"l_{motion}", f"r_{motion}"]:
            q[:, address[body.dof_index(name)]] += np.radians(angle)
    yaw = np.radians(curve((0.0, 0.0), (2.3, 0.0), (2.9, 40.0), (3.0, 40.0)))
    q[:, 0], q[:, 2] = 0.25 * curve((0.0, 0.0), (1.8, 0.0), (2.4, 1.0), (3.0, 1.0)), 1.0
    q[:, 3:7] = rotations.from_axis_angle([0.0, 0.0, 1.0], yaw)
    return q


@cache
def made(rate: float) -> Made:
    human = build_human(proportional_dimensions(STATURE_M))
    body, time = human.body, np.arange(round(SECONDS * rate) + 1) / rate
    q = _postures(body, time)
    frames = [body.frame(name) for name in POINTS]
    links, local = [frame.body for frame in frames], np.array([frame.position for frame in frames])
    points = body.solver_body().points(q, links, local)
    lowest = points[:, [POINTS.index(f"{s}_ankle") for s in "lr"], 2].min(axis=1)
    points[:, :, 2] -= (lowest - 0.039 * STATURE_M)[:, None]  # the lower foot stands
    turns = body.solver_body().orientations(q, links)
    still = human.dimensions.standing()
    rest = dict(zip(POINTS, still, strict=True))
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for part, above in pairwise(("shoulder", "elbow", "wrist", "hand")):
            length = float(np.linalg.norm(human.dimensions.of(f"{side}_{above}")))
            rest[f"{side}_{above}"] = rest[f"{side}_{part}"] + np.array([0.0, sign * length, 0.0])
    joints, of_joints = ({name: values[:, at] for at, name in enumerate(POINTS)} for values in (points, turns))
    return Made(rate, time, joints, of_joints, rest)


@dataclass(frozen=True, eq=False)
class Rig:
    """A layout's joints. names, parents (n). at: of each the part that carries it, and the share of the way from the
    part's joint to a point on it."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    at: tuple[tuple[str, str, float], ...]

    def poses(self, motion: Made, axes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions (T, n, 3), orientations (T, n, 4) and rest positions (n, 3) in file axes. axes: rows forward, left
        and up of the world in the file."""
        to_file = rotations.from_matrix(axes.T)
        hung = {
            f"{s}_{part}": rotations.shortest_arc([0.0, 0.0, -1.0], [0.0, 1.0 if s == "l" else -1.0, 0.0])
            for s in "lr"
            for part in ("shoulder", "elbow", "wrist")
        }
        position, orientation, rest = [], [], []
        for part, point, share in self.at:
            turn = rotations.multiply(motion.turns[part], rotations.conjugate(hung.get(part, rotations.IDENTITY)))
            still = motion.rest[part] + share * (motion.rest[point] - motion.rest[part])
            rest.append(still)
            position.append(motion.joints[part] + rotations.rotate(turn, still - motion.rest[part]))
            orientation.append(rotations.multiply(rotations.multiply(to_file, turn), rotations.conjugate(to_file)))
        return np.stack(position, axis=1) @ axes, np.stack(orientation, axis=1), np.stack(rest) @ axes

    def local(self, orientation: FloatArray) -> FloatArray:
        """Rotations (T, n, 4) in the parents' frames."""
        local = orientation.copy()
        for at, parent in enumerate(self.parents):
            if parent >= 0:
                local[:, at] = rotations.multiply(rotations.conjugate(orientation[:, parent]), orientation[:, at])
        return local


SIDES = (("Left", "left", "l"), ("Right", "right", "r"))
LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
HEAD_JOINT = 0.63
BODY = ("Hips", "Spine", "Chest", "Neck", "Head")


@cache
def smpl_rig(count: int = 22) -> Rig:
    names, parents = layout(TABLES["layouts"]["smpl"])
    places = {"pelvis": ("pelvis", "pelvis", 0.0), "spine1": ("spine", "spine", 0.0), "spine2": ("spine", "chest", 0.5)}
    places |= {"spine3": ("chest", "chest", 0.0), "neck": ("neck", "neck", 0.0), "head": ("neck", "head", HEAD_JOINT)}
    for _, word, s in SIDES:
        places |= {f"{word}_{part}": (f"{s}_{part}", f"{s}_{part}", 0.0) for part in ("collar", *LIMBS)}
        places |= {f"{word}_foot": (f"{s}_ankle", f"{s}_toe", 1.0), f"{word}_hand": (f"{s}_wrist", f"{s}_hand", 1.0)}
    return Rig(names[:count], parents[:count], tuple(places[name] for name in names[:count]))


@cache
def soma_rig(names: tuple[str, ...] = tuple(TABLES["layouts"]["soma"])) -> Rig:
    above = TABLES["layouts"]["soma"]
    places = {"Hips": ("pelvis", "pelvis", 0.0), "Spine1": ("spine", "spine", 0.0), "Spine2": ("spine", "chest", 0.5)}
    places |= {"Chest": ("chest", "chest", 0.0), "Neck1": ("neck", "neck", 0.0), "Neck2": ("neck", "head", 0.3)}
    places |= {"Head": ("neck", "head", HEAD_JOINT), "HeadEnd": ("neck", "head", 2.0 - HEAD_JOINT)}
    places |= dict.fromkeys(("Jaw", "LeftEye", "RightEye"), ("neck", "head", 0.9))
    for word, _, s in SIDES:
        for name, part in (("Shoulder", "collar"), ("Arm", "shoulder"), ("ForeArm", "elbow"), ("Hand", "wrist")):
            places[f"{word}{name}"] = (f"{s}_{part}", f"{s}_{part}", 0.0)
        for name, part in (("Leg", "hip"), ("Shin", "knee"), ("Foot", "ankle")):
            places[f"{word}{name}"] = (f"{s}_{part}", f"{s}_{part}", 0.0)
        places |= {f"{word}ToeBase": (f"{s}_ankle", f"{s}_toe", 1.0), f"{word}ToeEnd": (f"{s}_ankle", f"{s}_toe", 1.5)}
    for name in names:  # fingers, one after the other
        side = "l" if name.startswith("Left") else "r"
        if name not in places:
            share = 1.0 if name.endswith("Middle1") or "LeftHandMiddle1" not in names else 1.2
            places[name] = (f"{side}_wrist", f"{side}_hand", share)
    kept = []
    for name in names:
        parent = above[name]
        while parent and parent not in names:
            parent = above[parent]
        kept.append(names.index(parent) if parent else -1)
    return Rig(names, tuple(kept), tuple(places[name] for name in names))


@cache
def named_rig(style: str) -> Rig:
    """Joints by the names of a family: VRM's bones, Bandai Namco's `UpperLeg_L`, or MVN's segments."""
    mvn = style == "mvn"
    hips, spine, chest, neck, head = ("Pelvis", "L3", "T8", "Neck", "Head") if mvn else BODY
    if style == "vrm":
        hips, spine, chest, neck, head = (name.lower() for name in BODY)
    rows: list[tuple[str, str, tuple[str, str, float]]] = [(hips, "", ("pelvis", "pelvis", 0.0))]
    rows += [("L5", hips, ("pelvis", "pelvis", 0.0))] * mvn + [(spine, "L5" if mvn else hips, ("spine", "spine", 0.0))]
    rows += [("T12", spine, ("spine", "chest", 0.5))] * mvn
    rows += [(chest, rows[-1][0], ("chest", "chest", 0.0)), (neck, chest, ("neck", "neck", 0.0))]
    rows += [(head, neck, ("neck", "head", HEAD_JOINT))]
    arm = (
        ("Shoulder", "collar"),
        ("UpperArm", "shoulder"),
        ("ForeArm" if mvn else "LowerArm", "elbow"),
        ("Hand", "wrist"),
    )
    leg = (("UpperLeg", "hip"), ("LowerLeg", "knee"), ("Foot", "ankle"), ("Toe" if mvn else "Toes", "toe"))
    for word, lower, s in SIDES:
        for parent, limb in ((chest, arm), (hips, leg)):
            for part, joint in limb:
                name = {"vrm": lower + part, "bandai": f"{part}_{word[0]}", "mvn": word + part}[style]
                carried = PARTS.get(f"{s}_{joint}", f"{s}_{joint}")
                rows.append((name, parent, (carried, f"{s}_{joint}", 1.0)))
                parent = name
    names = tuple(name for name, _, _ in rows)
    above = tuple(names.index(parent) if parent else -1 for _, parent, _ in rows)
    return Rig(names, above, tuple(at for _, _, at in rows))


# Writers. Each writes the motion into a folder and returns the file.


TURNS = "Zrotation Yrotation Xrotation"


def bvh_text(rig: Rig, motion: Made, *, six: bool = False, root: bool = False) -> str:
    """y up, cm. six: position channels for every joint. root: a static joint above the first."""
    position, orientation, rest = rig.poses(motion, Y_UP)
    position, rest, local = 100.0 * position, 100.0 * rest, rig.local(orientation)
    lines, columns = ["HIERARCHY"], list[FloatArray]()

    def block(at: int, depth: int) -> None:
        parent, tab = rig.parents[at], "  " * depth
        offset = rest[at] - rest[parent] if parent >= 0 else rest[at]
        lines.extend([f"{tab}{'JOINT' if depth else 'ROOT'} {rig.names[at]}", tab + "{"])
        lines.append(f"{tab}  OFFSET {' '.join(f'{x:.6f}' for x in offset)}")
        with_place = six or parent < 0
        lines.append(f"{tab}  CHANNELS {'6 Xposition Yposition Zposition ' if with_place else '3 '}{TURNS}")
        if with_place:
            columns.append(position[:, at] if parent < 0 else np.tile(offset, (len(position), 1)))
        columns.append(np.degrees(np.unwrap(rotations.to_euler(local[:, at], "zyx"), axis=0)))
        children = [child for child, above in enumerate(rig.parents) if above == at]
        for child in children:
            block(child, depth + 1)
        if not children:
            lines.extend([tab + "  End Site", tab + "  {", tab + "    OFFSET 0 0 0", tab + "  }"])
        lines.append(tab + "}")

    if root:
        lines += ["ROOT Root", "{", "  OFFSET 0 0 0", f"  CHANNELS 6 Xposition Yposition Zposition {TURNS}"]
        columns.append(np.zeros((len(position), 6)))
    block(0, int(root))
    lines += ["}"] * root
    lines += ["MOTION", f"Frames: {len(position)}", f"Frame Time: {1.0 / motion.rate:.9f}"]
    lines += [" ".join(f"{x:.6f}" for x in row) for row in np.hstack(columns)]
    return "\n".join(lines) + "\n"


def smpl_arrays(motion: Made) -> tuple[FloatArray, FloatArray]:
    """Rotation vectors (T, 66) and translation (T, 3), z up."""
    rig = smpl_rig()
    position, orientation, _ = rig.poses(motion, Z_UP)
    rest = rotations.from_matrix(Y_UP)  # from x left, y up, z forward to the world
    orientation = rotations.multiply(orientation, rest)  # R C, with R the turn of a body that is z up
    vectors = rotations.log(rig.local(orientation)).reshape(len(position), -1)
    return vectors, position[:, 0] - np.array([0.0, -0.22, 0.03])


MARKER_PAIRS = {"knee": ("KNE", "KNI"), "ankle": ("ANK", "ANI"), "elbow": ("ELB", "ELBIN"), "wrist": ("IWR", "OWR")}


def marker_tracks(motion: Made) -> dict[str, FloatArray]:
    """Markers (T, 3) m, world: pairs about joints, four on the head, four on the waist."""
    tracks: dict[str, FloatArray] = {}
    for s in "lr":
        for joint, pair in MARKER_PAIRS.items():
            at, turn = motion.joints[f"{s}_{joint}"], motion.turns[f"{s}_{joint}"]
            off = rotations.rotate(turn, np.array([0.0, 0.05, 0.0]))
            tracks |= {f"{s.upper()}{pair[0]}": at + off, f"{s.upper()}{pair[1]}": at - off}
        tracks[f"{s.upper()}TOE"] = motion.joints[f"{s}_toe"]
        tracks[f"{s.upper()}SHO"] = motion.joints[f"{s}_shoulder"]
    for joint, names in (("head", ("FHD", "BHD")), ("pelvis", ("ASI", "PSI"))):
        for name, ahead in zip(names, (0.1, -0.1), strict=True):
            for s, left in (("L", 0.07), ("R", -0.07)):
                off = rotations.rotate(motion.sensor_turn(joint), np.array([ahead, left, 0.0]))
                tracks[s + name] = motion.joints[joint] + off
    return tracks


def write_amass(folder: Path, motion: Made, *, markers: bool = False, **changes: Any) -> Path:
    """AMASS SMPL-H, with gender as bytes and a rate that missed."""
    poses, trans = smpl_arrays(motion)
    arrays: dict[str, Any] = {
        "poses": np.hstack([poses, np.zeros((len(poses), 156 - 66))]),
        "trans": trans,
        "betas": np.zeros(16),
        "gender": np.array(b"female"),
        "mocap_framerate": np.array(motion.rate * (1.0 + 3.8e-7)),
        "dmpls": np.zeros((len(poses), 8)),
    }
    if markers:
        tracks = marker_tracks(motion)
        arrays["marker_data"] = np.stack(list(tracks.values()), axis=1)
        arrays["marker_data"][::7, 3] = np.nan
        arrays["marker_labels"] = np.array(list(tracks))
    path = folder / "amass.npz"
    np.savez(path, **{key: value for key, value in (arrays | changes).items() if value is not None})
    return path


def write_stageii(folder: Path, motion: Made) -> Path:
    poses, trans = smpl_arrays(motion)
    arrays = {"root_orient": poses[:, :3], "pose_body": poses[:, 3:], "pose_hand": np.zeros((len(poses), 90))}
    arrays |= {"trans": trans, "betas": np.zeros(16), "gender": np.array("neutral")}
    arrays |= {"surface_model_type": np.array("smplx"), "mocap_frame_rate": np.array(motion.rate)}
    path = folder / "walk_stageii.npz"
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


def write_joints(folder: Path, motion: Made, *, count: int = 22) -> Path:
    position, _, _ = smpl_rig(min(count, 24)).poses(motion, Z_UP)
    more = np.repeat(position[:, 20:21], count - position.shape[1], axis=1)
    path = folder / "joints.npz"
    np.savez(path, global_joint_positions=np.concatenate([position, more], axis=1), height=np.array(STATURE_M))
    return path


def write_kimodo(folder: Path, motion: Made, *, count: int = 77) -> Path:
    rig = {77: soma_rig(), 30: soma_rig(tuple(TABLES["layouts"]["soma_30"])), 22: smpl_rig()}.get(count, smpl_rig(24))
    position, orientation, _ = rig.poses(motion, Y_UP)
    turned = rotations.to_matrix(orientation)
    path = folder / "kimodo.npz"
    np.savez(path, posed_joints=position, global_rot_mats=turned, root_positions=position[:, 0])
    return path


def write_mvnx(folder: Path, motion: Made) -> Path:
    rig = named_rig("mvn")
    names = tuple(TABLES["mvn_segments"])
    position, orientation, rest = rig.poses(motion, Z_UP)
    order = [rig.names.index(name) for name in names]
    top = (2.0 - 2.0 * HEAD_JOINT) * (motion.rest["head"] - motion.rest["neck"])

    def flat(values: FloatArray) -> str:
        return " ".join(f"{x:.6f}" for x in values.reshape(-1))

    def frame(kind: str, index: int, turns: FloatArray, places: FloatArray) -> str:
        return (
            f'<frame time="{index}" index="{index}" type="{kind}"><orientation>{flat(turns)}</orientation>'
            f"<position>{flat(places)}</position><jointAngle>0 0 0</jointAngle></frame>"
        )

    lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="4">']
    lines += [f'<subject label="A" frameRate="{motion.rate:g}" segmentCount="23"><segments>']
    for number, name in enumerate(names, start=1):
        point = f'<points><point label="pTopOfHead"><pos_b>{flat(top)}</pos_b></point></points>'
        lines.append(f'<segment label="{name}" id="{number}">{point * (name == "Head")}</segment>')
    lines += ["</segments>", '<frames segmentCount="23">']
    lines += [frame(kind, 0, np.tile(rotations.IDENTITY, (23, 1)), rest[order]) for kind in ("identity", "tpose")]
    lines += [frame("normal", at, orientation[at, order], position[at, order]) for at in range(len(position))]
    path = folder / "take.mvnx"
    path.write_text("\n".join([*lines, "</frames></subject></mvnx>"]))
    return path


def write_trc(folder: Path, motion: Made, *, unit: str = "mm") -> Path:
    tracks = marker_tracks(motion)
    scale = {"mm": 1000.0, "m": 1.0}[unit]
    values = np.hstack([scale * track @ Y_UP for track in tracks.values()])
    numbered = [f"{axis}{at}" for at in range(1, len(tracks) + 1) for axis in "XYZ"]
    count, rate = str(len(values)), f"{motion.rate:g}"
    lines = [
        "PathFileType\t4\t(X/Y/Z)\ttrial.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        "\t".join([rate, rate, count, str(len(tracks)), unit, rate, "1", count]),
        "\t".join(["Frame#", "Time", *(f"{name}\t\t" for name in tracks)]),
        "\t".join(["", "", *numbered]),
        "",
    ]
    for at, row in enumerate(values):
        cells = [f"{x:.5f}" for x in row]
        if at % 10 == 3:
            cells[:3] = ["", "", ""]  # not seen
        lines.append("\t".join([str(at + 1), f"{motion.time[at]:.5f}", *cells]))
    path = folder / "trial.trc"
    path.write_text("\n".join(lines) + "\n")
    return path


def _keys(values: FloatArray, rows: NDArray[np.intp], motion: Made, interpolation: str) -> FloatArray:
    """Values at the keys; of a cubic spline in-tangent, value and out-tangent, from central differences."""
    if interpolation != "CUBICSPLINE":
        return values[rows]
    slope = np.gradient(values, motion.time, axis=0)
    return np.stack([slope[rows], values[rows], slope[rows]], axis=1).reshape(-1, values.shape[-1])


def gltf_parts(
    rig: Rig, motion: Made, *, interpolation: str = "LINEAR", every: int = 1, shorts: bool = False
) -> tuple[dict[str, Any], bytes]:
    """The document and the bytes of its buffer. every: frames from one key to the next. shorts: rotations as
    normalised integers."""
    position, orientation, rest = rig.poses(motion, Y_UP)
    local, rows = rig.local(orientation), np.arange(0, len(position), every)
    data, views, accessors = bytearray(), list[dict[str, Any]](), list[dict[str, Any]]()

    def accessor(values: FloatArray, kind: str, code: int = 5126) -> int:
        scaled = values if code == 5126 else np.rint(values * 32767)
        packed = np.ascontiguousarray(scaled, "<f4" if code == 5126 else "<i2").tobytes()
        data.extend(bytes(-len(data) % 4))
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(packed)})
        data.extend(packed)
        size = 1 if values.ndim == 1 else values.shape[-1]
        entry = {"bufferView": len(views) - 1, "componentType": code, "count": values.size // size, "type": kind}
        accessors.append(entry | ({"normalized": True} if code != 5126 else {}))
        return len(accessors) - 1

    times, samplers, channels = accessor(motion.time[rows], "SCALAR"), list[dict[str, Any]](), list[dict[str, Any]]()
    nodes: list[dict[str, Any]] = []
    for at, (name, parent) in enumerate(zip(rig.names, rig.parents, strict=True)):
        offset = rest[at] - (rest[parent] if parent >= 0 else 0.0)
        nodes.append({"name": name, "translation": offset.tolist()})
        if children := [child for child, above in enumerate(rig.parents) if above == at]:
            nodes[-1]["children"] = children
        signs = np.sign((local[1:, at] * local[:-1, at]).sum(axis=1))
        turn = local[:, at] * np.where(np.cumprod(np.append(1.0, signs)) < 0, -1.0, 1.0)[:, None]
        code = 5122 if shorts else 5126
        outputs = {"rotation": accessor(_keys(turn[:, [1, 2, 3, 0]], rows, motion, interpolation), "VEC4", code)}
        if parent < 0:
            outputs["translation"] = accessor(_keys(position[:, at], rows, motion, interpolation), "VEC3")
        for path, output in outputs.items():
            samplers.append({"input": times, "output": output, "interpolation": interpolation})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": at, "path": path}})
    document = {
        "asset": {"version": "2.0"},
        "nodes": nodes,
        "animations": [{"name": "made", "channels": channels, "samplers": samplers}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    return document, bytes(data)


def glb_bytes(document: Mapping[str, Any], data: bytes) -> bytes:
    text = json.dumps(document).encode()
    text, data = text + b" " * (-len(text) % 4), data + bytes(-len(data) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def write_glb(folder: Path, motion: Made, **how: Any) -> Path:
    path = folder / "take.glb"
    path.write_bytes(glb_bytes(*gltf_parts(named_rig("bandai"), motion, **how)))
    return path


def write_gltf(folder: Path, motion: Made, *, beside: bool = False) -> Path:
    document, data = gltf_parts(named_rig("bandai"), motion)
    document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    if beside:
        document["buffers"][0]["uri"] = "take.bin"
        (folder / "take.bin").write_bytes(data)
    path = folder / "take.gltf"
    path.write_text(json.dumps(document))
    return path


def write_vrma(folder: Path, motion: Made) -> Path:
    """Bones are named by the extension alone."""
    rig = named_rig("vrm")
    document, data = gltf_parts(rig, motion)
    bones = {name: {"node": at} for at, name in enumerate(rig.names)}
    for at, node in enumerate(document["nodes"]):
        node["name"] = f"bone{at}"
    document["extensions"] = {"VRMC_vrm_animation": {"specVersion": "1.0", "humanoid": {"humanBones": bones}}}
    path = folder / "take.vrma"
    path.write_bytes(glb_bytes(document, data))
    return path


def write_bvh(folder: Path, rig: Rig, motion: Made, **how: Any) -> Path:
    path = folder / "take.bvh"
    path.write_text(bvh_text(rig, motion, **how))
    return path


LAYOUTS: dict[str, Any] = {
    "SOMA, 3 channels": lambda folder, motion: write_bvh(folder, soma_rig(), motion, root=True),
    "SOMA, 6 channels": lambda folder, motion: write_bvh(folder, soma_rig(), motion, root=True, six=True),
    "UpperLeg_L": lambda folder, motion: write_bvh(folder, named_rig("bandai"), motion),
    "AMASS": write_amass,
    "AMASS with markers": lambda folder, motion: write_amass(folder, motion, markers=True),
    "AMASS stageii": write_stageii,
    "joints": write_joints,
    "joints of SMPL-H": lambda folder, motion: write_joints(folder, motion, count=52),
    "Kimodo, SOMA-77": write_kimodo,
    "Kimodo, SOMA-30": lambda folder, motion: write_kimodo(folder, motion, count=30),
    "Kimodo, SMPL": lambda folder, motion: write_kimodo(folder, motion, count=22),
    "GLB": write_glb,
    "GLB, cubic splines": lambda folder, motion: write_glb(folder, motion, interpolation="CUBICSPLINE", every=3),
    "GLB, steps": lambda folder, motion: write_glb(folder, motion, interpolation="STEP"),
    "GLB, short integers": lambda folder, motion: write_glb(folder, motion, shorts=True),
    "glTF, embedded": write_gltf,
    "glTF, beside": lambda folder, motion: write_gltf(folder, motion, beside=True),
    "VRMA": write_vrma,
    "MVNX": write_mvnx,
    "TRC": write_trc,
}
"""Layout -> what writes the motion in it."""
NO_RATE = {name for name in LAYOUTS if name.startswith("joints")}
NO_LENGTHS = {name for name in LAYOUTS if name.startswith("AMASS")}
NO_TURNS = {*NO_RATE, "TRC"}
RATES_HZ: Sequence[float] = (30.0, 120.0)
