"""`Pipeline`: from a sensor sample to checked joint goals in one call, for programs with their own loop and bus.

It calls the tick of a run, `retarget.run.tick.perform`, with servos that are always at their goals. It has no threads,
no bus and no clock, and reads configurations only.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import compress
from math import inf, isfinite
from numbers import Real
from pathlib import Path
from types import UnionType
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from hardware.clock import VirtualClock
from hardware.guard import Guard
from hardware.guard_state import GuardLimits, StopCause
from hardware.no_bus import NoBus
from retarget.errors import InputError, RefusedError, UsageError
from retarget.frames import SensorSample
from retarget.human.performer_calibration import Person
from retarget.human.reconstruction import Reconstructor
from retarget.human.rest_pose import fit_rest_pose
from retarget.human.samples import RATES_HZ, Parts, PerformerInput
from retarget.human.stance import refuse_sides, refuse_stance
from retarget.live.begin import live_rate_hz
from retarget.live.performer import base_sensors
from retarget.live.playout import OFF, SMOOTHINGS, pose_filter
from retarget.model.human import build_human
from retarget.model.human_dimensions import HumanDimensions
from retarget.model.robot import RobotBody, load_robot
from retarget.rotations import IDENTITY
from retarget.run.controllers import Commanded, RobotMotion
from retarget.run.options import RunOptions
from retarget.run.performers import SteppedPerformer
from retarget.run.prepare import robot_stage, scene_of, stage_priorities
from retarget.run.supervisor import AT_RISK, Event, OperatorInput, Supervisor
from retarget.run.tick import Failure, Machine, TickInput, TickState, caught, look_at, perform
from retarget.schema.catalogue import HUMAN
from retarget.schema.performer import Performer, load_performer
from retarget.sources.streams.stream_frame import unusable
from retarget.types import FloatArray, HumanPosture, RunState

DT_TOLERANCE = 0.01
"""Relative tolerance of `dt` against the period of the pipeline, for which the gate keeps speeds."""


@dataclass(frozen=True, eq=False, slots=True)
class Goal:
    """The result of one tick.

    joint_positions (n,): rad, by joint_names, to be sent now. gated: true if the gate refused the goal of following.
    hold_reason: why the robot holds, or has failed and brakes; else "". landmarks_asked, landmarks_reached (k, 3):
    desired and actual, m, by landmark_names, in the robot's world; NaN if the robot does not follow. Without a robot n
    and k are 0.
    """

    joint_names: tuple[str, ...]
    joint_positions: FloatArray
    gated: bool
    hold_reason: str
    human: HumanPosture
    landmark_names: tuple[str, ...]
    landmarks_asked: FloatArray
    landmarks_reached: FloatArray


class SensorReader:
    """The sensors of a performer in the samples of a caller, in the performer's order."""

    def __init__(self, performer: Performer) -> None:
        self.names = tuple(performer.sensors)
        self._performer = performer.name
        self._base = [self.names.index(name) for name in base_sensors(self.names)]
        self._given: tuple[str, ...] = ()
        self._columns: list[int] = []
        self.lost: tuple[str, ...] = ()
        """The base sensors that were not valid in the last sample."""

    def read(self, sample: SensorSample) -> SensorSample | None:
        """The sample without impossible poses; None if a base sensor is not valid.

        Raises UsageError for a sample without all sensors of the performer, or of a wrong shape.
        """
        if sample.names != self._given:
            self._columns, self._given = self._columns_of(sample.names), sample.names
        _check_shapes(sample)
        columns = self._columns
        position, orientation = sample.position.take(columns, axis=0), sample.orientation.take(columns, axis=0)
        turns = orientation.copy()
        turns[np.isnan(turns[:, 0])] = IDENTITY  # an unknown orientation is valid
        valid = sample.valid.take(columns) & ~unusable(position, turns)
        usable = valid.tolist()
        self.lost = tuple(self.names[row] for row in self._base if not usable[row])
        if self.lost or not any(usable):
            return None
        position[~valid], orientation[~valid] = np.nan, np.nan
        return SensorSample(self.names, position, orientation, valid)

    def _columns_of(self, names: tuple[str, ...]) -> list[int]:
        missing = [name for name in self.names if name not in names]
        if missing:
            raise UsageError(
                f"the sample does not have all sensors of performer {self._performer!r}",
                where="Pipeline, sample",
                found=f"no {', '.join(missing)}",
                allowed=", ".join(self.names),
                next_step="Name them so, with None (or valid False) for one that is lost, or choose another performer",
            )
        return [names.index(name) for name in self.names]


