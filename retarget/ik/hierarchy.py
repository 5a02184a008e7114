"""A priority file compiled for one body: a solver whose targets are set by name; and the scene around it.

The caller owns the target vector: `blank` makes it, the setters write this tick's targets, `solver.frame` reads it. A
target that is not set is absent. Names that no task uses are ignored.
"""

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from math import fsum, inf, sqrt

import numpy as np

from retarget import _solver
from retarget.arithmetic import expm1
from retarget.errors import ConfigError, suggest
from retarget.ik.solver import DAMPING
from retarget.ik.tasks import Limb, Slot, SlotKind, compile_task
from retarget.model.body import BodyModel, Frame, JointLimits
from retarget.model.observers import NO_SCENE, Observers
from retarget.model.scene_shapes import SceneShapes
from retarget.model.scene_state import ObstaclePoses, SceneState
from retarget.schema.priorities import Phase, Phased, Priorities
from retarget.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class _Place:
    slot: Slot
    start: int
    stop: int

    def set_spaces(self, targets: FloatArray, spaces: FloatArray) -> None:
        """Write half-spaces (k, m), and remove all others."""
        end = self.start + 1 + spaces.size
        targets[self.start] = 1.0
        targets[self.start + 1 : end] = spaces.ravel()
        targets[end : self.stop] = 0.0


