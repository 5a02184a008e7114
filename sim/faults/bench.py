"""One live run of OP3 that is hurt: sender, whole pipeline, the driver's bytes, emulated servos; on virtual time."""

from collections.abc import Callable
from dataclasses import dataclass, field

from hardware.bus import ServoBus
from hardware.bus_spec import BusSpec
from hardware.clock import Clock, VirtualClock
from hardware.dynamixel.bus import DynamixelBus
from hardware.guard import Guard, Halt, Think
from hardware.guard_state import GuardState, Stop
from retarget.live.admission import Admission
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.clock_map import ClockMap
from retarget.live.performer import LivePerformer
from retarget.live.playout import Playout
from retarget.live.playout_delay import PlayoutDelay
from retarget.live.roles import roles_of
from retarget.live.smoothing import LIGHT, pose_filter
from retarget.live.stream import LiveStream
from retarget.live.trust import Trust
from retarget.options import RunOptions
from retarget.performer import Performer
from retarget.pipeline import Watch
from retarget.prepare import Prepared, prepare_for
from retarget.robot_body import RobotBody
from retarget.samples import Performance
from retarget.sources.json_pose import JsonPoseDecoder
from sim.emulator.line import Line
from sim.emulator.loopback import EmulatedPort
from sim.emulator.robot_lines import robot_lines
from sim.emulator.servo import EmulatedServo
from sim.faults.sender import FakeSender
from sim.faults.wire_checker import Sent

ROBOT = "op3"


class TappedPort(EmulatedPort):
    """Keeps what the host sends, with the time."""

    def __init__(self, line: Line, clock: Clock, *, name: str, sent: list[Sent]) -> None:
        super().__init__(line, clock, name=name)
        self._sent = sent

    def write(self, data: bytes) -> None:
        """Send, and keep."""
        self._sent.append(Sent(self.now(), data))
        super().write(data)


@dataclass
class Trace:
    """What was seen of a run, s of its clock. states: (time, state) of every tick; out: when which sensors took no
    part; sent: every packet of the host; began: when following began."""

    states: list[tuple[float, GuardState]] = field(default_factory=list)
    out: list[tuple[float, frozenset[str]]] = field(default_factory=list)
    sent: list[Sent] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    stop: Stop | None = None
    began: float | None = None
    ended: float = 0.0
    error: str = ""
    torque: list[int] = field(default_factory=list)
    """Torque registers of all servos in the end."""

    def first(self, state: GuardState, since: float) -> float | None:
        """When a state was first seen from a time on, s."""
        return next((time for time, seen in self.states if time >= since and seen is state), None)


class Bench:
    """A run that can be hurt. `at` calls something once at a time, s after following began."""

    def __init__(self, sender: FakeSender, *, duration: float, seed: int = 0) -> None:
        self.sender, self.clock, self.trace = sender, VirtualClock(), Trace()
        self.lines: dict[str, Line] = {}
        self.robot: RobotBody
        self.guard: Guard
        self.stream: LiveStream
        self._duration, self._seed = duration, seed
        self._due: list[tuple[float, Callable[[], object]]] = []

    def at(self, time: float, act: Callable[[], object]) -> None:
        """Call `act` at a time, s after following began; a time below 0: before the bus is opened."""
        self._due.append((time, act))

    def run(self) -> Trace:
        """Run it; whatever is refused is in the trace."""
        options = RunOptions(robot=ROBOT, bus="emulator")
        try:
            with prepare_for(self._perform, options, clock=self.clock, make_bus=self._bus, parks=True) as prepared:
                self._watch(prepared)
        except Exception as error:  # noqa: BLE001 - what a run ends with is what is judged
            self.trace.error = f"{type(error).__name__}: {error}"
        self.trace.ended = self.clock.now()
        self.trace.torque = [
            device.memory.value("torque_enable")
            for line in self.lines.values()
            for device in line.devices
            if isinstance(device, EmulatedServo)
        ]
        return self.trace

    def _watch(self, prepared: Prepared) -> None:
        assert prepared.side is not None and isinstance(prepared.samples, LivePerformer)
        self.guard = guard = prepared.side.guard
        samples, trace = prepared.samples, self.trace
        tick, sample, names = guard.tick, samples.sample, samples.stream.roles.sensors

        def ticking(think: Think, halt: Halt = lambda: None) -> GuardState:
            state = tick(think, halt)
            now = self.clock.now()
            if trace.began is None and state is GuardState.MOVING and "the performer is followed" in trace.said:
                trace.began = now
            trace.states.append((now, state))
            if trace.began is not None:
                due = [one for one in self._due if now >= trace.began + one[0]]
                self._due = [one for one in self._due if one not in due]
                for _, act in due:
                    act()
            return state

        def sampled(index: int) -> object:
            found = sample(index)
            if found is not None:
                gone = frozenset(name for name, valid in zip(names, found.valid, strict=True) if not valid)
                trace.out.append((self.clock.now(), gone))
            return found

        guard.tick = ticking  # type: ignore[method-assign]
        samples.sample = sampled  # type: ignore[method-assign, assignment]
        try:
            prepared.run(Watch())
        finally:
            trace.stop = guard.stop_reason

    def _perform(self, performer: Performer, robot: RobotBody | None) -> Performance:
        assert robot is not None
        roles = roles_of(performer, "json", where="bench")
        count = len(roles.sensors)
        self.stream = LiveStream(
            self.sender,
            JsonPoseDecoder(),
            roles,
            admission=Admission(),
            clock_map=ClockMap(),
            trust=Trust(roles.sensors),
            playout=Playout(count, delay=PlayoutDelay()),
            smooth=pose_filter(LIGHT, count),
        )
        live = LiveOptions(countdown=0.3, duration=self._duration)
        rate = robot.profile.safety.rate_hz
        return begin_live(
            self.stream, live, clock=self.clock, rate_hz=rate, where="json://bench", tell=self.trace.said.append
        )

    def _bus(self, robot: RobotBody, clock: Clock) -> ServoBus:
        stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
        start = robot.joint_map.to_ticks(stand)
        self.robot = robot
        buses = robot.profile.bus_specs()
        self.lines = robot_lines(robot.joint_map.servos, buses, start=start, now=clock.now(), seed=self._seed)

        def port(bus: BusSpec) -> EmulatedPort:
            return TappedPort(self.lines[bus.name], clock, name=f"emulated {bus.port}", sent=self.trace.sent)

        for _, act in [one for one in self._due if one[0] < 0.0]:
            act()
        self._due = [one for one in self._due if one[0] >= 0.0]
        return DynamixelBus(robot.joint_map, buses, port, tell=self.trace.said.append)
