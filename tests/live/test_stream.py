"""A live stream: bounded latency and work of a poll, roles of senders, pages of cameras and headsets."""

import json
from pathlib import Path

import numpy as np
import pytest

from camera_people import datagrams, landmarks
from hardware.guard import CheckedGoal
from live_rig import ROLE_SETS, LiveRig, live_stream
from messages import Facts, refuses
from rendered import performer, raising
from retarget import rotations
from retarget.errors import UsageError
from retarget.frames import mirrored_name
from retarget.human.pose_validation import ValidityState
from retarget.live.address import parse_address
from retarget.live.admission import MOST_PER_POLL, TOO_MANY, Datagram
from retarget.live.begin import LiveOptions
from retarget.live.open_stream import open_stream
from retarget.live.raw_recording import ReplayReceiver
from retarget.live.roles import (
    CONVENTIONS,
    MAX_NAME_SETS,
    Roles,
    roles_of,
)
from retarget.live.stream import MOST_DECODED, LiveStream
from retarget.schema.performer import Performer, PerformerSensor, load_performer
from retarget.sources.streams.camera import CameraDecoder
from retarget.sources.streams.raw_record import RawReader
from retarget.sources.streams.stream_frame import Dropped, StreamDecoder, StreamFrame
from retarget.sources.streams.vmc import VmcDecoder
from retarget.sources.streams.vrchat import VrchatDecoder
from sim.faults.sender import FakeSender

FIVE = load_performer("five")


class Queue:
    """A receiver of datagrams that wait in a kernel."""

    finished = False

    def __init__(self, payloads: list[bytes]) -> None:
        self.dropped = Dropped()
        self.waiting = [Datagram(0.001 * k, ("127.0.0.1", 4), payload) for k, payload in enumerate(payloads)]

    def poll(self, now: float) -> list[Datagram]:
        taken, self.waiting = self.waiting[:MOST_PER_POLL], self.waiting[MOST_PER_POLL:]
        return taken

    def close(self) -> None:
        """Nothing is open."""


class Seen:
    """A decoder of nothing, which keeps its datagrams."""

    def __init__(self) -> None:
        self.dropped, self.given = Dropped(), list[bytes]()

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        self.given.append(datagram)
        return []


def polling(payloads: list[bytes], decoder: StreamDecoder) -> LiveStream:
    stream = live_stream(FakeSender(), FIVE)
    stream.receiver, stream.decoder = Queue(payloads), decoder
    return stream


@pytest.mark.parametrize("convention", ["slimevr", "unity_bones", "mvn", "json"])
def test_a_mirrored_camera_is_seen_as_if_it_were_not(convention: str) -> None:
    straight, mirrored = (roles_of(FIVE, convention, where="", mirrored=is_so) for is_so in (False, True))
    names, chance = straight.names, np.random.default_rng(1)
    position, turns = chance.normal(size=(len(names), 3)), rotations.normalise(chance.normal(size=(len(names), 4)))
    frame = StreamFrame(names, position, turns, chance.uniform(size=len(names)) < 0.7)
    other: dict[str, str] = {}
    for sensor, place in zip(straight.sensors, straight.places, strict=True):
        partner = straight.places[straight.sensors.index(mirrored_name(sensor))]
        other |= {place.position: partner.position, place.orientation: partner.orientation}
    order = [names.index(other[name]) for name in names]  # in the mirror, what the sender calls left is right
    seen = StreamFrame(
        names, position[order] * [1.0, -1.0, 1.0], turns[order] * [1.0, -1.0, 1.0, -1.0], frame.tracked[order]
    )
    as_is, undone = straight.take(frame), mirrored.take(seen)
    assert as_is is not None and undone is not None
    np.testing.assert_array_equal(undone.tracked, as_is.tracked)
    np.testing.assert_allclose(undone.position, as_is.position, atol=1e-12)
    np.testing.assert_allclose(undone.orientation, as_is.orientation, atol=1e-12)
    offset = np.tile([0.1, 0.2, 0.3], (len(FIVE.sensors), 1))
    assert mirrored.shifted(offset).mirrored


@pytest.mark.parametrize("count", [1, MOST_DECODED, 300])
def test_the_newest_datagrams_of_a_backlog_are_decoded_at_once(count: int) -> None:
    sent, decoder = [json.dumps(k).encode() for k in range(count)], Seen()
    stream = polling(sent, decoder)
    stream.poll(1.0, moving=True)
    assert decoder.given == sent[-MOST_DECODED:] and stream.arrived == count
    assert stream.admission.refused.reasons[TOO_MANY] == max(0, count - MOST_DECODED)


