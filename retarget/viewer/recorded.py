"""A run saved with `--save FILE.npz`, to be looked at."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.body_file import compile_body, compile_body_text
from retarget.errors import InputError, RefusedError
from retarget.exporting.npz_arrays import read_arrays
from retarget.robot_body import RobotBody, load_robot
from retarget.rotations import FloatArray
from retarget.viewer.moment import PHASE_WORDS, Cast, Moment, Tracks, actor
from retarget.viewer.zero_moment import around_row, zero_moment_point

__all__ = ["RecordedRun", "open_recorded"]

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
"""What it may lack."""
STATES = {phase.name.lower(): word for phase, word in PHASE_WORDS.items()}

Arrays = dict[str, NDArray[Any]]


class RecordedRun:
    """See `Viewed`. One row of it is worked out when it is looked at."""

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
        worn = arrays.get("sensor_names", ()) if "sensor_positions" in arrays else ()
        sensors = tuple(str(name) for name in worn)
        followed = tuple(str(name) for name in arrays["landmark_names"])  # of a human its sensors
        self.cast = Cast(
            title,
            robot if has_robot else None,
            shown,
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
    """The robot whose body file it is, if its profile lies beside it and can be read: it only adds to what is shown."""
    try:
        return load_robot(body.with_name("robot.yaml"), root="free")
    except RefusedError:
        return None
