"""A run as it is handed on to others: one frozen value that every export is written from and every reader yields."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from retarget.body import BodyModel, JointType
from retarget.errors import InputError
from retarget.record import Phase
from retarget.rotations import FloatArray

__all__ = ["PHASE_NAMES", "Motion", "Tracks", "posture", "quaternion_columns"]

PHASE_NAMES = tuple(phase.name.lower() for phase in Phase)
UNEVEN = 0.01
"""Ticks may be early or late by this share of their period and still count as evenly spaced."""

IntArray = NDArray[np.int64]
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
    (of a human: its sensors) that were asked for. row: what a row is. notes: for the user, of what the file lacks.
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

    def __len__(self) -> int:
        return len(self.time)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """All hinges and slides of the body, in its order."""
        return tuple(name for name, single in zip(self.body.dof_names, self._single, strict=True) if single)

    @property
    def joint_units(self) -> tuple[str, ...]:
        """`rad` of a hinge, `m` of a slide."""
        kinds = dict(zip(self.body.joint_names, self.body.joint_type.tolist(), strict=True))
        return tuple("m" if kinds[name] == JointType.SLIDE else "rad" for name in self.joint_names)

    @property
    def joints(self) -> FloatArray:
        """Positions (T, n) of `joint_names`."""
        _, address = self.body.scalar_joints()
        return np.asarray(self.q[:, address[self._single]])

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
        """The rows (T,) that are chosen."""
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

    @property
    def _single(self) -> NDArray[np.bool_]:
        single, _ = self.body.scalar_joints()
        return single


def posture(body: BodyModel, joint_names: tuple[str, ...], joints: FloatArray, root: FloatArray) -> FloatArray:
    """Postures (T, nq) of a body with a free root, from joints (T, n) and the root (T, 7), xyz and wxyz.

    Joints that are not named stay as in the body file. Raises ConfigError for a joint that the body does not have.
    """
    q = np.tile(body.qpos0, (len(joints), 1))
    q[:, :7] = root
    q[:, [body.joint_qpos[body.joint_index(name)] for name in joint_names]] = joints
    return q


def quaternion_columns(body: BodyModel) -> list[int]:
    """Where in q each quaternion begins."""
    offset = {int(JointType.FREE): 3, int(JointType.BALL): 0}
    return [
        int(address) + offset[kind]
        for address, kind in zip(body.joint_qpos, body.joint_type.tolist(), strict=True)
        if kind in offset
    ]
