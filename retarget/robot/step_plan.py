"""Step plan: when a foot lifts, which levels a stepping robot has, and where its mass goes.

    BOTH -- the performer lifts a foot --> SHIFT -- the mass is over the other, held --> SWING
    SHIFT -- the performer's foot is down again: too fast, declined --> BACK
    SWING -- the performer's foot is down --> the robot's is put down --> BACK -- the mass is between them --> BOTH

While the performer is in flight, the robot stays planted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from retarget.errors import ConfigError, UsageError
from retarget.ik.support_polygon import Stance, convex_hull, support_edges
from retarget.ik.tasks import SUPPORT_EDGES
from retarget.model.body import Frame
from retarget.model.robot import RobotBody
from retarget.robot.balance import ENOUGH, GRAVITY, Edges, moving_spaces, one_leg_load, shrunk
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
from retarget.types import Carrying, FloatArray

OVER_M = 0.003
"""How far (m) inside the region over one sole the balance is before the other may lift."""
HELD_S = 0.15
"""s for which the balance must have been there by then, because servos lag behind their goals."""
CONTACT_WAIT_S = 1.0
"""Longest wait (s) for the contact of a sole that is in its place."""

_STANDS_ON = {Carrying.LEFT: 0, Carrying.RIGHT: 1}


class StepState(Enum):
    """What the feet of the robot do."""

    BOTH = "both soles planted, the mass between them"
    SHIFT = "both soles planted, the mass on its way over one"
    SWING = "on one sole"
    BACK = "both soles planted, the mass on its way back"


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
class Sight:
    """The input of a tick. performer: which feet of theirs carry. over: how far (m) the robot's balance is inside the
    region over its left sole, and over its right one; settled: whether its mass is where standing on both asks for it.
    down: whether the foot that swings is in its place on the floor. contact: whether the left sole presses on the
    floor, and the right one; True where it is not measured."""

    performer: Carrying
    over: tuple[float, float]
    settled: bool
    down: bool
    contact: tuple[bool, bool] = (True, True)


class StepPlan:
    """`state`; `onto`: the foot, 0 left or 1 right, that carries or is to carry alone, None where none is; `lowers`:
    whether the foot that swings is to come down. Deterministic; one `look` per tick."""

    def __init__(self) -> None:
        self.tally = StepTally()
        self.restart()

    def restart(self) -> None:
        """Plant both soles; the tally stays."""
        self.state, self.onto, self.lowers = StepState.BOTH, None, False
        self._performer, self._pending, self._held, self._waited = Carrying.BOTH, False, 0.0, 0.0

    state: StepState
    onto: int | None

    @property
    def feet(self) -> tuple[bool, bool]:
        """Whether the left sole is locked to the floor, and the right one."""
        return (True, True) if self.state is not StepState.SWING else (self.onto == 0, self.onto == 1)

    def return_weight(self) -> None:
        """Bring the mass back between both feet, where a stop left it outside the region of standing."""
        if self.state is StepState.BOTH:
            self.state, self.onto = StepState.BACK, None

    def look(self, sight: Sight, dt: float) -> None:
        """Go on by `dt` s."""
        self._count(sight.performer)
        wanted = _STANDS_ON.get(sight.performer)
        if self.state is StepState.SWING:
            self._swing(sight, wanted, dt)
        elif wanted is not None:
            self._shift(sight, wanted, dt)
        elif self.state is not StepState.BOTH:
            self.onto, self._held = None, 0.0
            self.state = StepState.BOTH if sight.settled else StepState.BACK

    def _count(self, performer: Carrying) -> None:
        """Count the performer's lifts; each is pending until the robot makes it or the performer's foot is down."""
        if performer is self._performer:
            return
        self._pending = performer in _STANDS_ON
        self.tally.asked += self._pending
        self._performer = performer

    def _shift(self, sight: Sight, wanted: int, dt: float) -> None:
        if self.state is not StepState.SHIFT or self.onto != wanted:
            self.state, self.onto, self._held = StepState.SHIFT, wanted, 0.0
        self._held = self._held + dt if sight.over[wanted] > OVER_M and sight.contact[wanted] else 0.0
        if self._held > HELD_S and self._pending:
            self.state, self.lowers = StepState.SWING, False
            self._pending = False
            self.tally.made += 1

    def _swing(self, sight: Sight, wanted: int | None, dt: float) -> None:
        """A foot that is on its way down goes on to the floor, whatever is asked meanwhile."""
        self.lowers = self.lowers or wanted != self.onto
        self._waited = self._waited + dt if self.lowers and sight.down else 0.0
        if self._waited > 0.0 and (all(sight.contact) or self._waited > CONTACT_WAIT_S):
            self.state, self.lowers, self._held = StepState.BACK, False, 0.0
            self.onto = None


# Step balance: where capture point and zero-moment point of a stepping robot are to be: over both feet, over one, or on
# the way.
#
# As in `StandingBalance`, each region is a share of the polygon that carries, about its middle. From one region to
# another the mass goes through their hull, while both soles carry. A region only ever grows, or shrinks to one that
# holds both points already: so no change of it asks for a jump.

WELL_INSIDE = 0.8
"""Share of the region of standing to which a mass comes back. The zero-moment point has to be behind the mass to push
it farther in, and would leave the region if the mass stood at its edge."""
WIDER = 1.4
"""Share of the regions that a shift of weight goes through, so that a mass at the edge of one gets away from there."""
PRESSED = 0.5
"""Share of the support polygon for the zero-moment point on such a way. It is more than that of the capture point, else
a mass at the edge could not be pushed away from there."""
MOST_CORNERS = SUPPORT_EDGES // 2
"""Each edge makes two half-spaces."""


def balance_in_motion(priorities: Priorities) -> float | None:
    """The share of the support in which priorities keep a mass in motion; None: they balance it as if at rest."""
    tasks = [task for _, _, task in priorities.tasks() if isinstance(task, CentreOfMassTask)]
    return min((task.moving for task in tasks if task.moving is not None), default=None)


class StepBalance:
    """Regions of one stance on two soles. both, on_the_way: of standing, and of every shift of weight; over: of
    standing on the left sole, and on the right one; room: around the middle of these, m. middles: of the soles, (2,) m:
    both, left, right."""

    def __init__(self, stance: Stance, share: float) -> None:
        """share: of what carries, about its middle."""
        outlines = [sole.outline for sole in stance.soles]
        polygons = [convex_hull(np.concatenate(outlines)), *(convex_hull(outline) for outline in outlines)]
        self.middles = (np.concatenate(outlines).mean(axis=0), *(outline.mean(axis=0) for outline in outlines))
        self.both: Edges = shrunk(stance.edges(0.0), share, stance).tolist()
        self._well_inside: Edges = shrunk(stance.edges(0.0), WELL_INSIDE * share, stance).tolist()
        self.over: tuple[Edges, ...] = tuple(
            support_edges([about(polygon, middle, share)]).tolist()
            for polygon, middle in zip(polygons[1:], self.middles[1:], strict=True)
        )
        wider = min(WIDER * share, 1.0)
        self.on_the_way, self._pressed = (
            _around(polygons, self.middles, size) for size in (wider, max(wider, PRESSED))
        )
        still = np.zeros(3)
        self.room = min(
            self.depth(region, np.array([*middle, 0.0]), still, still)
            for region, middle in zip(self.over, self.middles[1:], strict=True)
        )
        self._outlines: tuple[Edges, ...] = tuple(
            support_edges([outline]).tolist() for outline in (np.concatenate(outlines), *outlines)
        )

    def spaces(self, region: Edges, com: FloatArray, velocity: FloatArray, dt: float) -> FloatArray:
        """Half-spaces (k, 4) for a centre of mass after the next `dt` s, now at com (3,) m, moving at velocity (3,)
        m/s."""
        spaces = moving_spaces(region, com, velocity, dt, pressed=self._pressed if region is self.on_the_way else None)
        if region is self.both:
            return spaces
        # At the height of an even motion. Else a robot that may not go aside fast enough would throw up its arms.
        spaces[:, 3] -= spaces[:, 2] * float(com[2] + velocity[2] * dt)
        spaces[:, 2] = 0.0
        return spaces

    def pressed(self, region: Edges) -> Edges:
        """Where the zero-moment point may be of a mass that is to be in a region."""
        return self._pressed if region is self.on_the_way else region

    def depth(self, region: Edges, com: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> float:
        """How far (m) inside a region both points are, of a mass at (3,) m, with (3,) m/s and (3,) m/s^2."""
        height = float(com[2])
        capture = com + velocity * (height / GRAVITY) ** 0.5
        pressed = com - acceleration * (height / max(GRAVITY + float(acceleration[2]), 0.1 * GRAVITY))
        return min(_inside(region, capture), _inside(region, pressed))

    def place(self, asked: FloatArray) -> FloatArray:
        """The place (2,) m well inside the region of standing that is nearest to the one asked (2,) m, on the line to
        the middle."""
        middle = self.middles[0]
        share = 1.0
        for nx, ny, offset in self._well_inside:
            room = offset - nx * float(middle[0]) - ny * float(middle[1])
            out = nx * float(asked[0] - middle[0]) + ny * float(asked[1] - middle[1])
            if out > room:
                share = min(share, room / out)
        return np.asarray(middle + share * (asked - middle))

    def inside(self, com: FloatArray, feet: tuple[bool, bool]) -> float:
        """How far (m) a centre of mass (3,) is inside the outline of the soles that carry: left, right."""
        return _inside(self._outlines[0 if all(feet) else 2 - int(feet[0])], com)


def _around(polygons: Sequence[FloatArray], middles: Sequence[FloatArray], share: float) -> Edges:
    """Edges of the hull of polygons (c, 2), each at a share of its size about its middle (2,)."""
    corners = [about(polygon, middle, share) for polygon, middle in zip(polygons, middles, strict=True)]
    edges: Edges = support_edges([at_most(convex_hull(np.concatenate(corners)), MOST_CORNERS)]).tolist()
    return edges


def about(corners: FloatArray, middle: FloatArray, share: float) -> FloatArray:
    """Corners (c, 2) of a polygon at a share of its size about a point (2,)."""
    return np.asarray(middle + share * (corners - middle))


def at_most(corners: FloatArray, count: int) -> FloatArray:
    """A convex polygon (c, 2) without the corners that matter least to its area: never larger."""
    while len(corners) > count:
        before, after = np.roll(corners, 1, axis=0) - corners, np.roll(corners, -1, axis=0) - corners
        area = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
        corners = np.delete(corners, int(np.argmin(area)), axis=0)
    return corners


def _inside(region: Edges, point: FloatArray) -> float:
    x, y, _ = point.tolist()
    return float(min(offset - nx * x - ny * y for nx, ny, offset in region))


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
    if balance_in_motion(priorities) is None:
        raise ConfigError(
            "steps of a robot whose balance does not look at motion",
            where=f"priorities {priorities.name}",
            found="no task of type centre_of_mass with moving",
            allowed="a centre_of_mass task of mode support with moving, as balanced has it",
            next_step="Choose --steps planted, or --priorities balanced",
        )


# Whether a robot steps: its priority file says so, or `--steps` instead, and its root and legs whether it can.

SOLES = 2
"""Of a robot that steps."""


def with_steps(
    priorities: Priorities, robot: RobotBody, asked: Steps | None, *, parts: str
) -> tuple[Priorities, tuple[str, ...]]:
    """The priorities with `asked` instead of their own `steps`, and notes for the operator: a robot that is too weak to
    stand on one leg stays planted.

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
    if steps == "shift" and (load := one_leg_load(robot)).share > ENOUGH:
        steps = "planted"
        notes = (f"both soles stay planted: {load}, more than {100 * ENOUGH:.0f}%",)
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