@pytest.mark.parametrize(("name", "decoder"), [("vmc_50hz", VmcDecoder), ("vrcosc_20hz", VrchatDecoder)])
@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_nothing_of_a_real_sender_is_dropped(
    name: str, decoder: type[VmcDecoder | VrchatDecoder], speed: float, shared: Path
) -> None:
    stream, now = polling([], decoder()), 0.0
    stream.receiver = ReplayReceiver(RawReader(shared / f"streams/slimevr/full12_{name}.udprec.gz"), speed=speed)
    while not stream.receiver.finished:
        now += 0.01
        stream.poll(now, moving=True)
    assert stream.frames > 250 and stream.admission.refused.count == 0


@pytest.mark.long
def test_a_second_of_powering_reports_no_lost_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=0.5))
    with rig.prepared() as prepared:
        assert prepared.machine is not None
        arm, guard = prepared.machine.guard.arm, prepared.machine.guard

        def slowly(goal: CheckedGoal) -> None:
            arm(goal)
            rig.clock.sleep_until(rig.clock.now() + 1.0)

        monkeypatch.setattr(guard, "arm", slowly)
        rig.said.clear()
        result = prepared.run()
    assert result.stop is None
    assert not [text for text in rig.said if "nothing" in text or "waits" in text], rig.said


# A sender's poses as the sensors of a performer: by convention, by the performer's file, in parts.


def frame(poses: dict[str, tuple[list[float] | None, list[float] | None]]) -> StreamFrame:
    """Poses by name; None: not sent."""
    nothing3, nothing4 = [np.nan] * 3, [np.nan] * 4
    return StreamFrame(
        tuple(poses),
        np.array([at or nothing3 for at, _ in poses.values()], dtype=float).reshape(-1, 3),
        np.array([turn or nothing4 for _, turn in poses.values()], dtype=float).reshape(-1, 4),
        np.ones(len(poses), dtype=bool),
    )


def test_a_hanging_hand_of_slimevr_is_a_wrist_behind_the_point_that_is_sent() -> None:
    roles = roles_of(FIVE, "slimevr", where="five.yaml")
    raised = rotations.from_axis_angle([1.0, 0.0, 0.0], np.pi / 2).tolist()
    upright = [1.0, 0.0, 0.0, 0.0]
    poses = roles.take(
        frame({"human://LEFT_HAND": ([0.13, 0.3, 0.9], upright), "human://HEAD": ([0.0, 0.0, 1.6], upright)})
    )
    assert poses is not None
    at = dict(zip(poses.rows.tolist(), range(len(poses.rows)), strict=True))
    wrist, head = at[roles.sensors.index("l_wrist")], at[roles.sensors.index("head")]
    np.testing.assert_allclose(poses.position[wrist], [0.0, 0.3, 0.9], atol=1e-12)
    np.testing.assert_allclose(poses.position[head], [0.0, 0.0, 1.6])
    assert rotations.angle_between(poses.orientation[wrist], rotations.IDENTITY) < 1e-9
    turned = roles.take(frame({"human://LEFT_HAND": ([0.13, 0.9, 1.4], raised)}))
    assert turned is not None
    np.testing.assert_allclose(turned.orientation[0], raised, atol=1e-12)


@pytest.mark.parametrize("convention", ["unity_bones", "mvn"])
def test_arms_of_a_sender_whose_identity_is_the_t_pose_are_those_that_would_hang(convention: str) -> None:
    arm = {name: place for name, place in CONVENTIONS[convention].items() if name[2:] in ("shoulder", "elbow", "wrist")}
    poses = Roles(tuple(arm), tuple(arm.values())).take(
        frame({place.orientation: ([0.0, 0.0, 1.4], [1.0, 0.0, 0.0, 0.0]) for place in arm.values()})
    )
    assert poses is not None and len(poses.rows) == 6
    for row, turn in zip(poses.rows, poses.orientation, strict=True):
        outward = [0.0, 1.0 if tuple(arm)[row].startswith("l_") else -1.0, 0.0]
        np.testing.assert_allclose(rotations.rotate(turn, [0.0, 0.0, -1.0]), outward, atol=1e-12)
        np.testing.assert_allclose(rotations.rotate(turn, [1.0, 0.0, 0.0]), [1.0, 0.0, 0.0], atol=1e-12)


def test_names_of_the_file_come_first_and_turn_as_their_sender_sends_them() -> None:
    def performer(**roles: str) -> Performer:
        sensors = {name: PerformerSensor(joint=name, role=role or None) for name, role in roles.items()}
        return Performer(name="p", description="d", sensors=sensors)

    (place,) = roles_of(performer(l_wrist="bone://LeftLowerArm"), "unity_bones", where="p.yaml").places
    assert place.position == "bone://LeftLowerArm"
    assert place.standing == CONVENTIONS["unity_bones"]["l_elbow"].standing
    mixed = performer(l_wrist="rigid://left hand", head="")
    assert roles_of(mixed, "json", where="p.yaml").names == ("rigid://left hand", "head")
    with refuses(UsageError, "natnet", "head"):
        roles_of(mixed, "natnet", where="p.yaml")
    with refuses(UsageError, "convention"):
        roles_of(mixed, "slimvr", where="p.yaml")


