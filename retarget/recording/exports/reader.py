"""Motions of a robot from any program, in a layout of `FORMATS` or as a recorded run. Nothing is unpickled.

Order of quaternions, place of the root and units are those of that table. Joints have the names in the file, else the
order of the table.
"""

import csv
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from retarget.errors import InputError, UsageError, suggest
from retarget.model.body import BodyModel, JointType, load_body
from retarget.model.robot import RobotBody
from retarget.recording.exports.formats import FORMATS
from retarget.recording.exports.tables import ROOT_COLUMNS, TIME_COLUMN
from retarget.recording.exports.trainers import BONES_ROOT, breadth_first
from retarget.recording.motion import CM, MAX_FPS, Motion, followed, links_of, posture, unit_quaternions
from retarget.recording.npz import MAX_BYTES, refuse_no_file
from retarget.recording.read_run import ROBOT_KEYS, read_run
from retarget.recording.reading import MAGIC
from retarget.recording.topics import XYZW
from retarget.rotations import from_euler, rotate
from retarget.run.record import Phase
from retarget.schema.arrays import ArrayFile, open_arrays
from retarget.schema.pickles import refuse_pickle
from retarget.types import MM, FloatArray

LAYOUTS = {
    "a run of --save or --record": "NPZ, MCAP",
    "mjlab, BeyondMimic": "NPZ with joint_pos, body_pos_w, body_quat_w, fps",
    "holosoma": "NPZ with joint_pos (root inside) or qpos, fps",
    "GMR twin": "NPZ with root_pos, root_rot, dof_pos, fps",
    "unitree": "CSV without header",
    "bones": "CSV with root_translateX",
    "csv": "CSV with time_s, root_x_m",
}
ADVICE = "See the layouts in docs/judge.md"
QPOS, OWN = "holosoma retarget", "run"
"""Layouts that are read, and never written by `export`."""
TIMED, NO_ORDER = frozenset({OWN, "csv"}), frozenset({OWN, "csv", "bones"})
"""Layouts that have the time of each row, and layouts without an order of quaternions to choose."""
KEYS = {
    "gmr-npz": frozenset({"root_pos", "root_rot", "dof_pos"}),
    "npz": frozenset({"joint_pos", "body_pos_w", "body_quat_w"}),
    QPOS: frozenset({"qpos"}),
    OWN: ROBOT_KEYS,
}
"""Arrays that identify a layout; the first complete one counts. holosoma has those of mjlab."""
MAKE = {
    "": 'p = p if "fps" in p else next(iter(p.values())); print(list(p))\n'
    "of = lambda *keys: next(numpy.asarray(p[key], float) for key in keys if key in p)\n"
    'root, joints = of("root_pos", "root_trans_offset", "root_trans"), of("dof_pos", "dof")\n'
    'numpy.savez({made!r}, fps=p["fps"], root_pos=root, root_rot=of("root_rot", "root_ori"), '
    "dof_pos=joints.reshape(len(root), -1))"
}
"""Python lines that convert a pickle of GMR, of PHC, HOVER or SONIC (first motion), or of PHUMA to GMR's NPZ."""
SAME_M = 0.01
"""Largest distance, m, of links in a file from those of the robot."""


@dataclass(frozen=True, eq=False)
class _FileMotion:
    """Content of a file: root (T, 7) xyz m and wxyz, joints (T, n) rad, m for a slide. names: of the joints; time (T,)
    s; fps: rows per second; links (T, b, 3) m. Each is None if the file does not have it."""

    layout: str
    root: FloatArray
    joints: FloatArray
    names: tuple[str, ...] | None = None
    fps: float | None = None
    time: FloatArray | None = None
    links: FloatArray | None = None


RUN = _FileMotion(OWN, np.zeros((0, 7)), np.zeros((0, 0)))
"""A recorded run, which `read_run` reads."""