class Hierarchy:
    """A priority file compiled for a body."""

    def __init__(
        self,
        priorities: Priorities,
        body: BodyModel,
        *,
        frames: Mapping[str, Frame],
        postures: Mapping[str, FloatArray],
        limits: JointLimits,
        fed: Container[str] | None = None,
        limbs: Mapping[str, Limb] | None = None,
        lengths: Mapping[str, float] | None = None,
        locked: BoolArray | None = None,
        iterations: int | None = None,
        damping: float | None = None,
        observers: Observers | None = None,
        scene: SceneShapes = NO_SCENE,
        phased: bool = False,
    ) -> None:
        """frames: of the names in `of`. postures: q (nq,) by name. fed: names whose targets will ever be set (all of
        `frames`); tasks on others are left out. lengths: m, of landmarks, for weights per length. locked (nv,): DoFs
        that never move. iterations: instead of the file's. damping: `DAMPING` for each iteration if absent, as every
        iteration lowers the error. phased: `set_phases` is called in every tick.

        Raises ConfigError: a name that the body lacks, or phases of support without `phased`.
        """
        watching = None if observers is None else observers.with_margin(priorities.observers.margin)
        names = () if watching is None else watching.names
        levels = _compile(
            priorities,
            body,
            frames,
            fed=frames if fed is None else fed,
            limbs=limbs or {},
            lengths=lengths or {},
            observers=names,
        )
        shapes = scene.with_margin(priorities.observers.obstacle_margin)
        self.observers = None if watching is None else watching.for_solver(body, shapes)
        n_ik = priorities.iterations if iterations is None else iterations
        self.solver = _solver.Solver(
            body.solver_body(),
            [[slot.task for slot in level] for level in levels],
            lower=limits.lower,
            upper=limits.upper,
            max_velocity=limits.max_velocity,
            max_acceleration=limits.max_acceleration,
            locked=np.zeros(body.nv, dtype=bool) if locked is None else locked,
            n_ik=n_ik,
            damping=DAMPING * n_ik if damping is None else damping,
            observers=self.observers,
            activation=priorities.activation,
        )
        self.slots = tuple(slot for level in levels for slot in level)
        if not phased and (by_phase := next((slot for slot in self.slots if slot.when), None)):
            raise ConfigError(
                f"the {by_phase.kind.value} of {by_phase.name} acts in some phases of support only",
                found=f"when: {', '.join(by_phase.when)}",
                next_step="Leave `when` out: it is for a human",
            )
        # Names of the entries of `solver.task_errors`.
        self.labels = tuple(f"{slot.kind.value} {slot.name}" for slot in self.slots)
        self._keep_places(levels)
        self._blank = self._make_blank(postures)

    def _keep_places(self, levels: Sequence[Sequence[Slot]]) -> None:
        self._places: dict[SlotKind, list[_Place]] = {kind: [] for kind in SlotKind}
        self._by_name: dict[tuple[SlotKind, str], list[_Place]] = {}
        self.spans: list[slice] = []  # of each level in the target vector
        end = 0
        for level, slots in enumerate(levels):
            start = end
            for index, slot in enumerate(slots):
                place = _Place(slot, *self.solver.target_slice(level, index))
                end = place.stop
                self._places[slot.kind].append(place)
                self._by_name.setdefault((slot.kind, slot.name), []).append(place)
            self.spans.append(slice(start, end))
        self._phased = [place for places in self._places.values() for place in places if place.slot.when]
        self._turned = [
            (place, place.slot.direction)
            for kind in (SlotKind.HEADING, SlotKind.AXIS)
            for place in self._places[kind]
            if place.slot.direction is not None
            and (place.slot.direction[:2] != (0.0, 0.0) or place.slot.lowered or place.slot.bent)
        ]

    def blank(self) -> FloatArray:
        """A target vector with only the targets that need no input: postures, upright axes, the CoM over the root."""
        return self._blank.copy()

    def clear(self, targets: FloatArray) -> None:
        """Make a used target vector blank again."""
        targets[:] = self._blank

    def set_position(self, targets: FloatArray, name: str, position: FloatArray, weight: float = 1.0) -> None:
        """Set a world position (3,) m."""
        self._set(targets, SlotKind.POSITION, name, position, weight)

    def position_slots(self, names: Sequence[str], kind: SlotKind = SlotKind.POSITION) -> tuple[IntArray, IntArray]:
        """Source (m,) and target (m, 4) indices for `targets[target] = block[source]`, block (len(names), 4) of weight,
        x, y, z."""
        found = [(row, place.start) for row, name in enumerate(names) for place in self._by_name.get((kind, name), ())]
        pairs = np.array(found, dtype=np.int64).reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1:] + np.arange(4)

    def weigh(self, targets: FloatArray, kind: SlotKind, name: str, weight: float) -> None:
        """Give the targets of a name that are set this weight; 1 is the priority file's."""
        for place in self._by_name.get((kind, name), ()):
            if targets[place.start] > 0.0:
                targets[place.start] = weight

    def set_orientation(self, targets: FloatArray, name: str, orientation: FloatArray, weight: float = 1.0) -> None:
        """Set a world orientation (4,) wxyz."""
        self._set(targets, SlotKind.ORIENTATION, name, orientation, weight)

    def set_look_at(self, targets: FloatArray, name: str, point: FloatArray, weight: float = 1.0) -> None:
        """Set the world point (3,) m that a frame aims at."""
        self._set(targets, SlotKind.LOOK_AT, name, point, weight)

    def set_centre_of_mass(self, targets: FloatArray, position: FloatArray, weight: float = 1.0) -> None:
        """Set the centre of mass of an `over_feet` task, world (3,) m."""
        self._set(targets, SlotKind.OVER_FEET, "over_feet", position, weight)

    def set_support(self, targets: FloatArray, spaces: FloatArray) -> None:
        """Set at most SUPPORT_EDGES half-spaces (k, 4) of the CoM: nx, ny, nz, d with nx x + ny y + nz z <= d."""
        for place in self._places[SlotKind.SUPPORT]:
            place.set_spaces(targets, spaces)

    def set_strength(self, targets: FloatArray, joint: str, spaces: FloatArray) -> None:
        """Set half-spaces (0 or 1, 7) n . c + m . o <= d of a joint that carries, for the centre of mass c and the
        joint's position o."""
        for place in self._by_name.get((SlotKind.STRENGTH, joint), ()):
            place.set_spaces(targets, spaces)

    def set_heading(
        self, targets: FloatArray, heading: Sequence[float], *, lowered: float = 0.0, bent: float = 0.0
    ) -> None:
        """Set the heading (x, y), a unit vector. lowered, bent: shares of an axis's lowered and bent direction, 0 to
        1."""
        cosine, sine = heading
        for place, (x, y, z) in self._turned:
            for direction, share in ((place.slot.lowered, lowered), (place.slot.bent, bent)):
                if direction is None:
                    continue
                u, v, w = direction
                x, y, z = x + share * (u - x), y + share * (v - y), z + share * (w - z)
                length = sqrt(x * x + y * y + z * z)
                x, y, z = x / length, y / length, z / length
            targets[place.start : place.stop] = (1.0, cosine * x - sine * y, sine * x + cosine * y, z)

    def set_phases(self, targets: FloatArray, shares: Mapping[Phase, float]) -> None:
        """Weigh tasks by the shares of the phases of support, of sum 1, after everything else is set."""
        for place in self._phased:
            targets[place.start] *= fsum(shares[phase] for phase in place.slot.when)

    def set_obstacles(self, poses: ObstaclePoses) -> None:
        """Set the obstacles at the start of the next frame. They go on at their velocities until the next call."""
        self.solver.set_obstacles(poses.position, poses.quat, poses.linear_velocity, poses.angular_velocity)

    def set_posture(self, targets: FloatArray, q: FloatArray) -> None:
        """Set another attractor (nq,) for this tick."""
        for place in self._places[SlotKind.POSTURE]:
            targets[place.start + 1 : place.stop] = q

    def set_joints(self, targets: FloatArray, columns: IntArray, positions: FloatArray) -> None:
        """Set the attractor of the joints at `columns` of q, (n,) rad, until `reset_posture`."""
        for place in self._places[SlotKind.POSTURE]:
            targets[place.start + 1 + columns] = positions

    def reset_posture(self, targets: FloatArray) -> None:
        """Set the attractor of the file again."""
        for place in self._places[SlotKind.POSTURE]:
            targets[place.start : place.stop] = self._blank[place.start : place.stop]

    def set_previous(self, targets: FloatArray, q: FloatArray, dt: float, *, settle: float = inf) -> None:
        """Set the posture (nq,) of `dt` s ago, which holds joints back. settle: s, where the task's is longer.

        With stiffness k and weight k / (exp(dt / settle) - 1) towards q, an undisturbed joint approaches its attractor
        as exp(-t / settle) at any rate of ticks.
        """
        for place in self._places[SlotKind.PREVIOUS]:
            targets[place.start] = 1.0 / expm1(min(dt / min(place.slot.settle, settle), 50.0))
            targets[place.start + 1 : place.stop] = q

    def set_carried(self, targets: FloatArray, position: Sequence[float], dt: float) -> None:
        """Set where the root would be carried, (3,) m, `dt` s after the last frame."""
        for place in self._places[SlotKind.CARRIED]:
            targets[place.start] = 1.0 / expm1(min(dt / place.slot.settle, 50.0))
            targets[place.start + 1 : place.stop] = position

    def _set(self, targets: FloatArray, kind: SlotKind, name: str, value: FloatArray, weight: float) -> None:
        for place in self._by_name.get((kind, name), ()):
            targets[place.start] = weight
            targets[place.start + 1 : place.stop] = value

    def _make_blank(self, postures: Mapping[str, FloatArray]) -> FloatArray:
        blank = np.zeros(self.solver.target_size)
        for kind in (SlotKind.OVER_ROOT, SlotKind.REACTIVE, SlotKind.PREVENTIVE):
            for place in self._places[kind]:
                blank[place.start] = 1.0
        for place in self._places[SlotKind.AXIS]:
            if place.slot.direction is not None and place.slot.direction[:2] == (0.0, 0.0):
                blank[place.start : place.stop] = (1.0, *place.slot.direction)
        for place in self._places[SlotKind.POSTURE]:
            name = place.slot.name
            if name not in postures:
                raise ConfigError("unknown posture", found=name, next_step=suggest(name, list(postures)))
            blank[place.start] = 1.0
            blank[place.start + 1 : place.stop] = postures[name]
        return blank


