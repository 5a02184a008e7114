"""The content of pages: the cast of a run, which stays the same, and tracks with a row for each tick."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from retarget import _solver
from retarget.model.meshes import OBSERVER, OBSTACLE, Mesh, SolidBody, shape_mesh, shapes_json
from retarget.model.observers import Observers, placed, robot_observers
from retarget.model.robot import RobotBody
from retarget.report.motion_metrics import Standing, standing_of
from retarget.rotations import multiply, rotate
from retarget.run.run_result import PRESSURE, in_truth
from retarget.run.table import RunTable
from retarget.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Cast:
    """The bodies of a run. robot: None for a human alone. profile: needed for soles and observers. joints (n),
    landmarks (k), sensors (s): names. servos_measure: rows have temperatures and currents."""

    human: SolidBody
    robot: SolidBody | None = None
    profile: RobotBody | None = None
    joints: tuple[str, ...] = ()
    landmarks: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    obstacles: Sequence[Mesh] = field(default=())
    servos_measure: bool = True

    @cached_property
    def columns(self) -> IntArray:
        """Columns of `joints` in a posture of the robot, (n,)."""
        if self.robot is None:
            return np.zeros(0, dtype=np.int64)
        body = self.robot.body
        return body.joint_qpos[[body.joint_index(joint) for joint in self.joints]]

    @cached_property
    def observers(self) -> Observers | None:
        """Observers of the robot; None if its profile is unknown."""
        return None if self.profile is None else robot_observers(self.profile)

    @cached_property
    def observer_meshes(self) -> list[Mesh]:
        """Shapes of the observers."""
        known = self.observers
        if known is None:
            return []
        return [shape_mesh(kind, size) for kind, size in zip(known.kinds.tolist(), known.sizes, strict=True)]

    def as_json(self) -> dict[str, Any]:
        """The message `scene` of a live page: its figures, see `figure.js`, and its joints."""
        profile = self.profile
        last: dict[str, Any] = {"layers": []}
        if self.obstacles:
            last = {"layers": ["scene"], "scene": shapes_json(self.obstacles, OBSTACLE)}
        human = {"body": self.human.as_json(), "layers": ["servos"], "sizes": None}
        if self.robot is None:
            return {"human": human | last | {"layers": ["servos", *last["layers"]]}, "robot": None, "joints": []}
        stands = profile is not None and profile.stands
        sizes = [len(foot.polygon) for foot in profile.profile.feet.values()] if profile and stands else None
        robot = last | {"body": self.robot.as_json(), "sizes": sizes}
        robot["layers"] = ["desired", "goal", *(["pass"] if stands else []), *last["layers"]]
        if self.observers is not None:
            robot["observers"] = shapes_json(self.observer_meshes, OBSERVER)
            robot["layers"].append("observers")
        return {"human": human, "robot": robot, "joints": self.joints, "measured": self.servos_measure}


def simulated(rows: RunTable) -> BoolArray:
    """True for the rows (T,) with the state of a simulated body."""
    if "truth" not in rows:
        return np.zeros(len(rows), dtype=bool)
    return np.asarray(np.isfinite(rows.truth[:, :-PRESSURE]).all(axis=1))


def moved(cast: Cast, rows: RunTable) -> FloatArray:
    """Postures (T, nq) of the robot: simulated if known, else as sent."""
    assert cast.robot is not None
    q = rows.q.copy()
    for row in np.flatnonzero(simulated(rows)).tolist():
        q[row], _ = in_truth(cast.robot.body, q[row], rows.truth[row])
    return q


def present(cast: Cast, rows: RunTable, q: FloatArray) -> FloatArray:
    """Postures (T, nq) with the measured positions of the servos, except in simulated rows."""
    if "present" not in rows:
        return q
    there = q.copy()
    there[:, cast.columns] = np.where(np.isfinite(rows.present), rows.present, q[:, cast.columns])
    return np.where(simulated(rows)[:, None], q, there)


def standing(cast: Cast, q: FloatArray) -> Standing | None:
    """Soles and centre of mass in postures (T, nq); None for a robot without soles."""
    return standing_of(cast.profile, q) if cast.profile is not None and cast.profile.stands else None


def observers_at(cast: Cast, rows: RunTable) -> tuple[FloatArray, FloatArray]:
    """Poses (T, o, 7) of the observers, NaN for one that does not act, and `nearest_points` (T, 2, 3), m."""
    known = cast.observers
    assert known is not None and cast.robot is not None
    found, near = np.full((len(rows), len(known.names), 7), np.nan), np.full((len(rows), 2, 3), np.nan)
    if "observer_modes" not in rows or rows.observer_modes.shape[1] != len(known.names):
        return found, near
    modes = rows.observer_modes > 0
    for row in np.flatnonzero(modes.any(axis=1)).tolist():
        acts = modes[row]
        places, turns = cast.robot.kinematics.forward(np.ascontiguousarray(rows.q[row]))
        place, turn = places[known.links[acts]], turns[known.links[acts]]
        found[row, acts, :3] = place + rotate(turn, known.positions[acts])
        found[row, acts, 3:] = multiply(turn, known.quats[acts])
        near[row] = nearest_points(known, acts, *placed(cast.robot.body, known, rows.q[row]))
    return found, near


def nearest_points(known: Observers, acts: BoolArray, places: FloatArray, turns: FloatArray) -> FloatArray:
    """Nearest points (2, 3), m, of the nearest pair of observers in which one acts (o,); NaN if no pair is within its
    influence distance. places (o, 3), m; turns (o, 4), wxyz."""
    pairs = known.pairs[acts[known.pairs].any(axis=1)]
    a, b = (np.ascontiguousarray(column) for column in pairs.T)
    sides = ((known.kinds[one], known.sizes[one], places[one], turns[one]) for one in (a, b))
    distance, *ends, _ = _solver.shape_distances(*next(sides), *next(sides))
    distance[distance > np.maximum(known.influence[a], known.influence[b])] = np.inf
    if not np.isfinite(distance).any():
        return np.full((2, 3), np.nan)
    return np.array([end[np.argmin(distance)] for end in ends])


def joint_tracks(cast: Cast, rows: RunTable) -> dict[str, FloatArray]:
    """Tracks (T, n) of the joints, NaN if unknown: goal, servo, degrees; temperature, degrees Celsius; current, A."""
    unknown = np.full((len(rows), len(cast.joints)), np.nan)
    known = {name: rows.known.get(name, unknown) for name in ("present", "temperature", "current")}
    tracks = {"goal": np.degrees(rows.q[:, cast.columns]), "servo": np.degrees(known["present"])}
    return tracks | {name: known[name] for name in ("temperature", "current")}


def view_of(solid: SolidBody, poses: FloatArray) -> FloatArray:
    """View (4,), m, of a body at poses (1, k, 7): its middle on the floor (2), its height and its reach."""
    reach = np.zeros(len(solid.links))
    np.maximum.at(reach, solid.owners, [np.linalg.norm(mesh.vertices, axis=1).max() for mesh in solid.meshes])
    middle = poses[0, :, :2].mean(axis=0)
    far = np.linalg.norm(poses[0, :, :2] - middle, axis=1) + reach
    return np.array([*middle, (poses[0, :, 2] + reach).max(), far.max()])


def live_tracks(cast: Cast, row: RunTable) -> dict[str, FloatArray]:
    """Tracks of one row, by figure and part, for `figure.js` and `plot.js`."""
    rows = row.each(lambda value: np.asarray(value)[None])
    poses = cast.human.poses(rows.human_q)
    found = {"human.poses": poses, "human.view": view_of(cast.human, poses)}
    if "sensors" in rows:
        found["human.marks"] = rows.sensors
    if "obstacles" in rows:
        found["human.scene" if cast.robot is None else "robot.scene"] = rows.obstacles
    if cast.robot is None:
        return found
    q = moved(cast, rows)
    poses = cast.robot.poses(present(cast, rows, q))
    found |= {"robot.poses": poses, "robot.view": view_of(cast.robot, poses), "robot.goal": cast.robot.poses(rows.q)}
    if "landmarks_asked" in rows:
        found["robot.marks"] = rows.landmarks_asked
    if (stand := standing(cast, q)) is not None:
        found |= {"robot.corners": stand.corners, "robot.com": stand.com, "robot.margin": stand.margin}
    if cast.observers is not None:
        found["robot.observers"], found["robot.near"] = observers_at(cast, rows)
    return found | {f"joints.{name}": values for name, values in joint_tracks(cast, rows).items()}
