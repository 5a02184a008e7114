"""Data of the page's player: performer, robot, centre of mass and soles, thinned."""

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget import rotations
from retarget.model.meshes import OBSERVER, OBSTACLE, Mesh, SolidBody, shapes_json
from retarget.model.robot import RobotBody
from retarget.pictures.plots import POSES, unlike_ticks
from retarget.pictures.solid import HUMAN_BONES, facing_x, obstacles
from retarget.report import motion_metrics
from retarget.report.findings import moments
from retarget.report.tracking import performer_facing, turned
from retarget.run.record import PHASE_NAMES
from retarget.run.run_result import RunResult
from retarget.types import BoolArray, FloatArray, IntArray

# Tracks as text inside a page.


class Packed(str):
    """Numbers of a track in base64. size: bytes of a number."""

    size: int


def packed(values: NDArray[Any], kind: str = "<f4") -> Packed:
    """Pack an array, by default as little-endian 32-bit floats. NaN stays."""
    text = Packed(base64.b64encode(values.astype(kind).tobytes()).decode("ascii"))
    text.size = np.dtype(kind).itemsize
    return text


MOST_INTEGER = 2**15 - 1
"""Largest signed 16-bit integer."""


def packed_poses(poses: FloatArray, centre: FloatArray) -> dict[str, Any]:
    """Pack poses (T, m, 7) as little-endian 16-bit integers: positions relative to the centre (T, 2) on the floor in
    units of `step`, m, quaternions in 1 / MOST_INTEGER. A zero quaternion is an unknown pose."""
    place = np.nan_to_num(poses[..., :3] - np.pad(centre, ((0, 0), (0, 1)))[:, None])
    step = max(float(np.abs(place).max(initial=0.0)), 1e-6) / MOST_INTEGER
    numbers = np.concatenate([place / step, np.nan_to_num(poses[..., 3:]) * MOST_INTEGER], axis=-1)
    return {"numbers": packed(numbers.round(), "<i2"), "step": step, "rows": len(poses)}


FPS = 30.0
MOST_ROWS = 3000
"""Largest number of rows. A longer run is thinned."""
TRAVEL = 0.5
"""The view follows a body that travels farther than this share of its height."""


