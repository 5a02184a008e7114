"""A finished run to be looked at, whatever file it is from: its cast, and what the page shows of each of its ticks."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import RefusedError
from retarget.model.body import body_from_file
from retarget.model.meshes import Mesh, SolidBody, solid_body
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_state import SceneState
from retarget.recording.configs import recorded_scene
from retarget.recording.cycles import STATES_OF_RUN
from retarget.recording.motion import PHASE_NAMES, Motion
from retarget.recording.read_run import human_of, read_recorded
from retarget.recording.reading import Recording
from retarget.run.record import Phase
from retarget.schema.scene import load_scene
from retarget.types import BoolArray, FloatArray
from retarget.viewer.snapshot import (
    STATE_WORDS,
    Cast,
    Row,
    obstacle_meshes,
    obstacle_poses,
)

WORDS: dict[int | str, str] = {"approach": "approaching", "follow": "following", "brake": "stopping"}
WORDS |= {STATES_OF_RUN[state]: words for state, words in STATE_WORDS.items()}
"""By the phase of a tick, and by the state of the run, which is more precise."""
OF_SERVOS = {"temperature": "temperature", "current": "current", "modes": "observer_modes", "truth": "truth"}
"""What a `Row` has besides postures: its name in the recorded run."""


class RecordedScene:
    """The scene of a recorded run: where its obstacles were at every tick.

    phase (T,): names of the phases of the ticks; no_command (T,). notes: why it is not shown, or that its file is
    another one now. A recording has its scene attached. Obstacles that a program moved live are shown where the scene
    file has them.
    """

    def __init__(self, recording: Recording, phase: NDArray[np.str_], no_command: BoolArray) -> None:
        self.obstacles: list[Mesh] = []
        self.notes: tuple[str, ...] = ()
        self._state: SceneState | None = None
        moves = (phase != PHASE_NAMES[Phase.APPROACH]) & ~no_command
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
    """A recorded run, as a page shows it. times (T,) s of its rows. notes: what is missing.

    tracks: everything else that is known of a `Row`, with a row per tick. scene: None without any.
    """

    cast: Cast
    times: FloatArray
    tracks: dict[str, NDArray[Any]]
    scene: RecordedScene | None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, row: int) -> Row:
        """The tick of a row."""
        poses = None if self.scene is None else self.scene.at(row)
        known = {name: values[row] for name, values in self.tracks.items()}
        return Row(time=float(self.times[row]), obstacle_poses=poses, **known)


def open_recorded(path: Path, *, body: Path | None = None) -> ShownRun:
    """Read a run: saved or recorded, by what is in the file. What is kept less often than every tick is shown as it was
    last. body: MJCF or URDF of the robot, where the one that the file names is not there any more.

    Raises InputError for anything else.
    """
    run = read_recorded(path, body=body)
    human, robot = human_of(run, path), run.robot
    motion, scene = robot or human, None
    if run.recording is not None:
        scene = RecordedScene(run.recording, motion.phase, run.tracks["no_command"])
    cast = Cast(
        human=_solid(human),
        robot=None if robot is None else _solid(robot),
        profile=run.profile if robot is None else run.profile or _profile(Path(robot.body.source)),
        joints=() if robot is None else run.profile.joint_map.joints if run.profile else robot.joint_names,
        landmarks=() if robot is None or robot.asked is None else robot.asked.names,
        sensors=() if run.sensors is None else run.sensors.names,
        obstacles=() if scene is None else scene.obstacles,
        servos_measure=bool(np.isfinite(run.tracks.get("temperature", np.nan)).any()),
    )
    tracks: dict[str, NDArray[Any]] = {"human": human.q[run.shown]}
    tracks |= {} if run.sensors is None else {"sensors": run.sensors.position[run.shown]}
    tracks |= {name: run.tracks[own] for name, own in OF_SERVOS.items() if own in run.tracks}
    if robot is not None:
        servos = np.full(robot.joints.shape, np.nan) if robot.servos is None else robot.servos
        tracks |= {"goal": robot.q, "present": servos[:, [robot.joint_names.index(joint) for joint in cast.joints]]}
        tracks |= {} if robot.asked is None else {"asked": robot.asked.position}
        tracks |= {} if run.reached is None else {"reached": run.reached.position}
    states = [WORDS[name] for name in motion.phase.tolist()]
    if "state" in run.tracks:
        states = [WORDS.get(state, word) for state, word in zip(run.tracks["state"].tolist(), states, strict=True)]
    whys = np.where(np.array(states) == "following", "", run.reasons or "")
    tracks |= {"state": np.array(states), "why": whys}
    notes = tuple(dict.fromkeys((*run.notes, *(() if scene is None else scene.notes))))
    return ShownRun(cast, motion.time, tracks, scene, notes)


def _solid(motion: Motion) -> SolidBody:
    assert motion.compiled is not None, "a body that was read"
    return solid_body(body_from_file(motion.compiled))


def _profile(body: Path) -> RobotBody | None:
    """The robot whose body file it is, if its profile lies next to it and can be read."""
    try:
        return load_robot(body.with_name("robot.yaml"), root="free")
    except RefusedError:
        return None
