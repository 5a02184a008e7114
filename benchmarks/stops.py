"""Stops of robots with mass. One run is forked at ticks that are drawn: each child asks for a stop and plays on to its
end, while the parent waits and then follows on. So one run gives many stops, and its own end."""

from __future__ import annotations

import json
import os
import traceback
from dataclasses import asdict, dataclass, replace

import numpy as np

from benchmarks.robustness import motion
from hardware.bus import ServoBus, ServoGoals
from hardware.clock import Clock, VirtualClock
from hardware.errors import RetargetError
from retarget.cli.buses import PhysicsBench
from retarget.cli.exit import StopRequest
from retarget.cli.operator import RunOperator
from retarget.frames import SensorFrames, SensorSample
from retarget.human.calibration import calibrate
from retarget.human.samples import Clip, Playback, lay_on_ticks
from retarget.model.robot import RobotBody, load_robot
from retarget.pipeline import Pipeline
from retarget.report.motion_metrics import standing_of
from retarget.run.options import PhysicsOptions, RunOptions
from retarget.run.performers import RecordedPerformer
from retarget.run.prepare import Prepared, prepare
from retarget.run.supervisor import AT_RISK, OperatorInput
from retarget.schema.performer import load_performer
from retarget.types import RunState
from sim.physics.witness import Witness, WitnessedBus

DRAWN = ("mass", "centre_of_mass", "friction", "latency")
CONDITIONS: dict[str, tuple[str, ...]] = {"planned": (), "drawn": DRAWN, "soft": ("stiffness=0.6",)}
"""What is simulated otherwise than planned: perturbations, those without a number drawn."""
MOTION = "end of the motion"
APPROACH, FOLLOW, LOST, JUMP = "approach", "follow", "sensors lost", "sensors jump"
CALM, DISTURBED = (*[FOLLOW] * 5, APPROACH), (FOLLOW, LOST, JUMP, APPROACH)
"""Kinds of stops in their order, of a run without and with sensors that are lost and jump."""
APPROACH_S = (0.7, 3.0)
"""Stops of an approach are drawn from these times, s after torque went on: a hand holds the robot until 0.6 s."""
GAP_S, LOST_S, JUMP_S = (1.5, 4.0), (0.5, 1.5), (0.1, 0.6)
"""Times, s, between two disturbances, of sensors that are lost, and of sensors that are displaced."""
AFTER_S = 0.4
"""A stop belongs to a disturbance for so long after its end, s: the robot holds, or blends back."""
JUMP_M = 0.35
"""Standard deviation of a displacement of wrists and head, m on each axis."""
SETTLED_S = 0.2
"""Servos still move for so long, s, when no motion is left in their goals."""
ROUND_S = 1e-3
"""Times are kept to a millisecond, s, which is less than a tick."""
STOOD_S = 1.0
"""Time, s, that a loop of one's own is watched for when it stands."""


@dataclass(frozen=True)
class Case:
    """One run and its stops. condition: of CONDITIONS. end: s of the recording. disturbed: sensors are lost and jump.
    own_loop: the run is a loop over `Pipeline`, which ends standing with torque."""

    robot: str
    source: str
    scene: str | None
    condition: str
    seed: int
    end: float
    stops: int
    disturbed: bool
    own_loop: bool

    @property
    def options(self) -> RunOptions:
        """The options of the run."""
        physics = PhysicsOptions(seed=self.seed, perturbations=CONDITIONS[self.condition])
        return RunOptions(
            robot=self.robot, bus="physics", scene=self.scene, physics=physics, playback=Playback(end=self.end)
        )


