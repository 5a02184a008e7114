"""What the page's player draws: performer, robot, centre of mass and soles, in fewer rows than there are ticks."""

import base64
import math
from itertools import pairwise
from typing import Any

import numpy as np

from retarget import rotations
from retarget.model.meshes import SolidBody
from retarget.model.scene_shapes import ShapeKind
from retarget.model.scene_state import SceneState
from retarget.report import motion_metrics
from retarget.report.findings import moments
from retarget.report.plots import HUMAN_BONES, POSES, unlike_ticks
from retarget.report.tracking import performer_facing, turned
from retarget.run.record import PHASE_NAMES
from retarget.run.run_result import RunResult
from retarget.types import BoolArray, FloatArray, IntArray

# The obstacles of a scene as edges, so that the page shows what the body had to keep clear of.

ROUND = 12
"""Corners of a circle."""


def wires_of(scene: SceneState, times: FloatArray) -> tuple[FloatArray, list[tuple[int, int]]] | None:
    """Points (R, p, 3) m, world, of the obstacles at times (T,) s, a row for each time or a single one where nothing
    moves, and the edges between them; None without any that has edges. A half-space has none: it is the ground, or a
    wall without an end."""
    local: list[FloatArray] = []
    owners: list[int] = []
    edges: list[tuple[int, int]] = []
    for obstacle, (kind, size) in enumerate(zip(scene.shapes.kinds.tolist(), scene.shapes.sizes, strict=True)):
        first = len(local)
        if kind == ShapeKind.BOX:
            corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
            found = [(a, b) for a in range(8) for b in (a + 1, a + 2, a + 4) if b < 8 and (a ^ b).bit_count() == 1]
        elif kind in (ShapeKind.CAPSULE, ShapeKind.CYLINDER):
            corners, found = _round(float(size[0]), float(size[1]))
        else:
            continue
        local += list(corners)
        owners += [obstacle] * len(corners)
        edges += [(first + a, first + b) for a, b in found]
    if not owners:
        return None
    poses = [scene.at_rest(float(time)) for time in times]
    place = np.array([pose.position[owners] for pose in poses])
    turn = np.array([pose.quat[owners] for pose in poses])
    points = place + rotations.rotate(turn, np.array(local)[None])
    return points if np.ptp(points, axis=0).max() > 0.0 else points[:1], edges


def _round(radius: float, half: float) -> tuple[FloatArray, list[tuple[int, int]]]:
    """A circle at both ends and one upright; of a sphere all three are about its centre."""
    angle = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
    across, along, flat = radius * np.cos(angle), radius * np.sin(angle), np.zeros(ROUND)
    rings = [np.column_stack([across, along, flat + end]) for end in (-half, half)]
    rings.append(np.column_stack([across, flat, along + half * np.sign(np.round(along, 12))]))
    ring = [*range(ROUND), 0]
    return np.vstack(rings), [(ROUND * i + a, ROUND * i + b) for i in range(len(rings)) for a, b in pairwise(ring)]


# Tracks as text inside a page.


def packed(values: FloatArray) -> str:
    """Pack an array as base64 of little-endian 32-bit floats; NaN stays for what is not known."""
    return base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")


MOST_INTEGER = 2**15 - 1
"""Largest number of 16 bits with a sign."""


def packed_poses(poses: FloatArray, centre: FloatArray) -> tuple[str, float]:
    """Pack poses (T, m, 7) of position, m, and quaternion as base64 of little-endian 16-bit integers, and what one is
    of a position, m from the centre (T, 2) on the floor; of a quaternion it is 1 / `MOST_INTEGER`."""
    place = poses[..., :3] - np.pad(centre, ((0, 0), (0, 1)))[:, None]
    step = max(float(np.abs(place).max()), 1e-6) / MOST_INTEGER
    numbers = np.concatenate([place / step, poses[..., 3:] * MOST_INTEGER], axis=-1)
    return base64.b64encode(numbers.round().astype("<i2").tobytes()).decode("ascii"), step


FPS = 30.0
MOST_ROWS = 3000
"""Pictures of a motion at most: a long run is shown more coarsely."""
TRAVEL = 0.5
"""A body that gets farther than this share of its height is followed by the view."""


