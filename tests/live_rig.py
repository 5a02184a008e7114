"""A sender of JSON poses on virtual time, with everything that can go wrong with it, and a live run that hears it."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from hardware.clock import Clock, VirtualClock
from retarget.frames import SensorFrames
from retarget.live.admission import Admission
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.clock_map import ClockMap
from retarget.live.datagram import Datagram, Source
from retarget.live.playout import Playout
from retarget.live.playout_delay import PlayoutDelay
from retarget.live.roles import roles_of
from retarget.live.smoothing import pose_filter
from retarget.live.stream import LiveStream
from retarget.live.trust import Trust
from retarget.options import RunOptions
from retarget.performer import Performer, load_performer
from retarget.prepare import Prepared, prepare_for
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.samples import Performance
from retarget.sources.json_pose import JsonPoseDecoder
from retarget.sources.stream_frame import Dropped
from sim.mock_bus import MockBus
from sim.performer import synthetic_performer

STILL_S = 2.0
"""So long the performer stands still first."""
NOISE_M = 0.0005
WHERE = "json://:7000"

Fault = Callable[[float, dict[str, FloatArray]], dict[str, FloatArray] | None]
"""From time (s of the sender) and positions by name to what is sent instead; None: nothing is sent."""


@dataclass
class Sender:
    """A performer's sensors as JSON datagrams, at 100 Hz with some jitter, on the clock that it is polled by."""

    frames: SensorFrames = field(default_factory=synthetic_performer)
    rate_hz: float = 100.0
    faults: list[Fault] = field(default_factory=list)
    source: Source = ("127.0.0.1", 40000)
    dropped: Dropped = field(default_factory=Dropped)
    stamp: Callable[[float], float] = lambda time: time + 1000.0

    def __post_init__(self) -> None:
        self._chance = np.random.default_rng(3)
        self._track = self.frames.resample(np.arange(0.0, self.frames.duration_s, 1.0 / self.rate_hz)).position
        self._sent = 0
        self._begun: float | None = None

    def poll(self, now: float) -> list[Datagram]:
        """What was sent by now."""
        self._begun = now if self._begun is None else self._begun
        found = []
        while (due := self._begun + self._sent / self.rate_hz) <= now:
            payload = self._payload(self._sent / self.rate_hz)
            self._sent += 1
            if payload is not None:
                found.append(Datagram(min(due + self._chance.uniform(0.0, 0.004), now), self.source, payload))
        return found

    def close(self) -> None:
        """Nothing is open."""

    def _payload(self, time: float) -> bytes | None:
        row = min(max(round((time - STILL_S) * self.rate_hz), 0), len(self._track) - 1)
        noise = self._chance.normal(0.0, NOISE_M, self._track[row].shape)
        poses: dict[str, FloatArray] | None = dict(zip(self.frames.names, self._track[row] + noise, strict=True))
        for fault in self.faults:
            poses = None if poses is None else fault(time, poses)
        if poses is None:
            return None
        told = {name: {"p": [round(float(x), 6) for x in point]} for name, point in poses.items()}
        return json.dumps({"axes": "rep103", "time": self.stamp(time), "poses": told}).encode()


def live_stream(sender: Sender, performer: Performer) -> LiveStream:
    """A stream that hears the sender."""
    roles = roles_of(performer, "json", where="test")
    return LiveStream(
        sender,
        JsonPoseDecoder(),
        roles,
        admission=Admission(),
        clock_map=ClockMap(),
        trust=Trust(roles.sensors),
        playout=Playout(len(roles.sensors), delay=PlayoutDelay()),
        smooth=pose_filter("light", len(roles.sensors)),
    )


class LiveRig:
    """A live run of OP3 on a mock bus. said: what the performer and the user were told."""

    def __init__(self, sender: Sender, *, robot: str = "op3", options: LiveOptions | None = None) -> None:
        self.sender, self.clock, self.said = sender, VirtualClock(), list[str]()
        self.live = options or LiveOptions(countdown=0.5, duration=6.0)
        self.run_options = RunOptions(robot=robot)
        self.stream: LiveStream
        self.bus: MockBus

    @contextmanager
    def prepared(self) -> Iterator[Prepared]:
        """Calibrated, and the bus open."""

        def perform(performer: Performer, robot: RobotBody | None) -> Performance:
            self.stream = live_stream(self.sender, performer)
            rate = 100.0 if robot is None else robot.profile.safety.rate_hz
            return begin_live(
                self.stream, self.live, clock=self.clock, rate_hz=rate, where=WHERE, tell=self.said.append
            )

        with prepare_for(perform, self.run_options, clock=self.clock, make_bus=self._bus, parks=True) as prepared:
            yield prepared

    def _bus(self, robot: RobotBody, clock: Clock) -> MockBus:
        stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
        self.bus = MockBus(robot.joint_map.servos, clock, start=robot.joint_map.to_ticks(stand))
        return self.bus


def five() -> Performer:
    """Head, wrists, ankles."""
    return load_performer("five")


def silent(first: float, last: float) -> Fault:
    """Nothing is sent from `first` to `last`, s of the sender."""
    return lambda time, poses: None if first <= time < last else poses


def lost(name: str, first: float, last: float) -> Fault:
    """One sensor is not in the datagrams."""
    return lambda time, poses: (
        {other: at for other, at in poses.items() if other != name} if first <= time < last else poses
    )


def frozen(name: str, first: float, last: float) -> Fault:
    """One sensor repeats its place, to the bit."""
    kept: list[FloatArray] = []

    def fault(time: float, poses: dict[str, FloatArray]) -> dict[str, FloatArray]:
        if not first <= time < last:
            return poses
        if not kept:
            kept.append(poses[name])
        return poses | {name: kept[0]}

    return fault


def moved(name: str, first: float, last: float, by: tuple[float, float, float]) -> Fault:
    """One sensor is somewhere else at once."""
    return lambda time, poses: poses | {name: poses[name] + np.array(by)} if first <= time < last else poses


def swapped(one: str, other: str, first: float, last: float) -> Fault:
    """Two sensors exchange their names."""
    return lambda time, poses: poses | {one: poses[other], other: poses[one]} if first <= time < last else poses
