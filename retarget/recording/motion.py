"""A recorded run as one table, which every export is written from and every reader returns."""

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from retarget.errors import InputError, UsageError
from retarget.model.body import BodyModel, JointType
from retarget.model.body_file import BodyFile
from retarget.model.robot import RobotBody
from retarget.recording.reading import Recording
from retarget.rotations import conjugate, log, multiply, normalise, slerp
from retarget.run.record import Phase
from retarget.run.table import RunTable
from retarget.types import FloatArray

UNEVEN = 0.01
"""Deviation from the period, as a share of it, up to which rows count as evenly spaced."""


CM = 100.0
"""Centimetres in a metre."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion(RunTable):
    """A motion of one body with a free root: q (T, nq) is what was sent. Servo fields have a column for each of
    `joint_names`, NaN or -1 for a joint without servo.

    source: its file. robot: its name, or `human`. row: meaning of a row. compiled, human: bodies of `q` and `human_q`.
    profile: of the robot, with this tree. recording: of an MCAP file.
    """

    source: str
    robot: str
    body: BodyModel
    row: str = "tick"
    notes: tuple[str, ...] = ()
    landmark_names: tuple[str, ...] = ()
    sensor_names: tuple[str, ...] = ()
    compiled: BodyFile | None = None
    human: BodyFile | None = None
    profile: RobotBody | None = None
    recording: Recording | None = None

    @property
    def is_human(self) -> bool:
        """True if the virtual human moves."""
        return self.robot == "human"

    @property
    def joint_names(self) -> tuple[str, ...]:
        """All hinges and slides of the body, in its order."""
        return self.body.scalar_names

    @property
    def joint_units(self) -> tuple[str, ...]:
        """`rad` for a hinge, `m` for a slide."""
        kinds = dict(zip(self.body.joint_names, self.body.joint_type.tolist(), strict=True))
        return tuple("m" if kinds[name] == JointType.SLIDE else "rad" for name in self.joint_names)

    @property
    def joints(self) -> FloatArray:
        """Positions (T, n) rad or m of `joint_names`."""
        single, address = self.body.scalar_joints()
        return np.asarray(self.q[:, address[single]])

    @property
    def root_position(self) -> FloatArray:
        """Position (T, 3) m of the first link's origin, world."""
        return np.asarray(self.q[:, :3])

    @property
    def root_quaternion(self) -> FloatArray:
        """Orientation (T, 4) wxyz of the first link, world."""
        return np.asarray(self.q[:, 3:7])

    @property
    def rate_hz(self) -> float:
        """Rows per second. Raises InputError for unevenly spaced rows, and for a single one."""
        steps = np.diff(self.time)
        if not steps.size:
            raise InputError("one row is no motion", where=self.source, next_step="Export more of the run: --phase all")
        period = float(np.median(steps))
        if np.abs(steps - period).max() > UNEVEN * period:
            raise InputError(
                "rows are not evenly spaced in time",
                where=self.source,
                found=f"{1e3 * steps.min():.1f} to {1e3 * steps.max():.1f} ms between two",
                next_step="Have them resampled: --fps N",
            )
        rate = len(steps) / float(self.time[-1] - self.time[0])
        whole = round(rate)
        return float(whole) if abs(rate - whole) < 1e-6 * rate else rate


def followed(motion: Motion, *, found: str = "no such tick", next_step: str = "") -> Motion:
    """The rows in which the body followed. found, next_step: for the InputError."""
    following = motion.phase == Phase.FOLLOW
    if not following.any():
        raise InputError("nothing was followed in this run", where=motion.source, found=found, next_step=next_step)
    return motion[following]


def posture(body: BodyModel, joint_names: tuple[str, ...], joints: FloatArray, root: FloatArray) -> FloatArray:
    """Postures (T, nq) from joints (T, n) and the free root (T, 7), xyz and wxyz; other joints as in the body file.
    Raises ConfigError for an unknown joint."""
    q = np.tile(body.qpos0, (len(joints), 1))
    q[:, :7] = root
    q[:, [body.joint_qpos[body.joint_index(name)] for name in joint_names]] = joints
    return q


UNIT = 0.01
"""Largest deviation of a quaternion from unit length."""


def unit_quaternions(turn: FloatArray, *, where: str) -> FloatArray:
    """Normalised quaternions (T, 4). Raises InputError if one is far from unit length."""
    off = np.abs(np.linalg.norm(turn, axis=1) - 1.0)
    if off.max() > UNIT:
        row = int(np.argmax(off)) + 1
        found = f"{turn[row - 1]} in row {row}"
        raise InputError("no unit quaternion", where=f"{where}: orientation of the root", found=found)
    return normalise(turn)


