"""A finished run to be looked at, whatever file it is from: its cast, and what the page shows of each of its ticks."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from retarget.errors import RefusedError
from retarget.model.body import body_from_file
from retarget.model.meshes import Mesh, solid_body
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_state import SceneState
from retarget.recording.configs import recorded_scene
from retarget.recording.cycles import STATES_OF_RUN
from retarget.recording.motion import Motion
from retarget.recording.read_run import no_human, read_recorded
from retarget.run.record import Phase
from retarget.run.table import RunTable
from retarget.schema.scene import load_scene
from retarget.types import FloatArray
from retarget.viewer.snapshot import SHOWN, STATE_WORDS, Cast, obstacle_meshes, obstacle_poses

WORDS = {STATES_OF_RUN[state]: words for state, words in STATE_WORDS.items()}
PHASE_WORDS = ("approaching", "following", "stopping")
"""What a robot does, by the state of the run, and by the phase of a tick, which is less precise."""


def recorded_obstacles(run: Motion) -> tuple[list[Mesh], FloatArray | None, tuple[str, ...]]:
    """The obstacles of a recorded run: their meshes; their poses (T, o, 7), m and wxyz, at every tick, None without
    any; and notes why they are not shown, or that the file of the scene is another one now.

    A recording has its scene attached. Obstacles that a program moved live are shown where the scene file has them.
    """
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


@dataclass(frozen=True, eq=False, kw_only=True)
class ShownRun(RunTable):
    """A recorded run, as a page shows it. notes: what is missing."""

    cast: Cast
    notes: tuple[str, ...] = ()


def open_recorded(path: Path, *, body: Path | None = None) -> ShownRun:
    """Read a run: saved or recorded, by what is in the file. What is kept less often than every tick is shown as it was
    last. body: MJCF or URDF of the robot, where the one that the file names is not there any more.

    Raises InputError for anything else.
    """
    run = read_recorded(path, body=body)
    if run.human is None or run.compiled is None:
        raise no_human(str(path))
    meshes, poses, notes = recorded_obstacles(run)
    cast = Cast(
        human=solid_body(body_from_file(run.human)),
        robot=None if run.is_human else solid_body(run.body),
        profile=run.profile or (None if run.is_human else _profile(Path(run.body.source))),
        joints=() if run.is_human else run.joint_names,
        landmarks=() if run.is_human else run.landmark_names,
        sensors=run.sensor_names,
        obstacles=meshes,
        servos_measure="temperature" in run and bool(np.isfinite(run.temperature).any()),
    )
    known = {name: values for name, values in run.known.items() if name in ("time", *SHOWN)} | {"obstacles": poses}
    kept = np.isfinite(run.human_q).all(axis=1)
    last = np.maximum.accumulate(np.where(kept, np.arange(len(run)), np.argmax(kept)))
    known |= {name: known[name][last] for name in ("human_q", "sensors") if name in known}
    doing = [PHASE_WORDS[phase] for phase in run.phase.tolist()]
    if "state" in run:
        doing = [WORDS.get(state, words) for state, words in zip(run.state.tolist(), doing, strict=True)]
    known["doing"] = np.array(doing, dtype=np.object_)
    known["reason"] = np.where(known["doing"] == "following", "", run.reason if "reason" in run else "")
    return ShownRun(**known, cast=cast, notes=tuple(dict.fromkeys((*run.notes, *notes))))


def _profile(body: Path) -> RobotBody | None:
    """The robot whose body file it is, if its profile lies next to it and can be read."""
    try:
        return load_robot(body.with_name("robot.yaml"), root="free")
    except RefusedError:
        return None