@dataclass(frozen=True)
class Ended:
    """How a run ended. kind: of its stop; at: s of the simulation, before: state of the run, when the stop came.

    state: of the run at its end. how: it fell or toppled, or was refused, else "". touched: ticks after the stop in
    which links touched each other or a fixture. before_deg, tilt_deg: largest tilt of a sole when the stop came, and
    after it. lifted_mm, slid_mm: how far a corner of a sole got up, and sideways, from where it was at the stop, until
    the robot stands; rest_lifted_mm, rest_slid_mm: until torque is off. on_lifted_mm, on_slid_mm: in the same time in
    the run that went on without the stop, None of an end that is none. stands_s, ends_s: times from the stop until
    then, None: it did not stand.
    """

    kind: str
    at: float
    before: str
    state: str
    how: str
    touched: int = 0
    before_deg: float = 0.0
    tilt_deg: float = 0.0
    lifted_mm: float = 0.0
    slid_mm: float = 0.0
    rest_lifted_mm: float = 0.0
    rest_slid_mm: float = 0.0
    on_lifted_mm: float | None = None
    on_slid_mm: float | None = None
    stands_s: float | None = None
    ends_s: float = 0.0


@dataclass(frozen=True)
class Disturbance:
    """kind: LOST or JUMP. begin, end: s of the recording."""

    kind: str
    begin: float
    end: float


def disturbances(case: Case, frames: SensorFrames) -> list[Disturbance]:
    """The times at which sensors are lost, and jump, by turns."""
    rng, found = np.random.default_rng([case.seed, 0]), list[Disturbance]()
    kinds = (LOST, JUMP) if rng.random() < 0.5 else (JUMP, LOST)
    time, last = rng.uniform(*GAP_S), min(case.end, frames.duration_s)
    while case.disturbed and time < last:
        kind = kinds[len(found) % 2]
        found.append(Disturbance(kind, time, time + rng.uniform(*(LOST_S if kind == LOST else JUMP_S))))
        time = found[-1].end + rng.uniform(*GAP_S)
    return found


def disturb(case: Case, frames: SensorFrames, found: list[Disturbance]) -> SensorFrames:
    """The recording in which wrists and head are displaced together while sensors jump."""
    rng, position = np.random.default_rng([case.seed, 1]), frames.position.copy()
    moved = np.array([frames.names.index(name) for name in ("head", "l_wrist", "r_wrist")])
    for one in found:
        rows = np.flatnonzero((frames.time >= one.begin) & (frames.time < one.end) & (one.kind == JUMP))
        position[np.ix_(rows, moved)] += rng.normal(0.0, JUMP_M, 3)
    return replace(frames, position=position)


def lost(found: list[Disturbance], time: float) -> bool:
    """True if all sensors are lost at this time of the recording, s."""
    return any(one.kind == LOST and one.begin <= time < one.end for one in found)


class LossyPerformer(RecordedPerformer):
    """A recording whose sensors are lost for a while; then the robot holds, and blends back."""

    def __init__(self, clip: Clip, found: list[Disturbance]) -> None:
        super().__init__(clip)
        self._found = found

    def sample(self, tick: int) -> SensorSample | None:
        """The sensors at a tick; None: hold."""
        if lost(self._found, tick * self.dt):
            self.hold()
            return None
        return super().sample(tick)


class Fork:
    """Forks this process at ticks that are drawn. kind: of the stop that a child is for; MOTION in the parent.

    found: how the children ended.
    """

    def __init__(self, case: Case, found: list[Disturbance], *, ticks: int, dt: float) -> None:
        self.kind, self.found = MOTION, list[Ended]()
        self._moments: dict[tuple[bool, int], str] = {}  # by whether following has begun, and tick of that
        self._followed, self._ticks, self._answer = False, {False: -1, True: -1}, -1
        rng = np.random.default_rng([case.seed, 2])
        for number in range(case.stops):
            kinds = DISTURBED if case.disturbed else CALM
            kind, within = kinds[number % len(kinds)], (0.0, ticks * dt)
            spans = [(one.begin, one.end + AFTER_S) for one in found if one.kind == kind]
            if spans:
                within = spans[rng.integers(len(spans))]
            elif kind == APPROACH:
                within = APPROACH_S
            else:
                kind = FOLLOW
            self._moments[kind != APPROACH, int(rng.uniform(*within) / dt)] = kind

    def stops(self, state: RunState | None, witness: Witness) -> bool:
        """Count a tick. True in a child that has just been made: it is to ask for a stop."""
        if state not in AT_RISK:
            return False
        self._followed |= state is RunState.FOLLOW
        self._ticks[self._followed] += 1
        kind = self._moments.pop((self._followed, self._ticks[self._followed]), None)
        if kind is None or self.kind != MOTION or witness.fall is not None:
            return False
        read, write = os.pipe()
        child = os.fork()
        if not child:
            self.kind, self._answer = kind, write
            return True
        os.close(write)
        with os.fdopen(read, encoding="utf-8") as answer:
            text = answer.read()
        os.waitpid(child, 0)
        self.found.append(Ended(**json.loads(text)))
        return False

    def ended(self, watch: StopWatch, robot: RobotBody, state: str) -> list[Ended]:
        """All that were found, the run first. A child does not come back: it answers how it ended. state: of it."""
        if self.kind == MOTION:
            return [watch.ended(self.kind, robot, state), *(watch.beside(one, robot) for one in self.found)]
        try:
            os.write(self._answer, json.dumps(asdict(watch.ended(self.kind, robot, state))).encode())
        except BaseException:  # noqa: BLE001 - a child is never to go on as its parent
            traceback.print_exc()
        finally:
            os._exit(0)