def _compile(
    priorities: Priorities,
    body: BodyModel,
    frames: Mapping[str, Frame],
    *,
    fed: Container[str],
    limbs: Mapping[str, Limb],
    lengths: Mapping[str, float],
    observers: tuple[str, ...],
) -> list[list[Slot]]:
    levels: list[list[Slot]] = []
    for index, level in enumerate(priorities.levels):
        is_soft = index == len(priorities.levels) - 1 and any(task.type == "posture" for task in level.tasks)
        slots: list[Slot] = []
        for task in level.tasks:
            made = compile_task(
                task, body, frames, fed=fed, is_soft=is_soft, limbs=limbs, lengths=lengths, observers=observers
            )
            when = task.when if isinstance(task, Phased) else None
            slots += made if when is None else [replace(slot, when=when) for slot in made]
        levels.append(slots)
    return levels


def body_frames(body: BodyModel) -> dict[str, Frame]:
    """Every named frame and link of a body."""
    return {name: body.frame(name) for name in (*body.body_names[1:], *(frame.name for frame in body.frames))}


Build = Callable[[Priorities, BoolArray], Hierarchy]  # from priorities and locked DoFs (nv,)


class SceneObstacles:
    """The obstacles of a hierarchy, s of the scene. Until `begin` they stand where they are at time 0."""

    def __init__(self, scene: SceneState | None) -> None:
        self.scene = scene
        self.time = 0.0  # of the next tick
        self.now: ObstaclePoses | None = None  # at the start of the current tick; None without a scene
        self._runs = False
        self.look()

    @property
    def shapes(self) -> SceneShapes:
        """The shapes that the hierarchy is built with."""
        return NO_SCENE if self.scene is None else self.scene.shapes

    def restart(self) -> None:
        """Go back to time 0, and drop poses that were received live."""
        if self.scene is not None:
            self.scene.restart()
        self.time, self._runs = 0.0, False
        self.look()

    def look(self) -> None:
        """Read the present poses, which may come live, unless the file moves them."""
        if self.scene is not None and not self._runs:
            self.now = self.scene.at_rest(self.time)

    def begin(self) -> None:
        """Let the obstacles move from the next tick on, from time 0."""
        self.time, self._runs = 0.0, False
        self.look()
        self._runs = True

    def tick(self, hierarchy: Hierarchy | None, dt: float) -> None:
        """Set the obstacles of a hierarchy, if any, at the start of a tick of `dt` s."""
        if self.scene is None:
            return
        self.now = self.scene.at(self.time) if self._runs else self.scene.at_rest(self.time)
        if hierarchy is not None:
            hierarchy.set_obstacles(self.now)
        if self._runs:
            self.time += dt
