"""A recorded run read back from any of its files.

NPZ (`--save`) has every tick in full precision. MCAP (`--record`) has goals and root in single precision, the desired
landmarks 25 times a second (interpolated linearly) and the human 12.5 times.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import ConfigError, InputError
from retarget.model.body import BodyModel, body_from_file
from retarget.model.body_file import BodyFile, compile_body, compile_body_text
from retarget.model.human import build_human
from retarget.model.robot import RobotBody
from retarget.recording.configs import as_recorded
from retarget.recording.cycles import Done
from retarget.recording.motion import Motion, posture, quaternion_columns, unit_quaternions
from retarget.recording.npz import NO_RUN, NO_SERVO, joints_and_root, read_arrays, refuse_no_file, run_arrays
from retarget.recording.reading import (
    MAGIC,
    MOVED_BODY,
    Recording,
    TopicRows,
    postures_sent,
    read_recording,
    refusing_hostile,
)
from retarget.recording.topics import LANDMARKS
from retarget.rotations import normalise
from retarget.run.record import PHASE_NAMES, Phase
from retarget.run.run_result import RunResult, truth_names
from retarget.run.table import FIELDS, STAGES, ByteArray, RunTable, TextArray
from retarget.schema.arrays import ArrayFile
from retarget.types import FloatArray


def read_run(path: Path, *, of_human: bool = False, body: Path | None = None) -> Motion:
    """The motion of a recorded run: of its robot, or of the virtual human.

    body: MJCF or URDF of the robot, if the one that the file names is missing. Raises InputError.
    """
    run = read_recorded(path, robot=not of_human, body=body)
    return replace(run, notes=tuple(f"{path}: {note}" for note in run.notes))


def no_human(source: str) -> InputError:
    """The error for a run without a human."""
    found = "no human_q, human_mjcf or /human/posture"
    return InputError("the human is not in this run", where=source[:200], found=found, next_step=NO_RUN)


def _of_human(known: dict[str, Any], human: BodyFile) -> Motion:
    own = {name: values for name, values in known.items() if name not in OF_SERVOS}
    own |= {"q": known["human_q"], "robot": "human", "body": body_from_file(human), "compiled": human, "human": human}
    return Motion(**own)[np.isfinite(known["human_q"]).all(axis=1)]


def read_recorded(path: Path, *, robot: bool = True, body: Path | None = None) -> Motion:
    """A recorded run, of its robot (and human, if known) or of the human alone.

    robot: required; body: as in `read_run`. Raises InputError for any other file, and for a run without a sent tick.
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
            return _of_mcap(recording, robot, body)
    if begins.startswith(ZIP):
        used = ROBOT_KEYS | HUMAN_KEYS | {"phase", *NAMES.values(), *(FIELDS[name].npz for name in READ)}
        return _of_arrays(read_arrays(path, needed=ROBOT_KEYS if robot else HUMAN_KEYS, used=used), path, robot, body)
    raise InputError("not a recorded run", where=str(path)[:200], found="neither NPZ nor MCAP", next_step=NO_RUN)


ZIP = b"PK"
"""First bytes of an NPZ file."""
ROBOT_KEYS = frozenset({"time", "joint_names", "joint_positions", "root_position", "root_quaternion", "body"})
HUMAN_KEYS = frozenset({"time", "human_q", "human_mjcf"})
NAMES = {"landmarks": "landmark_names", "sensors": "sensor_names", "servos": "joint_names"}
"""Keys of the column names of a width."""
OF_SERVOS = ("present", "goal_ticks", "temperature", "current")
READ = ("human_q", "sensors", "present", "goal_ticks", "landmarks_asked", "landmarks_reached", *STAGES)
"""Fields that are read if the file has them."""


def motion_of(run: RunResult, source: str) -> Motion:
    """The motion of a finished run, as if saved and read. source: its name in messages. Raises InputError."""
    body = source if run.robot is None else str(run.robot.profile.body_path)
    file = ArrayFile(source, run_arrays(run, body), advice="")
    return _of_arrays(file, Path(source), run.robot is not None, None)