class StopWatch:
    """Watches the soles of a robot from the last tick in which it moved with the performer."""

    def __init__(self, witness: Witness) -> None:
        self._witness = witness
        self._begun, self._before, self._touched = 0.0, "", 0
        self._stood: float | None = None

    def look(self, state: RunState | None) -> None:
        """Look at the robot before a tick."""
        if state in AT_RISK:
            assert state is not None
            self._begun, self._before, self._touched = self._witness.state.time, state.value, self._contacts
        elif self._stood is None and state is not RunState.STOPPING:
            self._stood = self._witness.state.time

    def ended(self, kind: str, robot: RobotBody, state: str) -> Ended:
        """How the run ended. state: of it."""
        witness, begun, end = self._witness, self._begun, self._witness.state.time
        stood = self._stood if self._stood is not None or state == RunState.FAULT.value else end
        fallen, log = witness.fall or witness.toppled, witness.log
        stopping = self._moved(robot, begun, end if stood is None else stood + SETTLED_S)
        to_rest = self._moved(robot, begun, end)
        tilts = np.degrees(log.column("tilt")[log.column("time") >= begun])
        return Ended(
            kind=kind,
            at=round(begun, 3),
            before=self._before,
            state=state,
            how="" if fallen is None else f"at {fallen.time:.2f} s {fallen.how}",
            touched=self._contacts - self._touched,
            before_deg=round(float(tilts[0].max()), 2),
            tilt_deg=round(float(tilts.max()), 2),
            lifted_mm=stopping[0],
            slid_mm=stopping[1],
            rest_lifted_mm=to_rest[0],
            rest_slid_mm=to_rest[1],
            stands_s=None if stood is None else round(stood - begun, 3),
            ends_s=round(end - begun, 3),
        )

    def beside(self, end: Ended, robot: RobotBody) -> Ended:
        """The end of a child, with what the soles of this run did in the time of its stop."""
        lifted, slid = self._moved(robot, end.at, end.at + (end.stands_s or end.ends_s) + SETTLED_S)
        return replace(end, on_lifted_mm=lifted, on_slid_mm=slid)

    def _moved(self, robot: RobotBody, begin: float, until: float) -> tuple[float, float]:
        """How far, mm, a corner of a sole got up and sideways between two times, s."""
        log = self._witness.log
        time = log.column("time")
        q = log.column("q")[(time >= begin - ROUND_S) & (time <= until + ROUND_S)]
        corners = 1e3 * standing_of(robot, q).corners
        moved = corners - corners[0]
        slid = np.linalg.norm(moved[..., :2], axis=2)
        return round(float(moved[..., 2].max()), 2), round(float(slid.max()), 2)

    @property
    def _contacts(self) -> int:
        return self._witness.log.self_contact_ticks + self._witness.log.fixture_contact_ticks


