"""Actions of LeRobot, `{"<joint>.pos": rad}`, as targets of a run. Each is validated, and only the newest counts."""

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
"""Suffixes of the position of a joint, rad, as it was read and as it was sent."""
STALE_MS = (20.0, 2000.0)
"""Range of the freshness limit, ms, from two ticks of a fast robot."""
LONGEST_STEP_S = 0.1
"""Longest time, s, over which a step between two actions is spread."""
FOR_EVER = 10**9
"""Ticks of a performance without end."""
MOST_RAD = 100.0
"""Largest target, rad. A larger value is in other units."""


def action_names(joints: Sequence[str]) -> tuple[str, ...]:
    """The keys of an action for joints, in their order."""
    return tuple(joint + POS for joint in joints)


def read_action(action: Mapping[str, object], names: Sequence[str]) -> FloatArray:
    """The targets (n,), rad, of an action with these keys; others are ignored. Raises InputError that names every key
    that is missing, not finite, or beyond `MOST_RAD`."""
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
    """The value of a number, or of an array or tensor of one element; else NaN."""
    if isinstance(value, bool | str | bytes):
        return np.nan
    try:
        return float(value) if isinstance(value, Real) else float(np.asarray(value, dtype=np.float64).item())
    except (TypeError, ValueError, OverflowError, RuntimeError):  # RuntimeError: a tensor that needs its gradient
        return np.nan


@dataclass(frozen=True, eq=False)
class ReceivedAction:
    """An action. joints (n,): rad, None if it was refused. time: s, of its arrival. step_s: time, s, over which its
    step is spread. reason: of its refusal."""

    joints: FloatArray | None
    time: float
    step_s: float = LONGEST_STEP_S
    reason: str = ""


class Actions:
    """The newest action as `Samples` and as `JointTargets` of a run.

    `put`, `refuse` and `clutch` may be called by another thread: each replaces one object. The performer is a held
    sample, which nothing follows.
    """

    ticks, kept, over = FOR_EVER, 1, False

    def __init__(self, held: Clip, first: FloatArray, *, fastest: FloatArray, clock: Clock, stale_s: float) -> None:
        """first (n,): rad, the target before any action. fastest (n,): rad/s, of the servos. stale_s: age, s, from
        which an action is signal loss. Raises UsageError for a limit out of range."""
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
        self._problem = ""  # of the actions, in a few words

    # From the thread that sends.

    def put(self, joints: FloatArray) -> None:
        """Take an action, (n,) rad, as the newest. A step that no servo can make in time is not spread: the run sees a
        jump, and approaches it slowly."""
        now = self._clock.now()
        step = min(max(now - self._newest.time, self.dt), LONGEST_STEP_S)
        jumps = (np.abs(joints - self._target) > JUMP * self._fastest * step).any()
        self._newest = ReceivedAction(joints, now, 0.0 if jumps else step)

    def refuse(self, reason: str) -> None:
        """Take an action that cannot be used: the robot holds until the next."""
        self._newest = ReceivedAction(None, self._clock.now(), reason=reason)

    def clutch(self, *, engaged: bool) -> None:
        """Follow actions again, slowly from where the robot is, or hold it without a time limit."""
        self._engaged = engaged

    @property
    def begun(self) -> bool:
        """True if there is an action."""
        return self._newest.joints is not None

    # From the thread of the ticks.

    @property
    def following(self) -> bool:
        """True if actions have been fresh for long enough."""
        return self._good.good

    def reset_heading(self) -> bool:
        """Do nothing: actions have no heading."""
        return False

    @property
    def paused(self) -> bool:
        """True if the operator holds the robot."""
        return not self._engaged

    @property
    def hold_reason(self) -> str:
        """The reason why the robot holds, in a few words."""
        return self._problem or TOO_SHORT

    def poll(self) -> None:
        """Go on towards the newest action, to be there when the next one is due."""
        now, newest = self._clock.now(), self._newest
        step, self._now = now - self._now, now
        problem = ""
        if not self._engaged:
            problem = "paused by the operator"
        elif newest.joints is None:
            problem = newest.reason
        elif now - newest.time > self._stale_s:
            problem = f"no action for more than {1e3 * self._stale_s:.0f} ms"
        self._problem = problem
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
        """True if actions have been fresh for long enough to move."""
        return self._good.step(self._now, good=not self._problem)

    def sample(self, tick: int) -> SensorSample | None:
        """The held sample; None without fresh actions: the robot holds."""
        return self._held.sample(0) if self.may_approach() or tick == 0 else None

    def hold(self) -> None:
        """Wait again until actions have been fresh for long enough."""
        self._good.restart()

    def recorded(self) -> Clip:
        """The held sample."""
        return self._held
