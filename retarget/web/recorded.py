"""The page of a recorded run, of any kind of file: its cast, and tracks with a row for each tick."""

import base64
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from retarget.errors import RefusedError
from retarget.model.body import body_from_file
from retarget.model.meshes import Mesh, solid_body
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_state import SceneState, obstacle_meshes, obstacle_poses
from retarget.pictures.animation import Packed, figure, ground, letters, packed
from retarget.pictures.page import FOLDER, player_script, template
from retarget.pictures.solid import facing_x
from retarget.recording.configs import recorded_scene
from retarget.recording.cycles import STATES_OF_RUN
from retarget.recording.motion import Motion
from retarget.recording.read_run import no_human, read_recorded
from retarget.report.tracking import turned
from retarget.rotations import rotate
from retarget.run.record import PHASE_NAMES, Phase
from retarget.run.table import RunTable
from retarget.schema.scene import load_scene
from retarget.types import FloatArray
from retarget.web.feed import SHOWN, STATE_WORDS
from retarget.web.shown import Cast, joint_tracks, moved, observers_at, present

WORDS = {STATES_OF_RUN[state]: words for state, words in STATE_WORDS.items()}
PHASE_WORDS = ("approaching", "following", "stopping")
"""Words for the states of a run, and for the phases of a tick, which are less precise."""


def recorded_obstacles(run: Motion) -> tuple[list[Mesh], FloatArray | None, tuple[str, ...]]:
    """The meshes of the obstacles, their poses (T, o, 7), m and wxyz, or None, and notes on a scene that is not
    shown or has changed. Obstacles that a program moved live are shown as in the scene file."""
    if run.recording is None:
        return [], None, ()
    try:
        with recorded_scene(run.recording) as (scene, notes):
            if scene is None:
                return [], None, notes
            state = SceneState(load_scene(scene))
    except RefusedError as error:
        return [], None, (f"its scene is not shown: {error}",)
    moves = (run.phase != Phase.APPROACH) & ~run.no_command
    times = run.recording.session.dt * (np.cumsum(moves) - moves)
    poses = [obstacle_poses(state.shapes, state.at_rest(time)) for time in times.tolist()]
    return obstacle_meshes(state.shapes), np.array(poses), notes


KEPT_FIELDS = ("time", "phase", "gated", *SHOWN)


@dataclass(frozen=True, eq=False, kw_only=True)
class ShownRun(RunTable):
    """A recorded run for a page. robot: name. notes: sentences on missing parts."""

    cast: Cast
    robot: str
    notes: tuple[str, ...] = ()


def open_recorded(path: Path, *, body: Path | None = None) -> ShownRun:
    """Read a saved or recorded run. Fields that are not kept in every tick repeat their last value. body: MJCF or URDF
    of the robot, in place of a missing one. Raises InputError for any other file."""
    run = read_recorded(path, body=body)
    if run.human is None or run.compiled is None:
        raise no_human(str(path))
    meshes, poses, notes = recorded_obstacles(run)
    profile = run.profile or (None if run.is_human else _profile(Path(run.body.source)))
    cast = Cast(
        human=solid_body(body_from_file(run.human)),
        robot=None if run.is_human else solid_body(run.body, None if profile is None else profile.frame_links),
        profile=profile,
        joints=() if run.is_human else run.joint_names,
        landmarks=() if run.is_human else run.landmark_names,
        sensors=run.sensor_names,
        obstacles=meshes,
        servos_measure="temperature" in run and bool(np.isfinite(run.temperature).any()),
    )
    known = {name: values for name, values in run.known.items() if name in KEPT_FIELDS} | {"obstacles": poses}
    kept = np.isfinite(run.human_q).all(axis=1)
    last = np.maximum.accumulate(np.where(kept, np.arange(len(run)), np.argmax(kept)))
    known |= {name: known[name][last] for name in ("human_q", "sensors") if name in known}
    doing = [PHASE_WORDS[phase] for phase in run.phase.tolist()]
    if "state" in run:
        doing = [WORDS.get(state, words) for state, words in zip(run.state.tolist(), doing, strict=True)]
    known["doing"] = np.array(doing, dtype=np.object_)
    known["reason"] = np.where(known["doing"] == "following", "", run.reason if "reason" in run else "")
    name = run.robot if profile is None else profile.profile.name
    return ShownRun(**known, cast=cast, robot=name, notes=tuple(dict.fromkeys((*run.notes, *notes))))


def _profile(body: Path) -> RobotBody | None:
    try:
        return load_robot(body.with_name("robot.yaml"), root="free")
    except RefusedError:
        return None