def _check_shapes(sample: SensorSample) -> None:
    """Raise UsageError unless the arrays have one row per name."""
    k = len(sample.names)
    found = sample.position.shape, sample.orientation.shape, sample.valid.shape
    if found != ((k, 3), (k, 4), (k,)):
        raise UsageError(
            "arrays of a wrong shape",
            where="SensorSample",
            found=f"position {found[0]}, orientation {found[1]}, valid {found[2]}",
            allowed=f"({k}, 3), ({k}, 4), ({k},) for {k} names",
        )


class Pipeline:
    """Three lines from a sensor sample to joint goals: `Pipeline(robot)`, `start(sample)`, and a `step` in every tick.

    Samples are in a world with z up and the ground at z = 0, in m. Deterministic: the same calls give the same goals.
    """

    def __init__(
        self,
        robot: str | Path | RobotBody | None,
        performer: str | Path | Performer = "five",
        *,
        rate_hz: float | None = None,
        priorities: str | None = None,
        parts: Parts = "whole",
        smoothing: str = OFF,
    ) -> None:
        """robot: a name, a path, or a robot; None or "human": only the performer is reconstructed. rate_hz: of your
        loop; None: that of the robot's profile. priorities: of the last stage, None: as for real servos. parts: `upper`
        keeps pelvis and legs still. smoothing: of the sensors, a name of `retarget.live.playout.SMOOTHINGS`. Raises
        UsageError, ConfigError, InputError, HardwareError."""
        robots, performers = str | Path | RobotBody | None, str | Path | Performer
        _check_type("robot", robot, robots, "a name, a path, what `retarget.load_robot` returns, or None")
        _check_type("performer", performer, performers, "a name, a path, or what `retarget.load_performer` returns")
        _check_type("priorities", priorities, str | None, "a name, a path, or None")
        _check_type("parts", parts, str, ", ".join(get_args(Parts)))
        _check_type("smoothing", smoothing, str, ", ".join(SMOOTHINGS))
        with _naming_arguments("performer"):
            self._performer = performer if isinstance(performer, Performer) else load_performer(performer)
        with _naming_arguments("robot"):
            self._robot = robot if isinstance(robot, RobotBody) else None
            if isinstance(robot, str | Path) and str(robot) != HUMAN:
                self._robot = load_robot(robot)
        with _naming_arguments():
            name = HUMAN if self._robot is None else self._robot.profile.name
            bus = "none" if self._robot is None else "profile"  # real servos: the robot has mass
            self._options = RunOptions(robot=name, bus=bus, priorities=priorities, parts=parts)
            self._priorities = stage_priorities(self._robot, self._options)[:2]
            self._filter = pose_filter(smoothing, len(self._performer.sensors))
        self.dt = 1.0 / _checked_rate(live_rate_hz(self._robot) if rate_hz is None else rate_hz)
        """s, the period of the loop that calls `step`."""
        self._sensors = SensorReader(self._performer)
        self._supervisor, self._now, self._operator = Supervisor(), 0.0, OperatorInput()
        self._reconstructor: Reconstructor | None = None
        self._human: HumanPosture
        self._samples: SteppedPerformer
        self._machine: Machine | None = None
        self._motion: RobotMotion
        self._state: TickState

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints of all goals, in their order; none without a robot."""
        return () if self._robot is None else self._robot.joint_map.joints

    @property
    def state(self) -> RunState:
        """IDLE before `start`, then APPROACH, FOLLOW or HOLD; after `stop` STOPPING, then OFF."""
        return self._supervisor.state

    @property
    def stands(self) -> bool:
        """True if the last goals were for one posture, so that no motion is left to brake."""
        return self._machine is None or self._supervisor.over or self._motion.stands(self._state.commanded)

    def start(
        self,
        sample: SensorSample,
        *,
        present: FloatArray | None = None,
        calibration: HumanDimensions | Person | None = None,
    ) -> None:
        """Begin with a performer who stands still as in `sample`. This takes half a second; goals begin with `step`.

        present: the robot's joint positions, rad (n,), from which it goes slowly to its stance, then to the performer's
        posture; None: those of the last goal, at first those of the stance. calibration: the performer's size; None: it
        is measured from the sample, a rest pose. Raises InputError for another pose, swapped sides, crossed limbs or
        invalid sensors, UsageError for impossible `present` and while the robot moves, HardwareError for a joint
        position that no servo reaches. After an error nothing has changed.
        """
        if not self.stands:
            raise UsageError(
                "the robot moves",
                where="Pipeline.start",
                found=self.state.value,
                next_step="Call stop(), and step(None, dt) until `stands`",
            )
        _check_type("sample", sample, SensorSample, A_SAMPLE, "Pipeline.start")
        first = self._sensors.read(sample)
        if first is None:
            valid = sample.valid & np.isfinite(sample.position).all(axis=1)
            names = compress(sample.names, valid)
            raise InputError(
                "the first sample does not show the performer",
                where="Pipeline.start",
                found=f"valid and finite: {', '.join(names) or 'no sensor'}",
                allowed=f"at least {', '.join(base_sensors(self._sensors.names))}",
                next_step="Wait for a sample in which they are valid",
            )
        allowed = "HumanDimensions, what `read_person` returns, or None"
        _check_type("calibration", calibration, HumanDimensions | Person | None, allowed, "Pipeline.start")
        human = build_human(_dimensions(first, calibration))
        for_human, for_robot = self._priorities
        reconstructor = Reconstructor(human, for_human, self._performer)
        performer = SteppedPerformer(first, self._filter)
        supervisor, machine = Supervisor(), None
        if self._robot is not None and for_robot is not None:
            scene = scene_of(self._robot, self._options)
            follower, gate = robot_stage(self._robot, for_robot, human, self._options, scene, dt=self.dt)
            dt = self.dt
            motion = RobotMotion(self._robot, reconstructor, follower, gate, first=first, dt=dt, motion_dt=dt)
            guard, commanded = self._armed(self._robot, motion, present)
            machine = Machine(self._robot, follower, gate, guard, supervisor, VirtualClock(), self.dt)
            self._state = TickState(commanded, sample=first)
            self._motion, self._human = motion, motion.follow.human
        else:
            self._human = reconstructor.start(first)
        self._reconstructor, self._samples, self._machine = reconstructor, performer, machine
        self._supervisor, self._now, self._operator = supervisor, 0.0, OperatorInput()
        for event in (Event.READY, Event.ARMED, *(() if machine else (Event.ARRIVED,))):
            supervisor.take(event, self._now)

    def _armed(self, robot: RobotBody, motion: RobotMotion, present: FloatArray | None) -> tuple[Guard, Commanded]:
        """A guard over servos that are always at their goals, and the commanded posture at the start."""
        last = None if self._machine is None else self._machine.guard.goal
        begin = motion.approach.first.joint_positions if last is None else last.joints
        if present is not None:
            begin = _within_reach(robot, present)
        bus = NoBus(VirtualClock(), start=robot.joint_map.to_ticks(begin))
        bus.open()
        guard = Guard(bus=bus, joint_map=robot.joint_map, limits=GuardLimits(max_pause=inf))
        guard.present()
        commanded = motion.begin(begin)
        guard.arm(commanded.goal)
        return guard, commanded

    def step(self, sample: SensorSample | None, dt: float) -> Goal:
        """The goal of the next tick. sample: the newest. For None, invalid base sensors, or sensors that move as no
        person can, the robot brakes on its soles, holds, and comes back slowly; `stop` ends a hold. dt: s, the period
        of your loop. Raises UsageError for another dt, other sensors, or before `start`; then nothing has changed.
        After any other error the robot brakes as after `stop`, and `hold_reason` gives it."""
        if self._reconstructor is None:
            raise UsageError("no performer yet", where="Pipeline.step", next_step="Call start(sample) first")
        _check_type("dt", dt, Real, f"{self.dt:g} s", "Pipeline.step")
        _check_type("sample", sample, SensorSample | None, f"None, or {A_SAMPLE}", "Pipeline.step")
        if not abs(dt - self.dt) <= DT_TOLERANCE * self.dt:
            raise UsageError(
                "another period than the pipeline's",
                where="Pipeline.step, dt",
                found=f"{dt:g} s",
                allowed=f"{self.dt:g} s",
                next_step="Give the period of your loop, not a measured time, and Pipeline(..., rate_hz=) its rate",
            )
        seen = None if sample is None else self._sensors.read(sample)
        self._now += self.dt
        lost = "no sample" if sample is None else f"no valid {', '.join(self._sensors.lost) or 'sensor'}"
        self._samples.take(self._now, seen, lost=lost)
        if self._machine is None:
            return self._without_robot(self._reconstructor)
        return self._moved(self._machine, self._motion)

    def stop(self) -> None:
        """Let the robot brake from the next `step` on; call that until `stands`. It holds until another `start`."""
        self._operator = OperatorInput(stop="Pipeline.stop")

    def _moved(self, machine: Machine, motion: RobotMotion) -> Goal:
        guard, performer, failures = machine.guard, PerformerInput(), list[Failure]()
        if self.state in AT_RISK:
            with caught(failures, StopCause.SOURCE):
                performer = look_at(self._samples, self._state.tick, approached=motion.approach.arrived)
        given = TickInput(self._now, 0.0, guard.read(), performer, self._operator, tuple(failures))
        output = perform(machine, motion, self._state, given).output
        self._state, stop = output.state, guard.stop
        if output.lost:
            self._samples.hold()
        assert guard.goal is not None, "the guard is armed"
        failed = "" if stop is None or stop.cause is StopCause.REQUESTED else stop.reason
        names = motion.approach.first.landmark_names
        unknown = np.full((len(names), 3), np.nan)
        return Goal(
            joint_names=self.joint_names,
            joint_positions=guard.goal.joints,
            gated=output.gated,
            hold_reason=machine.supervisor.hold_reason if output.run_state is RunState.HOLD else failed,
            human=motion.follow.human,
            landmark_names=names,
            landmarks_asked=unknown if output.followed is None else output.followed.landmarks_asked,
            landmarks_reached=unknown if output.followed is None else output.followed.landmarks_reached,
        )

    def _without_robot(self, reconstructor: Reconstructor) -> Goal:
        """The goal of the human alone, whose posture stays without a valid sample."""
        if self._operator.stop is not None:
            self._supervisor.take(Event.STOP, self._now)
        if self._samples.seen is not None:
            self._human = reconstructor.step(self._samples.seen, self.dt)
        nothing = np.zeros((0, 3))
        return Goal((), np.zeros(0), False, "", self._human, (), nothing, nothing)


A_SAMPLE = "a SensorSample, as `retarget.SensorSample.of(positions)` makes one"
"""Allowed type of a sample, in messages."""


def _check_type(argument: str, value: object, kinds: type | UnionType, allowed: str, call: str = "Pipeline") -> None:
    if not isinstance(value, kinds):
        found = f"{type(value).__name__} {value!r:.60}"
        raise UsageError("a wrong type", where=f"{call}, {argument}", found=found, allowed=allowed)


_OPTION = re.compile(r"--(?=(robot|performer|priorities|parts|smoothing)\b)")


@contextmanager
def _naming_arguments(argument: str = "") -> Iterator[None]:
    """Name arguments of `Pipeline` in errors, not command line options; `argument` in those without a place."""
    try:
        yield
    except RefusedError as error:
        problems = [
            replace(
                problem,
                where=_OPTION.sub("Pipeline, ", problem.where) or (argument and f"Pipeline, {argument}"),
                found=_OPTION.sub("", problem.found),
                next_step=_OPTION.sub("", problem.next_step),
            )
            for problem in error.problems
        ]
        raise type(error).from_problems(problems) from None


def _checked_rate(rate_hz: float) -> float:
    low, high = RATES_HZ
    _check_type("rate_hz", rate_hz, Real, f"{low:g} to {high:g} Hz, or None")
    if not (isfinite(rate_hz) and low <= rate_hz <= high):
        allowed = f"{low:g} to {high:g} Hz"
        raise UsageError(
            "impossible rate of ticks", where="Pipeline, rate_hz", found=f"{rate_hz:g} Hz", allowed=allowed
        )
    return float(rate_hz)


def _dimensions(first: SensorSample, calibration: HumanDimensions | Person | None) -> HumanDimensions:
    """The performer's size, measured from the first sample if it is not given."""
    names, position = tuple(compress(first.names, first.valid)), first.position[first.valid]
    at, turns = dict(zip(names, position, strict=True)), dict(zip(names, first.orientation[first.valid], strict=True))
    if calibration is not None:
        refuse_sides(at, where="the first sample", turns=turns)
        return calibration.dimensions if isinstance(calibration, Person) else calibration
    refuse_stance(at, where="the first sample", turns=turns)
    return fit_rest_pose(names, position, source="the first sample").dimensions


FAR_BEYOND = 0.35
"""Servos that were moved by hand may be this far beyond their limits, rad. Larger numbers are probably degrees."""


def _within_reach(robot: RobotBody, given: ArrayLike) -> FloatArray:
    """Check joint positions (n,) rad. Raises UsageError for impossible ones."""
    servos, where = robot.joint_map, "Pipeline.start, present"
    try:
        present = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        present = np.zeros(0)
    if present.shape != servos.lower.shape or not np.isfinite(present).all():
        allowed = f"{len(servos)} finite joint positions, rad, in the order of `joint_names`"
        raise UsageError("no joint positions", where=where, found=f"{given!r}"[:120], allowed=allowed)
    beyond = np.maximum(servos.lower - present, present - servos.upper)
    worst = int(beyond.argmax())
    if beyond[worst] <= FAR_BEYOND:
        return present
    raise UsageError(
        "no servo can stand there",
        where=where,
        found=f"{servos.joints[worst]} at {present[worst]:g} rad",
        allowed=f"{servos.lower[worst]:.2f} to {servos.upper[worst]:.2f} rad",
        next_step="Give the joint positions in radians, in the order of the profile's servos",
    )