def quaternion_columns(body: BodyModel) -> list[int]:
    """Indices in q at which quaternions begin."""
    offset = {int(JointType.FREE): 3, int(JointType.BALL): 0}
    return [
        int(address) + offset[kind]
        for address, kind in zip(body.joint_qpos, body.joint_type.tolist(), strict=True)
        if kind in offset
    ]


MAX_FPS = 1000.0
EXACT = 1e-9
"""Relative difference of two rates that count as equal."""


def resampled(motion: Motion, fps: float) -> Motion:
    """The motion at `fps` rows per second, by linear interpolation and slerp, without a filter.

    Fields of single ticks, such as servo goals, are left out, unless the rate stays the same. Raises UsageError for an
    impossible rate.
    """
    if not 0.0 < fps <= MAX_FPS:
        raise UsageError("impossible rate", where="--fps", found=f"{fps:g}", allowed=f"above 0, up to {MAX_FPS:g}")
    begin, end = float(motion.time[0]), float(motion.time[-1])
    if len(motion) > 1 and (end - begin) * fps * (1.0 + EXACT) < 1.0:
        raise UsageError(
            "so few rows a second that only one is left",
            where="--fps",
            found=f"{fps:g} in {end - begin:.3g} s",
            allowed=f"{1.0 / (end - begin):.3g} and more, up to {MAX_FPS:g}",
        )
    time = begin + np.arange(int((end - begin) * fps * (1.0 + EXACT)) + 1) / fps
    if len(time) == len(motion) and np.abs(time - motion.time).max() < EXACT:
        return motion
    before = np.clip(np.searchsorted(motion.time, time, side="right") - 1, 0, max(len(motion) - 2, 0))
    after = np.minimum(before + 1, len(motion) - 1)
    gap = np.where(after > before, motion.time[after] - motion.time[before], 1.0)
    share = np.clip((time - motion.time[before]) / gap, 0.0, 1.0)

    def between(values: FloatArray) -> FloatArray:
        weight = share.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray((1.0 - weight) * values[before] + weight * values[after])

    q = between(motion.q)
    for start in quaternion_columns(motion.body):
        q[:, start : start + 4] = slerp(motion.q[before, start : start + 4], motion.q[after, start : start + 4], share)
    values: dict[str, Any] = dict.fromkeys(motion.known)
    values |= {name: between(values) for name, values in motion.known.items() if name in ("present", "landmarks_asked")}
    return replace(motion, **values | {"time": time, "phase": motion.phase[before], "q": q})


CONVENTIONS: Final = {
    "world": "right-handed, x forward, y left, z up (REP-103), metres; the ground is z = 0",
    "root": "origin and orientation of the body's first link, in the world",
    "joints": "what was sent to the servos: rad of a hinge, m of a slide, zero as in the body file",
    "time": "seconds, 0 at the first tick of following",
}
"""Conventions of exported data. Each format states the order of its quaternions."""


@dataclass(frozen=True, eq=False)
class Links:
    """Origins of the links (b): position (T, b, 3) m and orientation (T, b, 4) wxyz, world."""

    names: tuple[str, ...]
    position: FloatArray
    orientation: FloatArray


def links_of(motion: Motion) -> Links:
    """Forward kinematics of all rows."""
    body = motion.body
    numbers = list(range(1, len(body.body_names)))
    solver, q = body.solver_body(), np.ascontiguousarray(motion.q)
    position = solver.points(q, numbers, np.zeros((len(numbers), 3)))
    return Links(body.body_names[1:], position, solver.orientations(q, numbers))


def rate_of_change(values: FloatArray, rate_hz: float) -> FloatArray:
    """Central differences (T, ...), per second, one-sided at the ends; 0 for a single row."""
    return np.asarray(np.gradient(values, axis=0) * rate_hz if len(values) > 1 else np.zeros_like(values))


def sign_aligned(quaternions: FloatArray) -> FloatArray:
    """The same orientations (T, ..., 4), with signs that do not flip from row to row."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0.0
    signs = np.cumprod(np.where(flips, -1.0, 1.0), axis=0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs[..., None]])


def angular_velocity(orientation: FloatArray, rate_hz: float) -> FloatArray:
    """World angular velocities (T, ..., 3) rad/s of orientations (T, ..., 4), by central differences."""
    if len(orientation) < 2:
        return np.zeros((*orientation.shape[:-1], 3))
    rows = np.arange(len(orientation))
    before, after = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(orientation) - 1)
    turn = log(multiply(orientation[after], conjugate(orientation[before])))
    seconds = (after - before) / rate_hz
    return np.asarray(turn / seconds.reshape(-1, *[1] * (turn.ndim - 1)))
