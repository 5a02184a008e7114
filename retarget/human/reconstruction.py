"""Stage 1, the paper's motion reconstruction: a few sensors move a virtual human of the performer's size.

A sample, live or of a file, passes through these steps:

    SensorLayout     reads the performer's sensors out of the sample
    SensorIntake     bridges losses, jumps and spikes; Reach draws in goals that no body of this size has
    Heading          estimates where the performer faces, for balance, crouch and pelvis (posture prior)
    Hierarchy        turns all goals into targets of strict levels (paper, Table 1, or another priority file)
    solver.frame     solves the prioritised inverse kinematics (paper, Figure 2)
    SecondPosture    frees a body that is tangled and misses its sensors

The upper levels follow the sensors. The lowest decides what no sensor measures.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil, fsum, inf, nan

import numpy as np

from retarget.arithmetic import Dwell, arctan2, cos, hypot, sin, squares
from retarget.frames import SensorSample
from retarget.human.heading import Heading
from retarget.human.posture_prior import ANKLES, Balance, Carried, Crouch, Ground, VirtualFeet
from retarget.human.sensor_intake import IntakeTimes, Reach, SensorIntake
from retarget.human.support_phase import CarryingFeet, PhaseShares
from retarget.ik.hierarchy import Hierarchy, SceneObstacles, body_frames
from retarget.ik.tasks import SlotKind
from retarget.model.human import POSTURES, Human, PostureReader, human_limits
from retarget.model.human_dimensions import POINTS
from retarget.model.observers import contacts, human_observers
from retarget.model.scene_state import SceneState
from retarget.rotations import Quat, as_quat, best_turn
from retarget.schema.performer import Performer
from retarget.schema.priorities import CarriedTask, CentreOfMassTask, PostureTask, Priorities
from retarget.types import BoolArray, Carrying, FloatArray, HumanPosture


@dataclass(frozen=True, eq=False, slots=True)
class SensorTurn:
    """A sensor's orientation. forward: its x axis on the ground. link (4,): of its link, world, wxyz."""

    sensor: str
    forward: tuple[float, float]
    link: FloatArray


