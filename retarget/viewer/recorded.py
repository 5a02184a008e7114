"""A finished run to be looked at: saved with `--save FILE.npz`, or recorded with `--record FILE.mcap`."""

from collections.abc import Callable
from functools import partial
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
from retarget.recording.npz import read_arrays
from retarget.recording.reading import (
    MAGIC,
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
from retarget.run.run_result import in_truth, truth_names
from retarget.schema.scene import load_scene
from retarget.types import FloatArray, RunState
from retarget.viewer.ground import rows_around, zero_moment_point
from retarget.viewer.snapshot import (
    PHASE_WORDS,
    Cast,
    Obstacle,
    Snapshot,
    Tracks,
    Viewed,
    actor,
    drawn,
    obstacles,
    placed,
)

KEYS: dict[str, tuple[str, tuple[str | int | None, ...]]] = {
    "time": ("known", ("T",)),
    "phase": ("text", ("T",)),
    "joint_names": ("text", ("n",)),
    "joint_positions": ("known", ("T", "n")),
    "root_position": ("known", ("T", 3)),
    "root_quaternion": ("known", ("T", 4)),
    "goal_ticks": ("whole", ("T", "n")),
    "landmark_names": ("text", ("k",)),
    "landmarks_asked": ("perhaps", ("T", "k", 3)),
    "landmarks_reached": ("perhaps", ("T", "k", 3)),
    "body": ("text", ()),
    "human_q": ("known", ("T", None)),
    "human_mjcf": ("text", ()),
}
"""What a saved run must have: kind and axes. T ticks, n joints, k landmarks, s sensors; `perhaps`: NaN is not known."""
OPTIONAL: dict[str, tuple[str, tuple[str | int | None, ...]]] = {
    "servo_positions": ("perhaps", ("T", "n")),
    "sensor_names": ("text", ("s",)),
    "sensor_positions": ("perhaps", ("T", "s", 3)),
}
"""What may be missing in it."""
STATES = {phase.name.lower(): word for phase, word in PHASE_WORDS.items()}

Arrays = dict[str, NDArray[Any]]


class RecordedRun:
    """A saved run, see `Viewed`. A row is computed when it is shown."""

    def __init__(self, arrays: Arrays, *, title: str) -> None:
        self.times: FloatArray = arrays["time"]
        self.notes: tuple[str, ...] = ()
        body = compile_body(Path(str(arrays["body"])), root="free")
        human = compile_body_text(str(arrays["human_mjcf"]), source="human of the run", root="free")
        robot = actor(body)
        model = robot.body
        shown = actor(human)
        if arrays["human_q"].shape[1] != shown.body.nq:
            raise InputError(
                "the human of the run has another tree", where="human_q", found=f"q of {arrays['human_q'].shape[1]}"
            )
        single, address = model.scalar_joints()
        of_file = [name for name, is_single in zip(model.dof_names, single, strict=True) if is_single]
        names = [str(name) for name in arrays["joint_names"]]
        if sorted(of_file) != sorted(names):
            raise InputError(
                "the body file has other joints than the run",
                where=body.source,
                found=", ".join(sorted(set(of_file) ^ set(names))[:5]) or "the same, of another number",
                next_step="It was changed since; put back the one of the run",
            )
        self._columns = address[single][[of_file.index(name) for name in names]]
        self._arrays = arrays
        has_robot = bool((arrays["goal_ticks"] >= 0).any())
        self._present = arrays.get("servo_positions", np.full_like(arrays["joint_positions"], np.nan))
        self._solver = model.solver_body()
        names_of_sensors = arrays.get("sensor_names", ()) if "sensor_positions" in arrays else ()
        sensors = tuple(str(name) for name in names_of_sensors)
        followed = tuple(str(name) for name in arrays["landmark_names"])  # of a human its sensors
        self.cast = Cast(
            title,
            robot if has_robot else None,
            shown,
            tuple(names) if has_robot else (),
            followed if has_robot or not sensors else (),
            _profile(Path(str(arrays["body"]))) if has_robot else None,
            sensors=sensors,
            servos_commanded=False,
        )

    def snapshot(self, row: int) -> Snapshot:
        """The tick of a row."""
        arrays = self._arrays
        sent, present = arrays["joint_positions"][row], self._present[row]
        goal = self._posture(row, sent)
        rows = list(rows_around(self.times, row))
        com = self._solver.centre_of_mass(np.array([self._posture(at, arrays["joint_positions"][at]) for at in rows]))
        return Snapshot(
            time=float(self.times[row]),
            state=STATES.get(str(arrays["phase"][row]), str(arrays["phase"][row])),
            robot=self._posture(row, np.where(np.isfinite(present), present, sent)),
            goal=goal,
            human=arrays["human_q"][row],
            present=present,
            sent=sent,
            asked=arrays["landmarks_asked"][row],
            reached=arrays["landmarks_reached"][row],
            com=com[1],
            zmp=zero_moment_point(self.times[rows], com),
            sensors=arrays["sensor_positions"][row] if self.cast.sensors else None,
        )

    def track(self, joint: int) -> Tracks:
        """A joint over all ticks; NPZ knows no more of it."""
        unknown = np.full(len(self.times), np.nan)
        sent, present = self._arrays["joint_positions"][:, joint], self._present[:, joint]
        return Tracks(self.times, sent, present, unknown, unknown)

    def _posture(self, row: int, joints: FloatArray) -> FloatArray:
        q = np.zeros(self._solver.nq)
        q[:3], q[3:7] = self._arrays["root_position"][row], self._arrays["root_quaternion"][row]
        q[self._columns] = joints
        return q


def open_recorded(path: Path) -> RecordedRun:
    """Read a saved run. Raises InputError: not one, damaged, or its body is not where it was."""
    arrays = _read(path)
    try:
        return RecordedRun(arrays, title=path.name)
    except RefusedError as error:
        raise InputError(
            "the body of the run cannot be read",
            where=str(path),
            found=str(error),
            next_step="A saved run names its body file; put that back",
        ) from error


def _read(path: Path) -> Arrays:
    """Everything that is shown, of the shape and kind that it must be."""
    file = read_arrays(path, needed=frozenset(KEYS), used=frozenset(OPTIONAL))
    ticks, joints = len(file.floats("time", None)), len(file.texts("joint_names", None))
    if not ticks:
        raise InputError("a run without ticks", where=str(path))
    sizes = {"T": ticks, "n": joints, "k": len(file.texts("landmark_names", None))}
    if "sensor_names" in file:
        sizes["s"] = len(file.texts("sensor_names", None))
    read: dict[str, Callable[..., NDArray[Any]]] = {
        "text": file.texts,
        "whole": file.whole,
        "known": file.floats,
        "perhaps": partial(file.floats, unknown=True),
    }
    arrays: Arrays = {}
    for key, (kind, axes) in (KEYS | OPTIONAL).items():
        shape = [sizes.get(axis) if isinstance(axis, str) else axis for axis in axes]
        if key in file:
            arrays[key] = read[kind](key, *shape)
    if (np.diff(arrays["time"]) <= 0.0).any():
        raise InputError("time does not increase", where=f"{path}: time")
    return arrays


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
WORDS = {STATES_OF_RUN[state]: state.value for state in RunState}
"""States of the guard that are more precise than the phase of a tick."""


class RecordedCycles:
    """A recorded run, see `Viewed`. What is kept less often than every tick is shown as it was last."""

    def __init__(self, recording: Recording) -> None:
        """Raises InputError for a recording without a tick that was sent, or of a robot with another body."""
        self._whole = whole = played(recording)
        self._rows = np.flatnonzero(whole.cycles.kept)
        session, self._cycles = recording.session, whole.cycles
        if not self._rows.size:
            raise InputError("nothing was sent in this recording", where=str(recording.path))
        postures = recording.topic(HUMAN_POSTURE)
        self._human = _spread(postures, self._cycles.index, "q")
        human = actor(compile_body_text(build_human(session.size).mjcf, source="human", root="free"))
        self.notes: tuple[str, ...] = (recording.damage,) if recording.damage else ()
        follows = np.flatnonzero(self._cycles.phase[self._rows] == Phase.FOLLOW)
        index = self._cycles.index[self._rows]
        self.times: FloatArray = (index - index[follows[0] if follows.size else 0]) * session.dt
        self._reasons = sorted((cycle, text) for (cycle, who), text in recording.texts.items() if _is_reason(who, text))
        self._sensors = _valid_sensors(self._cycles)[_as_of(postures.cycles, self._cycles.index)]
        self._points: FloatArray | None = None
        self._truth: FloatArray | None = None
        title = recording.path.name
        self._scene = RecordedScene(recording, self._cycles.taken(self._rows))
        self.notes += self._scene.notes
        if not session.joints:
            self.cast = Cast(title, None, human, (), (), obstacles=self._scene.obstacles, sensors=session.sensors)
            return
        with as_recorded(recording) as configs:
            robot, self.notes = configs.robot, tuple(dict.fromkeys((*self.notes, *configs.notes)))
            assert robot is not None, "there are joints"
            shown = actor(compile_body(robot.profile.body_path, root=robot.profile.root))
        asked = recording.topics.get(LANDMARKS)
        names = tuple(robot.profile.landmarks) if asked is not None else ()
        scene, joints = self._scene.obstacles, robot.joint_map.joints
        truth = recording.topics.get(TRUTH)
        if truth is not None and truth.rows["q"].shape[1] == len(truth_names(robot.body)):
            self._truth = _spread(truth, self._cycles.index, "q")
        simulated = self._truth is not None
        self.cast = Cast(title, shown, human, joints, names, robot, scene, simulated, session.sensors)
        postures_sent(whole, robot, self._rows[:1])  # refused now, if at all
        if asked is not None:
            self._points = _spread(asked, self._cycles.index, "poses")[..., :3]
        self._modes = _spread(recording.topic(TICK), self._cycles.index, "observer_modes")
        self._present = robot.joint_map.to_radians(self._cycles.position)

    def snapshot(self, row: int) -> Snapshot:
        """The tick of a row."""
        at, robot, time = int(self._rows[row]), self.cast.profile, float(self.times[row])
        human, poses = self._human[at], self._scene.at(row)
        state = WORDS.get(int(self._cycles.state[at]), PHASE_WORDS[Phase(int(self._cycles.phase[at]))])
        rows = list(rows_around(self.times, row))
        if robot is None:
            none, points = np.zeros(0), _NO_POINTS
            com = self.cast.human.body.solver_body().centre_of_mass(self._human[self._rows[rows]])
            alone = (none, none, human, none, none, points, points)
            zmp = zero_moment_point(self.times[rows], com)
            return Snapshot(time, state, *alone, com[1], zmp=zmp, sensors=self._sensors[at], obstacle_poses=poses)
        goals = postures_sent(self._whole, robot, self._rows[rows])
        goal, present = goals[1], self._present[at]
        there, pressure = goal.copy(), None
        there[robot.servo_columns] = present
        if self._truth is not None and np.isfinite(self._truth[at, :-2]).all():
            there, pressure = in_truth(robot.body, goal, self._truth[at])
        com, names = robot.body.solver_body().centre_of_mass(goals), self.cast.landmarks
        return Snapshot(
            time=time,
            state=state,
            robot=there,
            goal=goal,
            human=human,
            present=present,
            sent=goal[robot.servo_columns],
            asked=_NO_POINTS if self._points is None else self._points[at],
            reached=robot.points(goal[None], robot.landmark_frames(names))[0] if names else _NO_POINTS,
            com=com[1],
            why=self._why(at, state),
            zmp=zero_moment_point(self.times[rows], com),
            pressure=pressure,
            sensors=self._sensors[at],
            obstacle_poses=poses,
            modes=self._modes[at].astype(np.uint8),
            temperature=self._cycles.temperature[at],
            current=self._cycles.current[at],
        )

    def track(self, joint: int) -> Tracks:
        """A joint over all ticks."""
        rows, cycles = self._rows, self._cycles
        sent, present = cycles.q[rows, joint], self._present[rows, joint]
        return Tracks(self.times, sent, present, cycles.temperature[rows, joint], cycles.current[rows, joint])

    def _why(self, at: int, state: str) -> str:
        """The last failure or stop until then."""
        if state == "following":
            return ""
        index = int(self._cycles.index[at])
        return next((text for cycle, text in reversed(self._reasons) if cycle <= index), "")


def open_viewed(path: Path) -> Viewed:
    """Of a saved or a recorded run, by what is in the file. Raises InputError for anything else."""
    try:
        with path.open("rb") as file:
            begins = file.read(len(MAGIC))
    except OSError as error:
        step = "Give a file that `retarget run` wrote with --save FILE.npz or --record FILE.mcap"
        found = error.strerror or str(error)
        raise InputError("cannot read the run", where=str(path), found=found, next_step=step) from error
    if begins == MAGIC:
        recording = read_recording(path)
        with fields_required(recording):
            return RecordedCycles(recording)
    if begins.startswith(ZIP):
        return open_recorded(path)
    raise InputError(
        "not a run that was saved",
        where=str(path),
        found="neither NPZ nor MCAP",
        allowed="a file of retarget run --save FILE.npz, or --record FILE.mcap",
    )


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


_NO_POINTS = np.zeros((0, 3))


def _spread(topic: TopicRows, index: NDArray[np.int64], name: str) -> FloatArray:
    """A field of a topic at every cycle of `index` (T,): as it was recorded last, or first."""
    at = np.searchsorted(topic.cycles, index, side="right") - 1
    return np.asarray(topic.rows[name][np.maximum(at, 0)], dtype=np.float64)
