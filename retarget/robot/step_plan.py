"""Step plan: the state machine of steps in place, the levels that they need, and whether a robot steps at all.

The machine is `TRANSITIONS`, which `StepPlan` executes: in each tick the first transition out of its state is taken
whose condition has held for longer than its time. While the performer is in flight, the robot stays planted.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum

from retarget.arithmetic import Dwell
from retarget.errors import ConfigError, UsageError
from retarget.model.body import Frame
from retarget.model.robot import RobotBody
from retarget.robot.balance import ENOUGH, moving_share, on_one_leg
from retarget.robot.crouch_envelope import MISSED_M
from retarget.schema.priorities import (
    CentreOfMassTask,
    Level,
    OrientationTask,
    PositionTask,
    PreventiveTask,
    Priorities,
    ReactiveTask,
    Steps,
)
from retarget.types import MM, Carrying

OVER_M = 0.003
"""Distance (m) inside the room over one sole that capture point and zero-moment point have before the other foot
lifts."""
HELD_S = 0.15
"""s for which it must have been over the sole by then, because servos lag behind their goals."""
CONTACT_WAIT_S = 1.0
"""Longest wait (s) for the contact of a sole that is in its place."""

FOOT = {Carrying.LEFT: 0, Carrying.RIGHT: 1}
"""The foot on which a performer stands alone: 0 left, 1 right."""


class StepState(Enum):
    """What the feet of the robot do."""

    DOUBLE_SUPPORT = "both soles planted, the weight between them"
    SHIFT_WEIGHT = "both soles planted, the weight on its way over the support foot"
    SWING = "on the support foot; the swing foot follows the performer's"
    TOUCHDOWN = "on the support foot; the swing foot on its way down to its place"
    RETURN_WEIGHT = "both soles planted, the weight on its way back between them"


@dataclass
class StepTally:
    """How often the performer lifted a foot, and how often the robot did; declined: how often it could not in time, and
    stayed planted."""

    asked: int = 0
    made: int = 0

    @property
    def declined(self) -> int:
        """Lifts of the performer that the robot did not make."""
        return self.asked - self.made


@dataclass(frozen=True)
class StepInput:
    """The input of a tick. foot: on which the performer stands alone, None where on both or in flight. over (2,): how
    far (m) the robot's balance is inside the room over its left sole, and over its right one. outside: whether its
    mass is to stand, and is outside the room of standing on both; settled: whether it rests where standing asks for
    it. down: whether the swing foot is in its place on the floor. contact (2,): whether each sole presses on the floor;
    True where it is not measured. risen: whether it is as high as one leg can carry it."""

    foot: int | None
    over: tuple[float, float]
    outside: bool
    settled: bool
    down: bool
    contact: tuple[bool, bool] = (True, True)
    risen: bool = True


@dataclass(frozen=True)
class StepTransition:
    """A change of state, after its condition has held for more than `after` s. The condition looks at the input and at
    the support foot."""

    start: StepState
    end: StepState
    condition: Callable[[StepInput, int | None], bool]
    after: float = 0.0


def _asked(now: StepInput, support: int | None) -> bool:
    """The performer stands on one foot, which is not the support foot yet."""
    return now.foot is not None and now.foot != support


def _no_longer_asked(now: StepInput, support: int | None) -> bool:
    """The performer does not stand on the support foot alone."""
    return now.foot is None or now.foot != support


def _weight_over_support_foot(now: StepInput, support: int | None) -> bool:
    """The balance is well inside the room over the support foot, which presses on the floor and can carry alone."""
    return support is not None and now.over[support] > OVER_M and now.contact[support] and now.risen


TRANSITIONS = (
    StepTransition(StepState.DOUBLE_SUPPORT, StepState.SHIFT_WEIGHT, _asked),
    StepTransition(StepState.DOUBLE_SUPPORT, StepState.RETURN_WEIGHT, lambda now, _: now.outside),
    StepTransition(StepState.SHIFT_WEIGHT, StepState.SHIFT_WEIGHT, _asked),
    StepTransition(StepState.SHIFT_WEIGHT, StepState.RETURN_WEIGHT, _no_longer_asked),
    StepTransition(StepState.SHIFT_WEIGHT, StepState.SWING, _weight_over_support_foot, after=HELD_S),
    StepTransition(StepState.SWING, StepState.TOUCHDOWN, _no_longer_asked),
    StepTransition(StepState.TOUCHDOWN, StepState.RETURN_WEIGHT, lambda now, _: now.down and all(now.contact)),
    StepTransition(StepState.TOUCHDOWN, StepState.RETURN_WEIGHT, lambda now, _: now.down, after=CONTACT_WAIT_S),
    StepTransition(StepState.RETURN_WEIGHT, StepState.SHIFT_WEIGHT, _asked),
    StepTransition(StepState.RETURN_WEIGHT, StepState.DOUBLE_SUPPORT, lambda now, _: now.settled),
)
"""A foot on its way down goes on to the floor, whatever is asked meanwhile. A step whose foot is down again before the
weight has shifted is declined. Weight that a stop left outside the room of standing goes back as after a step."""


class StepPlan:
    """`state`; `support`: the foot, 0 left or 1 right, that carries or is to carry alone, None where none is; `tally`.
    Deterministic; one `step` per tick."""

    state: StepState
    support: int | None

    def __init__(self) -> None:
        self.tally = StepTally()
        self.restart()

    def restart(self) -> None:
        """Plant both soles; the tally stays."""
        self._asked: int | None = None
        self._enter(StepState.DOUBLE_SUPPORT, None)

    @property
    def single_support(self) -> int | None:
        """The foot that carries alone; None while both soles are planted."""
        return self.support if self.state in (StepState.SWING, StepState.TOUCHDOWN) else None

    def step(self, now: StepInput, dt: float) -> None:
        """Go on by `dt` s."""
        if now.foot is not None and now.foot != self._asked:
            self.tally.asked += 1
        self._asked = now.foot
        for transition, dwell in self._leaving:
            if dwell.step(dt, holds=transition.condition(now, self.support)) > transition.after:
                self._enter(transition.end, now.foot)
                return

    def _enter(self, state: StepState, foot: int | None) -> None:
        """Enter a state. foot: on which the performer stands alone."""
        self.state = state
        if state is StepState.SHIFT_WEIGHT:
            self.support = foot
        elif state in (StepState.RETURN_WEIGHT, StepState.DOUBLE_SUPPORT):
            self.support = None
        self.tally.made += state is StepState.SWING
        self._leaving = [(transition, Dwell()) for transition in TRANSITIONS if transition.start is state]


# The levels of a robot that steps: what priorities ask of one that stands, and two more.
#
# A planted sole stays as high in the hierarchy as the file has it. One that swings drops below soles, balance and
# collisions, to a level of its own; and a level above that brings the mass over the sole that is to carry.

WEIGHT, SWINGING = "weight over the sole that carries", "sole that swings"
"""Names of the levels."""


def swinging(sole: str) -> str:
    """Name of a sole while it swings."""
    return f"swinging_{sole}"


def swinging_frames(frames: Mapping[str, Frame], soles: tuple[str, ...]) -> dict[str, Frame]:
    """Frames by name, and those of soles under the names that they have while they swing."""
    return dict(frames) | {swinging(sole): frames[sole] for sole in soles}


def stepping_priorities(priorities: Priorities, soles: tuple[str, ...]) -> Priorities:
    """These priorities with the levels of steps, below all that keeps a robot on its feet and clear of things.

    soles: names of their frames. Raises ConfigError where they do not plant the soles, or do not look at mass in
    motion.
    """
    _refuse_unplanted(priorities, soles)
    last = max(index for index, level in enumerate(priorities.levels) if _keeps_safe(level, soles))
    names = tuple(swinging(sole) for sole in soles)
    weight = CentreOfMassTask(type="centre_of_mass", mode="over_feet", weight=(1.0, 1.0, 0.0))
    made = (
        Level(name=WEIGHT, tasks=(weight,)),
        Level(
            name=SWINGING,
            tasks=(PositionTask(type="position", of=names), OrientationTask(type="orientation", of=names)),
        ),
    )
    levels = (*priorities.levels[: last + 1], *made, *priorities.levels[last + 1 :])
    return priorities.model_copy(update={"levels": levels})


def _keeps_safe(level: Level, soles: tuple[str, ...]) -> bool:
    """Whether a level plants a sole, keeps the balance or parts what is close."""
    for task in level.tasks:
        if isinstance(task, ReactiveTask | PreventiveTask):
            return True
        if isinstance(task, CentreOfMassTask) and task.mode == "support":
            return True
        if isinstance(task, PositionTask | OrientationTask) and set(soles) & set(task.of):
            return True
    return False


def _refuse_unplanted(priorities: Priorities, soles: tuple[str, ...]) -> None:
    for kind, called in ((PositionTask, "position"), (OrientationTask, "orientation")):
        planted = {name for _, _, task in priorities.tasks() if isinstance(task, kind) for name in task.of}
        missing = [sole for sole in soles if sole not in planted]
        if missing:
            raise ConfigError(
                "steps of a robot whose soles are not planted",
                where=f"priorities {priorities.name}",
                found=f"no task of type {called} for {', '.join(missing)}",
                allowed="tasks of type position and orientation for every sole",
                next_step="Choose --steps planted, or --priorities balanced",
            )
    if moving_share(priorities) is None:
        raise ConfigError(
            "steps of a robot whose balance does not look at motion",
            where=f"priorities {priorities.name}",
            found="no task of type centre_of_mass with moving",
            allowed="a centre_of_mass task of mode support with moving, as balanced has it",
            next_step="Choose --steps planted, or --priorities balanced",
        )


# Whether a robot steps: its priority file says so, or `--steps` instead, and its root and legs whether it can.

SOLES = 2
"""Soles of a robot that steps."""


def with_steps(
    priorities: Priorities, robot: RobotBody, asked: Steps | None, *, parts: str
) -> tuple[Priorities, tuple[str, ...]]:
    """The priorities with `asked` instead of their own `steps`, and notes for the operator: a robot that is too weak to
    stand on one leg, or cannot get its weight over it, stays planted.

    asked: None keeps those of the file. parts: of the robot that follow. Raises UsageError or ConfigError where this
    robot cannot step so, as it is mounted.
    """
    steps = priorities.steps if asked is None else asked
    notes: tuple[str, ...] = ()
    if steps is not None:
        fault = _fault(steps, robot, parts)
        if fault is not None:
            found, next_step = fault
            kind = ConfigError if asked is None else UsageError
            where = f"priorities {priorities.name}, steps" if asked is None else "--steps"
            raise kind(f"steps {steps} are not possible here", where=where, found=found, next_step=next_step)
    if steps == "shift":
        load, missed = on_one_leg(robot)
        why = f"{load}, more than {100 * ENOUGH:.0f}%" if load.share > ENOUGH else ""
        if missed > MISSED_M:
            why = f"its mass does not come over one sole while both are flat ({MM * missed:.1f} mm off)"
        if why:
            steps, notes = "planted", (f"both soles stay planted: {why}",)
    return priorities if steps == priorities.steps else priorities.model_copy(update={"steps": steps}), notes


def _fault(steps: Steps, robot: RobotBody, parts: str) -> tuple[str, str] | None:
    """What makes these steps impossible, and what to do."""
    name = robot.profile.name
    if steps == "follow" and robot.stands:
        return f"{name} stands on its own soles", "Choose --steps shift, or hang it (--bus physics --mount gantry)"
    if steps != "shift":
        return None
    if not robot.stands:
        return f"{name} does not stand on its own soles", "Choose --steps follow: its feet are free"
    if len(robot.profile.feet) != SOLES:
        return f"{name} has {len(robot.profile.feet)} soles", f"Choose --steps planted: {SOLES} are needed"
    if parts != "whole":
        return f"legs that are kept still (--parts {parts})", "Choose --parts whole"
    if "pelvis" not in robot.profile.landmarks:
        return f"{name} has no landmark pelvis", "Name one in the profile, or choose --steps planted"
    return None
