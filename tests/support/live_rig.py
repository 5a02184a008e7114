"""A live run of OP3 on virtual time, with a sender of JSON poses."""

import select
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from hardware.clock import Clock, MonotonicClock, VirtualClock
from retarget.frames import SENSORS, SensorFrames
from retarget.human.pose_validation import StateArray, ValidityState
from retarget.human.samples import Performance
from retarget.live.address import StreamAddress
from retarget.live.admission import Datagram
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.open_stream import open_stream
from retarget.live.receivers import UdpReceiver
from retarget.live.sensor_validity import SensorValidity
from retarget.live.stream import LiveStream
from retarget.model.robot import RobotBody
from retarget.rotations import conjugate, from_rotation_vector, multiply
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare_for
from retarget.schema.performer import Performer, load_performer
from retarget.types import BoolArray, FloatArray
from sim.faults.sender import FakeSender
from sim.mock_bus import MockBus, mock_bus
from sim.performer import synthetic_performer

WHERE = "json://:7000"


class ClockedSender(FakeSender):
    """A sender whose clock is any function of its own time, s."""

    def __init__(self, clock: Callable[[float], float], frames: SensorFrames | None = None) -> None:
        super().__init__(synthetic_performer() if frames is None else frames)
        self._clock = clock

    def stamp(self, time: float) -> float:
        return self._clock(time)


def live_stream(sender: FakeSender, performer: Performer) -> LiveStream:
    """A stream from the sender."""
    return open_stream(None, performer, receiver=sender)


class LiveRig:
    """A live run of OP3 on a mock bus. said: messages to the performer and the user."""

    def __init__(self, sender: FakeSender, *, robot: str = "op3", options: LiveOptions | None = None) -> None:
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
                self.stream, self.live, clock=self.clock, rate_hz=rate, where=WHERE, notify=self.said.append
            )

        with prepare_for(
            perform,
            self.run_options,
            clock=self.clock,
            make_bus=self._bus,
            goes_to_rest=True,
            notify=self.said.append,
        ) as prepared:
            yield prepared

    def _bus(self, robot: RobotBody, clock: Clock) -> MockBus:
        self.bus = mock_bus(robot, clock)
        return self.bus


def five() -> Performer:
    """Head, wrists, ankles."""
    return load_performer("five")


# A walk for the tests of sensor validity: sensors that swing, with the noise of real ones, and their judgement.

NAMES = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle", "pelvis")
HOME = np.array([[0, 0, 1.6], [0, 0.3, 0.9], [0, -0.3, 0.9], [0, 0.12, 0.1], [0, -0.12, 0.1], [0, 0, 1.0]])
SWING = np.array([0.02, 0.25, -0.25, -0.3, 0.3, 0.03])
LAG = 0.005
"""s from capture to judgement."""


@dataclass
class Stream:
    """What a sender sent; tests change it."""

    time: FloatArray
    position: FloatArray
    orientation: FloatArray
    tracked: BoolArray
    names: tuple[str, ...] = NAMES


@dataclass
class Judged:
    """The judgement of a stream: states and usable (T, k), messages with the row at which they came."""

    validity: SensorValidity
    states: StateArray
    usable: BoolArray
    messages: list[tuple[int, str]] = field(default_factory=list)

    def alarms(self) -> set[ValidityState]:
        return {ValidityState(state) for state in np.unique(self.states)} - {ValidityState.FRESH}


def noisy(
    position: FloatArray, orientation: FloatArray, *, seed: int = 0, metres: float = 0.002
) -> tuple[FloatArray, FloatArray]:
    """The track with the noise of an optical or a consumer system: `metres`, and 0.1 degree."""
    random = np.random.default_rng(seed)
    turn = from_rotation_vector(random.normal(0.0, np.radians(0.1), position.shape))
    return position + random.normal(0.0, metres, position.shape), multiply(orientation, turn)


def walk(seconds: float = 2.0, rate: float = 100.0, *, swing: float = 1.0, noise: bool = True) -> Stream:
    """A walk of one step a second; `swing` 0: standing."""
    time = 5.0 + np.arange(0.0, seconds, 1.0 / rate)
    phase = swing * np.sin(2.0 * np.pi * time)[:, None] * SWING
    position = HOME + np.stack([phase, np.zeros_like(phase), 0.2 * np.abs(phase)], axis=-1)
    orientation = from_rotation_vector(np.stack([np.zeros_like(phase), -2.0 * phase, np.zeros_like(phase)], axis=-1))
    if noise:
        position, orientation = noisy(position, orientation)
    return Stream(time, position, orientation, np.ones(phase.shape, dtype=bool))


def recorded(frames: SensorFrames, rate: float, *, metres: float) -> Stream:
    """A recording as from a sender of `rate` Hz, with noise and with stamps that are off by up to 2 ms."""
    frames = frames.resample(np.arange(0.0, frames.duration_s, 1.0 / rate))
    position, orientation = noisy(frames.position, frames.orientation, metres=metres)
    late = np.random.default_rng(1).uniform(0.0, 0.002, len(frames))
    return Stream(5.0 + frames.time + late, position, orientation, frames.valid.copy(), frames.names)


def judge(stream: Stream, validity: SensorValidity | None = None) -> Judged:
    validity = validity or SensorValidity(stream.names)
    rows = np.arange(len(stream.names))
    judged = Judged(
        validity, np.zeros(stream.tracked.shape, dtype=np.uint8), np.zeros(stream.tracked.shape, dtype=bool)
    )
    for i, time in enumerate(stream.time.tolist()):
        judged.usable[i] = validity.take(
            rows, time, position=stream.position[i], orientation=stream.orientation[i], tracked=stream.tracked[i]
        )
        judged.states[i] = validity.judge(time + LAG)
        judged.messages += [(i, text) for text in validity.messages()]
    return judged


