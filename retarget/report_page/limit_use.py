"""How much of each kind of joint limit a run used: the joint that came nearest to its own."""

from dataclasses import dataclass

import numpy as np

from retarget.joint_limits import JointLimits
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["LimitUse", "Nearest", "limit_use"]


@dataclass(frozen=True)
class Nearest:
    """The joint that used most of its limit. value: what it did; limit: what it may do; rad, s (or m)."""

    joint: str
    value: float
    limit: float


@dataclass(frozen=True)
class LimitUse:
    """None where no joint has such a limit, or where too few ticks were sent to tell. room: rad (or m) between a joint
    and the limit of its position that it came nearest to, and its joint; negative: beyond."""

    room: tuple[str, float] | None
    velocity: Nearest | None
    acceleration: Nearest | None


def limit_use(run: RunResult) -> LimitUse:
    """Of the postures that were sent (of a human: reconstructed), by finite differences."""
    names, positions, limits, dt = _joints(run)
    if len(positions) < 3 or not names:
        return LimitUse(None, None, None)
    step = np.diff(positions, axis=0)
    change = np.diff(step, axis=0)
    room = np.minimum(positions - limits.lower, limits.upper - positions).min(axis=0)
    near = int(np.argmin(room))
    return LimitUse(
        room=(names[near], float(room[near])) if np.isfinite(room[near]) else None,
        velocity=_nearest(names, np.abs(step).max(axis=0) / dt, limits.max_velocity),
        acceleration=_nearest(names, np.abs(change).max(axis=0) / dt**2, limits.max_acceleration),
    )


def _nearest(names: tuple[str, ...], values: FloatArray, limits: FloatArray) -> Nearest | None:
    share = values / np.where(limits > 0.0, limits, np.inf)
    joint = int(np.argmax(share))
    return Nearest(names[joint], float(values[joint]), float(limits[joint])) if np.isfinite(limits[joint]) else None


def _joints(run: RunResult) -> tuple[tuple[str, ...], FloatArray, JointLimits, float]:
    """Names, positions (T, n), limits (n,) and the period that the report measures them by."""
    robot, sent = run.robot, run.record.robot
    if robot is not None and sent is not None:
        names = tuple(robot.joint_map.joints)
        return names, np.vstack([sent.start, sent.q[:, robot.servo_columns]]), robot.limits, run.clip.dt
    body, whole = run.human.body, run.human_limits
    single, address = body.scalar_joints()
    shown = single & ~run.human.locked
    limits = JointLimits(
        *(field[shown] for field in (whole.lower, whole.upper, whole.max_velocity, whole.max_acceleration))
    )
    names = tuple(name for name, kept in zip(body.dof_names, shown, strict=True) if kept)
    return names, run.record.human.q[:, address[shown]], limits, run.clip.motion_dt