# The page: the player of a report, with every tick, goals and joints.

MOST_ROWS = 40_000
"""Largest number of rows, some 70 MB: five minutes at 125 Hz. A longer run is thinned."""


def page_files(run: ShownRun, name: str) -> dict[str, bytes]:
    """Files of the page of a run by their places, "" for the page itself. name: of the recording."""
    tracks = bytearray()
    title = f"{run.robot}: {name}"
    html = template("view.html").render(title=title, animation=_lifted(_animation(run), tracks))
    script = player_script('await (await fetch("tracks")).arrayBuffer()')
    styles = {name: (FOLDER / name).read_bytes() for name in ("base.css", "page.css")}
    return {"": html.encode(), "player.js": script.encode(), "tracks": bytes(tracks)} | styles


def _lifted(value: Any, tracks: bytearray) -> Any:
    """Move packed numbers into `tracks`, and replace each by its first byte and count."""
    if isinstance(value, dict):
        return {name: _lifted(one, tracks) for name, one in value.items()}
    if not isinstance(value, Packed):
        return value
    tracks += bytes(-len(tracks) % 4)
    begin, numbers = len(tracks), base64.b64decode(value)
    tracks += numbers
    return [begin, len(numbers) // value.size]


def _animation(run: ShownRun) -> dict[str, Any]:
    every = math.ceil(len(run) / MOST_ROWS)
    rows, cast = np.arange(0, len(run), every), run.cast
    shown = run[rows]
    words = list(zip(shown.doing.tolist(), shown.reason.tolist(), strict=True))
    gated = run.gated if "gated" in run else np.zeros(len(run), dtype=bool)
    q = None if cast.robot is None else moved(cast, run)
    known = ("goal", "servo", *(("temperature", "current") if cast.servos_measure else ()))
    joints = {name: packed(joint_tracks(cast, shown)[name]) for name in known} if cast.joints else None
    return {
        "time": (1e3 * shown.time).round(1).tolist(),
        "phase": "".join(PHASE_NAMES[phase][0] for phase in shown.phase.tolist()),
        "gated": letters(gated, rows),
        "every": every,
        "performer": _performer(shown),
        "robot": None if q is None else _robot(shown, q[rows]),
        "ground": None if q is None or cast.profile is None else ground(cast.profile, q, rows),
        "recorded": None,
        "joints": joints and joints | {"names": cast.joints, "measured": cast.servos_measure},
        "doing": [(at, *one) for at, one in enumerate(words) if at == 0 or one != words[at - 1]],
        "poses": [],
        "moments": [],
        "notes": run.notes,
        "repeats": True,
    }


def _performer(run: ShownRun) -> dict[str, Any]:
    """The human and its sensors, rotated so that it faces x when following begins."""
    cast, first = run.cast, int(np.argmax(run.phase == Phase.FOLLOW))
    _, turns = cast.human.kinematics.forward(np.ascontiguousarray(run.human_q[first]))
    ahead = rotate(turns[1], np.array([1.0, 0.0, 0.0]))[None, :2]
    heading = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    marks = turned(run.sensors, heading) if "sensors" in run else np.zeros((len(run), 0, 3))
    poses, scene = facing_x(cast.human.poses(run.human_q), heading), _obstacles(run) if cast.robot is None else None
    if scene is not None:
        scene = scene[0], facing_x(scene[1], heading)
    made = figure("performer", cast.human, poses, marks=marks, layers=("servos",), scene=scene)
    return made | {"caption": "as reconstructed"}


def _robot(run: ShownRun, q: FloatArray) -> dict[str, Any]:
    """The robot in postures (T, nq), with measured servo positions, and its goals."""
    cast = run.cast
    assert cast.robot is not None
    marks = run.landmarks_asked if "landmarks_asked" in run else np.zeros((len(run), 0, 3))
    acts = "observer_modes" in run and cast.profile is not None
    made = figure(
        run.robot,
        cast.robot,
        cast.robot.poses(present(cast, run, q)),
        goal=cast.robot.poses(run.q),
        marks=marks,
        layers=("desired", "pass"),
        scene=_obstacles(run),
        observers=(cast.observer_meshes, *observers_at(cast, run)) if acts else None,
    )
    return made | {"caption": "as simulated" if "truth" in run else "as its servos report it"}


def _obstacles(run: ShownRun) -> tuple[list[Mesh], FloatArray] | None:
    return ([*run.cast.obstacles], run.obstacles) if "obstacles" in run and run.cast.obstacles else None
