"""A run as it is handed on to others: one frozen value that every export is written from and every reader yields."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError, UsageError
from retarget.model.body import BodyModel, JointType
from retarget.model.body_file import BodyFile
from retarget.rotations import conjugate, log, multiply, slerp
from retarget.run.record import Phase
from retarget.types import FloatArray, IntArray

PHASE_NAMES = tuple(phase.name.lower() for phase in Phase)
UNEVEN = 0.01
"""Ticks may be early or late by this share of their period and still count as evenly spaced."""
TextArray = NDArray[np.str_]


@dataclass(frozen=True, eq=False)
class Tracks:
    """Named points over time: position (T, k, 3) m, world; NaN where not known."""

    names: tuple[str, ...]
    position: FloatArray


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion of one body, one row per tick (T).

    source: the file that it is from. robot: its name, or `human`. body: its tree, with a free root. time (T,) s: 0 at
    the first tick of following.
    phase (T,): names of `Phase` in lower case. q (T, nq): what was sent, root xyz m and wxyz in the world (REP-103),
    then joints, rad or m. servos (T, n): where the servos were, as `joint_names`, NaN for a joint without servo; None
    where no servo answered. goal_ticks (T, n): servo goals, -1 without; None where rows are no ticks. asked: landmarks
    (of a human: its sensors) that were asked for. row: what a row is. notes: for the user, about missing parts.
    compiled: the body with its shapes, where it is to be seen.
    """

    source: str
    robot: str
    body: BodyModel
    time: FloatArray
    phase: TextArray
    q: FloatArray
    servos: FloatArray | None = None
    goal_ticks: IntArray | None = None
    asked: Tracks | None = None
    row: str = "tick"
    notes: tuple[str, ...] = ()
    compiled: BodyFile | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """All hinges and slides of the body, in its order."""
        return joint_names_of(self.body)

    @property
    def joint_units(self) -> tuple[str, ...]:
        """`rad` of a hinge, `m` of a slide."""
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
        """Rows per second. Raises InputError where rows are not evenly spaced in time, or where there is only one."""
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

    def rows(self, chosen: NDArray[np.bool_]) -> "Motion":
        """Numbers of the rows (T,) that are chosen."""
        asked = self.asked
        return replace(
            self,
            time=self.time[chosen],
            phase=self.phase[chosen],
            q=self.q[chosen],
            servos=None if self.servos is None else self.servos[chosen],
            goal_ticks=None if self.goal_ticks is None else self.goal_ticks[chosen],
            asked=None if asked is None else Tracks(asked.names, asked.position[chosen]),
        )


def joint_names_of(body: BodyModel) -> tuple[str, ...]:
    """All hinges and slides of a body, in its order."""
    single, _ = body.scalar_joints()
    return tuple(name for name, kept in zip(body.dof_names, single, strict=True) if kept)


def posture(body: BodyModel, joint_names: tuple[str, ...], joints: FloatArray, root: FloatArray) -> FloatArray:
    """Postures (T, nq) of a body with a free root, from joints (T, n) and the root (T, 7), xyz and wxyz.

    Joints that are not named stay as in the body file. Raises ConfigError for a joint that the body does not have.
    """
    q = np.tile(body.qpos0, (len(joints), 1))
    q[:, :7] = root
    q[:, [body.joint_qpos[body.joint_index(name)] for name in joint_names]] = joints
    return q


def joints_and_root(body: BodyModel, q: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Split postures (T, nq): names and positions, rad or m, (T, n) of all hinges and slides of the body, and its root
    (T, 7), xyz and wxyz of the first link in the world."""
    single, address = body.scalar_joints()
    solver, q = body.solver_body(), np.ascontiguousarray(q)
    root = np.hstack([solver.points(q, [1], np.zeros((1, 3)))[:, 0], solver.orientations(q, [1])[:, 0]])
    return joint_names_of(body), np.asarray(q[:, address[single]]), root


def quaternion_columns(body: BodyModel) -> list[int]:
    """Indices in q at which quaternions begin."""
    offset = {int(JointType.FREE): 3, int(JointType.BALL): 0}
    return [
        int(address) + offset[kind]
        for address, kind in zip(body.joint_qpos, body.joint_type.tolist(), strict=True)
        if kind in offset
    ]


# A motion at another rate: straight lines between the ticks, and the short arc between two orientations.
#
# Nothing is filtered: what moves faster than half the new rate shows as something slower.

MAX_FPS = 1000.0
EXACT = 1e-9
"""Two rates that differ by less than this share are one."""


def resampled(motion: Motion, fps: float) -> Motion:
    """The motion at `fps` rows per second, from its first row on; nothing is added after its last.

    Raises UsageError for an impossible rate. At its own rate it is returned as it is; otherwise servo goals, which were
    sent at ticks, are left out.
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
    asked = motion.asked
    return replace(
        motion,
        time=time,
        phase=motion.phase[before],
        q=q,
        servos=None if motion.servos is None else between(motion.servos),
        goal_ticks=None,
        asked=None if asked is None else Tracks(asked.names, between(asked.position)),
    )


# The conventions of what is exported, in words that travel with the data.

CONVENTIONS: Final = {
    "world": "right-handed, x forward, y left, z up (REP-103), metres; the ground is z = 0",
    "root": "origin and orientation of the body's first link, in the world",
    "joints": "what was sent to the servos: rad of a hinge, m of a slide, zero as in the body file",
    "time": "seconds, 0 at the first tick of following",
}
"""What: how. Each format states the order of its quaternions itself."""


# Where every link of a body is over a motion, and how fast.


@dataclass(frozen=True, eq=False)
class Links:
    """Links (b) in the order of the body file, without the world. position (T, b, 3) m and orientation (T, b, 4) wxyz
    of their origins, world."""

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
    """Central differences over the rows (T, ...), per second; one-sided at both ends, 0 for a single row."""
    return np.asarray(np.gradient(values, axis=0) * rate_hz if len(values) > 1 else np.zeros_like(values))


def angular_velocity(orientation: FloatArray, rate_hz: float) -> FloatArray:
    """World angular velocities (T, ..., 3) rad/s of orientations (T, ..., 4), by differences as `rate_of_change`."""
    if len(orientation) < 2:
        return np.zeros((*orientation.shape[:-1], 3))
    rows = np.arange(len(orientation))
    before, after = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(orientation) - 1)
    turn = log(multiply(orientation[after], conjugate(orientation[before])))
    seconds = (after - before) / rate_hz
    return np.asarray(turn / seconds.reshape(-1, *[1] * (turn.ndim - 1)))