def _of_arrays(file: ArrayFile, path: Path, robot: bool, body: Path | None) -> Motion:
    time, human = _npz_time(file), None
    named = {word: tuple(map(str, file.texts(key, None))) for word, key in NAMES.items() if key in file}
    widths = {word: len(names) for word, names in named.items()}
    if all(key in file for key in HUMAN_KEYS):
        human = compile_body_text(str(file.texts("human_mjcf")), source=f"{path}: human_mjcf", root="free")
        widths["human"] = body_from_file(human).nq
    known: dict[str, Any] = {"source": str(path), "time": time, "phase": _npz_phase(file, len(time))}
    known["sensor_names"], known["landmark_names"] = named.get("sensors", ()), named.get("landmarks", ())
    for one in (FIELDS[name] for name in READ):
        if one.npz in file and all(word in widths for word in one.shape if isinstance(word, str)):
            shape = (len(time), *one.sizes(widths))
            if one.dtype.kind == "i":
                known[one.name] = file.whole(one.npz, *shape)
            else:
                known[one.name] = file.floats(one.npz, *shape, unknown=one.name != "human_q")
    if human is not None:
        known["human_q"] = known["human_q"].copy()
        known["human_q"][:, 3:7] = unit_quaternions(known["human_q"][:, 3:7], where=file.source)
        if not robot:
            return _of_human(known | {"landmarks_asked": None}, human)
        if body_from_file(human).scalar_names == named["servos"]:
            return _of_human(known, human)
    names, place = named["servos"], _body_place(file, path, body)
    compiled = compile_body(place, root="free")
    model = body_from_file(compiled)
    known["q"] = _npz_posture(file, model, names, len(time))
    order = [names.index(name) if name in names else -1 for name in model.scalar_names]
    for name, missing in (("present", np.nan), ("goal_ticks", NO_SERVO)):
        if name in known:
            values = np.hstack([known[name], np.full((len(time), 1), missing)])[:, order]
            known[name] = None if (np.isnan(values) | (values == NO_SERVO)).all() else values
    # The folder of a body that a profile calls `body.xml`, else the name of its file.
    name = place.resolve().parent.name if place.stem == "body" else place.stem
    return Motion(**known, robot=name, body=model, compiled=compiled, human=human)


def _npz_posture(file: ArrayFile, model: BodyModel, names: tuple[str, ...], rows: int) -> FloatArray:
    joints = file.floats("joint_positions", rows, len(names))
    turn = unit_quaternions(file.floats("root_quaternion", rows, 4), where=file.source)
    root = np.hstack([file.floats("root_position", rows, 3), turn])
    try:
        return posture(model, names, joints, root)
    except ConfigError as error:
        raise InputError(
            "joints and body do not belong together",
            where=file.source,
            found=", ".join(problem.found for problem in error.problems),
            allowed=f"joints of {model.source}",
            next_step=MOVED_BODY,
        ) from error


def _body_place(file: ArrayFile, path: Path, body: Path | None) -> Path:
    """The given body, the one that the file names, or one of that name beside the file."""
    named = Path(str(file.texts("body")))
    for place in (path.parent / named, path.parent / named.name) if body is None else (body,):
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


def _npz_time(file: ArrayFile) -> FloatArray:
    time = file.floats("time", None)
    if not time.size:
        raise InputError("a run without ticks", where=file.source)
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        where, found = f"{file.source}: time", f"row {back[0] + 2} is no later than the one before"
        raise InputError("time does not increase", where=where, found=found)
    return time


def _npz_phase(file: ArrayFile, rows: int) -> ByteArray:
    """The phases. Files from before phases were saved are all following."""
    if "phase" not in file:
        return np.full(rows, Phase.FOLLOW, dtype=np.int8)
    phase = file.texts("phase", rows)
    strange = sorted(set(phase.tolist()) - set(PHASE_NAMES))
    if strange:
        where, allowed = f"{file.source}: phase", ", ".join(PHASE_NAMES)
        raise InputError("unknown phase", where=where, found=repr(strange[0])[:80], allowed=allowed)
    return np.array([PHASE_NAMES.index(name) for name in phase.tolist()], dtype=np.int8)


def _of_mcap(recording: Recording, with_robot: bool, body: Path | None) -> Motion:
    session, cycles = recording.session, recording.cycles
    source, alone = str(recording.path), not session.joints
    postures = np.isfinite(cycles.human_q).all(axis=1) & (cycles.human_q.shape[1] > 0)
    kept = np.flatnonzero(cycles.kept & (postures | (not alone)))  # of a human alone, a tick is its posture
    if not kept.size:
        raise InputError("a run without ticks", where=source)
    rows, postures = cycles[kept], postures[kept]
    notes = [f"{recording.damage}; what is whole of it is used"] if recording.damage else []
    notes += [f"{recording.missing} ticks were never written"] if recording.missing else []
    known = {name: rows.known[name] for name in ("state", "no_command", "observer_modes", "human_q", *STAGES)}
    known |= {"time": _time(recording, rows.index), "phase": np.clip(rows.phase, 0, len(Phase) - 1)}
    known |= {"reason": _reasons(recording, rows), "sensors": _valid_sensors(cycles)[kept]}
    known |= {"source": source, "sensor_names": session.sensors, "recording": recording}
    human = _recorded_human(recording) if postures.any() else None
    known["human_q"][postures, 3:7] = normalise(known["human_q"][postures, 3:7])
    if with_robot and not alone:
        with as_recorded(recording, body=body) as configs:
            assert configs.robot is not None, "there are joints"
            known |= _of_robot(recording, kept, configs.robot)
            return Motion(**known, human=human, notes=(*notes, *configs.notes))
    if human is None:
        raise no_human(source)
    if alone:
        own = {"landmarks_asked": known["sensors"], "landmark_names": session.sensors, "notes": tuple(notes)}
        return _of_human(known | own, human)
    run = _of_human(known | {"row": "posture that was kept"}, human)
    often = 1.0 / float(np.median(np.diff(run.time))) if len(run) > 1 else 0.0
    every = "`retarget replay` with --save FILE.npz has it at every tick"
    return replace(run, notes=(*notes, f"the human was kept {often:.3g} times a second; {every}"))


