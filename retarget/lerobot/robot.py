"""The robot of LeRobot: a run in a thread of its own follows actions as it follows a performer."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

from hardware.clock import Clock, MonotonicClock
from hardware.errors import GuardError
from retarget.errors import InputError
from retarget.human.samples import Performance, Playback
from retarget.lerobot.actions import GOAL, POS, Actions, action_names, read_action
from retarget.lerobot.background import BackgroundRun, Connection
from retarget.model.robot import RobotBody, load_robot
from retarget.robot.follower import stance_angles
from retarget.run.joint_targets import following_targets
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.prepare import MakeBus, Prepared, performance_of, prepare_for
from retarget.schema.performer import Performer
from retarget.sources.open import SAMPLE, open_source
from retarget.types import Notify

STALE_MS = 200.0
"""Freshness limit, ms: six actions at 30 Hz."""
HELD_S = 0.1
"""Length, s, of the sample of the held performer."""


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """Parts of the program that wires a robot. operator: may stop its run. close: closes what `operator` opened."""

    make_bus: MakeBus
    operator: Callable[[Prepared], Operator]
    close: Callable[[], None] = lambda: None
    notify: Notify


@contextmanager
def following_actions(
    robot: RobotBody, options: RunOptions, wiring: Wiring, *, clock: Clock, stale_ms: float = STALE_MS
) -> Iterator[tuple[Prepared, Actions]]:
    """Yields a run of a robot that follows actions, ready to start, and its `Actions`. It begins in its stance.

    options: robot, bus and end. Raises RetargetError.
    """

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        """The performer of the sample, who is held, because a run needs one."""
        return performance_of(lambda: open_source(SAMPLE), Playback(end=HELD_S))(performer, robot)

    make_bus, notify = wiring.make_bus, wiring.notify
    with prepare_for(
        perform, options, clock=clock, make_bus=make_bus, goes_to_rest=True, notify=notify, robot=robot
    ) as prepared:
        machine, first = prepared.machine, robot.posture(stance_angles(robot))[robot.servo_columns]
        assert machine is not None, "a robot has servos"
        held, fastest = prepared.samples.recorded(), robot.joint_map.max_velocity
        actions = Actions(held, first, fastest=fastest, clock=clock, stale_s=1e-3 * stale_ms)
        goals = following_targets(robot, machine.follower, actions, first=first, dt=machine.dt)
        yield replace(prepared, samples=actions, machine=replace(machine, goals=goals)), actions


class HumanoidDevice:
    """A robot that follows joint targets: `connect`, then `send` and `observation` at any rate, and `disconnect`.

    Its run sends gated goals at the rate of the profile. Torque comes on with the first action: the robot goes slowly
    to its stance, then to the target. Without an action for `stale_ms` it holds; after 5 s it goes to rest.
    """

    def __init__(self, options: RunOptions, wiring: Wiring, *, stale_ms: float = STALE_MS) -> None:
        """Raises RetargetError for a robot that cannot be loaded."""
        self._options, self._wiring, self._stale_ms = options, wiring, stale_ms
        self._clock: Clock = MonotonicClock()
        self.robot = load_robot(options.robot, root=options.root)
        self.joints = self.robot.joint_map.joints
        self._names = action_names(self.joints)
        self._actions: Actions | None = None
        self.connection = Connection("robot", wiring.close)

    @property
    def action_features(self) -> dict[str, type]:
        """`<joint>.pos`, rad."""
        return dict.fromkeys(self._names, float)

    @property
    def observation_features(self) -> dict[str, type]:
        """`<joint>.pos`, then `<joint>.goal`, rad."""
        return dict.fromkeys([joint + suffix for suffix in (POS, GOAL) for joint in self.joints], float)

    def connect(self) -> None:
        """Open the bus and read the servos, without torque. Raises RetargetError."""
        run = BackgroundRun(
            self._prepared,
            operator=self._wiring.operator,
            begins=lambda: self._actions is not None and self._actions.begun,
            clock=self._clock,
            notify=self._wiring.notify,
        )
        self.connection.open(run)

    @contextmanager
    def _prepared(self) -> Iterator[Prepared]:
        following = following_actions(
            self.robot, self._options, self._wiring, clock=self._clock, stale_ms=self._stale_ms
        )
        with following as (prepared, self._actions):
            yield prepared

    def observation(self) -> dict[str, float]:
        """The newest reading, rad, by `observation_features`. Raises GuardError if it is not connected."""
        reading = self.connection.run("get_observation").reading
        values = [*reading.present.tolist(), *reading.goal.tolist()]
        return dict(zip(self.observation_features, values, strict=True))

    def send(self, action: Mapping[str, object]) -> dict[str, float]:
        """Take the target of all joints, rad, and return the goals that were sent last, by the same keys.

        Raises InputError for an action that is not finite or not whole: the robot holds until the next. GuardError if
        the robot has stopped, with the reason, or is not connected.
        """
        run, actions = self.connection.run("send_action"), self._actions
        assert actions is not None, "a run that has started has them"
        try:
            joints = read_action(action, self._names)
        except InputError as error:
            actions.refuse(f"the last action was refused: {error.problems[0].what}")
            raise
        if run.over:
            raise GuardError(
                "the robot does not follow any more",
                where="send_action",
                found=str(run.error or run.reading.reason or "the run is over"),
                then="See why, then disconnect and connect it again",
            )
        actions.put(joints)
        return dict(zip(self._names, run.reading.goal.tolist(), strict=True))

    def clutch(self, *, engaged: bool) -> None:
        """Follow actions again, slowly from where the robot is, or hold it without a time limit."""
        self.connection.run("clutch")
        assert self._actions is not None, "a run that has started has them"
        self._actions.clutch(engaged=engaged)

    def disconnect(self) -> None:
        """Brake, go to rest and switch torque off, within `background.JOIN_S`. Raises nothing. Ctrl-C meanwhile
        switches torque off at once. If `connection` still has a run then, cut the power or call this again."""
        self.connection.close()