def animation_of(run: RunResult) -> dict[str, Any] | None:
    """The data of the player; None for a run that followed nothing. time: ms. phase, gated: a letter per row.
    every: ticks per row. moments: times of faults, ms. poses: rows that are shown side by side."""
    record, following = run.record, run.record.following
    if following.stop - following.start < 2:
        return None
    every = max(1, math.ceil(1.0 / (run.clip.dt * FPS) - 1e-9), math.ceil(len(record) / MOST_ROWS))
    rows = np.arange(0, len(record), every)
    ticks = unlike_ticks(run, min(POSES, run.ticks_followed))
    return {
        "time": [round(1e3 * time) for time in record.time[rows]],
        "phase": "".join(PHASE_NAMES[phase][0] for phase in record.phase[rows]),
        "gated": letters(record.gated, rows),
        "every": every,
        "performer": _performer(run, rows),
        "robot": _robot(run, rows),
        "ground": None if run.robot is None or run.moved_q is None else ground(run.robot, run.moved_q, rows),
        "recorded": _recorded(run, rows),
        "joints": None,
        "poses": [min(-(-tick // every), len(rows) - 1) for tick in ticks],
        "moments": [round(1e3 * moment.time) for moment in moments(run)],
    }


def _performer(run: RunResult, rows: IntArray) -> dict[str, Any]:
    """The reconstructed human and the sensors, rotated so that it faces x when following begins."""
    caption = "as reconstructed" + ("" if _recorded(run, rows) is None else "; lines: as recorded")
    heading, scene = performer_facing(run)[:1], obstacles(run, rows) if run.robot is None else None
    poses = facing_x(run.human.solid.poses(run.record.human_q[rows]), heading)
    if scene is not None:
        scene = scene[0], facing_x(scene[1], heading)
    marks = turned(run.sensors_desired[rows], heading)
    made = figure("performer", run.human.solid, poses, marks=marks, layers=("servos",), scene=scene)
    return made | {"caption": caption}


def _robot(run: RunResult, rows: IntArray) -> dict[str, Any] | None:
    """The robot as it moved, see `RunResult.moved_q`, and its desired landmarks."""
    robot, sent, q = run.robot, run.record.robot, run.moved_q
    if robot is None or sent is None or q is None:
        return None
    caption = "as sent" if run.physics is None else "as simulated"
    poses, marks, scene = robot.solid.poses(q[rows]), sent.landmarks_asked[rows], obstacles(run, rows)
    made = figure(robot.profile.name, robot.solid, poses, marks=marks, layers=("desired", "pass"), scene=scene)
    return made | {"caption": caption}


def figure(
    label: str,
    solid: SolidBody,
    poses: FloatArray,
    *,
    marks: FloatArray,
    layers: Sequence[str],
    goal: FloatArray | None = None,
    scene: tuple[Sequence[Mesh], FloatArray] | None = None,
    observers: tuple[Sequence[Mesh], FloatArray, FloatArray] | None = None,
) -> dict[str, Any]:
    """A body for `Figure` of `figure.js`. poses, goal: (T, links, 7). marks (T, k, 3): sensors or desired
    landmarks, m. scene: meshes and poses (T or 1, o, 7) of obstacles. observers: meshes, poses (T, o, 7) and nearest
    points (T, 2, 3), m. layers: other parts that can be hidden."""
    boxes = np.array([[mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)] for mesh in solid.meshes])
    corners = np.stack([boxes[:, [x, y, z], range(3)] for x in (0, 1) for y in (0, 1) for z in (0, 1)], axis=1)
    some = poses[:: math.ceil(len(poses) / MOST_ROWS)]
    some = some[:, solid.owners, None]
    points = (some[..., :3] + rotations.rotate(some[..., 3:], corners)).reshape(len(some), -1, 3)
    height = float(points[..., 2].max())
    centre = poses[..., :2].mean(axis=1)
    if np.ptp(centre, axis=0).max() < TRAVEL * height:
        centre = np.repeat(np.median(centre, axis=0)[None], len(centre), axis=0)
    else:
        centre = _smooth(centre, int(FPS))
    reach = float(np.linalg.norm(points[..., :2] - centre[:: math.ceil(len(poses) / MOST_ROWS), None], axis=-1).max())
    made: dict[str, Any] = {"label": label, "body": solid.as_json(), "height": height, "reach": reach}
    made |= {"centre": packed(centre), "poses": packed_poses(poses, centre), "marks": packed(marks)}
    if goal is not None:
        made["goal"] = packed_poses(goal, centre)
    if scene is not None:
        made["scene"] = packed_poses(scene[1], np.zeros((1, 2))) | {"body": shapes_json(scene[0], OBSTACLE)}
    if observers is not None:
        made["observers"] = packed_poses(observers[1], centre) | {"body": shapes_json(observers[0], OBSERVER)}
        made["near"] = packed(observers[2])
    return made | {"layers": [*layers, *(name for name in ("goal", "scene", "observers") if name in made)]}


def _smooth(track: FloatArray, width: int) -> FloatArray:
    """Moving mean over `width` rows of a track (T, 2), padded with its end values."""
    half = width // 2
    padded = np.vstack([np.repeat(track[:1], half, axis=0), track, np.repeat(track[-1:], width - 1 - half, axis=0)])
    kernel = np.full(width, 1.0 / width)
    return np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])


def ground(robot: RobotBody, q: FloatArray, rows: IntArray) -> dict[str, Any] | None:
    """Return soles and centre of mass in rows of postures q (T, nq); None for a robot that does not stand. corners:
    (T, c, 3), `sizes` per sole. contact: greatest height of contact, m. middle, span (2,): seen from above. outside: a
    letter per row, 1 if the centre of mass was outside in any of its ticks."""
    if not robot.stands:
        return None
    stand = motion_metrics.standing_of(robot, q)
    flat = np.concatenate([stand.corners[rows], stand.com[rows, None]], axis=1)[..., :2].reshape(-1, 2)
    low, high = flat.min(axis=0), flat.max(axis=0)
    return {
        "corners": packed(stand.corners[rows]),
        "sizes": stand.sizes,
        "com": packed(stand.com[rows]),
        "margin": packed(stand.margin[rows]),
        "contact": motion_metrics.CONTACT_M,
        "middle": (0.5 * (low + high)).tolist(),
        "span": (high - low).tolist(),
        "outside": letters(stand.outside, rows),
    }


def _recorded(run: RunResult, rows: IntArray) -> dict[str, Any] | None:
    if run.human_truth is None or run.robot is not None:
        return None
    names = run.record.human_joint_names
    edges = [(names.index(a), names.index(b)) for a, b in HUMAN_BONES]
    points = turned(run.human_truth[rows], performer_facing(run)[:1])
    return {"points": packed(points), "edges": edges}


def letters(flags: BoolArray, rows: IntArray) -> str:
    """A letter per row: 1 if the flag (T,) is set in any of its ticks, else 0."""
    return "".join("1" if value else "0" for value in np.maximum.reduceat(flags, rows))
