"""Recorded runs read back as a `Motion`: the reader is chosen by the file's suffix."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError
from retarget.model.body import load_body, load_body_text
from retarget.model.human import build_human
from retarget.model.robot import RobotBody
from retarget.recording.configs import as_recorded
from retarget.recording.cycles import Done
from retarget.recording.motion import PHASE_NAMES, Motion, TextArray, Tracks, posture, quaternion_columns
from retarget.recording.npz import HUMAN, NO_RUN, SavedRun
from retarget.recording.reading import Played, TopicRows, fields_required, played, postures_sent, read_recording
from retarget.recording.topics import GOALS, HUMAN_POSTURE, LANDMARKS
from retarget.rotations import normalise
from retarget.run.record import Phase
from retarget.types import FloatArray, IntArray


def read_mcap_run(path: Path, *, body: Path | None = None) -> Motion:
    """What a run sent; of `--robot human` what it reconstructed. body: MJCF or URDF of the robot, instead of the
    recorded run's.

    Goals and the root are kept in single precision, the landmarks asked for 25 times a second: between two of them they
    are on a straight line. Raises InputError for anything that is not such a run.
    """
    found = played(read_recording(path))
    if not found.recording.session.joints:
        return _human(found)
    found.recording.topic(GOALS)
    with as_recorded(found.recording, body=body) as configs:
        robot = configs.robot
        assert robot is not None, "there are joints"
        model = load_body(robot.profile.body_path, root="free")
    kept = _kept(found)
    index, phase = found.cycles.index[kept], found.cycles.phase[kept]
    single, _ = model.scalar_joints()
    names = tuple(name for name, is_single in zip(model.dof_names, single, strict=True) if is_single)
    motion = Motion(
        str(path),
        robot.profile.name,
        model,
        _time(found, index),
        _names_of(phase),
        posture(model, names, *_joints_and_root(found, robot, kept, names)),
        servos=_servos(found, robot, kept, names),
        goal_ticks=_goals(found, robot, kept, names),
        notes=_notes(found),
    )
    landmarks = found.recording.topics.get(LANDMARKS)
    if landmarks is None:
        return motion
    with fields_required(found.recording):
        return replace(motion, asked=_asked(tuple(robot.profile.landmarks), landmarks, index))


def read_mcap_human(path: Path) -> Motion:
    """The virtual human of a run, as often as it was kept. Raises InputError for anything that is not such a run."""
    return _human(played(read_recording(path)))


def _human(found: Played) -> Motion:
    recording, cycles = found.recording, found.cycles
    topic, session = recording.topic(HUMAN_POSTURE), recording.session
    model = load_body_text(build_human(session.size).mjcf, source=f"{recording.path}: the human", root="free")
    with fields_required(recording):
        _, each = np.unique(topic.cycles, return_index=True)
        said, q = topic.cycles[each], np.asarray(topic.rows["q"][each], dtype=np.float64)
    if q.shape[1] != model.nq:
        raise InputError("the human has another tree now", where=str(recording.path), found=f"q of {q.shape[1]}")
    at = np.searchsorted(cycles.index, said)
    there = at < len(cycles)
    there[there] = cycles.index[at[there]] == said[there]
    if not there.any():
        raise InputError("a run without ticks", where=str(recording.path))
    rows, q = at[there], q[there]
    q[:, 3:7] = normalise(q[:, 3:7])
    index = cycles.index[rows]
    motion = Motion(
        str(recording.path),
        "human",
        model,
        _time(found, index),
        _names_of(cycles.phase[rows] if session.joints else np.full(len(rows), Phase.FOLLOW, dtype=np.int8)),
        q,
        notes=_notes(found),
    )
    if session.joints:
        often = 1.0 / (session.dt * float(np.median(np.diff(index)))) if len(index) > 1 else 0.0
        every = "`retarget replay` with --save FILE.npz has it at every tick"
        note = f"{recording.path}: the human was kept {often:.3g} times a second; {every}"
        return replace(motion, row="posture that was kept", notes=(*motion.notes, note))
    position = np.where(cycles.sensor_valid[rows][..., None], cycles.sensor_position[rows], np.nan)
    return replace(motion, asked=Tracks(session.sensors, position))


def _kept(found: Played) -> NDArray[np.intp]:
    """Rows of the cycles that were sent."""
    rows = np.flatnonzero(found.cycles.kept)
    if not rows.size:
        raise InputError("a run without ticks", where=str(found.recording.path))
    return rows


def _time(found: Played, index: NDArray[np.int64]) -> FloatArray:
    """Times of cycles (T,), s: 0 at the first that followed, or at what would have been the first."""
    cycles, kept = found.cycles, _kept(found)
    follows = np.flatnonzero(cycles.phase[kept] == Phase.FOLLOW)
    if follows.size:
        first = int(cycles.index[kept[follows[0]]])
    else:
        first = int(cycles.index[kept[0]]) + int(np.count_nonzero(cycles.phase[kept] == Phase.APPROACH))
    return np.asarray((index - first) * found.recording.session.dt)


def _names_of(phase: NDArray[np.int8]) -> TextArray:
    return np.array(PHASE_NAMES)[np.clip(phase, 0, len(PHASE_NAMES) - 1)]


def _joints_and_root(
    found: Played, robot: RobotBody, kept: NDArray[np.intp], names: tuple[str, ...]
) -> tuple[FloatArray, FloatArray]:
    """What was sent: joints (T, n) of `names`, and the root (T, 7), xyz and wxyz of the first link in the world."""
    body = robot.body
    q = postures_sent(found, robot, kept)
    if not np.isfinite(q).all():
        raise InputError("goals that are no numbers", where=str(found.recording.path))
    for start in quaternion_columns(body):
        q[:, start : start + 4] = normalise(q[:, start : start + 4])
    columns = [body.joint_qpos[body.joint_index(name)] for name in names]
    solver, origin = body.solver_body(), np.zeros((1, 3))
    root = np.hstack([solver.points(q, [1], origin)[:, 0], solver.orientations(q, [1])[:, 0]])
    return np.asarray(q[:, columns]), root


def _servos(found: Played, robot: RobotBody, kept: NDArray[np.intp], names: tuple[str, ...]) -> FloatArray | None:
    """Where they were (T, n), read before that was sent."""
    cycles, servos = found.cycles, robot.joint_map
    if found.recording.session.bus == "none":
        return None
    present = np.full((len(kept), len(names)), np.nan)
    read = cycles.read[kept] == Done.WELL
    columns = [names.index(joint) for joint in servos.joints]
    present[:, columns] = np.where(read[:, None], servos.to_radians(cycles.position[kept]), np.nan)
    return present


def _goals(found: Played, robot: RobotBody, kept: NDArray[np.intp], names: tuple[str, ...]) -> IntArray:
    return robot.joint_map.spread(names, found.cycles.goal[kept])


def _asked(names: tuple[str, ...], topic: TopicRows, index: NDArray[np.int64]) -> Tracks | None:
    """Landmarks at every cycle: between two that were kept on a straight line, before the first and after the last that
    were asked for as they stood then; unknown in between where one of them is."""
    tracks = []
    for at in range(topic.rows["poses"].shape[1]):
        said = topic.rows["poses"][:, at, :3]
        known = np.flatnonzero(np.isfinite(said).all(axis=1))
        if known.size:
            part = slice(known[0], known[-1] + 1)
            x, y = topic.cycles[part].astype(np.float64), said[part]
            tracks.append((names[at], np.stack([np.interp(index, x, column) for column in y.T], axis=1)))
    if not tracks:
        return None
    return Tracks(tuple(name for name, _ in tracks), np.stack([track for _, track in tracks], axis=1))


def _notes(found: Played) -> tuple[str, ...]:
    """What is missing in the file."""
    recording, notes = found.recording, []
    if recording.damage:
        notes.append(f"{recording.path}: {recording.damage}; what is whole of it is exported")
    if found.missing:
        notes.append(f"{recording.path}: {found.missing} ticks were never written")
    return tuple(notes)


SUFFIXES = (".npz", ".mcap")


def read_run(path: Path, *, of_human: bool = False, body: Path | None = None) -> Motion:
    """The motion of a recorded run: of its robot, or of the virtual human that the robot followed.

    body: MJCF or URDF of the robot, where the one that the file names is not there any more. Raises InputError.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            "not a recorded run",
            where=str(path)[:200],
            found=path.suffix or "no suffix",
            allowed=", ".join(SUFFIXES),
            next_step=NO_RUN,
        )
    if suffix == ".mcap":
        return read_mcap_human(path) if of_human else read_mcap_run(path, body=body)
    return SavedRun(path, needed=HUMAN).human() if of_human else SavedRun(path, body=body).robot()
