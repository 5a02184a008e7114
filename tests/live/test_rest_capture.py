"""A second of standing still: size, floor, heading; and refusals by name."""

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
from retarget.live.address import parse_address
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.open_stream import open_stream
from retarget.live.rest_capture import CAPTURE_S, Alignment, Calibrated, RestCapture, align
from retarget.model.human_dimensions import FRACTIONS, POINTS, HumanDimensions, proportional_dimensions
from retarget.schema.performer import load_performer
from retarget.sources.streams.mvn import MVN_JOINTS, SEGMENTS
from retarget.types import FloatArray
from sim.faults.sender import FakeSender

Places = dict[str, FloatArray]

FIVE = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
SIX = (*FIVE, "pelvis")
STANDING = np.array([[0.0, 0.0, 1.62], [0.02, 0.25, 0.8], [0.02, -0.25, 0.8], [0.0, 0.1, 0.07], [0.0, -0.1, 0.07]])
ANGLES = st.floats(-np.pi, np.pi)
PLACES = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-1, 1))


@settings(max_examples=60)
@given(ANGLES, PLACES)
def test_a_standing_performer_faces_x_on_the_floor(yaw: float, place: tuple[float, float, float]) -> None:
    turn = rotations.from_axis_angle([0.0, 0.0, 1.0], yaw)
    sent = rotations.rotate(turn, STANDING) + np.array(place)
    found = align(FIVE, sent)
    ours = found.positions(sent)
    np.testing.assert_allclose(ours[:, :2], STANDING[:, :2], atol=1e-9)
    np.testing.assert_allclose(ours[3, 2], 0.07, atol=0.01)
    assert rotations.angle_between(found.orientations(turn), rotations.IDENTITY) < 1e-7


def test_left_and_right_in_one_place_show_no_direction() -> None:
    with refuses(InputError):
        align(FIVE, STANDING * [1.0, 0.0, 1.0], where="vmc://:39539")


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


PERSON = proportional_dimensions(1.75)
TURNED = {name: at_rest(PERSON, 0.1, turn=0.9)[name] for name in SIX}
SPREAD = {name: at_rest(PERSON, np.pi / 2, turn=0.9)[name] for name in SIX}


def calibrated(
    at: Places,
    *,
    stature: float | None = None,
    lost: tuple[str, ...] = (),
    sway: float = 0.0,
    head: FloatArray | None = None,
    oriented: bool = True,
) -> Calibrated:
    """A second with the sensors at these places. stature: the known one. head: its orientation."""
    capture, noise = RestCapture(where="vmc://:39539", oriented=oriented), np.random.default_rng(5)
    names, base, turns = tuple(at), np.array(list(at.values())), np.full((len(at), 4), np.nan)
    valid = np.array([name not in lost for name in names])
    if head is not None:
        turns[names.index("head")] = head
    for tick in range(150):
        if capture.done:
            break
        position = np.where(valid[:, None], base + noise.normal(0.0, sway, base.shape), np.nan)
        capture.take(0.01 * tick, SensorSample(names, position, turns, valid))
    assert capture.done and 0.01 * tick == pytest.approx(CAPTURE_S, abs=0.02)
    return capture.result(stature=stature)


def measured(at: Places, stature: float | None = None) -> float:
    """Stature, m."""
    return calibrated(at, stature=stature).dimensions.stature


def test_a_performer_who_stands_still_is_measured_and_faces_x_and_lost_sensors_are_named() -> None:
    found = calibrated(TURNED, sway=0.0013)
    assert found.dimensions.stature == pytest.approx(1.75, abs=0.03)
    assert found.missing == ()
    at = dict(zip(found.sensors, found.position, strict=True))
    across = at["l_wrist"] - at["r_wrist"]
    assert across[1] > 0.3 and abs(across[0]) < 0.02
    assert at["l_ankle"][2] == pytest.approx(TURNED["l_ankle"][2], abs=0.015)
    np.testing.assert_allclose(np.mean([at["l_ankle"], at["r_ankle"]], axis=0)[:2], 0.0, atol=1e-6)
    assert calibrated(TURNED, lost=("pelvis",), sway=0.0013).missing == ("pelvis",)
    with refuses(InputError, found="l_wrist"):
        calibrated(TURNED, lost=("l_wrist",), sway=0.0013)


def test_arms_out_are_a_rest_pose_but_not_one_alone_and_lying_down_is_none() -> None:
    assert measured(SPREAD) == pytest.approx(1.75, abs=0.04)
    lying = {name: place[[2, 1, 0]] for name, place in TURNED.items()}
    for at in (lying, *(TURNED | {wrist: SPREAD[wrist]} for wrist in ("l_wrist", "r_wrist"))):
        with refuses(InputError):
            measured(at)