def _recorded_human(recording: Recording) -> BodyFile:
    source = str(recording.path)
    mjcf = build_human(recording.session.size).mjcf
    human = compile_body_text(mjcf, source=f"{source}: the human", root="free", own=True)
    if recording.cycles.human_q.shape[1] != body_from_file(human).nq:
        found = f"q of {recording.cycles.human_q.shape[1]}"
        raise InputError("the human has another tree now", where=source, found=found)
    return human


def _of_robot(recording: Recording, kept: NDArray[np.intp], robot: RobotBody) -> dict[str, Any]:
    """Postures, goals and servos of the robot in the cycles `kept` (T,), on a tree with a free root."""
    rows, servos = recording.cycles[kept], robot.joint_map
    compiled = compile_body(robot.profile.body_path, root="free")
    model = body_from_file(compiled)
    q = postures_sent(recording, robot, kept)
    if not np.isfinite(q).all():
        raise InputError("goals that are no numbers", where=str(recording.path))
    for start in quaternion_columns(robot.body):
        q[:, start : start + 4] = normalise(q[:, start : start + 4])
    names, joints, root = joints_and_root(robot.body, q)
    columns = [names.index(joint) for joint in servos.joints]

    def spread(values: FloatArray) -> FloatArray:
        made = np.full(joints.shape, np.nan)
        made[:, columns] = values
        return made

    known = {"q": posture(model, names, joints, root), "goal_ticks": servos.spread(names, rows.goal_ticks)}
    known |= {name: spread(rows.known[name]) for name in ("temperature", "current")}
    if recording.session.bus != "none":
        read = (rows.read == Done.WELL)[:, None]
        known["present"] = spread(np.where(read, servos.to_radians(rows.position), np.nan))
    if LANDMARKS in recording.topics:
        known |= _landmarks(tuple(robot.profile.landmarks), recording.topics[LANDMARKS], rows.index)
    if rows.truth.shape[1] == len(truth_names(model)):
        there = np.where(np.isnan(rows.truth).all(axis=1), 0, np.arange(len(rows)))
        known["truth"] = rows.truth[np.maximum.accumulate(there)]
    moved = model.joint_qpos[[model.joint_index(joint) for joint in servos.joints]]
    profile = replace(robot, body=model, servo_columns=moved)
    return known | {"robot": robot.profile.name, "body": model, "compiled": compiled, "profile": profile}


def _time(found: Recording, index: NDArray[np.int64]) -> FloatArray:
    """Times of cycles (T,), s: 0 at the first that followed, or would have."""
    cycles = found.cycles
    kept = np.flatnonzero(cycles.kept)
    follows = np.flatnonzero(cycles.phase[kept] == Phase.FOLLOW)
    if follows.size:
        first = int(cycles.index[kept[follows[0]]])
    else:
        first = int(cycles.index[kept[0]]) + int(np.count_nonzero(cycles.phase[kept] == Phase.APPROACH))
    return np.asarray((index - first) * found.session.dt)


def _landmarks(names: tuple[str, ...], topic: TopicRows, index: NDArray[np.int64]) -> dict[str, Any]:
    """Desired landmarks at every cycle: interpolated linearly, and constant before the first and after the last known
    one."""
    tracks = {}
    for at, name in enumerate(names[: topic.rows["poses"].shape[1]]):
        said = topic.rows["poses"][:, at, :3]
        known = np.flatnonzero(np.isfinite(said).all(axis=1))
        if known.size:
            part = slice(known[0], known[-1] + 1)
            x, y = topic.cycles[part].astype(np.float64), said[part]
            tracks[name] = np.stack([np.interp(index, x, column) for column in y.T], axis=1)
    desired = np.stack(list(tracks.values()), axis=1) if tracks else None
    return {"landmarks_asked": desired, "landmark_names": tuple(tracks)}


def _reasons(recording: Recording, cycles: RunTable) -> TextArray:
    said = sorted(
        (cycle, text)
        for (cycle, source), text in recording.texts.items()
        if source.startswith("bus ") or (source in ("guard", "outside") and ": " in text)  # a cause and a reason
    )
    last = np.searchsorted([cycle for cycle, _ in said], cycles.index, side="right")
    return np.array([said[count - 1][1] if count else "" for count in last.tolist()], dtype=np.object_)


def _valid_sensors(cycles: RunTable) -> FloatArray:
    """Sensors (T, s, 3) m of the last sample at every cycle, or of the first; NaN: not valid."""
    sampled = cycles.sampled != Done.NOT
    position = np.where((cycles.sampled == Done.WELL)[:, None, None], cycles.sensor_position, np.nan)
    position[~cycles.sensor_valid] = np.nan
    last = np.maximum.accumulate(np.where(sampled, np.arange(len(cycles)), -1))
    return np.asarray(position[np.maximum(last, np.flatnonzero(sampled)[0])])
