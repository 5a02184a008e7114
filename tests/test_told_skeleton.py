"""The skeleton that a stream tells is the performer's size, exactly; one that is no human's is left aside."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from hardware.clock import VirtualClock
from mvn_packets import quaternions, scale
from people import at_rest
from retarget.human_dimensions import POINTS, HumanDimensions, proportional_dimensions
from retarget.live.admission import Admission
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.clock_map import ClockMap
from retarget.live.datagram import Datagram
from retarget.live.playout import Playout
from retarget.live.roles import roles_of
from retarget.live.stream import LiveStream
from retarget.live.told_skeleton import told_skeleton
from retarget.live.trust import Trust
from retarget.performer import load_performer
from retarget.rotations import FloatArray
from retarget.samples import Performance
from retarget.sources.json_pose import JsonPoseDecoder
from retarget.sources.mvn import MvnDecoder
from retarget.sources.mvn_roles import MVN_JOINTS
from retarget.sources.mvn_wire import SEGMENTS
from retarget.sources.stream_frame import Dropped
from support.messages import shows

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
LIMBS = ("knee", "ankle", "elbow", "wrist")


def long_legs() -> HumanDimensions:
    """Legs 8 % longer than usual, arms 6 % shorter, and the left thigh 2 cm longer than the right one."""
    usual = proportional_dimensions(1.75)
    offset = usual.offset.copy()
    for name, factor in (("knee", 1.08), ("ankle", 1.08), ("elbow", 0.94), ("wrist", 0.94)):
        for side in "lr":
            offset[POINTS.index(f"{side}_{name}")] *= factor
    offset[POINTS.index("l_knee"), 2] -= 0.02
    return HumanDimensions(offset, usual.stature, usual.mass, "made")


def placed(points: dict[str, FloatArray]) -> list[tuple[str, FloatArray]]:
    return [(segment, points[joint]) for joint, segment in MVN_JOINTS.items()]


def t_pose(person: HumanDimensions) -> bytes:
    return scale([(segment, at.tolist()) for segment, at in placed(at_rest(person, np.pi / 2, splay=0.0))])


@dataclass
class MvnSender:
    """Somebody stands still at 100 Hz; the T-pose comes once, with what `rest` makes of it."""

    person: HumanDimensions
    rest: bytes
    dropped: Dropped = field(default_factory=Dropped)
    sent: int = 0

    finished = False

    def poll(self, now: float) -> list[Datagram]:
        chance = np.random.default_rng(self.sent)
        segments = [
            (SEGMENTS.index(segment) + 1, (at + chance.normal(0.0, 0.0005, 3)).tolist(), UPRIGHT)
            for segment, at in placed(at_rest(self.person, 0.1))
        ]
        found = [self.rest] if self.sent == 0 else []
        while self.sent / 100.0 <= now:
            found.append(quaternions(segments, sample=self.sent, time_ms=10 * self.sent))
            self.sent += 1
        return [Datagram(now, ("127.0.0.1", 9000), datagram) for datagram in found]

    def close(self) -> None:
        """Nothing is open."""


def begun(sender: MvnSender, *, mirror: bool = False) -> tuple[Performance, list[str]]:
    said: list[str] = []
    roles = roles_of(load_performer("five"), "mvn", where="test")
    stream = LiveStream(
        sender,
        MvnDecoder(),
        roles,
        admission=Admission(),
        clock_map=ClockMap(resolution=1e-3),
        trust=Trust(roles.sensors),
        playout=Playout(len(roles.sensors), delay=None),
    )
    options = LiveOptions(countdown=0.2, mirror=mirror)
    found = begin_live(stream, options, clock=VirtualClock(), rate_hz=100.0, where="mvn://:9763", tell=said.append)
    return found, said


def worst_limb(found: HumanDimensions, true: HumanDimensions) -> float:
    return max(abs(found.length(f"{side}_{part}") - true.length(f"{side}_{part}")) for part in LIMBS for side in "lr")


def test_the_skeleton_of_mvn_is_the_size() -> None:
    person = long_legs()
    told, said = begun(MvnSender(person, t_pose(person)))
    fitted, measured = begun(MvnSender(person, b""))
    assert worst_limb(told.dimensions, person) < 1e-5
    assert worst_limb(fitted.dimensions, person) > 0.02  # what the rest pose of five sensors cannot see
    assert said[-1].startswith("known: ")
    shows(said[-1], "mvn://:9763")
    assert measured[-1].startswith("measured: ")


def test_mirrored_the_longer_leg_is_the_other_one() -> None:
    person = long_legs()
    found, _ = begun(MvnSender(person, t_pose(person)), mirror=True)
    for one, other in pairwise(("l_knee", "r_knee", "l_knee")):
        np.testing.assert_allclose(found.dimensions.of(one), person.of(other) * [1.0, -1.0, 1.0], atol=1e-5)


def test_a_skeleton_that_is_no_human_s_is_left_aside() -> None:
    person = long_legs()
    half = scale([(segment, at.tolist()) for segment, at in placed(at_rest(person, np.pi / 2)) if "Leg" not in segment])
    found, said = begun(MvnSender(person, half))
    assert any(text.startswith("the stream's skeleton is not used: ") and "l_knee" in text for text in said)
    assert found.dimensions.origin.startswith("N-pose")


def test_other_senders_tell_none() -> None:
    assert told_skeleton(JsonPoseDecoder()) is None
    assert told_skeleton(MvnDecoder()) is None