def read_motion(
    path: Path, robot: RobotBody, *, fps: float | None = None, quaternion: str | None = None
) -> tuple[str, Motion]:
    """The layout of a file, in a word, and its motion of a robot, on a tree with a free root; of a run only the
    following.

    fps: rows per second, for a layout without times. quaternion: "xyzw" or "wxyz", against its layout. Raises
    InputError, and UsageError for one of the two that the layout does not take.
    """
    refuse_no_file(path)
    begins = _head(path)
    refuse_pickle(path, begins, MAKE, made=f"{path.stem}_motion.npz")
    if begins.startswith(MAGIC):
        given = RUN
    else:
        given = _of_arrays(path, quaternion) if begins.startswith(b"PK") else _of_text(path, robot, quaternion)
    for option, value, without in (("--fps", fps, TIMED), ("--quaternion", quaternion, NO_ORDER)):
        if value is not None and given.layout in without:
            what = f"files of the layout {given.layout} say it themselves"
            raise UsageError(what, where=option, found=value, next_step="Leave it out")
    if given is RUN:
        return OWN, followed(read_run(path, body=robot.profile.body_path))
    model = load_body(robot.profile.body_path, root="free")
    motion = _checked(path, given, robot, model, fps)
    return given.layout, motion


def _head(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError("too large", where=str(path)[:200], allowed=f"up to {MAX_BYTES} bytes")
        with path.open("rb") as file:
            return file.read(4096)
    except OSError as error:
        raise InputError("cannot read the motion", where=str(path)[:200], found=error.strerror or error) from error


def _of_arrays(path: Path, quaternion: str | None) -> _FileMotion:
    layout = ""

    def needed(names: Collection[str]) -> Collection[str]:
        nonlocal layout
        layout = next((known for known, keys in KEYS.items() if keys <= set(names)), "")
        if not layout:
            found = ", ".join(sorted(name[:40] for name in names)[:12]) or "no array"
            raise _unknown(path, found)
        return () if layout == OWN else KEYS[layout] | {"fps", "joint_names"}

    file = open_arrays(path, needed, max_bytes=MAX_BYTES, advice=ADVICE)
    if layout == OWN:
        return RUN
    names = tuple(map(str, file.texts("joint_names", None))) if "joint_names" in file else None
    fps = float(file.floats("fps", *[1] * file.arrays["fps"].ndim).reshape(-1)[0]) if "fps" in file else None
    if layout == "gmr-npz":
        joints = file.floats("dof_pos", None, None)
        position = file.floats("root_pos", len(joints), 3)
        turn = _wxyz(file.floats("root_rot", len(joints), 4), quaternion or FORMATS[layout].conventions.quaternion)
        return _FileMotion(layout, np.hstack([position, turn]), joints, names, fps)
    if layout == QPOS:
        return _root_first(QPOS, file, "qpos", names, fps, quaternion)
    links = file.floats("body_pos_w", None, None, 3)
    turns = file.floats("body_quat_w", len(links), links.shape[1], 4)
    # In holosoma's layout the world is body 0, and the root is among the joints.
    if not links[:, 0].any() and links.shape[1] > 1 and file.arrays["joint_pos"].shape[1:] > (7,):
        return _root_first("holosoma", file, "joint_pos", names, fps, quaternion)
    turn = _wxyz(turns[:, 0], quaternion or FORMATS[layout].conventions.quaternion)
    joints = file.floats("joint_pos", len(links), None)
    return _FileMotion(layout, np.hstack([links[:, 0], turn]), joints, names, fps, links=links)


def _root_first(
    layout: str, file: ArrayFile, key: str, names: tuple[str, ...] | None, fps: float | None, quaternion: str | None
) -> _FileMotion:
    whole = file.floats(key, None, None)
    if whole.shape[1] < 7:
        found, allowed = f"{whole.shape[1]} columns", "7 of the root, then the joints"
        raise InputError("no root", where=f"{file.source}: {key}", found=found, allowed=allowed)
    turn = _wxyz(whole[:, 3:7], quaternion or FORMATS["holosoma"].conventions.quaternion)
    return _FileMotion(layout, np.hstack([whole[:, :3], turn]), whole[:, 7:], names, fps)


def _of_text(path: Path, robot: RobotBody, quaternion: str | None) -> _FileMotion:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise _unknown(path, "neither NPZ, MCAP nor CSV") from error
    head = rows[0] if rows else []
    if set(BONES_ROOT) <= set(head):
        named = {name.removesuffix("_dof"): name for name in head if name.endswith("_dof")}
        root, joints = _numbers(path, rows, BONES_ROOT), _numbers(path, rows, tuple(named.values()))
        # Rotations about fixed axes x, y, z are those about moving axes z, y, x.
        turn = from_euler(np.deg2rad(root[:, :2:-1]), "zyx")
        scale = [1.0 / CM if name in _slides(robot.body) else np.deg2rad(1.0) for name in named]
        return _FileMotion("bones", np.hstack([root[:, :3] / CM, turn]), joints * scale, tuple(named))
    if {TIME_COLUMN, *ROOT_COLUMNS} <= set(head):
        units = dict.fromkeys(robot.body.scalar_names, "rad") | dict.fromkeys(_slides(robot.body), "m")
        columns = {joint: f"{joint}_{unit}" for joint, unit in units.items() if f"{joint}_{unit}" in head}
        time, root = _numbers(path, rows, (TIME_COLUMN,))[:, 0], _numbers(path, rows, ROOT_COLUMNS)
        return _FileMotion("csv", root, _numbers(path, rows, tuple(columns.values())), tuple(columns), time=time)
    if not head or not _is_number(head[0]):
        raise _unknown(path, ", ".join(head)[:200] or "an empty file")
    names = tuple(map(str, range(len(head))))
    whole = _numbers(path, [list(names), *rows], names)
    if len(names) < 7:
        raise InputError(
            "no root", where=str(path)[:200], found=f"{len(names)} columns", allowed="xyz, quaternion, joints"
        )
    turn = _wxyz(whole[:, 3:7], quaternion or FORMATS["unitree"].conventions.quaternion)
    return _FileMotion("unitree", np.hstack([whole[:, :3], turn]), whole[:, 7:])


def _slides(body: BodyModel) -> tuple[str, ...]:
    kinds = zip(body.joint_names, body.joint_type.tolist(), strict=True)
    return tuple(name for name, kind in kinds if kind == JointType.SLIDE)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(path: Path, rows: list[list[str]], names: tuple[str, ...]) -> FloatArray:
    """The named columns (T, c) of rows below a header."""
    head, columns = rows[0], [rows[0].index(name) for name in names]
    values = np.empty((len(rows) - 1, len(columns)))
    for number, row in enumerate(rows[1:]):
        if len(row) != len(head):
            where, allowed = f"{path}: line {number + 1} of data", f"{len(head)}, as in the line before"
            raise InputError("another number of columns", where=where, found=len(row), allowed=allowed)
        for place, column in enumerate(columns):
            if not _is_number(row[column]) or not np.isfinite(float(row[column])):
                where = f"{path}: line {number + 1} of data, column {column + 1}"
                raise InputError("no finite number", where=where, found=repr(row[column])[:80])
            values[number, place] = float(row[column])
    return values


def _wxyz(turn: FloatArray, order: str) -> FloatArray:
    return turn[:, np.argsort(XYZW)] if order == "xyzw" else turn


def _unknown(path: Path, found: str) -> InputError:
    allowed = "; ".join(f"{name}: {what}" for name, what in LAYOUTS.items())
    return InputError("no known layout", where=str(path)[:200], found=found, allowed=allowed, next_step=ADVICE)


def _checked(path: Path, given: _FileMotion, robot: RobotBody, model: BodyModel, fps: float | None) -> Motion:
    where, rows = str(path)[:200], len(given.joints)
    if rows < 3:
        raise InputError("too few rows for a motion", where=where, found=rows, allowed="3 and more")
    names = _names(where, given, model)
    root = given.root.copy()
    root[:, 3:] = unit_quaternions(root[:, 3:], where=where)
    _refuse_units(where, names, given.joints, root, model)
    motion = Motion(
        source=str(path),
        robot=robot.profile.name,
        body=model,
        time=_times(where, given, rows, fps),
        phase=np.full(rows, Phase.FOLLOW, dtype=np.int8),
        q=posture(model, names, given.joints, root),
    )
    missing = sorted(set(robot.joint_map.joints) - set(names))
    if missing:
        motion = replace(motion, notes=(f"not in the file, taken as in the body file: {', '.join(missing)}",))
    if given.names is None and given.links is not None:
        return _as_links(given, motion)
    return motion


def _names(where: str, given: _FileMotion, model: BodyModel) -> tuple[str, ...]:
    found, own = given.joints.shape[1], model.scalar_names
    names = own if given.names is None else given.names
    if found != len(names):
        allowed = f"{len(names)}: {', '.join(names)}"
        raise InputError("another number of joints", where=where, found=found, allowed=allowed)
    for name in names:
        if name not in own:
            step = suggest(name, own) or "Give the robot that moves: --robot"
            raise InputError("the robot has no such joint", where=where, found=name[:80], next_step=step)
    return names


def _times(where: str, given: _FileMotion, rows: int, fps: float | None) -> FloatArray:
    if given.time is not None:
        if (np.diff(given.time) <= 0.0).any():
            raise InputError("time does not increase", where=where)
        return given.time
    rate = given.fps if fps is None else fps
    if rate is None:
        usual = FORMATS[given.layout].conventions.fps if given.layout in FORMATS else 30.0
        step = f"Say it with --fps N; usual are {usual:g}"
        raise InputError("the layout does not say how many rows a second it has", where=where, next_step=step)
    if not 1.0 <= rate <= MAX_FPS:
        raise InputError("impossible rate", where=where, found=f"{rate:g} Hz", allowed=f"1 to {MAX_FPS:g}")
    return np.arange(rows) / rate


HIGH = 10.0
"""Largest height of a root, as a multiple of that in the body file."""


def _refuse_units(where: str, names: tuple[str, ...], joints: FloatArray, root: FloatArray, model: BodyModel) -> None:
    """Raise InputError for degrees, centimetres, and a quaternion in another order."""
    slides = _slides(model)
    hinges = [column for column, name in enumerate(names) if name not in slides]
    far = np.abs(joints[:, hinges]).max(initial=0.0)
    if far > 2.0 * np.pi:
        joint = names[hinges[int(np.abs(joints[:, hinges]).max(axis=0).argmax())]]
        step = "Convert it: numpy.deg2rad"
        raise InputError(
            "degrees instead of rad", where=where, found=f"{joint} {far:.1f}", allowed="rad", next_step=step
        )
    height = float(np.abs(root[:, 2]).max())
    if height > max(HIGH * float(model.qpos0[2]), HIGH):
        found = f"a root {height:.0f} above the floor"
        raise InputError("centimetres or millimetres instead of metres", where=where, found=found, allowed="metres")
    up = float(np.mean(rotate(root[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2]))
    others = {
        order: float(np.mean(rotate(turn, np.array([0.0, 0.0, 1.0]))[:, 2]))
        for order, turn in (("wxyz", root[:, [4, 5, 6, 3]]), ("xyzw", root[:, [6, 3, 4, 5]]))
    }
    best = max(others, key=lambda order: others[order])
    if up < 0.0 and others[best] > np.cos(np.deg2rad(30.0)):
        step = f"Say the order: --quaternion {best}"
        raise InputError("the robot is upside down, as in the other order of quaternions", where=where, next_step=step)


def _as_links(given: _FileMotion, motion: Motion) -> Motion:
    """The motion with its joints in the order that puts the links where the file has them. Raises InputError if none
    does."""
    assert given.links is not None, "the file has links"
    body = motion.body
    of_links, of_joints = breadth_first(body)
    if given.links.shape[1] != len(of_links):
        return motion
    other = motion.q.copy()
    other[:, [body.joint_qpos[body.joint_index(motion.joint_names[joint])] for joint in of_joints]] = given.joints
    tries = [(motion, list(range(len(of_links)))), (replace(motion, q=other), of_links)]
    off = [float(np.abs(links_of(one).position[:, order] - given.links).max()) for one, order in tries]
    if min(off) > SAME_M:
        found = f"{MM * min(off):.0f} mm off"
        raise InputError("links are not where this robot has them", where=motion.source[:200], found=found)
    return tries[off.index(min(off))][0]