class SensorLayout:
    """k sensors in the performer's order. A sensor that the source lacks is never valid.

    joints (k): row in POINTS of the joint of each. oriented: rows whose orientation is used.
    """

    def __init__(self, performer: Performer) -> None:
        self.names = tuple(performer.sensors)
        self.joints = [POINTS.index(sensor.joint) for sensor in performer.sensors.values()]
        self.oriented = [self.names.index(name) for name in performer.oriented]
        self._sample_names: tuple[str, ...] = ()
        self._columns = np.zeros(0, dtype=np.int64)
        self._exists: BoolArray = np.zeros(len(self.names), dtype=bool)

    def read(self, sample: SensorSample) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Positions (k, 3) m, orientations (k, 4) wxyz, and the mask (k,) of valid sensors."""
        if sample.names is not self._sample_names:
            self._sample_names = sample.names
            names = sample.names
            self._columns = np.array([names.index(name) if name in names else 0 for name in self.names], dtype=np.int64)
            self._exists = np.array([name in sample.names for name in self.names])
        position = sample.position.take(self._columns, axis=0)
        known = np.logical_and.reduce(np.isfinite(position), axis=1)
        valid = sample.valid.take(self._columns) & self._exists
        return position, sample.orientation.take(self._columns, axis=0), valid & known

    def turns(self, orientation: FloatArray) -> list[SensorTurn]:
        """The known and used orientations of (k, 4) wxyz."""
        found = []
        for row in self.oriented:
            turn = orientation[row]
            if np.isfinite(turn).all():
                w, x, y, z = turn.tolist()
                forward = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z))
                found.append(SensorTurn(self.names[row], forward, turn))
        return found


# A jump, or sensors that cross, can pull a body through itself into a posture from which no small motion leads back to
# its sensors. A natural posture in the same place gets there within a few frames.

_MISSED_M, _MISSED_S = 0.01, 0.05
"""A body is tangled if it misses a sensor within its reach by more m for more s."""
_TRIED_FRAMES, _REACHED_M = 16, 0.005  # most frames of the second posture, to come this near (m) to all sensors
_LEAST_FIT = 4  # fewer sensors do not determine how a body is turned
_BETTER = 0.5  # after its last frame the second posture also wins if it misses by this share of the body's miss


@dataclass(slots=True)
class SecondPosture:
    """A second posture q (nq,), solved one frame per tick beside a body that misses its sensors.

    missed: time for which the body has missed its sensors. limit_s: its limit, doubled by each failure, since a sensor
    can be where no body goes.
    """

    q: FloatArray | None = None
    frames: int = 0
    missed: Dwell = field(default_factory=Dwell)
    limit_s: float = _MISSED_S

    def is_due(self, missed: float, dt: float) -> bool:
        """True if this tick of `dt` s solves a frame. missed: m, of the body."""
        if missed <= _MISSED_M:
            self.q, self.frames, self.limit_s = None, 0, _MISSED_S
        return self.missed.step(dt, holds=missed > _MISSED_M) > self.limit_s

    def keep(self, q: FloatArray, missed: float, *, by_body: float) -> bool:
        """Keep q (nq,), which misses a sensor by `missed` m. True if it is to replace the body, which misses by
        `by_body`."""
        self.q, self.frames = q, self.frames + 1
        last = self.frames == _TRIED_FRAMES
        reached = missed < (_BETTER * by_body if last else _REACHED_M)
        if reached or last:
            self.q, self.frames, self.missed.held = None, 0, 0.0
            self.limit_s = _MISSED_S if reached else 2.0 * self.limit_s
        return reached


_SETTLING_S = 1.0  # length of a frame while settling, so long that no speed limit holds it back
_SETTLING_FRAMES = 200
_SETTLED = 1e-5  # settling ends when no coordinate changes by more per frame (m, rad)
_LONGEST_FRAME_S = 0.0101
"""Longest frame of the solver, that of 100 Hz: the few iterations of a longer one do not follow a fast hand."""
_MOST_PARTS = 50  # frames of a step: those of 0.5 s
_BALANCE = (SlotKind.OVER_ROOT, SlotKind.OVER_FEET)
_FOLLOWED = ("head", "l_wrist", "r_wrist", *ANKLES)  # sensors that strict levels follow

Points = dict[str, list[float]]


class Reconstructor:
    """Turns sensor samples into human postures: `start` takes the first, `step` each further one.

    sensors: names in the order of `HumanPosture.sensor_error`. hierarchy: compiled priorities.
    """

    def __init__(
        self,
        human: Human,
        priorities: Priorities,
        performer: Performer,
        *,
        iterations: int | None = None,
        scene: SceneState | None = None,
        intake: IntakeTimes | None = None,
    ) -> None:
        """scene: in the performer's world. Raises ConfigError if the priorities name a thing that the human lacks."""
        self._human = human
        self._layout = SensorLayout(performer)
        self.sensors = self._layout.names
        self._feet = None if set(ANKLES) & set(self._layout.names) else VirtualFeet(human.dimensions)
        names = self._layout.names + (() if self._feet is None else ANKLES)
        self._names, self._sensor_count = names, len(self._layout.names)
        sensor_frames = {name: human.body.frame(sensor.joint) for name, sensor in performer.sensors.items()}
        self.scene_obstacles = SceneObstacles(scene)
        self.observers = human_observers(human, priorities.observers)
        build = partial(
            Hierarchy,
            priorities,
            human.body,
            frames=body_frames(human.body) | sensor_frames,
            postures={name: human.posture(name) for name in POSTURES},
            limits=human_limits(human.body),
            fed=names,
            locked=human.locked,
            iterations=iterations,
            observers=self.observers,
            scene=self.scene_obstacles.shapes,
            phased=True,
        )
        self.hierarchy, self._second_hierarchy = build(), build()
        self._reader = PostureReader(human)
        standing = dict(zip(POINTS, human.dimensions.standing().tolist(), strict=True))
        above = standing["head"][2] - standing["l_ankle"][2]
        self._heading = Heading(priorities.heading, above, feet=self._feet is None)
        tasks = [task for _, _, task in priorities.tasks()]
        over_feet = [task for task in tasks if isinstance(task, CentreOfMassTask) and task.mode == "over_feet"]
        self._balance = Balance(over_feet[0]) if over_feet else None
        self._balance_error = next((i for i, slot in enumerate(self.hierarchy.slots) if slot.kind in _BALANCE), None)
        self._carried = next((Carried(task.by) for task in tasks if isinstance(task, CarriedTask)), None)
        self._crouch = next(
            (
                Crouch(human, upright=task.towards, lowered=task.lowered)
                for task in tasks
                if isinstance(task, PostureTask) and task.lowered is not None
            ),
            None,
        )
        self._depth = self._crouch or Crouch(human, upright="natural", lowered="crouch")
        joints_of = self._layout.joints + ([] if self._feet is None else [POINTS.index(name) for name in ANKLES])
        self._joints_of = np.array(joints_of, dtype=np.int64)
        self._carrying: CarryingFeet | None = None
        self._phases, self._ankles = PhaseShares(), [POINTS.index(name) for name in ANKLES]
        self._intake = SensorIntake(len(names), intake)
        self._reach = Reach(names, [POINTS[index] for index in joints_of], human.dimensions)
        self._source, self._slots = self.hierarchy.position_slots(names)
        self._block = np.zeros((len(names), 4))
        self._targets, self._q = self.hierarchy.blank(), human.posture("natural")
        self._reached = self._reader.joints(self._q[None])[0, self._joints_of]
        self._followed = np.array([name in _FOLLOWED for name in names])
        self._second = SecondPosture()

    def start(self, sample: SensorSample) -> HumanPosture:
        """The converged posture of the first sample, at rest."""
        position, orientation, valid = self._layout.read(sample)
        measured = {name: at for name, at, ok in zip(self.sensors, position.tolist(), valid, strict=True) if ok}
        turns = self._layout.turns(np.where(valid[:, None], orientation, np.nan))
        self._heading.start(measured, _facing(turns))
        if self._feet is not None:
            self._feet.start(
                measured.get("head", [0.0, 0.0, 0.0]), self._heading.forward, crouch=self._lowered(measured)
            )
            position, orientation, valid = self._with_feet(position, orientation, valid)
        self._intake.start(position, orientation, valid)
        self._reach.clamp(self._intake.position, self._intake.present)
        if self._balance is not None:
            self._balance.start()
        if self._carried is not None:
            self._carried.start()
        self._carrying, self._phases = None, PhaseShares()
        self.scene_obstacles.restart()
        self._q = self._placed()
        self.scene_obstacles.tick(self.hierarchy, 0.0)
        points = self._present(self._intake.position)
        # Solve the first sample again and again, without the past of a motion.
        for _ in range(_SETTLING_FRAMES):
            self.hierarchy.solver.reset(self._q)
            before = self._q
            self._solve(points, turns, _SETTLING_S, self._intake.position)
            if float(np.abs(self._q - before).max()) < _SETTLED:
                break
        self.hierarchy.solver.reset(self._q)
        self._second = SecondPosture()
        self.scene_obstacles.begin()
        # Virtual feet follow the head, so they show nothing of the support phase.
        self._carrying = CarryingFeet() if self._feet is None else None
        return self._posture(0.0)

    def resume(self, speed: float = 1.0) -> None:
        """Go on after a hold: the body goes slowly to its sensors. speed: of the performer's time."""
        self._intake.resume(speed)

    @property
    def away(self) -> float:
        """Greatest distance of a sensor from its goal, m."""
        return self._intake.away

    def step(self, sample: SensorSample, dt: float) -> HumanPosture:
        """The posture `dt` s later. Missing sensors take no part, and come and go without a jump."""
        position, orientation, valid = self._layout.read(sample)
        if self._feet is not None:
            known = self._present(self._intake.position)
            if "head" in known:
                self._feet.step(known["head"], self._heading.forward, crouch=self._lowered(known), dt=dt)
            position, orientation, valid = self._with_feet(position, orientation, valid)
        intake, missed = self._intake, self._missed(self._reached)
        # A long step is solved in frames of at most _LONGEST_FRAME_S, with goals on straight lines between the samples.
        # A sensor that has just come back has no line.
        before, present = intake.position.copy(), intake.present.copy()
        intake.step(position, orientation, valid, reached=self._reached, dt=dt)
        self._reach.clamp(intake.position, intake.present)
        before[~present] = intake.position[~present]
        turns = self._layout.turns(intake.orientation)
        parts = min(max(ceil(dt / _LONGEST_FRAME_S - 1e-6), 1), _MOST_PARTS)
        for part in range(1, parts + 1):
            at = intake.position if part == parts else before + (part / parts) * (intake.position - before)
            points = self._present(at)
            # Virtual feet count as planted feet do: they steady the heading.
            self._heading.step(points, _facing(turns), dt=dt / parts)
            self.scene_obstacles.tick(self.hierarchy, dt / parts)
            self._solve(points, turns, dt / parts, at)
        if self._second.is_due(missed, dt):
            self._try_second_posture(missed)
        return self._posture(dt)

    def _missed(self, reached: FloatArray) -> float:
        """Greatest distance, m, of a strictly followed goal from its sensor at (k, 3) m."""
        away = np.where(self._intake.present[:, None], self._intake.position - reached, 0.0)
        return float(np.sqrt(squares(away[self._followed]).max(initial=0.0)))

    def _try_second_posture(self, missed: float) -> None:
        """Solve one frame of the second posture, and take it over if it misses the sensors by less."""
        hierarchy, targets = self._second_hierarchy, self._targets
        begin = self._fitted() if self._second.q is None else self._second.q
        hierarchy.solver.reset(begin)
        if self.scene_obstacles.now is not None:
            hierarchy.set_obstacles(self.scene_obstacles.now)
        # The pelvis is carried from the body's place, as a jump of it would be seen.
        hierarchy.set_previous(targets, begin, _SETTLING_S)
        q = hierarchy.solver.frame(targets, _SETTLING_S)
        away = self._missed(self._reader.joints(q[None])[0, self._joints_of])
        scene, observers = self.scene_obstacles.scene, self.observers
        if away < missed and scene is not None and observers is not None:
            # The obstacle may be what keeps the body away.
            without_self = replace(observers, pairs=np.zeros((0, 2), dtype=np.int64))
            if contacts(self._human.body, without_self, scene, q, time=self.scene_obstacles.time):
                away = inf
        if self._second.keep(q, away, by_body=missed):
            self._q = q
            self.hierarchy.solver.reset(q)

    def _solve(self, points: Points, turns: list[SensorTurn], dt: float, at: FloatArray) -> None:
        """Set all targets and solve one frame. at (k, 3) m: all goals; `points`: those present."""
        hierarchy, targets, heading = self.hierarchy, self._targets, self._heading.forward
        feet = [points[name] for name in ANKLES if name in points]
        lowered, bent = self._crouched(points, feet)
        hierarchy.clear(targets)
        self._block[:, 0] = self._intake.present
        self._block[:, 1:] = at
        targets[self._slots] = self._block[self._source]
        for turn in turns:
            hierarchy.set_orientation(targets, turn.sensor, turn.link)
        if self._balance is not None:
            self._balance.step(feet, heading, dt=dt, lowered=lowered)
            hierarchy.set_centre_of_mass(targets, self._balance.goal, self._balance.weight)
        if self._crouch is not None and "head" in points:
            hierarchy.set_posture(targets, self._crouch.posture(lowered))
        hierarchy.set_heading(targets, heading, lowered=lowered, bent=bent)
        hierarchy.set_previous(targets, self._q, dt)
        if self._carried is not None:
            carried = self._carried.step(self._q[:3].tolist(), points, dt)
            if "pelvis" not in points:
                hierarchy.set_carried(targets, carried, dt)
        carrying = Carrying.BOTH if self._carrying is None else self._carrying.carrying
        hierarchy.set_phases(targets, self._phases.step(carrying, dt))
        self._q = hierarchy.solver.frame(targets, dt)

    def _posture(self, dt: float) -> HumanPosture:
        joints, orientations, centre_of_mass = self._reader.read(self._q)
        self._reached = joints.take(self._joints_of, axis=0)
        # Virtual feet come after the sensors and have no measurement.
        error = (self._intake.measured - self._reached)[: self._sensor_count]
        distance = np.sqrt(squares(error))
        if not self._intake.all_present:
            distance[~self._intake.present[: self._sensor_count]] = np.nan
        solver, balance, ankles = self.hierarchy.solver, self._balance_error, joints[self._ankles].tolist()
        return HumanPosture(
            q=self._q,
            joint_names=POINTS,
            joints=joints,
            orientations=orientations,
            centre_of_mass=centre_of_mass,
            sensor_error=distance,
            balance_error=nan if balance is None else float(solver.task_errors[balance]),
            heading=self._heading.forward,
            observer_modes=solver.observer_modes,
            carrying=Carrying.BOTH if self._carrying is None else self._carrying.step(ankles, dt),
        )

    def _placed(self) -> FloatArray:
        forward = self._heading.forward
        half = 0.5 * arctan2(forward[1], forward[0])
        return self._turned((cos(half), 0.0, 0.0, sin(half)))

    def _fitted(self) -> FloatArray:
        """A natural posture (nq,) in the orientation that best fits the sensors, even upside down."""
        present = self._intake.present
        if np.count_nonzero(present) < _LEAST_FIT:
            return self._placed()
        at_rest = self._reader.joints(self._human.posture("natural")[None])[0, self._joints_of]
        return self._turned(as_quat(best_turn(at_rest[present], self._intake.position[present])))

    def _turned(self, orientation: Quat) -> FloatArray:
        q = self._human.posture("natural")
        q[3:7] = orientation
        present = self._intake.present
        if present.any():
            joints = self._reader.joints(q[None])[0]
            # The mean offset is the least squares translation.
            q[:3] += (self._intake.position - joints[self._joints_of])[present].mean(axis=0)
        return q

    def _present(self, at: FloatArray) -> Points:
        goals = zip(self._names, at.tolist(), self._intake.present.tolist(), strict=True)
        return {name: goal for name, goal, is_present in goals if is_present}

    def _with_feet(
        self, position: FloatArray, orientation: FloatArray, valid: BoolArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        assert self._feet is not None
        feet, unknown = self._feet.ankles, np.full((2, 4), np.nan)
        return (
            np.concatenate([position, feet]),
            np.concatenate([orientation, unknown]),
            np.concatenate([valid, [True, True]]),
        )

    def _crouched(self, points: Points, feet: list[list[float]]) -> tuple[float, float]:
        """Shares, 0 to 1, by which the body is lowered and bent over."""
        if self._crouch is None or "head" not in points or not feet:
            return 0.0, 0.0
        (x, y, z), (ahead, aside) = points["head"], self._heading.forward
        lowered = self._crouch.share(max(hypot(hypot(x - u, y - v), z - w) for u, v, w in feet))
        middle = [fsum(foot[axis] for foot in feet) / len(feet) for axis in (0, 1)]
        return lowered, self._crouch.bent(lowered, (x - middle[0]) * ahead + (y - middle[1]) * aside)

    def _lowered(self, points: Points) -> float:
        assert self._feet is not None
        return self._depth.share_by_height(points["head"][2] - self._feet.ankle_height) if "head" in points else 0.0


def _facing(turns: list[SensorTurn]) -> dict[str, Ground]:
    return {turn.sensor: turn.forward for turn in turns}
