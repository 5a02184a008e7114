"""A finished run to be looked at: saved with `--save FILE.npz`, or recorded with `--record FILE.mcap`."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError, RefusedError
from retarget.model.body_file import compile_body, compile_body_text
from retarget.model.human import build_human
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_state import SceneState
from retarget.recording.configs import as_recorded, recorded_scene
from retarget.recording.cycles import Cycles, Done
from retarget.recording.npz import HUMAN, NO_RUN, ROBOT, SavedRun, refuse_no_file
from retarget.recording.reading import (
    MAGIC,
    Played,
    Recording,
    TopicRows,
    fields_required,
    played,
    postures_sent,
    read_recording,
)
from retarget.recording.taps import STATES_OF_RUN
from retarget.recording.topics import HUMAN_POSTURE, LANDMARKS, TICK, TRUTH
from retarget.run.record import Phase
from retarget.run.run_result import truth_names
from retarget.schema.scene import load_scene
from retarget.types import FloatArray
from retarget.viewer.ground import rows_around, zero_moment_point
from retarget.viewer.snapshot import (
    PHASE_WORDS,
    STATE_WORDS,
    Cast,
    Obstacle,
    Row,
    Snapshot,
    Tracks,
    actor,
    drawn,
    obstacles,
    placed,
    snapshot_of,
)

STATES = {phase.name.lower(): word for phase, word in PHASE_WORDS.items()}


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """A recorded run, as a page shows it, whatever file it is from. times (T,) s of its rows. notes: what is missing.

    states, whys: words (T). tracks: everything of a `Row` that is an array, with a row per tick. obstacles: their poses
    (o, 7) in a row; None without any.
    """

    cast: Cast
    times: FloatArray
    states: list[str]
    tracks: dict[str, NDArray[Any]]
    whys: list[str] | None = None
    obstacles: Callable[[int], FloatArray | None] = lambda row: None
    notes: tuple[str, ...] = ()

    def snapshot(self, row: int) -> Snapshot:
        """The tick of a row."""
        rows = list(rows_around(self.times, row))
        com = self.cast.com(self.tracks["human" if self.cast.robot is None else "goal"][rows])
        shown = Row(
            time=float(self.times[row]),
            state=self.states[row],
            why="" if self.whys is None else self.whys[row],
            landmarks=self.cast.landmarks,
            obstacle_poses=self.obstacles(row),
            **{name: values[row] for name, values in self.tracks.items()},
        )
        return snapshot_of(shown, self.cast, com=com[1], zmp=zero_moment_point(self.times[rows], com))

    def track(self, joint: int) -> Tracks:
        """A joint over all ticks."""
        unknown = np.full((len(self.times), len(self.cast.joints)), np.nan)
        temperature, current = (self.tracks.get(name, unknown)[:, joint] for name in ("temperature", "current"))
        sent = self.tracks["goal"][:, self.cast.columns[joint]]
        return Tracks(self.times, sent, self.tracks["present"][:, joint], temperature, current)


def open_recorded(path: Path, *, body: Path | None = None) -> RecordedRun:
    """Read a run: saved or recorded, by what is in the file. body: MJCF or URDF of the robot, where the one that the
    file names is not there any more. Raises InputError for anything else."""
    try:
        refuse_no_file(path)
        with path.open("rb") as file:
            begins = file.read(len(MAGIC))
    except OSError as error:
        found = error.strerror or str(error)
        raise InputError("cannot read the run", where=str(path), found=found, next_step=NO_RUN) from error
    if begins == MAGIC:
        recording = read_recording(path)
        with fields_required(recording):
            return _of_recording(recording, body)
    if begins.startswith(ZIP):
        return _of_saved(path, body)
    raise InputError(
        "not a run that was saved",
        where=str(path),
        found="neither NPZ nor MCAP",
        allowed="a file of retarget run --save FILE.npz, or --record FILE.mcap",
    )


def _of_saved(path: Path, body: Path | None) -> RecordedRun:
    """Of NPZ, which keeps no scene, temperatures, currents and physics."""
    saved = SavedRun(path, needed=ROBOT | HUMAN, body=body)
    human, motion = saved.human(), saved.robot()
    shown = actor(compile_body_text(saved.human_mjcf, source=human.body.source, root="free"))
    tracks: dict[str, NDArray[Any]] = {"human": human.q}
    sensors = saved.points("sensor_names", "sensor_positions")
    reached = saved.points("landmark_names", "landmarks_reached")
    if sensors is not None:
        tracks["sensors"] = sensors.position
    landmarks: tuple[str, ...] = ()
    has_robot = motion.robot != "human"
    if motion.asked is not None and reached is not None and (has_robot or sensors is None):
        landmarks, tracks["asked"], tracks["reached"] = motion.asked.names, motion.asked.position, reached.position
    states = [STATES[name] for name in motion.phase.tolist()]
    worn = () if sensors is None else sensors.names
    if not has_robot:
        cast = Cast(path.name, None, shown, (), landmarks, sensors=worn, servos_commanded=False)
        return RecordedRun(cast, saved.time, states, tracks)
    place = saved.body_path()
    robot, joints = actor(compile_body(place, root="free")), motion.joint_names
    columns = [robot.body.joint_qpos[robot.body.joint_index(name)] for name in joints]
    tracks["goal"] = motion.q
    tracks["present"] = np.full((len(saved.time), len(joints)), np.nan) if motion.servos is None else motion.servos
    cast = Cast(
        path.name,
        robot,
        shown,
        joints,
        landmarks,
        _profile(place),
        sensors=worn,
        servos_commanded=False,
        columns=np.array(columns),
    )
    return RecordedRun(cast, saved.time, states, tracks)


def _profile(body: Path) -> RobotBody | None:
    """The robot whose body file it is, if its profile lies next to it and can be read."""
    try:
        return load_robot(body.with_name("robot.yaml"), root="free")
    except RefusedError:
        return None


# The scene of a recorded run: where its obstacles were at every tick.


class RecordedScene:
    """kept: the cycles that are shown, a row each. notes: why it is not shown, or that its file is another one now.

    A recording has its scene attached. Obstacles that a program moved live are shown where the scene file has them.
    """

    def __init__(self, recording: Recording, kept: Cycles) -> None:
        self.obstacles: tuple[Obstacle, ...] = ()
        self.notes: tuple[str, ...] = ()
        self._state: SceneState | None = None
        self._times = recording.session.dt * _ticks(kept)
        try:
            with recorded_scene(recording) as (scene, self.notes):
                if scene is None:
                    return
                self._state = SceneState(load_scene(scene))
        except RefusedError as error:
            self.notes = (f"its scene is not shown: {error}",)
            return
        self.obstacles = obstacles(self._state.shapes)

    def at(self, row: int) -> FloatArray | None:
        """Poses (o, 7) of the obstacles; None without any."""
        return (
            None
            if self._state is None
            else placed(self._state.at_rest(float(self._times[row])).rows(drawn(self._state.shapes)))
        )


def _ticks(kept: Cycles) -> NDArray[np.int64]:
    """Ticks for which the obstacles had moved at each row: all with a command, from the first followed one on."""
    moves = (kept.phase != Phase.APPROACH) & ~kept.no_command
    return np.asarray(np.cumsum(moves) - moves)


# A run recorded with `--record FILE.mcap`, to be looked at.

ZIP = b"PK"
"""Begins an NPZ file."""
WORDS = {STATES_OF_RUN[state]: words for state, words in STATE_WORDS.items()}
"""States of the guard that are more precise than the phase of a tick."""


def _of_recording(recording: Recording, body: Path | None) -> RecordedRun:
    """Of MCAP. What is kept less often than every tick is shown as it was last. Raises InputError for a recording
    without a tick that was sent, or of a robot with another body."""
    whole, session, title = played(recording), recording.session, recording.path.name
    rows = np.flatnonzero(whole.cycles.kept)
    if not rows.size:
        raise InputError("nothing was sent in this recording", where=str(recording.path))
    cycles, every = whole.cycles.taken(rows), whole.cycles.index
    postures = recording.topic(HUMAN_POSTURE)
    human = actor(compile_body_text(build_human(session.size).mjcf, source="human", root="free"))
    scene = RecordedScene(recording, cycles)
    notes = ((recording.damage,) if recording.damage else ()) + scene.notes
    follows = np.flatnonzero(cycles.phase == Phase.FOLLOW)
    times = (cycles.index - cycles.index[follows[0] if follows.size else 0]) * session.dt
    states = [
        WORDS.get(state, PHASE_WORDS[Phase(phase)])
        for state, phase in zip(cycles.state.tolist(), cycles.phase.tolist(), strict=True)
    ]
    tracks: dict[str, NDArray[Any]] = {
        "human": _spread(postures, cycles.index, "q"),
        "sensors": _valid_sensors(whole.cycles)[_as_of(postures.cycles, every)][rows],
    }
    if not session.joints:
        cast = Cast(title, None, human, (), (), obstacles=scene.obstacles, sensors=session.sensors)
        return RecordedRun(cast, times, states, tracks, obstacles=scene.at, notes=notes)
    with as_recorded(recording, body=body) as configs:
        robot, notes = configs.robot, tuple(dict.fromkeys((*notes, *configs.notes)))
        assert robot is not None, "there are joints"
        shown = actor(compile_body(robot.profile.body_path, root=robot.profile.root))
    tracks |= _robot_tracks(whole, robot, rows)
    simulated = "truth" in tracks
    cast = Cast(
        title,
        shown,
        human,
        robot.joint_map.joints,
        tuple(robot.profile.landmarks) if "asked" in tracks else (),
        robot,
        scene.obstacles,
        simulated,
        session.sensors,
        columns=robot.servo_columns,
    )
    return RecordedRun(cast, times, states, tracks, _whys(recording, cycles, states), scene.at, notes)


def _robot_tracks(whole: Played, robot: RobotBody, rows: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
    """What a recording holds of its robot in some rows of the cycles. Raises InputError where the body is another."""
    recording, cycles = whole.recording, whole.cycles.taken(rows)
    tracks: dict[str, NDArray[Any]] = {
        "goal": postures_sent(whole, robot, rows),
        "present": robot.joint_map.to_radians(cycles.position),
        "modes": _spread(recording.topic(TICK), cycles.index, "observer_modes").astype(np.uint8),
        "temperature": cycles.temperature,
        "current": cycles.current,
    }
    asked, truth = recording.topics.get(LANDMARKS), recording.topics.get(TRUTH)
    if asked is not None:
        tracks["asked"] = _spread(asked, cycles.index, "poses")[..., :3]
    if truth is not None and truth.rows["q"].shape[1] == len(truth_names(robot.body)):
        tracks["truth"] = _spread(truth, cycles.index, "q")
    return tracks


def _whys(recording: Recording, cycles: Cycles, states: list[str]) -> list[str]:
    """The last failure or stop until each cycle that does not follow, or ""."""
    reasons = sorted((cycle, text) for (cycle, who), text in recording.texts.items() if _is_reason(who, text))
    last = np.searchsorted([cycle for cycle, _ in reasons], cycles.index, side="right").tolist()
    return [
        reasons[count - 1][1] if count and state != "following" else ""
        for count, state in zip(last, states, strict=True)
    ]


def _is_reason(who: str, text: str) -> bool:
    """Whether an event is a failure or a stop, whose text is a cause and a reason."""
    return who.startswith("bus ") or (who in ("guard", "outside") and ": " in text)


def _valid_sensors(cycles: Cycles) -> FloatArray:
    """Sensors (T, s, 3) m at every cycle, as they were sampled last, or first; NaN: not valid."""
    sampled = cycles.sampled != Done.NOT
    position = np.where((cycles.sampled == Done.WELL)[:, None, None], cycles.sensor_position, np.nan)
    position[~cycles.sensor_valid] = np.nan
    last = np.maximum.accumulate(np.where(sampled, np.arange(len(cycles)), -1))
    return np.asarray(position[np.maximum(last, np.flatnonzero(sampled)[0])])


def _as_of(cycles: NDArray[np.int64], index: NDArray[np.int64]) -> NDArray[np.intp]:
    """Rows of the cycles `index` (T,) at which what is shown at each of them was recorded: the last of `cycles` until
    then, or the first. So the sensors shown are those that the shown human was made of."""
    kept = cycles[np.maximum(np.searchsorted(cycles, index, side="right") - 1, 0)]
    return np.minimum(np.searchsorted(index, kept), len(index) - 1)


def _spread(topic: TopicRows, index: NDArray[np.int64], name: str) -> FloatArray:
    """A field of a topic at every cycle of `index` (T,): as it was recorded last, or first."""
    at = np.searchsorted(topic.cycles, index, side="right") - 1
    return np.asarray(topic.rows[name][np.maximum(at, 0)], dtype=np.float64)
