"""A live run of OP3 on virtual time, with a sender of JSON poses."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hardware.clock import Clock, VirtualClock
from retarget.frames import SensorFrames
from retarget.human.samples import Performance
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.open_stream import open_stream
from retarget.live.stream import LiveStream
from retarget.model.robot import RobotBody
from retarget.rotations import conjugate, multiply
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare_for
from retarget.schema.performer import Performer, load_performer
from retarget.sources.streams.raw_record import RawWriter
from retarget.types import FloatArray
from sim.faults.sender import FakeSender, SenderFault
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
            notify = self.said.append
            return begin_live(self.stream, self.live, clock=self.clock, rate_hz=rate, where=WHERE, notify=notify)

        options, notify = self.run_options, self.said.append
        with prepare_for(
            perform, options, clock=self.clock, make_bus=self._bus, goes_to_rest=True, notify=notify
        ) as prepared:
            yield prepared

    def _bus(self, robot: RobotBody, clock: Clock) -> MockBus:
        self.bus = mock_bus(robot, clock)
        return self.bus


def raw_stream(path: Path, seconds: float, *faults: SenderFault) -> str:
    """Address of a recording of a sender of JSON poses."""
    writer, sender = RawWriter(path, url="json://:14150"), FakeSender(faults=[*faults])
    for tick in range(round(100 * seconds)):
        for datagram in sender.poll(0.01 * tick):
            address, port = datagram.source
            writer.append(datagram.payload, time_ns=round(1e9 * datagram.arrival), address=address, port=port)
        writer.flush()
    writer.close()
    return f"replay://{path}"


def five() -> Performer:
    """Head, wrists, ankles."""
    return load_performer("five")


# The meaning of each role of a sender, written out: the orientation of its segment and the place of its joint.

_UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_HALF = float(np.sqrt(0.5))
_LOWERED = {"l_": (_HALF, -_HALF, 0.0, 0.0), "r_": (_HALF, _HALF, 0.0, 0.0)}
"""An arm of the T-pose turned until it hangs: by 90 degrees about forward, the left one to the right."""
_HAND = (0.13, 0.0, 0.0)
"""m by which SlimeVR's hand is forward of the forearm's line, arms hanging (measured, default proportions)."""


@dataclass(frozen=True, slots=True)
class Role:
    """One pose of a sender.

    name: the sender's, as in `StreamFrame.names`. point: the canonical sensor whose joint its position is, "" if none.
    segment: the canonical sensor whose body segment its rotation is, "" if none. standing: the orientation that is
    sent, wxyz, of a person who stands upright with hanging arms and faces x. offset: from the joint to the point that
    is sent, m, in the axes of the sent rotation; of the sender's default proportions, where calibration begins.
    """

    name: str
    point: str
    segment: str
    standing: tuple[float, float, float, float] = _UPRIGHT
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


_ROLES = {
    # Knee and elbow: the joint, turned with the segment above it. Hand: in front of the grip.
    "slimevr LEFT RIGHT": """human://HEAD head head | human://CHEST chest chest | human://WAIST pelvis pelvis
        | human://%_KNEE *knee *hip | human://%_FOOT *ankle *ankle | human://%_ELBOW *elbow *shoulder
        | human://%_HAND *wrist *wrist""",
    # SlimeVR's fixed ids over VRChat OSC, same meaning. The head turns on a yaw reset only; no wrists.
    "slimevr_vrchat 0 0": """tracker://head head - | tracker://6 chest chest | tracker://1 pelvis pelvis
        | tracker://2 l_ankle l_ankle | tracker://3 r_ankle r_ankle | tracker://4 l_knee l_hip
        | tracker://5 r_knee r_hip | tracker://7 l_elbow l_shoulder | tracker://8 r_elbow r_shoulder""",
    # Unity's bones: the joint where the bone begins, and the bone; after forward kinematics (`VmcBodyDecoder`).
    "unity_bones Left Right": """bone://Head head head | bone://Chest chest - | bone://UpperChest - chest
        | bone://Hips pelvis pelvis | bone://%UpperArm *shoulder *shoulder | bone://%LowerArm *elbow *elbow
        | bone://%Hand *wrist *wrist | bone://%UpperLeg *hip *hip | bone://%LowerLeg *knee *knee
        | bone://%Foot *ankle *ankle | bone://%Toes *toe *toe""",
}
"""By convention and its words of the sides (%): names of poses, their points and segments, of both sides (*)."""


def _roles(texts: str, left: str, right: str) -> Iterator[Role]:
    for text in texts.split("|"):
        for short, word in (("l_", left), ("r_", right)) if "%" in text else (("", ""),):
            name, point, segment = text.replace("%", word).replace("*", short).split()
            arm = name.startswith("bone://") and point[2:] in ("shoulder", "elbow", "wrist")
            standing = _LOWERED[short] if arm else _UPRIGHT
            offset = _HAND if name.endswith("_HAND") else (0.0, 0.0, 0.0)
            yield Role(name, point.strip("-"), segment.strip("-"), standing, offset)


ROLE_SETS = {
    convention: tuple(_roles(texts, left, right))
    for words, texts in _ROLES.items()
    for convention, left, right in [words.split()]
}
"""The roles of one kind of sender, under the name that performers' files use."""


def canonical_orientation(role: Role, orientation: FloatArray) -> FloatArray:
    """World orientation (..., 4) wxyz of the role's segment, identity where arms hang, from the sent orientation."""
    return multiply(orientation, conjugate(role.standing))