# Real datagrams over loopback: nothing sleeps, every wait is a bounded `select`.

LOOPBACK = StreamAddress("vmc://", "vmc")
"""Loopback, at any free port."""
PATIENCE_S = 5.0
CLOCK = MonotonicClock()


@contextmanager
def sending(to: UdpReceiver) -> Iterator[socket.socket]:
    """A socket that is connected to a receiver on loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", to.bound[1]))
        yield sender


def arrived(receiver: UdpReceiver) -> list[Datagram]:
    """One poll, once there is something to fetch."""
    ready, _, _ = select.select([receiver], [], [], PATIENCE_S)
    assert ready, "nothing arrived over loopback"
    return receiver.poll(CLOCK.now())


# What each role of a sender means, written out: the orientation of its segment and the place of its joint.

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
_HALF_ROOT = float(np.sqrt(0.5))
_LOWERED: dict[str, Quaternion] = {"l_": (_HALF_ROOT, -_HALF_ROOT, 0.0, 0.0), "r_": (_HALF_ROOT, _HALF_ROOT, 0.0, 0.0)}
"""An arm of the T-pose turned until it hangs: by 90 degrees about forward, the left one to the right."""


@dataclass(frozen=True, slots=True)
class Role:
    """One pose of a sender.

    name: the sender's, as in `StreamFrame.names`. point: the canonical sensor whose joint its position is, "" if none.
    segment: the canonical sensor whose body segment its rotation is, "" if none. standing: the orientation that is
    sent, wxyz, of who stands upright with hanging arms and faces x. offset: from the joint to the point that is sent,
    m, in the axes of the sent rotation; of the sender's default proportions, where calibration begins.
    """

    name: str
    point: str
    segment: str
    standing: Quaternion = _UPRIGHT
    offset: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        assert {self.point, self.segment} <= {"", *SENSORS} and (self.point or self.segment)


_SIDES = (("l_", "Left"), ("r_", "Right"))

_HAND_FORWARD = 0.13
"""m by which SlimeVR's hand is forward of the forearm's line, arms hanging (measured, default proportions)."""

_SLIMEVR = (
    Role("human://HEAD", "head", "head"),
    Role("human://CHEST", "chest", "chest"),
    Role("human://WAIST", "pelvis", "pelvis"),
    *(
        role
        for short, side in _SIDES
        for role in (
            Role(f"human://{side.upper()}_KNEE", f"{short}knee", f"{short}hip"),
            Role(f"human://{side.upper()}_FOOT", f"{short}ankle", f"{short}ankle"),
            Role(f"human://{side.upper()}_ELBOW", f"{short}elbow", f"{short}shoulder"),
            Role(f"human://{side.upper()}_HAND", f"{short}wrist", f"{short}wrist", offset=(_HAND_FORWARD, 0.0, 0.0)),
        )
    ),
)
"""SlimeVR's sparse set. Knee and elbow: the joint, turned with the segment above it. Hand: a point in front of the
grip, beyond the wrist by a length that the stream does not hold; without a tracker there, it turns with the forearm.
SlimeVR sends roles without trackers too, so the performer's file must list those with trackers."""

_SLIMEVR_VRCHAT = (
    Role("tracker://head", "head", ""),
    Role("tracker://6", "chest", "chest"),
    Role("tracker://1", "pelvis", "pelvis"),
    *(
        Role(f"tracker://{number}", short + point, short + segment)
        for point, segment, numbers in (("ankle", "ankle", "23"), ("knee", "hip", "45"), ("elbow", "shoulder", "78"))
        for (short, _), number in zip(_SIDES, numbers, strict=True)
    ),
)
"""SlimeVR's fixed ids over VRChat OSC, same meaning as above. The head turns on a yaw reset only; no wrists."""

_BONES = (
    Role("bone://Head", "head", "head"),
    Role("bone://Chest", "chest", ""),
    Role("bone://UpperChest", "", "chest"),
    Role("bone://Hips", "pelvis", "pelvis"),
    *(
        Role(f"bone://{side}{bone}", short + sensor, short + sensor, _LOWERED[short])
        for bone, sensor in (("UpperArm", "shoulder"), ("LowerArm", "elbow"), ("Hand", "wrist"))
        for short, side in _SIDES
    ),
    *(
        Role(f"bone://{side}{bone}", short + sensor, short + sensor)
        for bone, sensor in (("UpperLeg", "hip"), ("LowerLeg", "knee"), ("Foot", "ankle"), ("Toes", "toe"))
        for short, side in _SIDES
    ),
)
"""Unity's bones: the joint where the bone begins, and the bone; after forward kinematics (`VmcBodyDecoder`)."""

ROLE_SETS = {"slimevr": _SLIMEVR, "slimevr_vrchat": _SLIMEVR_VRCHAT, "unity_bones": _BONES}
"""The roles of one kind of sender, under the name that performers' files use."""


def role(convention: str, name: str) -> Role:
    """The role of a pose by the sender's name."""
    return next(one for one in ROLE_SETS[convention] if one.name == name)


def canonical_orientation(role: Role, orientation: FloatArray) -> FloatArray:
    """World orientation (..., 4) wxyz of the role's segment, identity where arms hang, from the sent orientation."""
    return multiply(orientation, conjugate(role.standing))