@pytest.mark.parametrize(("stature", "fits"), [(1.05, False), (1.3, True), (2.1, True), (2.4, False)])
def test_an_impossible_stature_is_refused(stature: float, fits: bool) -> None:
    points = at_rest(proportional_dimensions(stature), 0.1, turn=0.9)
    at = {name: points[name] for name in SIX}
    if fits:
        assert measured(at) == pytest.approx(stature, abs=0.04)
        return
    with refuses(InputError, allowed=("1.2", "2.2")):
        measured(at)


# The skeleton that MVN sends is the size.


def long_legs() -> HumanDimensions:
    """Legs 8 % longer than usual, arms 6 % shorter, and the left thigh 2 cm longer than the right one."""
    usual = proportional_dimensions(1.75)
    offset = usual.offset.copy()
    for name, factor in (("knee", 1.08), ("ankle", 1.08), ("elbow", 0.94), ("wrist", 0.94)):
        for side in "lr":
            offset[POINTS.index(f"{side}_{name}")] *= factor
    offset[POINTS.index("l_knee"), 2] -= 0.02
    return HumanDimensions(offset, usual.stature, usual.mass, "made")


LONG_LEGS = long_legs()


def placed(points: Places) -> list[tuple[str, FloatArray]]:
    return [(segment, points[joint]) for joint, segment in MVN_JOINTS.items()]


T_POSE = placed(at_rest(LONG_LEGS, np.pi / 2, splay=0.0))


class MvnSender(FakeSender):
    """The performer with long legs, who stands still."""

    def encoded(self, time: float) -> bytes:
        sample = round(self.rate_hz * time)
        noise = np.random.default_rng(sample).normal(0.0, 0.0005, (len(MVN_JOINTS), 3))
        segments = [
            (SEGMENTS.index(segment) + 1, (at + off).tolist(), (1.0, 0.0, 0.0, 0.0))
            for (segment, at), off in zip(placed(at_rest(LONG_LEGS, 0.1)), noise, strict=True)
        ]
        return quaternions(segments, sample=sample, time_ms=10 * sample)


def begun(skeleton: list[tuple[str, FloatArray]] | None, *, mirror: bool = False) -> tuple[Performance, list[str]]:
    """A live run that begins with a sender which sends its skeleton once, at first."""
    sender, said = MvnSender(), list[str]()
    if skeleton is not None:
        rest = scale([(segment, at.tolist()) for segment, at in skeleton])
        sender.garbles = [lambda time, datagram: [rest, datagram] if time == 0.0 else [datagram]]
    stream = open_stream(parse_address("mvn://:9763"), load_performer("five"), receiver=sender)
    options = LiveOptions(countdown=0.2, mirror=mirror)
    found = begin_live(stream, options, clock=VirtualClock(), rate_hz=100.0, where="mvn://:9763", notify=said.append)
    return found, said


def test_the_skeleton_of_mvn_is_the_size_mirrored_too_unless_it_is_no_humans() -> None:
    def worst_limb(found: Performance) -> float:
        limbs = [f"{side}_{part}" for part in ("knee", "ankle", "elbow", "wrist") for side in "lr"]
        return max(abs(found.dimensions.length(limb) - LONG_LEGS.length(limb)) for limb in limbs)

    found, said = begun(T_POSE)
    fitted, measured_ = begun(None)
    assert worst_limb(found) < 1e-5
    assert worst_limb(fitted) > 0.02  # what the rest pose of five sensors cannot see
    assert said[-1].startswith("known: ")
    shows(said[-1], "mvn://:9763")
    assert measured_[-1].startswith("measured: ")
    mirrored, _ = begun(T_POSE, mirror=True)
    for one, other in pairwise(("l_knee", "r_knee", "l_knee")):
        np.testing.assert_allclose(mirrored.dimensions.of(one), LONG_LEGS.of(other) * [1.0, -1.0, 1.0], atol=1e-5)
    half, said = begun([(segment, at) for segment, at in T_POSE if "Leg" not in segment])
    assert any(text.startswith("the stream's skeleton is not used: ") and "l_knee" in text for text in said)
    assert half.dimensions.origin.startswith("N-pose")


# Only a performer who stands upright is measured; the message says what is wrong.

STATURE = 1.68
UPPER = ("head", "l_wrist", "r_wrist")


def standing() -> Places:
    """Sensors of a person of 1.68 m, arms hanging; z = 0 is the floor."""
    points = dict(zip(POINTS, proportional_dimensions(STATURE).standing(), strict=True))
    floor = points["l_ankle"][2] - FRACTIONS.ankle_height * STATURE
    return {name: points[name] - [0.0, 0.0, floor] for name in FIVE}


