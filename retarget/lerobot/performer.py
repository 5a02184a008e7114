"""The teleoperator of LeRobot: a run without servos, in a thread of its own, whose gated goals are the actions."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from math import inf, isfinite

from hardware.clock import Clock, MonotonicClock
from hardware.errors import GuardError
from hardware.no_bus import NoBus
from retarget.errors import UsageError
from retarget.lerobot.actions import action_names
from retarget.lerobot.background import BackgroundRun, Connection
from retarget.model.robot import RobotBody, load_robot
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.prepare import Perform, Prepared, prepare_for
from retarget.types import Notify

LONGEST_DELAY_S = 600.0
"""Longest time, s, before a performance begins."""
STALE_S = 0.5
"""Greatest age of a goal, s, some 50 ticks: older ones show that the run hangs."""


@dataclass(frozen=True, kw_only=True)
class PerformerWiring:
    """Parts of the program that wires a performer. perform: the performance, called in the thread of the run with a
    function that raises KeyboardInterrupt once the run is to end. operator: may hold or stop the run. close: closes
    what `perform` opened."""

    perform: Callable[[Callable[[], None]], Perform]
    operator: Callable[[Prepared], Operator]
    close: Callable[[], None]
    notify: Notify


class PerformerDevice:
    """A performer who gives joint goals: `connect`, then `action` at any rate, and `disconnect`.

    From the first `action` the goal is the stance of the robot for `delay_s`, in which a real robot gets there; then it
    follows the performer. After a file its last goal stays. A performer who is lost for 5 s is an error.
    """

    def __init__(self, options: RunOptions, wiring: PerformerWiring, *, delay_s: float) -> None:
        """Raises RetargetError for a robot that cannot be loaded, UsageError for a delay out of range."""
        if not (isfinite(delay_s) and 0.0 <= delay_s <= LONGEST_DELAY_S):
            allowed = f"0 to {LONGEST_DELAY_S:g} s"
            raise UsageError("impossible delay", where="delay_s", found=f"{delay_s:g}", allowed=allowed)
        self._options, self._wiring, self._delay_s = options, wiring, delay_s
        self._clock: Clock = MonotonicClock()
        self._robot = load_robot(options.robot, root=options.root)
        self._names = action_names(self._robot.joint_map.joints)
        self.connection = Connection("performer", wiring.close)
        self._begins_at = inf  # [s]

    @property
    def action_features(self) -> dict[str, type]:
        """`<joint>.pos` of the robot, rad."""
        return dict.fromkeys(self._names, float)

    def connect(self) -> None:
        """Open the source and wait until the performer is measured. Raises RetargetError."""
        run = BackgroundRun(
            lambda: self._prepared(run.refuse_ended),
            operator=self._wiring.operator,
            begins=lambda: self._clock.now() >= self._begins_at,
            clock=self._clock,
            notify=self._wiring.notify,
        )
        self.connection.open(run)

    def _prepared(self, look: Callable[[], None]) -> AbstractContextManager[Prepared]:
        """A run without servos that ends once it has braked. look: see `PerformerWiring.perform`."""
        self._begins_at = inf

        def standing(robot: RobotBody, clock: Clock) -> NoBus:
            stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
            return NoBus(clock, start=robot.joint_map.to_ticks(stand))

        return prepare_for(
            self._wiring.perform(look),
            self._options,
            clock=self._clock,
            make_bus=standing,
            goes_to_rest=False,
            notify=self._wiring.notify,
            robot=self._robot,
            has_deadlines=False,
        )

    def action(self) -> dict[str, float]:
        """The newest goals, rad, by `action_features`. Raises GuardError if the performer was lost for too long, the
        run hangs, or it is not connected."""
        run = self.connection.run("get_action")
        self._begins_at = min(self._begins_at, self._clock.now() + self._delay_s)
        if run.over and run.error is not None:
            raise GuardError("the performer is not followed any more", where="get_action", found=str(run.error))
        reading = run.reading
        age = self._clock.now() - reading.time
        if age > STALE_S and not run.over:
            raise GuardError(
                "the performer gives no new goals",
                where="get_action",
                found=f"the last is {age:.1f} s old, allowed {STALE_S:g} s",
                then="See what blocks this program: the source, or a busy machine",
            )
        return dict(zip(self._names, reading.goal.tolist(), strict=True))

    def disconnect(self) -> None:
        """Close the source. Raises nothing."""
        self.connection.close()
