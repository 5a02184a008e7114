"""One live run of OP3 with faults: sender, whole pipeline, driver and emulated servos, on virtual time."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from ipaddress import IPv4Network
from itertools import groupby
from math import inf

import numpy as np

from hardware.bus import BusSpec, ServoBus
from hardware.clock import Clock, VirtualClock
from hardware.dynamixel.bus import DynamixelBus
from hardware.errors import BusError
from hardware.guard import Guard
from hardware.guard_state import Stop
from retarget.frames import SensorFrames
from retarget.human.samples import Performance, Playback, Samples
from retarget.live.admission import Admission
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.open_stream import open_stream
from retarget.live.stream import LiveStream
from retarget.model.human_dimensions import POINTS
from retarget.model.robot import RobotBody
from retarget.run.loop import LiveInputs, Operator, RunObserver, Tick
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, performance_of, prepare_for
from retarget.run.supervisor import OperatorInput
from retarget.run.tick import Machine, TickInput
from retarget.schema.performer import Performer
from retarget.types import FloatArray, RunState
from sim.buses import imu_stand_in, motion_of_shafts, simulation_of
from sim.emulator.line import Line
from sim.emulator.ports import EmulatedPort
from sim.emulator.robot_lines import robot_lines
from sim.emulator.servo2 import EmulatedServo
from sim.faults.bounds import BOUNDS
from sim.faults.sender import FakeSender, Poses
from sim.faults.wire_checker import READS, Sent, packets, torque_off, written
from sim.physics.bus import drive_shafts
from sim.physics.simulation import Simulation
from sim.physics.witness import Witness, WitnessedBus

# The trace of a live run with faults.

MOVING = (RunState.APPROACH, RunState.FOLLOW)
HOLDING = (RunState.HOLD,)
STOPPING = (RunState.STOPPING, RunState.RETURN_TO_STANCE, RunState.GO_TO_REST)
STOPPED = (RunState.OFF, RunState.FAULT)
"""States of a run as the judge groups them."""


@dataclass(frozen=True, slots=True)
class TickEnd:
    """The end of a tick, at `time`, s. latched: a stop is latched; slow: speed override of the robot."""

    time: float
    state: RunState
    latched: bool
    slow: float


@dataclass
class Trace:
    """The events of a run; all times in s of its clock.

    out: sensors that took no part in a tick. speeds: greatest speed (m/s) of a joint of the human with a sensor. sent:
    packets of the host. postures: of the goals under load, (n,) rad. let_go: servos (id) that stopped driving. began:
    start of following. gone: the host was killed. acted: onsets of faults that wait for an event. rebased: the clock
    map followed a jump of the sender's clock. desired: postures (n,), rad, of a forced stage. torque: registers of all
    servos in the end. left: the end of the run was not observed. endless: it did not end.
    """

    ticks: list[TickEnd] = field(default_factory=list)
    out: list[tuple[float, frozenset[str]]] = field(default_factory=list)
    speeds: list[tuple[float, float]] = field(default_factory=list)
    sent: list[Sent] = field(default_factory=list)
    postures: list[tuple[float, FloatArray]] = field(default_factory=list)
    let_go: list[tuple[float, int]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    desired: list[tuple[float, FloatArray]] = field(default_factory=list)
    acted: list[float] = field(default_factory=list)
    stop: Stop | None = None
    began: float | None = None
    approach_ended: float | None = None
    gone: float | None = None
    rebased: float | None = None
    ended: float = 0.0
    writes_fail: bool = False
    left: bool = False
    endless: bool = False
    error: str = ""
    torque: list[int] = field(default_factory=list)

    def first(self, states: tuple[RunState, ...], since: float) -> float | None:
        """Return when, s, one of these states was first seen from a time on."""
        return next((tick.time for tick in self.ticks if tick.time >= since and tick.state in states), None)

    @property
    def armed(self) -> float | None:
        """End of the first tick with torque, s."""
        return self.ticks[0].time if self.ticks else None

    def stopped(self, since: float) -> float | None:
        """Return when, s, a stop was latched from a time on: at the end of its tick."""
        return next((tick.time for tick in self.ticks if tick.time >= since and tick.latched), None)

    @property
    def latched(self) -> float | None:
        """First time at which a stop was latched, s."""
        return self.stopped(-inf)

    def torque_off_at(self, since: float) -> float | None:
        """Return when, s, torque was switched off or the bus given up, from a time on."""
        seen = (torque_off(written(self.sent), since), self.first(STOPPED, since))
        return min((time for time in seen if time is not None), default=None)

    @property
    def holds(self) -> list[tuple[float, float]]:
        """Begin and end of each hold, s."""
        runs = [(held, next(ticks).time) for held, ticks in groupby(self.ticks, lambda tick: tick.state in HOLDING)]
        ends = [begun for _, begun in runs[1:]] + [tick.time for tick in self.ticks[-1:]]
        return [(begun, end) for (held, begun), end in zip(runs, ends, strict=True) if held]


class Killed(BaseException):
    """The host was killed, as by SIGKILL: none of its code may run any more."""


class TappedPort(EmulatedPort):
    """A port that keeps what the host sends. writes_fail: writes raise, but reads pass; dead: every call raises."""

    def __init__(self, line: Line, clock: Clock, *, name: str, sent: list[Sent]) -> None:
        super().__init__(line, clock, name=name)
        self.writes_fail = self.dead = False
        self._sent = sent

    def write(self, data: bytes) -> None:
        """Send bytes, and keep them."""
        if self.dead:
            raise Killed
        one = Sent(self.now(), data)
        if self.writes_fail and any(packet.instruction not in READS for packet in packets([one])):
            raise BusError("the adapter does not take what is written")
        self._sent.append(one)
        super().write(data)

    def _require(self, what: str) -> None:
        if self.dead:
            raise Killed
        super()._require(what)


ROBOT = "op3"
LISTED = IPv4Network("127.0.0.0/8")
BEFORE_OPENING, BEFORE_ARMING = -1.0, -0.5
"""Times of faults before a run begins, s after following began."""


class Bench(Operator, RunObserver):
    """A run with faults, and its operator and observer. `at` calls a function once at a time, s after following began.

    stop_requested: SIGINT or SIGTERM came. undo: called in the end. gate: False: goals are not checked. leaves: the run
    is not observed to its end, where the robot is at rest. approaching: `at` counts from when torque is on, and the
    robot begins in posture `rest`. recording: the performer instead of a stream, see `record`. held_up: time, s as in
    `at`, and allowed length, s, of each fault that the robot holds for and goes on after. mass: simulated mechanics are
    behind the emulated wire. presses: something presses against the robot, so that it gives way in a hold. delays:
    called in every tick of a moving robot, once its servos are read.
    """

    def __init__(
        self,
        sender: FakeSender,
        *,
        duration: float,
        seed: int = 0,
        performer: str = "five",
        gate: bool = True,
        mass: bool = False,
    ) -> None:
        self.sender, self.clock, self.trace = sender, VirtualClock(), Trace()
        self.lines: dict[str, Line] = {}
        self.ports: dict[str, TappedPort] = {}
        self.stop_requested = self.leaves = self.approaching = self.presses = False
        self.held_up: list[tuple[float, float]] = []
        self.delays: list[Callable[[], object]] = []
        self.undo: list[Callable[[], object]] = []
        self.robot: RobotBody
        self.machine: Machine
        self.guard: Guard
        self.stream: LiveStream
        self.samples: Samples
        self.recording: SensorFrames | None = None
        self.mass = mass
        self.witness: Witness | None = None
        self.simulation: Simulation | None = None
        self._duration, self._seed, self._performer, self._gate = duration, seed, performer, gate
        self._due: list[tuple[float, Callable[[], object]]] = []

    @property
    def servos(self) -> list[EmulatedServo]:
        """All emulated servos of all buses."""
        return [one for line in self.lines.values() for one in line.devices if isinstance(one, EmulatedServo)]

    def servo(self, device: int) -> EmulatedServo:
        """The servo of an id."""
        return next(one for one in self.servos if one.id == device)

    def at(self, time: float, act: Callable[[], object]) -> None:
        """Call `act` at a time, s after following began. BEFORE_ARMING, or less: before the bus is opened."""
        self._due.append((time, act))

    def record(self) -> None:
        """Make the performer a recording of what the sender sends, with the faults that are due so far."""
        due, sent = np.arange(0.0, self._duration, 1.0 / self.sender.rate_hz), list[Poses]()
        for time in due.tolist():
            self._act_until(time)
            sent.append(self.sender.poses(time) or {})
        frames = self.sender.frames.resample(due)
        position = np.array([[poses.get(name, np.full(3, np.nan)) for name in frames.names] for poses in sent])
        valid, unknown = np.isfinite(position).all(axis=2), np.full_like(frames.orientation, np.nan)
        self.recording = replace(frames, position=position, orientation=unknown, valid=valid, joints=None)

    def _act_until(self, time: float) -> None:
        due = [one for one in self._due if one[0] <= time]
        self._due = [one for one in self._due if one not in due]
        for _, act in due:
            act()

    def interrupt(self) -> None:
        """Send SIGINT or SIGTERM."""
        self.stop_requested = True

    def refuse_writes(self) -> None:
        """Let the adapters refuse every write, but not reads."""
        self.trace.writes_fail = True
        for port in self.ports.values():
            port.writes_fail = True

    def kill(self) -> None:
        """End the host in this tick, like `kill -9`."""
        self.trace.gone = self.clock.now()
        for port in self.ports.values():
            port.dead = True
        raise Killed

    def run(self) -> Trace:
        """Run it and return its trace; an error that ends it is in the trace."""
        bus = "physics+wire" if self.mass else "emulator"
        options = RunOptions(robot=ROBOT, bus=bus, performer=self._performer, gate=self._gate)
        try:
            with prepare_for(
                self._perform,
                options,
                clock=self.clock,
                make_bus=self._bus,
                goes_to_rest=True,
                has_deadlines=True,
                notify=self.trace.said.append,
            ) as prepared:
                self._run(prepared)
        except Killed:
            pass
        except Exception as error:  # noqa: BLE001 - how a run ends is judged later
            self.trace.error = f"{type(error).__name__}: {error}"
        finally:
            for act in self.undo:
                act()
        self.trace.ended = self.clock.now()
        self.clock.advance(BOUNDS.afterwards_s)
        for servo in self.servos:
            servo.catch_up(self.clock.now())
        self.trace.torque = [servo.memory.value("torque_enable") for servo in self.servos]
        return self.trace

    def _run(self, prepared: Prepared) -> None:
        assert prepared.machine is not None
        self.machine = prepared.machine
        self.guard = guard = prepared.machine.guard
        self.samples = prepared.samples
        self._worn = [POINTS.index(sensor.joint) for sensor in prepared.performer.sensors.values()]
        self._joints: FloatArray | None = None
        self._act_until(BEFORE_ARMING)
        try:
            prepared.loop(self, [self], DelayedInputs(self)).run()
        finally:
            self.trace.stop = guard.stop
        if self.failure:
            raise RuntimeError(self.failure)

    def poll(self, state: RunState | None) -> OperatorInput:
        """Stop the robot if a signal came."""
        return OperatorInput(stop="a signal asks for a stop" if self.stop_requested else None)

    def see(self, tick: Tick) -> None:
        """Keep the result of a tick, and inject what is due."""
        trace, guard, now = self.trace, self.guard, self.clock.now()
        state = self.machine.supervisor.state
        assert tick.given is not None, "a robot has inputs"
        if (sample := tick.given.performer.sample) is not None:
            gone = zip(sample.names, sample.valid, strict=True)
            trace.out.append((tick.given.now, frozenset(name for name, valid in gone if not valid)))
            if tick.row is not None:
                joints = tick.record.human_joints[tick.row, self._worn]
                moved = 0.0 if self._joints is None else float(np.linalg.norm(joints - self._joints, axis=1).max())
                trace.speeds.append((tick.given.now, moved / self.samples.dt))
                self._joints = joints
        if tick.tried is not None:
            trace.postures.append((tick.given.now, tick.tried.posture))
        if trace.approach_ended is None and state not in (RunState.APPROACH, RunState.HOLD):
            trace.approach_ended = now
        follows = self.recording is not None or "the performer is followed" in trace.said
        if trace.began is None and state is RunState.FOLLOW and follows:
            trace.began = now
        trace.ticks.append(TickEnd(now, state, guard.stop is not None, guard.health.warnings.speed_override))
        if trace.rebased is None and self.recording is None and self.stream.clock_map.jumps:
            trace.rebased = now
        since = trace.armed if self.approaching else trace.began
        if since is not None:
            self._act_until(now - since)
        if self.leaves and state in STOPPING and guard.stop is None:  # nothing is followed any more
            self.leave()
        if now > self._duration + BOUNDS.endless_s:
            trace.endless = True
            self.kill()

    def leave(self) -> None:
        """End the observation after this tick."""
        self.trace.left = True
        self.kill()

    def _perform(self, performer: Performer, robot: RobotBody | None) -> Performance:
        assert robot is not None
        if (recording := self.recording) is not None:
            return performance_of(lambda: recording, Playback())(performer, robot)
        self.stream = open_stream(None, performer, receiver=self.sender)
        self.stream.admission = Admission(allow=(LISTED,))
        live = LiveOptions(countdown=0.3, duration=self._duration)
        rate = robot.profile.safety.rate_hz
        return begin_live(
            self.stream, live, clock=self.clock, rate_hz=rate, where="json://bench", notify=self.trace.said.append
        )

    def _bus(self, robot: RobotBody, clock: Clock) -> ServoBus:
        known = robot.profile.postures
        begins = robot.posture(known.rest if self.approaching else known.stand)[robot.servo_columns]
        start = robot.joint_map.to_ticks(begins)
        self.robot = robot
        buses = robot.profile.bus_specs()
        imu, simulation = robot.profile.imu_spec(), simulation_of(robot, start=start) if self.mass else None
        self.simulation = simulation
        sensor = None if imu is None else imu_stand_in(imu, simulation, seed=self._seed)
        self.lines = robot_lines(
            robot.joint_map.servos, buses, start=start, now=clock.now(), seed=self._seed, powered=True, imu=sensor
        )

        for servo in self.servos:
            servo.let_go = partial(lambda device, now: self.trace.let_go.append((now, device)), servo.id)

        def port(bus: BusSpec) -> TappedPort:
            made = TappedPort(self.lines[bus.name], clock, name=f"emulated {bus.port}", sent=self.trace.sent)
            self.ports[bus.name] = made
            return made

        made = DynamixelBus(robot.joint_map, buses, port, imu=imu, notify=self.trace.said.append)
        self._act_until(BEFORE_OPENING)
        if simulation is None:
            if sensor is not None:
                sensor.motion = motion_of_shafts(robot, self.lines, start, clock)
            return made
        drive_shafts(simulation, robot.joint_map.servos, self.lines, now=clock.now())
        self.witness = Witness(simulation)
        return WitnessedBus(made, self.witness)


class DelayedInputs(LiveInputs):
    """The inputs of the ticks of a bench, with its delays."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench.machine, bench.samples, bench)
        self._bench = bench

    def gather(self, tick: int, run_state: RunState, *, approached: bool) -> TickInput:
        """Gather the input of the next tick, and delay it where the robot moves on."""
        given = super().gather(tick, run_state, approached=approached)
        for delay in self._bench.delays if run_state in MOVING and given.performer.may_go_on else ():
            delay()
        return given
