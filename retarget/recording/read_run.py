"""A recorded run read back, whatever file it is from: for the page, for exports and for programs.

NPZ (`--save`) holds every tick in full precision. MCAP (`--record`) holds goals and the root in single precision, the
landmarks asked for 25 times a second (between two of them they are on a straight line) and the human 12.5 times.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import ConfigError, InputError
from retarget.model.body import BodyModel, body_from_file
from retarget.model.body_file import compile_body, compile_body_text
from retarget.model.human import build_human
from retarget.model.robot import RobotBody
from retarget.recording.configs import as_recorded
from retarget.recording.cycles import Done
from retarget.recording.motion import (
    PHASE_NAMES,
    Motion,
    TextArray,
    Tracks,
    joints_and_root,
    posture,
    quaternion_columns,
)
from retarget.recording.npz import NO_RUN, NO_SERVO, ArrayFile, read_arrays, refuse_no_file
from retarget.recording.reading import (
    MAGIC,
    Played,
    Recording,
    TopicRows,
    played,
    postures_sent,
    read_recording,
    refusing_hostile,
)
from retarget.recording.topics import LANDMARKS
from retarget.rotations import normalise
from retarget.run.record import Phase
from retarget.run.run_result import truth_names
from retarget.run.table import RunTable
from retarget.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """A recorded run. robot: what was sent, a row per tick (T), None for a human alone and where it was not asked for.
    human: what was reconstructed (H), of a human alone at every tick; None: not in the file.

    shown (T,): the row of the human at each tick, or the last before it. sensors: of the performer, at the human's
    rows, NaN: not valid; reached: landmarks, at the ticks. profile: of the robot, with the tree of its motion. tracks:
    what else is known at the ticks, by its names in `Cycles`. reasons: the last failure or stop until each tick, or "".
    recording: of an MCAP file. notes: about missing parts.
    """

    robot: Motion | None
    human: Motion | None
    shown: IntArray
    sensors: Tracks | None = None
    reached: Tracks | None = None
    profile: RobotBody | None = None
    tracks: dict[str, NDArray[Any]] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()
    recording: Recording | None = None
    notes: tuple[str, ...] = ()


def read_run(path: Path, *, of_human: bool = False, body: Path | None = None) -> Motion:
    """The motion of a recorded run: of its robot, or of the virtual human that the robot followed.

    body: MJCF or URDF of the robot, where the one that the file names is not there any more. Raises InputError.
    """
    run = read_recorded(path, robot=not of_human, body=body)
    notes = tuple(f"{path}: {note}" for note in run.notes)
    return replace(run.robot or human_of(run, path), notes=notes)


def human_of(run: RecordedRun, path: Path) -> Motion:
    """The human of a run that was read from `path`. Raises InputError where the file has none."""
    if run.human is None:
        found = "no human_q, human_mjcf or /human/posture"
        raise InputError("the human is not in this run", where=str(path)[:200], found=found, next_step=NO_RUN)
    return run.human


def read_recorded(path: Path, *, robot: bool = True, body: Path | None = None) -> RecordedRun:
    """A recorded run, by what is in its file. robot: whether it is needed; body: as of `read_run`.

    Raises InputError for anything that is no such run, and for one without a tick that was sent.
    """
    try:
        refuse_no_file(path)
        with path.open("rb") as file:
            begins = file.read(len(MAGIC))
    except OSError as error:
        found = error.strerror or str(error)
        raise InputError("cannot read the run", where=str(path)[:200], found=found, next_step=NO_RUN) from error
    if begins == MAGIC:
        recording = read_recording(path)
        with refusing_hostile(recording):
            return _of_mcap(played(recording), robot, body)
    if begins.startswith(ZIP):
        return _of_npz(path, robot, body)
    raise InputError("not a recorded run", where=str(path)[:200], found="neither NPZ nor MCAP", next_step=NO_RUN)


# A run that `--save FILE.npz` wrote. It keeps no scene, temperatures, currents and physics.

ZIP = b"PK"
"""Begins an NPZ file."""
ROBOT_KEYS = frozenset({"time", "joint_names", "joint_positions", "root_position", "root_quaternion", "body"})
HUMAN_KEYS = frozenset({"time", "human_q", "human_mjcf"})
OTHER_KEYS = frozenset({"phase", "goal_ticks", "servo_positions"})
POINT_KEYS = frozenset({"landmark_names", "landmarks_asked", "landmarks_reached", "sensor_names", "sensor_positions"})
UNIT = 0.01
"""A quaternion may miss unit length by this."""


def _of_npz(path: Path, robot: bool, body: Path | None) -> RecordedRun:
    file = read_arrays(
        path, needed=ROBOT_KEYS if robot else HUMAN_KEYS, used=ROBOT_KEYS | HUMAN_KEYS | OTHER_KEYS | POINT_KEYS
    )
    time = _npz_time(file)
    phase, human = _npz_phase(file, len(time)), None
    if all(key in file for key in HUMAN_KEYS):
        compiled = compile_body_text(str(file.texts("human_mjcf")), source=f"{path}: human_mjcf", root="free")
        model = body_from_file(compiled)
        q = file.floats("human_q", len(time), model.nq)
        q[:, 3:7] = _unit(file, q[:, 3:7])
        human = Motion(str(path), "human", model, time, phase, q, compiled=compiled)
    run = RecordedRun(
        None,
        human,
        np.arange(len(time)),
        sensors=_npz_points(file, len(time), "sensor_names", "sensor_positions"),
        reached=_npz_points(file, len(time), "landmark_names", "landmarks_reached"),
    )
    if not robot:
        return run
    names = tuple(str(name) for name in file.texts("joint_names", None))
    asked = _npz_points(file, len(time), "landmark_names", "landmarks_asked")
    if human is not None and human.joint_names == names:
        return replace(run, human=replace(human, asked=asked))
    return replace(run, robot=_npz_robot(file, _body_place(file, path, body), names, time, phase, asked))


def _npz_robot(
    file: ArrayFile, body: Path, names: tuple[str, ...], time: FloatArray, phase: TextArray, asked: Tracks | None
) -> Motion:
    compiled = compile_body(body, root="free")
    model, rows = body_from_file(compiled), len(time)
    q = _npz_posture(file, model, names, rows)
    robot = Motion(file.source, _robot_name(body), model, time, phase, q, asked=asked, compiled=compiled)
    order = [names.index(name) if name in names else -1 for name in robot.joint_names]
    if "servo_positions" in file:
        servos = file.floats("servo_positions", rows, len(names), unknown=True)
        servos = np.hstack([servos, np.full((rows, 1), np.nan)])[:, order]
        robot = replace(robot, servos=servos if np.isfinite(servos).any() else None)
    if "goal_ticks" in file:
        goals = np.hstack([file.whole("goal_ticks", rows, len(names)), np.full((rows, 1), NO_SERVO)])[:, order]
        robot = replace(robot, goal_ticks=goals if (goals != NO_SERVO).any() else None)
    return robot


def _npz_posture(file: ArrayFile, model: BodyModel, names: tuple[str, ...], rows: int) -> FloatArray:
    """Postures (T, nq) from what the file has of root and joints."""
    joints = file.floats("joint_positions", rows, len(names))
    turn = _unit(file, file.floats("root_quaternion", rows, 4))
    root = np.hstack([file.floats("root_position", rows, 3), turn])
    try:
        return posture(model, names, joints, root)
    except ConfigError as error:
        step = "Give the body that was moved: --body FILE.xml"
        what = "joints and body do not belong together"
        raise InputError(what, where=file.source, found=error, next_step=step) from error


def _body_place(file: ArrayFile, path: Path, body: Path | None) -> Path:
    """The body that is given; the one that the file names, where it was; or one of that name beside the file."""
    named = Path(str(file.texts("body")))
    for place in (named, path.parent / named.name) if body is None else (body,):
        try:
            if place == body or (place.name and place.is_file()):
                return place
        except OSError:  # a name that no system can have
            continue
    raise InputError(
        "the robot's body is not there",
        where=file.source,
        found=str(named)[:200],
        next_step="Say where its MJCF or URDF is now: --body FILE.xml",
    )


def _robot_name(body: Path) -> str:
    """The folder of a body that a profile calls `body.xml`, else the name of its file."""
    return body.resolve().parent.name if body.stem == "body" else body.stem


def _npz_time(file: ArrayFile) -> FloatArray:
    time = file.floats("time", None)
    if not time.size:
        raise InputError("a run without ticks", where=file.source)
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        where, found = f"{file.source}: time", f"row {back[0] + 2} is no later than the one before"
        raise InputError("time does not increase", where=where, found=found)
    return time


def _npz_phase(file: ArrayFile, rows: int) -> TextArray:
    """Files from before phases were saved are all following."""
    if "phase" not in file:
        return np.full(rows, PHASE_NAMES[Phase.FOLLOW])
    phase = file.texts("phase", rows)
    strange = sorted(set(phase.tolist()) - set(PHASE_NAMES))
    if strange:
        where, allowed = f"{file.source}: phase", ", ".join(PHASE_NAMES)
        raise InputError("unknown phase", where=where, found=repr(strange[0])[:80], allowed=allowed)
    return np.asarray(phase)


def _npz_points(file: ArrayFile, rows: int, names: str, tracks: str) -> Tracks | None:
    """Points by the keys of their names and of where they were; None where the file has none."""
    if names not in file or tracks not in file:
        return None
    named = tuple(str(name) for name in file.texts(names, None))
    return Tracks(named, file.floats(tracks, rows, len(named), 3, unknown=True))


def _unit(file: ArrayFile, turn: FloatArray) -> FloatArray:
    """Quaternions made exactly unit. Raises InputError where they are none."""
    off = np.abs(np.linalg.norm(turn, axis=1) - 1.0)
    if off.max() > UNIT:
        row = int(np.argmax(off)) + 1
        where, found = f"{file.source}: orientation of the root", f"{turn[row - 1]} in row {row}"
        raise InputError("no unit quaternion", where=where, found=found)
    return normalise(turn)


# A run that `--record FILE.mcap` wrote.


def _of_mcap(whole: Played, with_robot: bool, body: Path | None) -> RecordedRun:
    recording, session = whole.recording, whole.recording.session
    postures = np.isfinite(whole.cycles.human_q).all(axis=1) & (whole.cycles.human_q.shape[1] > 0)
    # Of a human alone, a tick is its posture.
    kept = np.flatnonzero(whole.cycles.kept & (bool(session.joints) | postures))
    if not kept.size:
        raise InputError("a run without ticks", where=str(recording.path))
    cycles, rows = whole.cycles[kept], np.flatnonzero(postures[kept])
    tracks: dict[str, NDArray[Any]] = {"state": cycles.state, "no_command": cycles.no_command}
    notes = [f"{recording.damage}; what is whole of it is used"] if recording.damage else []
    notes += [f"{whole.missing} ticks were never written"] if whole.missing else []
    run = RecordedRun(None, None, np.zeros(len(kept), dtype=np.int64), tracks=tracks, recording=recording)
    if rows.size:
        run = _with_human(run, whole, cycles, rows)
    if with_robot and session.joints:
        with as_recorded(recording, body=body) as configs:
            assert configs.robot is not None, "there are joints"
            run = _with_robot(run, whole, kept, configs.robot)
            notes += configs.notes
    elif session.joints and run.human is not None:
        steps = np.diff(run.human.time)
        often = 1.0 / float(np.median(steps)) if steps.size else 0.0
        every = "`retarget replay` with --save FILE.npz has it at every tick"
        notes.append(f"the human was kept {often:.3g} times a second; {every}")
    return replace(run, reasons=_reasons(recording, cycles), notes=tuple(notes))


def _with_human(run: RecordedRun, whole: Played, cycles: RunTable, rows: NDArray[np.intp]) -> RecordedRun:
    """The run with its human, which was kept in some rows of the cycles (T,)."""
    recording, session = whole.recording, whole.recording.session
    source, q, index = str(recording.path), cycles.human_q[rows], cycles.index[rows]
    compiled = compile_body_text(build_human(session.size).mjcf, source=f"{source}: the human", root="free", own=True)
    model = body_from_file(compiled)
    if q.shape[1] != model.nq:
        raise InputError("the human has another tree now", where=source, found=f"q of {q.shape[1]}")
    q[:, 3:7] = normalise(q[:, 3:7])
    worn = _valid_sensors(whole.cycles)[np.searchsorted(whole.cycles.index, index)]
    sensors, alone = Tracks(session.sensors, worn), not session.joints
    human = Motion(
        source,
        "human",
        model,
        _time(whole, index),
        _names_of(cycles.phase[rows]),
        q,
        asked=sensors if alone else None,
        row="tick" if alone else "posture that was kept",
        compiled=compiled,
    )
    shown = np.maximum(np.searchsorted(index, cycles.index, side="right") - 1, 0)
    return replace(run, human=human, shown=shown, sensors=sensors)


def _with_robot(run: RecordedRun, whole: Played, kept: NDArray[np.intp], robot: RobotBody) -> RecordedRun:
    """The run with what was sent to its robot in the cycles `kept` (T,), on a tree with a free root."""
    recording, cycles, servos = whole.recording, whole.cycles[kept], robot.joint_map
    compiled = compile_body(robot.profile.body_path, root="free")
    model = body_from_file(compiled)
    q = postures_sent(whole, robot, kept)
    if not np.isfinite(q).all():
        raise InputError("goals that are no numbers", where=str(recording.path))
    for start in quaternion_columns(robot.body):
        q[:, start : start + 4] = normalise(q[:, start : start + 4])
    names, joints, root = joints_and_root(robot.body, q)
    motion = Motion(
        str(recording.path),
        robot.profile.name,
        model,
        _time(whole, cycles.index),
        _names_of(cycles.phase),
        posture(model, names, joints, root),
        goal_ticks=servos.spread(names, cycles.goal_ticks),
        compiled=compiled,
    )
    if recording.session.bus != "none":
        present = np.full(joints.shape, np.nan)
        read = (cycles.read == Done.WELL)[:, None]
        present[:, [names.index(joint) for joint in servos.joints]] = np.where(
            read, servos.to_radians(cycles.position), np.nan
        )
        motion = replace(motion, servos=present)
    if LANDMARKS in recording.topics:
        asked = _asked(tuple(robot.profile.landmarks), recording.topics[LANDMARKS], cycles.index)
        motion = replace(motion, asked=asked)
    tracks = run.tracks | {name: getattr(cycles, name) for name in ("temperature", "current", "observer_modes")}
    if cycles.truth.shape[1] == len(truth_names(model)):
        known = np.where(np.isnan(cycles.truth).all(axis=1), 0, np.arange(len(cycles)))
        tracks["truth"] = cycles.truth[np.maximum.accumulate(known)]
    profile = replace(
        robot, body=model, servo_columns=model.joint_qpos[[model.joint_index(joint) for joint in servos.joints]]
    )
    return replace(run, robot=motion, profile=profile, tracks=tracks)


def _time(found: Played, index: NDArray[np.int64]) -> FloatArray:
    """Times of cycles (T,), s: 0 at the first that followed, or at what would have been the first."""
    cycles = found.cycles
    kept = np.flatnonzero(cycles.kept)
    follows = np.flatnonzero(cycles.phase[kept] == Phase.FOLLOW)
    if follows.size:
        first = int(cycles.index[kept[follows[0]]])
    else:
        first = int(cycles.index[kept[0]]) + int(np.count_nonzero(cycles.phase[kept] == Phase.APPROACH))
    return np.asarray((index - first) * found.recording.session.dt)


def _names_of(phase: NDArray[np.int8]) -> TextArray:
    return np.array(PHASE_NAMES)[np.clip(phase, 0, len(PHASE_NAMES) - 1)]


def _asked(names: tuple[str, ...], topic: TopicRows, index: NDArray[np.int64]) -> Tracks | None:
    """Landmarks at every cycle: between two that were kept on a straight line, before the first and after the last that
    were asked for as they stood then; unknown in between where one of them is."""
    tracks = {}
    for at, name in enumerate(names[: topic.rows["poses"].shape[1]]):
        said = topic.rows["poses"][:, at, :3]
        known = np.flatnonzero(np.isfinite(said).all(axis=1))
        if known.size:
            part = slice(known[0], known[-1] + 1)
            x, y = topic.cycles[part].astype(np.float64), said[part]
            tracks[name] = np.stack([np.interp(index, x, column) for column in y.T], axis=1)
    return Tracks(tuple(tracks), np.stack(list(tracks.values()), axis=1)) if tracks else None


def _reasons(recording: Recording, cycles: RunTable) -> tuple[str, ...]:
    """The last failure or stop until each of the cycles, or ""."""
    said = sorted((cycle, text) for (cycle, who), text in recording.texts.items() if _is_reason(who, text))
    last = np.searchsorted([cycle for cycle, _ in said], cycles.index, side="right")
    return tuple(said[count - 1][1] if count else "" for count in last.tolist())


def _is_reason(who: str, text: str) -> bool:
    """Whether an event is a failure or a stop, whose text is a cause and a reason."""
    return who.startswith("bus ") or (who in ("guard", "outside") and ": " in text)


def _valid_sensors(cycles: RunTable) -> FloatArray:
    """Sensors (T, s, 3) m at every cycle, as they were sampled last, or first; NaN: not valid."""
    sampled = cycles.sampled != Done.NOT
    position = np.where((cycles.sampled == Done.WELL)[:, None, None], cycles.sensor_position, np.nan)
    position[~cycles.sensor_valid] = np.nan
    last = np.maximum.accumulate(np.where(sampled, np.arange(len(cycles)), -1))
    return np.asarray(position[np.maximum(last, np.flatnonzero(sampled)[0])])
