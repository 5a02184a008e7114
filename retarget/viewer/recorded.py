"""A finished run to be looked at, whatever file it is from: its cast, and what the page shows of each of its ticks."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from retarget.errors import RefusedError
from retarget.model.body import body_from_file
from retarget.model.meshes import Mesh, solid_body
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_state import SceneState
from retarget.recording.configs import recorded_scene
from retarget.recording.cycles import STATES_OF_RUN
from retarget.recording.read_run import no_human, read_recorded
from retarget.recording.reading import Recording
from retarget.run.record import Phase
from retarget.run.table import ByteArray, RunTable
from retarget.schema.scene import load_scene
from retarget.types import BoolArray, FloatArray
from retarget.viewer.snapshot import SHOWN, STATE_WORDS, Cast, obstacle_meshes, obstacle_poses

WORDS = {STATES_OF_RUN[state]: words for state, words in STATE_WORDS.items()}
PHASE_WORDS = ("approaching", "following", "stopping")
"""What a robot does, by the state of the run, and by the phase of a tick, which is less precise."""


class RecordedScene:
    """The scene of a recorded run: where its obstacles were at every tick.

    phase (T,): phases of the ticks; no_command (T,). notes: why it is not shown, or that its file is
    another one now. A recording has its scene attached. Obstacles that a program moved live are shown where the scene
    file has them.
    """

    def __init__(self, recording: Recording, phase: ByteArray, no_command: BoolArray) -> None:
        self.obstacles: list[Mesh] = []
        self.notes: tuple[str, ...] = ()
        self._state: SceneState | None = None
        moves = (phase != Phase.APPROACH) & ~no_command
        self._times = recording.session.dt * (np.cumsum(moves) - moves)
        try:
            with recorded_scene(recording) as (scene, self.notes):
                if scene is None:
                    return
                self._state = SceneState(load_scene(scene))
        except RefusedError as error:
            self.notes = (f"its scene is not shown: {error}",)
            return
        self.obstacles = obstacle_meshes(self._state.shapes)

    def at(self, row: int) -> FloatArray | None:
        """Poses (o, 7) of the obstacles, m and wxyz; None without any."""
        if self._state is None:
            return None
        return obstacle_poses(self._state.shapes, self._state.at_rest(float(self._times[row])))


@dataclass(frozen=True, eq=False)
class ShownRun:
    """A recorded run, as a page shows it: its rows (T). scene: None without any. notes: what is missing."""

    cast: Cast
    table: RunTable
    scene: RecordedScene | None
    notes: tuple[str, ...] = ()

    @property
    def times(self) -> FloatArray:
        """Times (T,) s of the rows."""
        return self.table.time

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, row: int) -> RunTable:
        """The tick of a row."""
        shown, obstacles = self.table[row], None if self.scene is None else self.scene.at(row)
        return shown if obstacles is None else replace(shown, obstacles=obstacles)


def open_recorded(path: Path, *, body: Path | None = None) -> ShownRun:
    """Read a run: saved or recorded, by what is in the file. What is kept less often than every tick is shown as it was
    last. body: MJCF or URDF of the robot, where the one that the file names is not there any more.

    Raises InputError for anything else.
    """
    run = read_recorded(path, body=body)
    if run.human is None or run.compiled is None:
        raise no_human(str(path))
    scene = None if run.recording is None else RecordedScene(run.recording, run.phase, run.no_command)
    cast = Cast(
        human=solid_body(body_from_file(run.human)),
        robot=None if run.is_human else solid_body(run.body),
        profile=run.profile or (None if run.is_human else _profile(Path(run.body.source))),
        joints=() if run.is_human else run.joint_names,
        landmarks=() if run.is_human else run.landmark_names,
        sensors=run.sensor_names,
        obstacles=() if scene is None else scene.obstacles,
        servos_measure="temperature" in run and bool(np.isfinite(run.temperature).any()),
    )
    known = {name: values for name, values in run.known.items() if name in ("time", *SHOWN)}
    kept = np.isfinite(run.human_q).all(axis=1)
    last = np.maximum.accumulate(np.where(kept, np.arange(len(run)), np.argmax(kept)))
    known |= {name: known[name][last] for name in ("human_q", "sensors") if name in known}
    doing = [PHASE_WORDS[phase] for phase in run.phase.tolist()]
    if "state" in run:
        doing = [WORDS.get(state, words) for state, words in zip(run.state.tolist(), doing, strict=True)]
    known["doing"] = np.array(doing, dtype=np.object_)
    known["reason"] = np.where(known["doing"] == "following", "", run.reason if "reason" in run else "")
    notes = tuple(dict.fromkeys((*run.notes, *(() if scene is None else scene.notes))))
    return ShownRun(cast, RunTable(**known), scene, notes)


def _profile(body: Path) -> RobotBody | None:
    """The robot whose body file it is, if its profile lies next to it and can be read."""
    try:
        return load_robot(body.with_name("robot.yaml"), root="free")
    except RefusedError:
        return None
