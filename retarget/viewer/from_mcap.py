"""A run recorded with `--record FILE.mcap`, to be looked at."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hardware.guard_state import GuardState
from retarget.body_file import compile_body, compile_body_text
from retarget.errors import InputError
from retarget.human import build_human
from retarget.record import Phase
from retarget.recording.configs import as_then
from retarget.recording.cycles import Cycles, Done
from retarget.recording.note import STATES
from retarget.recording.played import lacking, played, postures_sent
from retarget.recording.reading import MAGIC, Recording, TopicRows, read_recording
from retarget.recording.topics import HUMAN_POSTURE, LANDMARKS, TICK, TRUTH
from retarget.rotations import FloatArray
from retarget.viewer.beside import in_truth, truth_names
from retarget.viewer.moment import PHASE_WORDS, Cast, Moment, Tracks, Viewed, actor
from retarget.viewer.recorded import open_recorded
from retarget.viewer.scene_then import SceneThen
from retarget.viewer.zero_moment import around_row, zero_moment_point

__all__ = ["RecordedCycles", "open_viewed"]

ZIP = b"PK"
"""Begins an NPZ file."""
SAID = {STATES[state]: state.value for state in (GuardState.HOLDING, GuardState.STOPPING, GuardState.STOPPED)}
"""States of the guard that say more than the phase of a tick."""


class RecordedCycles:
    """See `Viewed`. What is kept less often than every tick is shown as it was last. notes: what of it is missing."""

    def __init__(self, recording: Recording) -> None:
        """Raises InputError for one in which there is nothing to be seen, or of another robot than the one there is."""
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
        self._reasons = sorted((cycle, text) for (cycle, who), text in recording.texts.items() if _tells_why(who, text))
        self._sensors = _believed(self._cycles)[_as_of(postures.cycles, self._cycles.index)]
        self._points: FloatArray | None = None
        self._truth: FloatArray | None = None
        title = recording.path.name
        self._scene = SceneThen(recording, self._cycles.taken(self._rows))
        self.notes += self._scene.notes
        if not session.joints:
            self.cast = Cast(title, None, human, (), (), around=self._scene.obstacles, sensors=session.sensors)
            return
        with as_then(recording) as configs:
            robot, self.notes = configs.robot, tuple(dict.fromkeys((*self.notes, *configs.told)))
            assert robot is not None, "there are joints"
            shown = actor(compile_body(robot.profile.body_path, root=robot.profile.root))
        asked = recording.topics.get(LANDMARKS)
        names = tuple(robot.profile.landmarks) if asked is not None else ()
        around, joints = self._scene.obstacles, robot.joint_map.joints
        truth = recording.topics.get(TRUTH)
        if truth is not None and truth.rows["q"].shape[1] == len(truth_names(robot.body)):
            self._truth = _spread(truth, self._cycles.index, "q")
        simulated = self._truth is not None
        self.cast = Cast(title, shown, human, joints, names, robot, around, simulated, session.sensors)
        postures_sent(whole, robot, self._rows[:1])  # refused now, if at all
        if asked is not None:
            self._points = _spread(asked, self._cycles.index, "poses")[..., :3]
        self._modes = _spread(recording.topic(TICK), self._cycles.index, "observer_modes")
        self._present = robot.joint_map.to_radians(self._cycles.position)

    def moment(self, row: int) -> Moment:
        """The tick of a row."""
        at, robot, time = int(self._rows[row]), self.cast.profile, float(self.times[row])
        human, around = self._human[at], self._scene.at(row)
        state = SAID.get(int(self._cycles.state[at]), PHASE_WORDS[Phase(int(self._cycles.phase[at]))])
        rows = list(around_row(self.times, row))
        if robot is None:
            none, points = np.zeros(0), _NO_POINTS
            com = self.cast.human.body.solver_body().centre_of_mass(self._human[self._rows[rows]])
            alone = (none, none, human, none, none, points, points)
            zmp = zero_moment_point(self.times[rows], com)
            return Moment(time, state, *alone, com[1], zmp=zmp, sensors=self._sensors[at], around=around)
        goals = postures_sent(self._whole, robot, self._rows[rows])
        goal, present = goals[1], self._present[at]
        there, pressure = goal.copy(), None
        there[robot.servo_columns] = present
        if self._truth is not None and np.isfinite(self._truth[at, :-2]).all():
            there, pressure = in_truth(robot.body, goal, self._truth[at])
        com, names = robot.body.solver_body().centre_of_mass(goals), self.cast.landmarks
        return Moment(
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
            around=around,
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
        """What failed or stopped it until then, last."""
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
        with lacking(recording):
            return RecordedCycles(recording)
    if begins.startswith(ZIP):
        return open_recorded(path)
    raise InputError(
        "not a run that was saved",
        where=str(path),
        found="neither NPZ nor MCAP",
        allowed="a file of retarget run --save FILE.npz, or --record FILE.mcap",
    )


def _tells_why(who: str, text: str) -> bool:
    """Whether an event is a failure or a stop: of those the cause is told, and then the reason."""
    return who.startswith("bus ") or (who in ("guard", "outside") and ": " in text)


def _believed(cycles: Cycles) -> FloatArray:
    """Sensors (T, s, 3) m at every cycle, as they were said last, or first; NaN: they were not believed."""
    said = cycles.sampled != Done.NOT
    position = np.where((cycles.sampled == Done.WELL)[:, None, None], cycles.sensor_position, np.nan)
    position[~cycles.sensor_valid] = np.nan
    last = np.maximum.accumulate(np.where(said, np.arange(len(cycles)), -1))
    return np.asarray(position[np.maximum(last, np.flatnonzero(said)[0])])


def _as_of(cycles: NDArray[np.int64], index: NDArray[np.int64]) -> NDArray[np.intp]:
    """Rows of the cycles `index` (T,) in which there was what is shown at each of them: what was said last in one of
    `cycles`, or first. So sensors are those that the human who is shown was made of."""
    said = cycles[np.maximum(np.searchsorted(cycles, index, side="right") - 1, 0)]
    return np.minimum(np.searchsorted(index, said), len(index) - 1)


_NO_POINTS = np.zeros((0, 3))


def _spread(topic: TopicRows, index: NDArray[np.int64], name: str) -> FloatArray:
    """A field of a topic at every cycle of `index` (T,): as it was said last, or first."""
    at = np.searchsorted(topic.cycles, index, side="right") - 1
    return np.asarray(topic.rows[name][np.maximum(at, 0)], dtype=np.float64)
