"""A run saved with `--save FILE.npz`, to be looked at."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.body_file import compile_body, compile_body_text
from retarget.errors import InputError, RefusedError
from retarget.robot_body import RobotBody, load_robot
from retarget.rotations import FloatArray
from retarget.viewer.moment import PHASE_WORDS, Cast, Moment, Tracks, actor
from retarget.viewer.zero_moment import around_row, zero_moment_point

__all__ = ["RecordedRun", "open_recorded"]

KEYS = {
    "time": 1,
    "phase": 1,
    "joint_names": 1,
    "joint_positions": 2,
    "root_position": 2,
    "root_quaternion": 2,
    "goal_ticks": 2,
    "landmark_names": 1,
    "landmarks_asked": 3,
    "landmarks_reached": 3,
    "body": 0,
    "human_q": 2,
    "human_mjcf": 0,
}
"""What a saved run must have, and how many axes each has."""
OPTIONAL = {"servo_positions": 2, "sensor_names": 1, "sensor_positions": 3}
"""What it may lack."""
PER_TICK = ("phase", "joint_positions", "root_position", "root_quaternion", "goal_ticks", "landmarks_asked", "human_q")
STATES = {phase.name.lower(): word for phase, word in PHASE_WORDS.items()}
MOST_BYTES = 4 << 30

Arrays = dict[str, NDArray[Any]]
_NO_SENSORS = np.zeros((1, 0, 3))


class RecordedRun:
    """See `Viewed`. One row of it is worked out when it is looked at."""

    def __init__(self, arrays: Arrays, *, title: str) -> None:
        self.times: FloatArray = arrays["time"]
        self.notes: tuple[str, ...] = ()
        body = compile_body(Path(str(arrays["body"])), root="free")
        human = compile_body_text(str(arrays["human_mjcf"]), source="human of the run", root="free")
        robot = actor(body)
        model = robot.body
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
        sensors = tuple(str(name) for name in arrays.get("sensor_names", ()))
        followed = tuple(str(name) for name in arrays["landmark_names"])  # of a human its sensors
        self.cast = Cast(
            title,
            robot if has_robot else None,
            actor(human),
            tuple(names) if has_robot else (),
            followed if has_robot or not sensors else (),
            _profile(Path(str(arrays["body"]))) if has_robot else None,
            sensors=sensors,
            servos_told=False,
        )

    def moment(self, row: int) -> Moment:
        """The tick of a row."""
        arrays = self._arrays
        sent, present = arrays["joint_positions"][row], self._present[row]
        goal = self._posture(row, sent)
        rows = list(around_row(self.times, row))
        com = self._solver.centre_of_mass(np.array([self._posture(at, arrays["joint_positions"][at]) for at in rows]))
        return Moment(
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
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ValueError("larger than 4 GB")
        with np.load(path, allow_pickle=False) as file:
            if not hasattr(file, "files"):
                raise ValueError("one array, not a run")
            missing = [key for key in KEYS if key not in file.files]
            if missing:
                raise ValueError(f"without {', '.join(missing)}")
            arrays = {key: file[key] for key in (*KEYS, *(key for key in OPTIONAL if key in file.files))}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, KeyError) as error:
        raise _refused(path, getattr(error, "strerror", None) or str(error)) from error
    _check(arrays, path)
    return arrays


def _check(arrays: Arrays, path: Path) -> None:
    ticks = len(arrays["time"]) if arrays["time"].ndim == 1 else 0
    if not ticks:
        raise _refused(path, "no tick at all")
    wrong = [key for key, axes in (KEYS | OPTIONAL).items() if key in arrays and arrays[key].ndim != axes]
    ticking = (*PER_TICK, *(key for key in ("servo_positions", "sensor_positions") if key in arrays))
    wrong += [key for key in ticking if key not in wrong and len(arrays[key]) != ticks]
    if not wrong and arrays.get("sensor_positions", _NO_SENSORS).shape[1:] != (len(arrays.get("sensor_names", ())), 3):
        wrong.append("sensor_positions")
    if wrong:
        raise _refused(path, f"another shape of {', '.join(wrong)}")
    numbers = [key for key in (*PER_TICK[1:], "time") if key != "landmarks_asked"]
    broken = [key for key in numbers if not np.isfinite(arrays[key]).all()]
    if broken:
        raise _refused(path, f"{', '.join(broken)} with what is no number")


def _refused(path: Path, found: str) -> InputError:
    return InputError(
        "not a run that was saved",
        where=str(path),
        found=found,
        allowed="a file of retarget run --save FILE.npz",
        next_step="Save it again, from the same source",
    )


def _profile(body: Path) -> RobotBody | None:
    """The robot whose body file it is, if its profile lies beside it and can be read: it only adds to what is shown."""
    try:
        return load_robot(body.with_name("robot.yaml"), root="free")
    except RefusedError:
        return None