class SeenBench:
    """The bench of a run, and its witness once the bus is made."""

    def __init__(self, options: RunOptions) -> None:
        self.bench = PhysicsBench(options, lambda text: None)
        self.witness: Witness

    def make_bus(self, robot: RobotBody, clock: Clock) -> ServoBus:
        """Make the bus of the run. Raises RetargetError."""
        bus = self.bench.make_bus(robot, clock)
        assert isinstance(bus, WitnessedBus), "the robot has mass"
        self.witness = bus.witness
        return bus


class ForkingOperator(RunOperator):
    """Asks for a stop in each child."""

    def __init__(self, prepared: Prepared, seen: SeenBench, fork: Fork) -> None:
        super().__init__(prepared, StopRequest(), bench=seen.bench)
        self.watch, self._witness, self._fork = StopWatch(seen.witness), seen.witness, fork

    def poll(self, state: RunState | None) -> OperatorInput:
        """What is asked for now."""
        self.watch.look(state)
        if self._fork.stops(state, self._witness):
            self.stop.request("a stop at a tick that was drawn")
        return super().poll(state)


def run_case(case: Case) -> list[Ended]:
    """How a run and its stops ended, the run first."""
    recorded = motion(case.source)
    found = disturbances(case, recorded)
    frames = disturb(case, recorded, found)
    try:
        return own_loop(case, frames, found) if case.own_loop else whole_run(case, frames, found)
    except RetargetError as error:
        return [Ended(MOTION, 0.0, "", "refused", str(error))]


def whole_run(case: Case, frames: SensorFrames, found: list[Disturbance]) -> list[Ended]:
    """A run as of `retarget run`, with the way to rest. Raises RetargetError."""
    options = case.options
    seen = SeenBench(options)
    with prepare(lambda: frames, options, clock=VirtualClock(), make_bus=seen.make_bus, goes_to_rest=True) as prepared:
        if found:
            prepared = replace(prepared, samples=LossyPerformer(prepared.samples.recorded(), found))
        fork = Fork(case, found, ticks=prepared.samples.ticks, dt=prepared.samples.dt)
        operator = ForkingOperator(prepared, seen, fork)
        run = prepared.run(operator)
    assert run.robot is not None, "the robot has mass"
    return fork.ended(operator.watch, run.robot, run.state or "")


def own_loop(case: Case, frames: SensorFrames, found: list[Disturbance]) -> list[Ended]:
    """A loop over `Pipeline`, whose goals go to the servos as they are. Raises RetargetError."""
    robot, clock, seen = load_robot(case.robot), VirtualClock(), SeenBench(case.options)
    rate_hz = robot.profile.safety.rate_hz
    clip = lay_on_ticks(frames, performer=load_performer("five"), playback=case.options.playback, rate_hz=rate_hz)
    clip, bus = clip.with_jumps or clip, seen.make_bus(robot, clock)
    bus.open()
    states = bus.read()
    bus.write(ServoGoals(states.position))
    bus.torque(True)
    pipeline = Pipeline(robot, rate_hz=rate_hz)
    present = robot.joint_map.to_radians(states.position)
    pipeline.start(clip.sample(0), present=present, calibration=calibrate(frames))
    fork, watch = Fork(case, found, ticks=clip.ticks, dt=clip.dt), StopWatch(seen.witness)
    tick = stood = 0
    while stood * clip.dt < STOOD_S:
        clock.advance(clip.dt)
        bus.read()
        state = pipeline.state
        watch.look(state)
        if fork.stops(state, seen.witness) or tick >= clip.ticks or seen.witness.fall is not None:
            pipeline.stop()
        tick += tick > 0 or state is RunState.FOLLOW
        sample = None if lost(found, tick * clip.dt) else clip.sample(min(tick, clip.ticks - 1))
        goal = pipeline.step(sample, clip.dt)
        bus.write(ServoGoals(robot.joint_map.to_ticks(goal.joint_positions)))
        stood += pipeline.state not in (*AT_RISK, RunState.STOPPING)
    state = RunState.STANDING if pipeline.state is RunState.OFF else pipeline.state
    return fork.ended(watch, robot, state.value)
