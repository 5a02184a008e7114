"""Actions of LeRobot, `{"<joint>.pos": rad}`, as targets of a run: validated, time-stamped; only the newest is used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from numbers import Real

import numpy as np

from hardware.clock import Clock
from retarget.errors import InputError, UsageError
from retarget.frames import SensorSample
from retarget.human.samples import Clip
from retarget.live.performer import TOO_SHORT
from retarget.live.sensor_validity import Debounce
from retarget.run.joint_targets import JUMP
from retarget.types import FloatArray

POS, GOAL = ".pos", ".goal"
"""Suffixes of a joint's position as it was read, and as it was sent. Both are radians."""
STALE_MS = (20.0, 2000.0)
"""Least and most of the freshness limit, ms: two ticks of a fast robot, and what an operator notices."""
LONGEST_STEP_S = 0.1
"""Actions are bridged over the time between the last two, at most this long."""
FOR_EVER = 10**9
"""No limit on ticks."""
MOST_RAD = 100.0
"""No joint turns this far, rad: a larger value is in other units."""


def action_names(joints: Sequence[str]) -> tuple[str, ...]:
    """The keys of an action for joints, in their order."""
    return tuple(joint + POS for joint in joints)


def read_action(action: Mapping[str, object], names: Sequence[str]) -> FloatArray:
    """The targets (n,), rad, of an action with these keys; other keys are left alone. Raises InputError that names
    every key without a finite number, or with one beyond `MOST_RAD`."""
    missing = [name for name in names if name not in action]
    if missing:
        raise InputError(
            "an action without all joints",
            where="send_action",
            found=f"no {_few(missing)}",
            allowed=f"{len(names)} keys, those of action_features",
            next_step="Use a teleoperator, a policy or a data set of the same robot",
        )
    values = [_number(action[name]) for name in names]
    pairs = zip(names, values, strict=True)
    wrong = [f"{name} = {action[name]!r:.40}" for name, value in pairs if not abs(value) <= MOST_RAD]
    if wrong:
        raise InputError(
            "an action with an impossible angle",
            where="send_action",
            found=_few(wrong),
            allowed=f"finite numbers, -{MOST_RAD:g} to {MOST_RAD:g} rad",
            next_step="Send radians, not degrees. The robot holds until the next good action",
        )
    return np.array(values)


def _few(names: Sequence[str]) -> str:
    shown = ", ".join(names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"


def _number(value: object) -> float:
    """A number, also one in an array or tensor of one element; NaN where it is none."""
    if isinstance(value, bool | str | bytes):
        return np.nan
    try:
        return float(value) if isinstance(value, Real) else float(np.asarray(value, dtype=np.float64).item())
    except (TypeError, ValueError, OverflowError, RuntimeError):  # RuntimeError: a tensor that needs its gradient
        return np.nan


@dataclass(frozen=True, eq=False)
class ReceivedAction:
    """The newest action. joints (n,): rad; None: it was refused. time: s when it came. step_s: s since the one before,
    within which the robot goes there. reason: why it was refused."""

    joints: FloatArray | None
    time: float
    step_s: float = LONGEST_STEP_S
    reason: str = ""


class Actions:
    """`retarget.human.samples.Samples` and `retarget.run.joint_targets.JointTargets` of actions.

    `put`, `refuse` and `clutch` are called by another thread than the rest: each replaces one object. In place of a
    performer a sample is held, which nothing follows. ticks: without end; kept: one.
    """

    ticks, kept, over = FOR_EVER, 1, False

    def __init__(self, held: Clip, first: FloatArray, *, fastest: FloatArray, clock: Clock, stale_s: float) -> None:
        """held: its first sample is held. first (n,): rad, the target before there is an action. fastest (n,): rad/s,
        of the servos. stale_s: an action that is older is signal loss, s. Raises UsageError for a limit that cannot be
        meant."""
        low, high = STALE_MS
        if not low <= 1e3 * stale_s <= high:
            raise UsageError(
                "impossible freshness limit",
                where="stale_ms",
                found=f"{1e3 * stale_s:g}",
                allowed=f"{low:g} to {high:g} ms",
            )
        self._held, self._clock, self._stale_s = held, clock, stale_s
        self._newest = ReceivedAction(None, -inf, reason="no action yet")
        self._taken: ReceivedAction | None = None
        self._target, self._fastest, self._now = np.array(first), fastest, clock.now()
        self._good, self._engaged = Debounce(), True
        self.dt = self.motion_dt = held.dt
        self._wrong = ""  # with actions, in a few words

    # From the thread that sends.

    def put(self, joints: FloatArray) -> None:
        """Take an action, (n,) rad, as the newest. One that no servo could get to in time is not bridged: it shows as a
        jump, to which the robot goes slowly."""
        now = self._clock.now()
        step = min(max(now - self._newest.time, self.dt), LONGEST_STEP_S)
        jumps = (np.abs(joints - self._target) > JUMP * self._fastest * step).any()
        self._newest = ReceivedAction(joints, now, 0.0 if jumps else step)

    def refuse(self, reason: str) -> None:
        """The newest action cannot be used: the robot holds until there is another."""
        self._newest = ReceivedAction(None, self._clock.now(), reason=reason)

    def clutch(self, *, engaged: bool) -> None:
        """Follow actions again, slowly from where the robot is; or hold it, without a limit in time."""
        self._engaged = engaged

    @property
    def begun(self) -> bool:
        """Whether there is an action."""
        return self._newest.joints is not None

    # From the thread of the ticks.

    @property
    def following(self) -> bool:
        """Whether actions have been fresh for long enough."""
        return self._good.good

    def reset_heading(self) -> bool:
        """Do nothing: actions have no heading."""
        return False

    @property
    def paused(self) -> bool:
        """Whether the operator holds the robot."""
        return not self._engaged

    @property
    def hold_reason(self) -> str:
        """Why the robot holds, in a few words."""
        return self._wrong or TOO_SHORT

    def poll(self) -> None:
        """Go on towards the newest action, so as to be there when the next one is due."""
        now, newest = self._clock.now(), self._newest
        step, self._now = now - self._now, now
        self._wrong = self._problem(newest, now)
        if newest.joints is None:
            return
        left = newest.step_s - (now - newest.time) + step  # [s] from the tick before
        if left <= step:
            self._target = newest.joints
        else:
            self._target = self._target + step / left * (newest.joints - self._target)

    def target(self) -> FloatArray:
        """The target of this tick, (n,) rad."""
        return self._target

    def may_approach(self) -> bool:
        """Whether actions have been fresh for long enough to move."""
        return self._good.step(self._now, good=not self._wrong)

    def sample(self, tick: int) -> SensorSample | None:
        """The held sample; None: there is no fresh action, and the robot is to hold."""
        return self._held.sample(0) if self.may_approach() or tick == 0 else None

    def hold(self) -> None:
        """The robot holds: it waits until actions have been fresh for long enough."""
        self._good.restart()

    def recorded(self) -> Clip:
        """The held sample."""
        return self._held

    def _problem(self, newest: ReceivedAction, now: float) -> str:
        if not self._engaged:
            return "paused by the operator"
        if newest.joints is None:
            return newest.reason
        if now - newest.time > self._stale_s:
            return f"no action for more than {1e3 * self._stale_s:.0f} ms"
        return ""
