"""A second of standing still: size, floor, heading; and what is refused, by name."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.clock import VirtualClock
from messages import refuses, shows
from mvn_packets import quaternions, scale
from people import at_rest
from retarget import rotations
from retarget.errors import InputError
from retarget.frames import SensorSample
from retarget.human.samples import Performance
from retarget.live.admission import Admission, Datagram
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.clock_map import ClockMap
from retarget.live.playout import Playout
from retarget.live.rest_capture import CAPTURE_S, Alignment, Calibrated, RestCapture, align
from retarget.live.roles import roles_of
from retarget.live.sensor_validity import SensorValidity
from retarget.live.stream import LiveStream
from retarget.model.human_dimensions import FRACTIONS, POINTS, HumanDimensions, proportional_dimensions
from retarget.schema.performer import load_performer
from retarget.sources.streams.mvn import MVN_JOINTS, SEGMENTS, MvnDecoder
from retarget.sources.streams.stream_frame import Dropped
from retarget.types import FloatArray

NAMES = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
STANDING = np.array([[0.0, 0.0, 1.62], [0.02, 0.25, 0.8], [0.02, -0.25, 0.8], [0.0, 0.1, 0.07], [0.0, -0.1, 0.07]])
ANGLES = st.floats(-np.pi, np.pi)
PLACES = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-1, 1))


@settings(max_examples=60)
@given(ANGLES, PLACES)
def test_a_standing_performer_faces_x_on_the_floor(yaw: float, place: tuple[float, float, float]) -> None:
    turn = rotations.from_axis_angle([0.0, 0.0, 1.0], yaw)
    sent = rotations.rotate(turn, STANDING) + np.array(place)
    found = align(NAMES, sent)
    ours = found.positions(sent)
    np.testing.assert_allclose(ours[:, :2], STANDING[:, :2], atol=1e-9)
    np.testing.assert_allclose(ours[3, 2], 0.07, atol=0.01)
    assert rotations.angle_between(found.orientations(turn), rotations.IDENTITY) < 1e-7


def test_left_and_right_in_one_place_show_no_direction() -> None:
    sent = STANDING.copy()
    sent[:, 1] = 0.0
    with refuses(InputError):
        align(NAMES, sent, where="vmc://:39539")


@settings(max_examples=60)
@given(ANGLES, PLACES, ANGLES, PLACES)
def test_a_turn_keeps_its_centre(
    yaw: float, origin: tuple[float, float, float], turn: float, about: tuple[float, float, float]
) -> None:
    before = Alignment(yaw, np.array(origin))
    after = before.turned(turn, np.array(about))
    sent = np.array([[0.3, -0.2, 1.0], [1.0, 2.0, 0.0]])
    ours, centre = before.positions(sent), np.array([about[0], about[1], 0.0])
    spun = rotations.rotate(rotations.from_axis_angle([0.0, 0.0, 1.0], turn), ours - centre) + centre
    np.testing.assert_allclose(after.positions(sent), spun, atol=1e-9)
    q = rotations.from_axis_angle([0.0, 1.0, 0.0], 0.4)
    expected = rotations.multiply(rotations.from_axis_angle([0.0, 0.0, 1.0], turn), before.orientations(q))
    assert rotations.angle_between(after.orientations(q), expected) < 1e-7


REST_CAPTURE_NAMES = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle", "pelvis")
PERSON = proportional_dimensions(1.75)
REST_CAPTURE_STANDING = at_rest(PERSON, 0.1, turn=0.9)
WHERE = "vmc://:39539"


def sample(position: FloatArray, *, lost: tuple[str, ...] = ()) -> SensorSample:
    valid = np.array([name not in lost for name in REST_CAPTURE_NAMES])
    return SensorSample(
        REST_CAPTURE_NAMES,
        np.where(valid[:, None], position, np.nan),
        np.full((len(REST_CAPTURE_NAMES), 4), np.nan),
        valid,
    )


def captured(*, lost: tuple[str, ...] = (), sway: float = 0.004, wave: float = 0.0) -> Calibrated:
    noise = np.random.default_rng(5)
    capture = RestCapture(where=WHERE)
    base = np.array([REST_CAPTURE_STANDING[name] for name in REST_CAPTURE_NAMES])
    for tick in range(150):
        if capture.done:
            break
        position = base + noise.normal(0.0, sway / 3, base.shape)
        position[1, 2] += wave * tick / 150
        capture.take(0.01 * tick, sample(position, lost=lost))
    assert capture.done and 0.01 * tick == pytest.approx(CAPTURE_S, abs=0.02)
    return capture.result()


def test_a_performer_who_stands_still_is_measured_and_faces_x() -> None:
    found = captured()
    assert found.dimensions.stature == pytest.approx(1.75, abs=0.03)
    assert found.missing == ()
    at = dict(zip(found.sensors, found.position, strict=True))
    across = at["l_wrist"] - at["r_wrist"]
    assert across[1] > 0.3 and abs(across[0]) < 0.02
    assert at["l_ankle"][2] == pytest.approx(REST_CAPTURE_STANDING["l_ankle"][2], abs=0.015)
    np.testing.assert_allclose(np.mean([at["l_ankle"], at["r_ankle"]], axis=0)[:2], 0.0, atol=1e-6)


def test_a_sensor_that_is_not_fresh_is_named_and_missing_where_it_can_be() -> None:
    assert captured(lost=("pelvis",)).missing == ("pelvis",)
    with refuses(InputError, found="l_wrist"):
        captured(lost=("l_wrist",))


def taken(standing: dict[str, FloatArray]) -> Calibrated:
    capture = RestCapture(where=WHERE)
    base = np.array([standing[name] for name in REST_CAPTURE_NAMES])
    for tick in range(150):
        capture.take(0.01 * tick, sample(base))
    return capture.result()


def test_lying_down_is_refused() -> None:
    with refuses(InputError):
        taken({name: place[[2, 1, 0]] for name, place in REST_CAPTURE_STANDING.items()})


@pytest.mark.parametrize("raised", ["l_wrist", "r_wrist"])
def test_one_arm_out_and_the_other_hanging_is_no_rest_pose(raised: str) -> None:
    out = at_rest(PERSON, np.pi / 2, turn=0.9)
    with refuses(InputError):
        taken(REST_CAPTURE_STANDING | {raised: out[raised]})
    assert taken(out).dimensions.stature == pytest.approx(1.75, abs=0.04)


@pytest.mark.parametrize(("stature", "fits"), [(1.05, False), (1.3, True), (2.1, True), (2.4, False)])
def test_an_impossible_stature_is_refused(stature: float, fits: bool) -> None:
    standing = at_rest(proportional_dimensions(stature), 0.1, turn=0.9)
    if fits:
        assert taken(standing).dimensions.stature == pytest.approx(stature, abs=0.04)
        return
    with refuses(InputError, allowed=("1.2", "2.2")):
        taken(standing)


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
    """A performer who stands still at 100 Hz; the T-pose datagram `rest` comes once, at first."""

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
        validity=SensorValidity(roles.sensors),
        playout=Playout(len(roles.sensors), delay=None),
    )
    options = LiveOptions(countdown=0.2, mirror=mirror)
    found = begin_live(stream, options, clock=VirtualClock(), rate_hz=100.0, where="mvn://:9763", notify=said.append)
    return found, said


def worst_limb(found: HumanDimensions, true: HumanDimensions) -> float:
    return max(abs(found.length(f"{side}_{part}") - true.length(f"{side}_{part}")) for part in LIMBS for side in "lr")


def test_the_skeleton_of_mvn_is_the_size() -> None:
    person = long_legs()
    found, said = begun(MvnSender(person, t_pose(person)))
    fitted, measured = begun(MvnSender(person, b""))
    assert worst_limb(found.dimensions, person) < 1e-5
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


# The live calibration measures only who stands upright, and says in words who does not.

STATURE = 1.68
FIVE = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
UPPER = ("head", "l_wrist", "r_wrist")


def standing() -> dict[str, FloatArray]:
    """Sensors of a person of 1.68 m, arms hanging; z = 0 is the floor."""
    points = dict(zip(POINTS, proportional_dimensions(STATURE).standing(), strict=True))
    floor = points["l_ankle"][2] - FRACTIONS.ankle_height * STATURE
    return {name: points[name] - [0.0, 0.0, floor] for name in FIVE}


def measured(at: dict[str, FloatArray], stature: float | None = None) -> float:
    """Stature (m) of a second of standing still; `stature`: the known one."""
    capture = RestCapture(where="test")
    names, position, count = tuple(at), np.array(list(at.values())), len(at)
    for tick in range(60):
        capture.take(
            0.02 * tick, SensorSample(names, position, np.full((count, 4), np.nan), np.ones(count, dtype=bool))
        )
    return capture.result(stature=stature).dimensions.stature


def leaning(degrees: float) -> dict[str, FloatArray]:
    """The upper body turned forward about the hips."""
    at, angle = standing(), np.deg2rad(degrees)
    hips = np.array([0.0, 0.0, 0.5 * STATURE])
    turn = np.array([[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]])
    return at | {name: hips + turn @ (at[name] - hips) for name in UPPER}


def crouched(degrees: float) -> dict[str, FloatArray]:
    """Thighs and shanks turned by as much, so that the body comes straight down; with sensors on the knees."""
    person, at, angle = proportional_dimensions(STATURE), standing(), np.deg2rad(degrees)
    leg = person.length("l_knee") + person.length("l_ankle")
    at |= {name: at[name] - [0.0, 0.0, (1.0 - np.cos(angle)) * leg] for name in UPPER}
    ahead = person.length("l_ankle") * np.array([np.sin(angle), 0.0, np.cos(angle)])
    return at | {f"{side}_knee": at[f"{side}_ankle"] + ahead for side in "lr"}


def bowing(degrees: float) -> dict[str, FloatArray]:
    """Bent forward at the hips, which go back so far that the head stays above the feet."""
    pelvis = np.array([0.0, 0.0, 0.5 * STATURE])
    at = leaning(degrees) | {"pelvis": pelvis}
    back = at["head"] * [1.0, 0.0, 0.0]
    return {name: place - (0.0 if "ankle" in name else 1.0) * back for name, place in at.items()}


def test_a_known_stature_is_kept_whatever_the_posture_hides() -> None:
    crouching = {name: at for name, at in crouched(35.0).items() if "knee" not in name}
    assert measured(crouching) < 0.97 * STATURE
    assert measured(crouching, STATURE) == pytest.approx(STATURE, rel=0.005)
    too_low = np.array([0.0, 0.0, 0.06])  # [m] the sender's floor
    three = {name: at + too_low for name, at in standing().items() if "ankle" not in name}
    assert measured(three) > 1.03 * STATURE
    assert measured(three, STATURE) == pytest.approx(STATURE, rel=0.005)
    with refuses(InputError, "1.20 m"):
        measured(standing(), 1.2)


def test_who_stands_upright_is_measured_within_two_percent() -> None:
    assert measured(standing()) == pytest.approx(STATURE, rel=0.02)
    assert measured(leaning(8.0)) == pytest.approx(STATURE, rel=0.02)
    assert measured(crouched(10.0)) == pytest.approx(STATURE, rel=0.02)


@pytest.mark.parametrize(
    ("at", "found"),
    [
        (crouched(16.0), "your knees are bent, 0.1. m ahead of your feet"),
        (leaning(25.0), "your head is 0.[23]. m ahead of your feet"),
        (bowing(22.0), "your head is 0.2. m ahead of your hips"),
        (standing() | {"head": standing()["head"] + [0.3, 0.0, -0.05]}, "your head is 0.2. m ahead of your feet"),
        (standing() | {"head": standing()["head"] - [0.0, 0.2, 0.0]}, "your head is 0.20 m to the right of your feet"),
        (standing() | {"l_ankle": standing()["l_ankle"] + [0.05, 0.0, 0.1]}, "left foot is 0.10 m above your right"),
        (standing() | {"r_ankle": standing()["r_ankle"] + [0.0, 0.0, 0.06]}, "right foot is 0.06 m above your left"),
        (
            standing() | {name: standing()[name] + [0.55, 0.0, 0.5] for name in ("l_wrist", "r_wrist")},
            "your hands are 0.5. m ahead of your head",
        ),
    ],
)
def test_who_does_not_is_told_why(at: dict[str, FloatArray], found: str) -> None:
    with pytest.raises(InputError, match=found):
        measured(at)


def moved(at: dict[str, FloatArray], apart: float) -> dict[str, FloatArray]:
    """The sensors `at`, with both ankles so far apart (m)."""
    return at | {
        name: at[name] * [1.0, 0.0, 1.0] + [0.0, side * 0.5 * apart, 0.0]
        for name, side in (("l_ankle", 1.0), ("r_ankle", -1.0))
    }


def swapped(at: dict[str, FloatArray], *parts: str) -> dict[str, FloatArray]:
    """The sensors `at`, with left and right of these parts exchanged."""
    sides = {f"{side}_{part}": at[f"{other}_{part}"] for part in parts for side, other in ("lr", "rl")}
    return at | sides


def arms_crossed() -> dict[str, FloatArray]:
    """Each hand below the other elbow: as far apart as the feet, so that all pairs together show no direction."""
    at = standing()
    apart = float(at["l_ankle"][1] - at["r_ankle"][1])
    return at | {
        name: at["head"] + np.array([0.2, -side * 0.5 * apart, -0.5])
        for name, side in (("l_wrist", 1.0), ("r_wrist", -1.0))
    }


CROSSED = "left and right of the"


@pytest.mark.parametrize("known", [None, STATURE])
@pytest.mark.parametrize(
    ("at", "found"),
    [
        (moved(standing(), 0.55), "your ankles are 0.55 m apart"),
        (moved(standing(), 0.98), "your ankles are 0.98 m apart"),
        (swapped(standing(), "wrist"), CROSSED),
        (swapped(standing(), "ankle"), CROSSED),
        (arms_crossed(), CROSSED),
    ],
)
def test_wide_feet_and_what_is_crossed_or_swapped_are_refused_without_a_raised_arm(
    at: dict[str, FloatArray], found: str, known: float | None
) -> None:
    with refuses(InputError, found=found):
        measured(at, known)


def test_the_pair_that_differs_from_all_others_is_named() -> None:
    points = at_rest(PERSON, 0.1)
    at = {name: points[name] for name in (*FIVE, "l_hip", "r_hip", "l_knee", "r_knee")}
    with refuses(InputError, found="of the ankles are exchanged"):
        measured(swapped(at, "ankle"))
    with refuses(InputError, found="of the wrists are exchanged"):
        measured(swapped(at, "wrist"))


@pytest.mark.parametrize("arms", [0.05, 0.8, np.pi / 2])
@pytest.mark.parametrize("apart", [0.0, 0.08, 0.3, 0.48])
@pytest.mark.parametrize("ahead", [0.0, 0.12])
def test_who_stands_with_feet_together_or_as_wide_as_a_stride_is_measured(
    arms: float, apart: float, ahead: float
) -> None:
    points = at_rest(PERSON, arms)
    at = moved({name: points[name] - [2.0, -1.0, 0.0] for name in FIVE}, apart)
    at["l_ankle"] = at["l_ankle"] + np.array([ahead, 0.0, 0.04])
    assert measured(at) == pytest.approx(PERSON.stature, rel=0.04)


def facing_back() -> FloatArray:
    """Orientation of a head whose face is where left and right have the back."""
    return rotations.from_axis_angle([0.0, 0.0, 1.0], np.pi)


@pytest.mark.parametrize("known", [None, STATURE])
def test_toes_or_a_face_that_point_backward_show_a_mirrored_performer(known: float | None) -> None:
    at = standing()
    ahead = {f"{side}_toe": at[f"{side}_ankle"] + [0.15, 0.0, -0.05] for side in "lr"}
    assert measured(at | ahead) == pytest.approx(STATURE, rel=0.02)
    with refuses(InputError, found=("left toes", "right toes")):
        measured({name: place * [-1.0, 1.0, 1.0] for name, place in (at | ahead).items()}, known)


@pytest.mark.parametrize("oriented", [True, False])
def test_a_face_counts_only_where_the_axes_are_the_performers(oriented: bool) -> None:
    at = standing()
    capture = RestCapture(where="test", oriented=oriented)
    turns = np.full((len(at), 4), np.nan)
    turns[list(at).index("head")] = facing_back()
    for tick in range(60):
        capture.take(
            0.02 * tick, SensorSample(tuple(at), np.array([*at.values()]), turns, np.ones(len(at), dtype=bool))
        )
    if not oriented:
        assert capture.result().dimensions.stature == pytest.approx(STATURE, rel=0.02)
        return
    with refuses(InputError, found="your head faces backward", next_step="--mirrored-camera"):
        capture.result()