def leaning(degrees: float) -> Places:
    """The upper body turned forward about the hips."""
    at, angle = standing(), np.deg2rad(degrees)
    hips = np.array([0.0, 0.0, 0.5 * STATURE])
    turn = np.array([[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]])
    return at | {name: hips + turn @ (at[name] - hips) for name in UPPER}


def crouched(degrees: float) -> Places:
    """Thighs and shanks turned by as much, so that the body comes straight down; with sensors on the knees."""
    person, at, angle = proportional_dimensions(STATURE), standing(), np.deg2rad(degrees)
    leg = person.length("l_knee") + person.length("l_ankle")
    at |= {name: at[name] - [0.0, 0.0, (1.0 - np.cos(angle)) * leg] for name in UPPER}
    ahead = person.length("l_ankle") * np.array([np.sin(angle), 0.0, np.cos(angle)])
    return at | {f"{side}_knee": at[f"{side}_ankle"] + ahead for side in "lr"}


def bowing(degrees: float) -> Places:
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


@pytest.mark.parametrize("at", [standing(), leaning(8.0), crouched(10.0)])
def test_a_performer_who_stands_upright_is_measured_within_two_percent(at: Places) -> None:
    assert measured(at) == pytest.approx(STATURE, rel=0.02)


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
def test_the_message_says_what_is_not_upright(at: Places, found: str) -> None:
    with pytest.raises(InputError, match=found):
        measured(at)


def moved(at: Places, width: float) -> Places:
    """The sensors `at`, with the ankles at this distance (m)."""
    sides = (("l_ankle", 0.5), ("r_ankle", -0.5))
    return at | {name: at[name] * [1.0, 0.0, 1.0] + [0.0, side * width, 0.0] for name, side in sides}


def swapped(at: Places, *parts: str) -> Places:
    """The sensors `at`, with left and right of these parts swapped."""
    return at | {f"{side}_{part}": at[f"{other}_{part}"] for part in parts for side, other in ("lr", "rl")}


def arms_crossed() -> Places:
    """Each hand below the other elbow: at the distance of the feet, so that all pairs together show no direction."""
    at = standing()
    x, _, z = at["head"]
    return at | {f"{side}_wrist": np.array([x + 0.2, at[f"{other}_ankle"][1], z - 0.5]) for side, other in ("lr", "rl")}


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
def test_wide_feet_crossed_arms_and_swapped_sides_are_refused(at: Places, found: str, known: float | None) -> None:
    with refuses(InputError, found=found):
        measured(at, known)


def test_the_pair_that_differs_from_all_others_is_named() -> None:
    points = at_rest(PERSON, 0.1)
    at = {name: points[name] for name in (*FIVE, "l_hip", "r_hip", "l_knee", "r_knee")}
    for part in ("ankle", "wrist"):
        with refuses(InputError, found=f"of the {part}s are exchanged"):
            measured(swapped(at, part))


@pytest.mark.parametrize("arms", [0.05, 0.8, np.pi / 2])
@pytest.mark.parametrize("width", [0.0, 0.08, 0.3, 0.48])
@pytest.mark.parametrize("ahead", [0.0, 0.12])
def test_feet_together_or_as_wide_as_a_stride_are_measured(arms: float, width: float, ahead: float) -> None:
    points = at_rest(PERSON, arms)
    at = moved({name: points[name] - [2.0, -1.0, 0.0] for name in FIVE}, width)
    at["l_ankle"] = at["l_ankle"] + np.array([ahead, 0.0, 0.04])
    assert measured(at) == pytest.approx(PERSON.stature, rel=0.04)


@pytest.mark.parametrize("known", [None, STATURE])
def test_toes_or_a_face_that_point_backward_show_a_mirrored_performer(known: float | None) -> None:
    at = standing()
    ahead = {f"{side}_toe": at[f"{side}_ankle"] + [0.15, 0.0, -0.05] for side in "lr"}
    assert measured(at | ahead) == pytest.approx(STATURE, rel=0.02)
    with refuses(InputError, found=("left toes", "right toes")):
        measured({name: place * [-1.0, 1.0, 1.0] for name, place in (at | ahead).items()}, known)


def test_a_face_counts_only_where_the_axes_are_the_performers() -> None:
    back = rotations.from_axis_angle([0.0, 0.0, 1.0], np.pi)
    unknown = calibrated(standing(), head=back, oriented=False)
    assert unknown.dimensions.stature == pytest.approx(STATURE, rel=0.02)
    with refuses(InputError, found="your head faces backward", next_step="--mirrored-camera"):
        calibrated(standing(), head=back)