def animation_of(run: RunResult) -> dict[str, Any] | None:
    """What the player draws, as JSON; None of a run that followed nothing.

    time: ms. phase, gated: a letter a row. every: ticks to a row. moments: ms, at which something went wrong. recorded:
    of a human alone, its body as the file knows it. poses: rows that are shown side by side.
    """
    record, following = run.record, run.record.following
    if following.stop - following.start < 2:
        return None
    every = max(1, math.ceil(1.0 / (run.clip.dt * FPS) - 1e-9), math.ceil(len(record) / MOST_ROWS))
    rows = np.arange(0, len(record), every)
    ticks = unlike_ticks(run, min(POSES, run.ticks_followed))
    return {
        "time": [round(1e3 * time) for time in record.time[rows]],
        "phase": "".join(PHASE_NAMES[phase][0] for phase in record.phase[rows]),
        "gated": _letters(record.gated, rows),
        "every": every,
        "performer": _performer(run, rows),
        "robot": _robot(run, rows),
        "ground": _ground(run, rows),
        "obstacles": _obstacles(run, rows),
        "recorded": _recorded(run, rows),
        "poses": [min(-(-tick // every), len(rows) - 1) for tick in ticks],
        "moments": [round(1e3 * moment.time) for moment in moments(run)],
        "simulated": run.physics is not None,
    }


def _performer(run: RunResult, rows: IntArray) -> dict[str, Any]:
    """The reconstructed human and the sensors, turned so that it faces x where following begins."""
    facing = performer_facing(run)[:1]
    poses = run.human.solid.poses(run.record.human_q[rows])
    poses[..., :3] = turned(poses[..., :3], facing)
    half = -0.5 * float(np.arctan2(facing[0, 1], facing[0, 0]))
    poses[..., 3:] = rotations.multiply(np.array([np.cos(half), 0.0, 0.0, np.sin(half)]), poses[..., 3:])
    return _figure("performer", run.human.solid, poses, turned(run.sensors_asked[rows], facing))


def _robot(run: RunResult, rows: IntArray) -> dict[str, Any] | None:
    """The robot as it moved, see `RunResult.moved_q`, and the landmarks that were asked of it."""
    robot, sent, q = run.robot, run.record.robot, run.moved_q
    if robot is None or sent is None or q is None:
        return None
    return _figure(robot.profile.name, robot.solid, robot.solid.poses(q[rows]), sent.landmarks_asked[rows])


def _figure(label: str, solid: SolidBody, poses: FloatArray, marks: FloatArray) -> dict[str, Any]:
    """A body, as `bodies.js` draws it. poses (T, links, 7) and their step: see `packed_poses`. marks (T, k, 3): what
    was measured of a performer, or asked of a robot. centre (T, 2): where the view looks. height, reach m: what it must
    show."""
    boxes = np.array([[mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)] for mesh in solid.meshes])
    corners = np.stack([boxes[:, [x, y, z], range(3)] for x in (0, 1) for y in (0, 1) for z in (0, 1)], axis=1)
    points = (poses[:, :, None, :3] + rotations.rotate(poses[:, :, None, 3:], corners)).reshape(len(poses), -1, 3)
    height = float(points[..., 2].max())
    centre = poses[..., :2].mean(axis=1)
    if np.ptp(centre, axis=0).max() < TRAVEL * height:
        centre = np.repeat(np.median(centre, axis=0)[None], len(centre), axis=0)
    else:
        centre = _smooth(centre, int(FPS))
    reach = float(np.linalg.norm(points[..., :2] - centre[:, None], axis=-1).max())
    track, step = packed_poses(poses, centre)
    view = {"centre": packed(centre), "height": height, "reach": reach}
    return {"label": label, "body": solid.as_json(), "poses": track, "step": step, "marks": packed(marks)} | view


def _smooth(track: FloatArray, width: int) -> FloatArray:
    """Moving mean over `width` rows of a track (T, 2), which goes on as it ends."""
    half = width // 2
    padded = np.vstack([np.repeat(track[:1], half, axis=0), track, np.repeat(track[-1:], width - 1 - half, axis=0)])
    kernel = np.full(width, 1.0 / width)
    return np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])


def _ground(run: RunResult, rows: IntArray) -> dict[str, Any] | None:
    """Soles and centre of mass of a robot that stands, as it moved. corners (T, c, 3) of all soles, `sizes` of them
    each; com (T, 3); margin (T,), see `support_margin`. contact: m above the ground that still carry. middle, span
    (2,): of all of it, seen from above. outside: a letter a row, 1 where the centre of mass was beyond the edge in any
    of its ticks."""
    robot, q = run.robot, run.moved_q
    if robot is None or q is None or not robot.stands:
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
        "outside": _letters(stand.outside, rows),
    }


def _obstacles(run: RunResult, rows: IntArray) -> dict[str, Any] | None:
    """Obstacles of the last stage's body, in the world that its figure is drawn in."""
    wires = None if run.scene is None else wires_of(run.scene, np.maximum(run.record.time[rows], 0.0))
    if wires is None:
        return None
    points, edges = wires
    if run.robot is None:
        points = turned(points, performer_facing(run)[:1])
    return _lines(points, edges)


def _recorded(run: RunResult, rows: IntArray) -> dict[str, Any] | None:
    """The recorded body, turned as the performer's figure is."""
    if run.human_truth is None or run.robot is not None:
        return None
    names = run.record.human_joint_names
    edges = [(names.index(a), names.index(b)) for a, b in HUMAN_BONES]
    return _lines(turned(run.human_truth[rows], performer_facing(run)[:1]), edges)


def _lines(points: FloatArray, edges: list[tuple[int, int]]) -> dict[str, Any]:
    """Lines between pairs of points (rows, p, 3): a row for each of the animation's, or one where nothing moves."""
    return {"points": packed(points), "rows": len(points), "edges": edges}


def _letters(flags: BoolArray, rows: IntArray) -> str:
    """1 for a row in any tick of which the flag (T,) is up, else 0."""
    return "".join("1" if value else "0" for value in np.maximum.reduceat(flags, rows))