def test_changing_names_are_kept_within_bounds() -> None:
    roles = Roles(("head",), [CONVENTIONS["json"]["head"]])
    for number in range(3 * MAX_NAME_SETS):
        assert roles.take(frame({f"other{number}": (None, None), "head": ([0.0, 0.0, 1.0], None)})) is not None
    assert roles._plan.cache_info().currsize <= MAX_NAME_SETS


@pytest.mark.parametrize(
    ("convention", "facts"),
    [("slimevr_vrchat", ("l_wrist", "r_wrist", "vmc://:39539")), ("natnet", ("head", "l_wrist", "--performer"))],
)
def test_what_a_kind_of_sender_never_sends_is_refused_once_with_the_next_step(convention: str, facts: Facts) -> None:
    with refuses(UsageError, facts) as refusal:
        roles_of(FIVE, convention, where="five.yaml")
    assert len(refusal.value.problems) == 1


def test_a_partial_performer_leaves_out_what_a_kind_of_sender_never_sends() -> None:
    everything = load_performer("all")
    roles = roles_of(everything, "slimevr", where="all.yaml")
    assert roles.sensors == tuple(everything.sensors) and roles.partial
    assert {name for name, place in zip(roles.sensors, roles.places, strict=True) if not place.position} == {
        f"{side}_{joint}" for side in "lr" for joint in ("shoulder", "hip", "toe")
    }
    poses = roles.take(frame({"human://HEAD": ([0.0, 0.0, 1.6], None), "": ([0.0, 0.0, 1.0], None)}))
    assert poses is not None and poses.rows.tolist() == [roles.sensors.index("head")]
    with refuses(UsageError, "l_wrist", "r_wrist"):
        roles_of(everything, "slimevr_vrchat", where="all.yaml")
    with refuses(UsageError, "l_shoulder"):
        roles_of(everything.model_copy(update={"partial": False}), "slimevr", where="all.yaml")


@pytest.mark.parametrize("convention", ROLE_SETS)
def test_a_sensor_is_at_the_role_of_its_joint_and_turns_with_the_role_of_its_segment(convention: str) -> None:
    points = {one.point: one for one in ROLE_SETS[convention] if one.point}
    segments = {one.segment: one for one in ROLE_SETS[convention] if one.segment}
    assert CONVENTIONS[convention].keys() == points.keys()
    for sensor, place in CONVENTIONS[convention].items():
        assert (place.position, place.offset) == (points[sensor].name, points[sensor].offset)
        assert place.orientation == (segments[sensor].name if sensor in segments else "")
        assert sensor not in segments or place.standing == segments[sensor].standing


# A page of `web://`: a camera or a headset, which is known from what it sends.

SEEN_BY_CAMERA = datagrams(landmarks(raising(performer(1.7), "l", seconds=2.0)))
WORN = [
    json.dumps({"axes": "webxr", "time": 1.0 + k / 60.0, "poses": {"head": {"p": [0.001 * k, 1.6, 0.0]}}}).encode()
    for k in range(60)
]


@pytest.mark.parametrize(("payloads", "rate", "lost_after"), [(SEEN_BY_CAMERA, 30.0, 0.22), (WORN, 60.0, 0.142)])
@pytest.mark.parametrize("before", [[], SEEN_BY_CAMERA[:10], WORN[:10]], ids=["first", "after a camera", "after worn"])
def test_a_camera_alone_may_leave_pictures_out(
    payloads: list[bytes], rate: float, lost_after: float, before: list[bytes]
) -> None:
    stream = open_stream(parse_address("web://"), load_performer("web"), receiver=Queue([]))
    head, now = stream.roles.sensors.index("head"), 1.0
    for number, payload in enumerate([*before, *payloads[20:50]]):
        now = 1.0 + number / rate
        stream.take(Datagram(now, ("127.0.0.1", 1), payload), now, moving=False)
        stream.read(now)
    assert stream.read(now + lost_after - 0.01).states[head] == ValidityState.FRESH
    assert stream.read(now + lost_after + 0.01).states[head] == ValidityState.STALE


def test_a_camera_is_smoothed_once() -> None:
    stream = open_stream(parse_address("web://"), load_performer("web"), receiver=Queue([]), latest=True)
    decoder = CameraDecoder()
    for number, payload in enumerate(SEEN_BY_CAMERA):
        now = 1.0 + number / 30.0
        stream.take(Datagram(now, ("127.0.0.1", 1), payload), now, moving=False)
        shown, (alone,) = stream.read(now), decoder.decode(payload)
        for row, name in enumerate(stream.roles.sensors):
            np.testing.assert_array_equal(shown.position[row], alone.position[alone.names.index(name)])
