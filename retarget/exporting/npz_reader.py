"""A run that `--save FILE.npz` wrote, as a `Motion`: of the robot, or of the human that it followed."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from retarget.body import BodyModel, load_body, load_body_text
from retarget.errors import ConfigError, InputError
from retarget.exporting.motion import PHASE_NAMES, IntArray, Motion, TextArray, Tracks, posture
from retarget.exporting.npz_arrays import ArrayFile, read_arrays
from retarget.record import Phase
from retarget.rotations import FloatArray, normalise

__all__ = ["read_npz_human", "read_npz_run"]

ROBOT = frozenset({"time", "joint_names", "joint_positions", "root_position", "root_quaternion", "body"})
HUMAN = frozenset({"time", "human_q", "human_mjcf"})
USED = frozenset({"phase", "goal_ticks", "servo_positions", "landmark_names", "landmarks_asked"})
UNIT = 0.01
"""A quaternion may miss unit length by this."""


def read_npz_run(path: Path, *, body: Path | None = None) -> Motion:
    """What a run sent; of `--robot human` what it reconstructed. body: MJCF or URDF of the robot instead of the one
    that the file names.

    Raises InputError for anything that is not such a run, and where its body is not found.
    """
    file = read_arrays(path, needed=ROBOT, used=USED | HUMAN)
    time = _time(file)
    rows, names = len(time), tuple(str(name) for name in file.texts("joint_names", None))
    human = _human(file, time) if all(key in file for key in HUMAN) else None
    if human is not None and human.joint_names == names:
        return replace(human, asked=_asked(file, rows))
    model = _robot_body(file, path, body)
    q = _posture(file, model, names, rows)
    motion = Motion(str(path), _robot_name(model), model, time, _phase(file, rows), q, asked=_asked(file, rows))
    order = [names.index(name) if name in names else -1 for name in motion.joint_names]
    return replace(motion, servos=_servos(file, len(names), order), goal_ticks=_goals(file, len(names), order))


def read_npz_human(path: Path) -> Motion:
    """The virtual human of a run, as it was reconstructed. Raises InputError for anything that is not such a run."""
    file = read_arrays(path, needed=HUMAN, used=USED)
    return _human(file, _time(file))


def _human(file: ArrayFile, time: FloatArray) -> Motion:
    text = str(file.texts("human_mjcf"))
    model = load_body_text(text, source=f"{file.source}: human_mjcf", root="free")
    q = file.floats("human_q", len(time), model.nq)
    q[:, 3:7] = _unit(file, q[:, 3:7])
    return Motion(file.source, "human", model, time, _phase(file, len(time)), q)


def _posture(file: ArrayFile, model: BodyModel, names: tuple[str, ...], rows: int) -> FloatArray:
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


def _robot_name(model: BodyModel) -> str:
    """The folder of a body that a profile calls `body.xml`, else the name of its file."""
    path = Path(model.source)
    return path.resolve().parent.name if path.stem == "body" else path.stem


def _time(file: ArrayFile) -> FloatArray:
    time = file.floats("time", None)
    if not time.size:
        raise InputError("a run without ticks", where=file.source)
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        where = f"{file.source}: time"
        raise InputError(
            "time does not increase", where=where, found=f"row {back[0] + 2} is no later than the one before"
        )
    return time


def _phase(file: ArrayFile, rows: int) -> TextArray:
    """Files from before phases were saved are all following."""
    if "phase" not in file:
        return np.full(rows, PHASE_NAMES[Phase.FOLLOW])
    phase = file.texts("phase", rows)
    strange = sorted(set(phase.tolist()) - set(PHASE_NAMES))
    if strange:
        where, allowed = f"{file.source}: phase", ", ".join(PHASE_NAMES)
        raise InputError("unknown phase", where=where, found=repr(strange[0])[:80], allowed=allowed)
    return np.asarray(phase)


def _unit(file: ArrayFile, turn: FloatArray) -> FloatArray:
    """Quaternions made exactly unit. Raises InputError where they are none."""
    off = np.abs(np.linalg.norm(turn, axis=1) - 1.0)
    if off.max() > UNIT:
        row = int(np.argmax(off)) + 1
        where, found = f"{file.source}: orientation of the root", f"{turn[row - 1]} in row {row}"
        raise InputError("no unit quaternion", where=where, found=found)
    return normalise(turn)


def _robot_body(file: ArrayFile, path: Path, given: Path | None) -> BodyModel:
    """The body that is given; the one that the file names, where it was; or one of that name beside the file."""
    if given is not None:
        return load_body(given, root="free")
    named = Path(str(file.texts("body")))
    places = [place for place in (named, path.parent / named.name) if _is_there(place)]
    if not places:
        raise InputError(
            "the robot's body is not there",
            where=file.source,
            found=str(named)[:200],
            next_step="Say where its MJCF or URDF is now: --body FILE.xml",
        )
    return load_body(places[0], root="free")


def _is_there(place: Path) -> bool:
    try:
        return bool(place.name) and place.is_file()
    except OSError:
        return False


def _servos(file: ArrayFile, joints: int, order: list[int]) -> FloatArray | None:
    if "servo_positions" not in file:
        return None
    servos = file.floats("servo_positions", file.arrays["time"].size, joints, unknown=True)
    servos = np.hstack([servos, np.full((len(servos), 1), np.nan)])[:, order]
    return servos if np.isfinite(servos).any() else None


def _goals(file: ArrayFile, joints: int, order: list[int]) -> IntArray | None:
    if "goal_ticks" not in file:
        return None
    goals = file.whole("goal_ticks", file.arrays["time"].size, joints)
    goals = np.hstack([goals, np.full((len(goals), 1), -1)])[:, order]
    return goals if (goals >= 0).any() else None


def _asked(file: ArrayFile, rows: int) -> Tracks | None:
    if "landmark_names" not in file or "landmarks_asked" not in file:
        return None
    names = tuple(str(name) for name in file.texts("landmark_names", None))
    return Tracks(names, file.floats("landmarks_asked", rows, len(names), 3, unknown=True))
