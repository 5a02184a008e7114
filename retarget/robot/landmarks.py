"""Landmarks of a robot: where a human posture asks them to be, scaled limb by limb, and where they are; in its world.

The robot's world has its origin on the ground between the planted soles, x forward. Landmarks follow from the performer
and from constants of the robot (profile, stance, envelope), never from what the robot does: so a lag of the robot shows
in its errors.

Feet are asked where they are planted; those of a robot that hangs, by the length of the legs, and no closer to each
other sideways than it stands (`feet_apart`); those of one that nothing carries, with the whole body where the performer
is (`retarget.robot.free_legs`). The pelvis is asked over the ankles, as high as the leg that bears the
performer is long (`PelvisOverFeet`), its height within the robot's envelope. The trunk leans and twists as the line
from the hips to the base of the neck and the chest do, its lean within the envelope at that height. The trunk carries
the robot's own shoulders, and from each of them a hand is asked by the length of the arm. A trunk that stays where it
is carries the head: it is asked where it stands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from math import copysign, fsum, inf, sqrt
from typing import TYPE_CHECKING

import numpy as np

from retarget._solver import Body as SolverBody
from retarget._solver import Probe
from retarget.arithmetic import arctan2, exp, hypot, low_pass, matmul, norm, soft_cap
from retarget.errors import ConfigError
from retarget.ik.hierarchy import Hierarchy, body_frames
from retarget.ik.support_polygon import Stance
from retarget.ik.tasks import Limb
from retarget.model.body import Frame
from retarget.model.human_dimensions import POINTS, HumanDimensions
from retarget.model.robot import HEAD, TRUNK, RobotBody
from retarget.robot.crouch_envelope import Envelope
from retarget.robot.free_legs import LEFT, FreeFoot, FreeLegs
from retarget.rotations import (
    NO_TURN,
    Quat,
    Vector,
    arc,
    as_quat,
    as_vector,
    axis_turn,
    inverse,
    minus,
    plus,
    product,
    rotated,
    rotation_vector,
    turn,
)
from retarget.schema.profile import RobotProfile
from retarget.schema.profile_parts import Landmark
from retarget.types import BoolArray, Carrying, FloatArray

if TYPE_CHECKING:
    from retarget.types import HumanPosture


# Facing: the slow heading in which a planted robot mirrors the performer.
#
# A robot whose feet stay planted cannot turn with the performer. It keeps its stance and takes what the performer does
# relative to this heading, so a performer who turns round slowly is followed as one who faces forward, while a quick
# twist of the trunk is a twist of the robot's trunk.

SETTLE_S = 1.0
"""Time constant (s of the robot's clock) with which the heading follows: slower than a twist, faster than a stroll."""
CLEAR = 0.2
"""Length of the mean of the unit directions below which feet and pelvis give no direction, and the heading is held."""


class Facing:
    """Mean ground direction of pelvis, left foot and right foot, through a first-order low pass.

    The pelvis counts as much as both feet: each alone misleads, the feet of a wide stance, the pelvis of a twist.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Take the next direction as it is."""
        self._mean = 0j  # x + i y; zero: not started

    def update(
        self, pelvis: Quat, left_foot: Sequence[float], right_foot: Sequence[float], dt: float
    ) -> tuple[float, float]:
        """Heading (x, y), a unit vector on the ground, `dt` s after the last one.

        pelvis: orientation wxyz, forward where its left axis has it, so that bending does not matter; feet: x, y, z of
        any length, from ankle to toe. What is not finite takes no part.
        """
        x, y = _seen(pelvis, left_foot, right_foot)
        length = hypot(x, y)
        if length > CLEAR:
            times = dt / SETTLE_S if self._mean else inf
            self._mean = low_pass(self._mean, complex(x / length, y / length), times)
        x, y = self._mean.real, self._mean.imag
        norm = hypot(x, y)
        return (x / norm, y / norm) if norm > 1e-9 else (1.0, 0.0)


def _seen(pelvis: Quat, left_foot: Sequence[float], right_foot: Sequence[float]) -> tuple[float, float]:
    """Mean of the unit directions on the ground; shorter than one where they disagree."""
    w, qx, qy, qz = pelvis
    left_x, left_y = 2.0 * (qx * qy - w * qz), 1.0 - 2.0 * (qx * qx + qz * qz)
    x = y = 0.0
    for dx, dy, share in (
        (left_y, -left_x, 0.5),
        (left_foot[0], left_foot[1], 0.25),
        (right_foot[0], right_foot[1], 0.25),
    ):
        length = hypot(dx, dy)
        if 1e-6 < length < float("inf"):
            x += share * dx / length
            y += share * dy / length
    return x, y


# The feet of a robot that hangs, no closer to each other sideways than it stands.
#
# Feet of performers pass each other within a hand's breadth, and cross; those of most robots are half as wide as their
# hips are apart, and would meet. So the goal of the left foot stays to the left of that of the right one, at least by
# their distance in the stance. Goals that are farther apart stay as they are, and the middle of both feet always does.

KNEE = 0.1
"""Share of the least distance above which nothing changes; in between it is approached smoothly."""


@dataclass(frozen=True)
class FeetApart:
    """Rows of the landmarks of the left and the right foot, and the least distance sideways between them, m."""

    left: int
    right: int
    least: float

    def ask(self, landmarks: list[Vector], aside: tuple[float, float] = (0.0, 1.0)) -> None:
        """Move both feet of `landmarks`, m, aside in place, each by half of what is missing. aside: to the left of the
        body, a unit vector on the ground."""
        (lx, ly, lz), (rx, ry, rz) = landmarks[self.left], landmarks[self.right]
        x, y = aside
        # From a knee above the least distance on nothing changes; below, the distance approaches it smoothly.
        apart, room = x * (lx - rx) + y * (ly - ry), KNEE * self.least
        missing = self.least + room - apart
        half = 0.5 * ((apart if missing <= 0.0 else self.least + room * exp(-missing / room)) - apart)
        x, y = half * x, half * y
        landmarks[self.left], landmarks[self.right] = (lx + x, ly + y, lz), (rx - x, ry - y, rz)


def feet_apart(profile: RobotProfile, stance: Stance, rows: Sequence[str]) -> FeetApart | None:
    """The `FeetApart` of a robot whose landmarks are `rows`; None where there are not two feet side by side in them."""
    soles = {foot.frame for foot in profile.feet.values()}
    feet = [row for row, name in enumerate(rows) if profile.landmarks[name].frame in soles]
    if len(feet) != 2:
        return None
    sideways = {row: float(stance.points[profile.landmarks[rows[row]].frame][1]) for row in feet}
    left, right = sorted(feet, key=lambda row: -sideways[row])
    least = sideways[left] - sideways[right]
    return FeetApart(left, right, least) if least > 0.0 else None


# The pelvis is as high as the leg that bears the performer is long, not as high as theirs is above the ground: in a
# stride, both legs of a walker are straight and the pelvis is low, and a robot with its feet side by side would bend
# its knees. The leg that bears is the one whose ankle is low and below its hip; between the two the length goes over
# evenly. Of how far legs are aslant, only what both have in common counts: hips that go back in a squat.
#
# Near a straight leg a bob of the pelvis that nobody sees takes a wide swing of the knee. So the height follows what is
# asked the more slowly, the less it is off: within HEIGHT_BAND it takes its time, and far outside it has no lag to
# speak of. A fiftieth of the leg is 23 degrees of a straight knee, and two of a deep squat.

UNDER = 0.15
"""Share of the leg by which an ankle is off the place below its hip where it bears half as much as right there."""
LIFT_COUNTS = 4.0
"""An ankle that is high above the other one counts as so many times that far off: feet are lifted less than they go."""
STRAIGHT, STRAIGHT_KNEE = 0.97, 0.015
"""Share of the leg from which on a performer's counts as stretched: five sensors know it to 3 %, 28 degrees of the
knee, and who stands straight should not be seen with bent knees. Share in which it is approached smoothly."""
HEIGHT_SETTLE_S, HEIGHT_BAND = 0.6, 0.02
"""Time constant (s) with which the height follows well within HEIGHT_BAND, a share of the leg; three times the band
off, it is a tenth of that."""


class PelvisOverFeet:
    """The middle of the hips from the middle of both ankles, in the robot's world and size."""

    def __init__(self, leg: float) -> None:
        """leg: m, the stretched leg of the performer in the size of the robot's."""
        self._leg = leg
        self.restart()

    def restart(self) -> None:
        """Begin again, with the next height as it is."""
        self._height: float | None = None

    def step(self, hips: Vector, legs: Sequence[Vector], higher: float, dt: float) -> Vector:
        """Where the hips are to be after another `dt` s. hips: of the performer, from the middle of both ankles; legs:
        from the left hip to its ankle, and of the right; higher: by how much the left ankle is above the right one; all
        m, scaled as a leg."""
        x, y, _ = hips
        return x, y, self._on_bearing_leg(legs, higher, dt)

    def _on_bearing_leg(self, legs: Sequence[Vector], higher: float, dt: float) -> float:
        """The height of the hips over the ankles, m, on the leg that bears. higher: by how much the left ankle is above
        the right one, m."""
        shares = []
        for (x, y, _), lift in zip(legs, (max(higher, 0.0), max(-higher, 0.0)), strict=True):
            off = (x * x + y * y + LIFT_COUNTS * LIFT_COUNTS * lift * lift) / (UNDER * UNDER * self._leg * self._leg)
            shares.append(1.0 / (1.0 + off * off))
        share = shares[0] / (shares[0] + shares[1])  # of the left leg
        # What both legs have in common of their way ahead and aside.
        x, y = (sorted((legs[0][axis], 0.0, legs[1][axis]))[1] for axis in (0, 1))
        left, right = (hypot(hypot(*leg[:2]), leg[2]) for leg in legs)
        length = soft_cap((share * left + (1.0 - share) * right) / STRAIGHT, self._leg, STRAIGHT_KNEE)
        asked = sqrt(max(length * length - x * x - y * y, 0.0))
        height = asked if self._height is None else self._height
        off = (asked - height) / (HEIGHT_BAND * self._leg)
        self._height = low_pass(height, asked, dt / HEIGHT_SETTLE_S * (1.0 + off * off))
        return self._height


CROUCH_KNEE = 0.1
"""Share of the robot's range of heights, from its bottom, in which what is asked lower is drawn together."""
LEAN_KNEE = 0.3
"""Share of the robot's lean, from its end, in which what is asked beyond is drawn together."""
TRUNK_LINE = {"neck": 1.0, "l_hip": -0.5, "r_hip": -0.5}
"""The line of the trunk, from the hips to the base of the neck, as a sum of joints."""
FEET = ({"l_toe": 1.0, "l_ankle": -1.0}, {"r_toe": 1.0, "r_ankle": -1.0})
"""The lines of the feet."""
PELVIS = "pelvis"
"""Frame at which the line of the trunk begins."""
PELVIS_JOINTS = {"pelvis", "l_hip", "r_hip"}
"""A limb measured from here up is carried by the trunk, and leans as the robot's trunk is asked to."""
HEAD_ALONE = ("head",)
"""What a landmark follows that no joint of a limb moves."""
ANKLES, HIPS = ("l_ankle", "r_ankle"), ("l_hip", "r_hip")
UP, FORWARD = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
"""Unit vectors in the robot's world."""


class Role(Enum):
    """How a landmark is asked: where it is planted, as the pelvis, by a limb that the trunk leans, by a limb that the
    trunk carries, or by one that begins where another landmark is asked."""

    STILL = 0
    PELVIS = 1
    BORNE = 2
    LIMB = 3
    JOINED = 4


@dataclass(frozen=True, eq=False)
class AskedLandmarks:
    """What is asked at one instant, in the robot's world frame.

    landmarks: k points, m, in the order of the profile's landmarks. limbs: lines, m, in the order of `limb_names`.
    trunk: orientation wxyz of the trunk, the identity when the performer stands upright and faces the heading. gaze:
    unit direction of the performer's eyes. soles: of free legs alone.
    """

    landmarks: list[Vector]
    limbs: list[Vector]
    trunk: Quat
    gaze: Vector
    soles: tuple["AskedSole", ...] = ()


@dataclass(frozen=True)
class AskedSole:
    """A sole of free legs. name: of its landmark; frame: its own. orientation: wxyz. weight: of its place."""

    name: str
    frame: str
    orientation: Quat
    weight: float


@dataclass(frozen=True)
class _Mark:
    """How one landmark is asked. place: in the stance; offset: from the end of the limb; carried: its anchor from the
    pelvis, in the frame of an upright trunk, all m. joined: row of the landmark at which it begins, if it does."""

    role: Role
    place: Vector
    offset: Vector
    carried: Vector
    joined: int


class LandmarkMap:
    """Maps the postures of one performer to landmarks of one robot. Its only state is the performer's heading."""

    def __init__(
        self,
        profile: RobotProfile,
        dimensions: HumanDimensions,
        stance: Stance,
        envelope: Envelope | None,
        *,
        floats: bool = False,
    ) -> None:
        """`envelope`: None where pelvis and trunk stay where they are (a robot on a stand, or its upper part alone).
        floats: whether the robot goes where the performer does (`FreeLegs`). Raises ConfigError: it has no legs for
        that."""
        self.names = tuple(profile.landmarks)
        self._envelope = envelope
        self._facing = Facing()
        rest = dict(zip(POINTS, dimensions.standing(), strict=True))
        entries = list(profile.landmarks.values())
        self._sums = [_limb(entry, rest) for entry in entries] + [TRUNK_LINE, *FEET]
        pelvis = profile.landmarks.get("pelvis")
        scale = leg_scale(profile, rest)
        self._sums += [{ankle: scale, hip: -scale} for ankle, hip in zip(ANKLES, HIPS, strict=True)]
        self._sums.append({ANKLES[0]: scale, ANKLES[1]: -scale})
        self._over_feet = PelvisOverFeet(pelvis.robot_length) if pelvis is not None and scale else None
        self._free = _free_legs(profile, dimensions, rest, scale) if floats else None
        self._sums += [] if self._free is None else self._free.sums
        self._summed: tuple[tuple[str, ...], FloatArray] = (), np.zeros((len(self._sums), 0))
        line = matmul(_weights([TRUNK_LINE], POINTS), dimensions.standing())
        self._upright = arc(as_vector(line[0]), UP)
        self._marks: list[_Mark] = []
        self._plan(profile, entries, stance)
        self._feet_apart = None if stance.soles else feet_apart(profile, stance, self.names)

    def _plan(self, profile: RobotProfile, entries: list[Landmark], stance: Stance) -> None:
        """What each landmark is, and where its anchor is in the stance."""
        soles = {foot.frame for foot in profile.feet.values()} if stance.soles else set()
        pelvis = profile.landmarks.get("pelvis")
        place = np.zeros(3) if pelvis is None else stance.points[pelvis.frame]
        stays = self._envelope is None and self._free is None
        anchors = [np.mean([stance.points[name] for name in entry.anchor], axis=0) for entry in entries]
        self._pelvis = None if pelvis is None else self.names.index("pelvis")
        self._feet = as_vector(anchors[self._pelvis]) if self._pelvis is not None else (0.0, 0.0, 0.0)
        ends = [as_vector(stance.points[entry.frame]) for entry in entries]
        rows: dict[str, int] = {}  # of the landmarks above, by frame
        for row, (name, entry) in enumerate(profile.landmarks.items()):
            joined = rows.get(entry.anchor[0])
            if entry.frame in soles or (name == "pelvis" and stays):
                role = Role.STILL
            elif name == "pelvis":
                role = Role.PELVIS
            elif stays and entry.follows == HEAD_ALONE:
                role = Role.STILL
            elif set(entry.measured_from) <= PELVIS_JOINTS:
                role = Role.BORNE
            else:
                role = Role.LIMB if joined is None else Role.JOINED
            self._marks.append(_Mark(role, ends[row], entry.offset, as_vector(anchors[row] - place), joined or 0))
            rows.setdefault(entry.frame, row)
        names = limb_names(profile)
        self._limbs = [self.names.index(name) for name in names if name != TRUNK]
        self._trunk_line = [as_vector(stance.points[TRUNK] - stance.points[PELVIS])] if TRUNK in names else []
        limbs = [minus(end, as_vector(begin)) for end, begin in zip(ends, anchors, strict=True)]
        self.standing = AskedLandmarks(ends, self._of_limbs(limbs, NO_TURN), NO_TURN, FORWARD)
        """What asks the robot to stand as in its stance."""

    @property
    def note(self) -> str:
        """A sentence for the operator where the robot can hardly crouch, else ""."""
        return "" if self._envelope is None else self._envelope.note

    def restart(self) -> None:
        """A new performance: take the heading of its first posture as it is."""
        self._facing.restart()
        if self._over_feet is not None:
            self._over_feet.restart()
        if self._free is not None:
            self._free.restart()

    def ask(self, human: "HumanPosture", dt: float) -> AskedLandmarks:
        """What this posture asks of the robot, `dt` s of the robot's clock after the one before."""
        names, weights = self._summed
        if human.joint_names is not names:
            weights = _weights(self._sums, human.joint_names)
            self._summed = human.joint_names, weights
        # All limbs at once: each is a weighted sum of joints, already scaled to the robot.
        # k limbs, the trunk, two feet, two legs, the line between the ankles; performer's world
        rows = matmul(weights, human.joints).tolist()
        pelvis_seen, chest_seen, head_seen = map(as_quat, human.orientations)
        feet = len(self.names) + 1
        # The heading of a robot that goes where the performer does stays that in which they began.
        x, y = self._facing.update(pelvis_seen, rows[feet], rows[feet + 1], dt if self._free is None else 0.0)
        # Turn into the heading frame, in which the robot faces x: (x, y) is the unit vector of the performer's heading,
        # and `from_world` the same turn as a quaternion, from the half angles of its cosine.
        limbs: list[Vector] = [(x * a + y * b, x * b - y * a, c) for a, b, c in rows]
        from_world = (sqrt(max(0.5 + 0.5 * x, 0.0)), 0.0, 0.0, -copysign(sqrt(max(0.5 - 0.5 * x, 0.0)), y))
        chest = product(from_world, chest_seen)
        seen = product(product(arc(rotated(chest, UP), limbs[feet - 1]), chest), self._upright)
        gaze = rotated(product(from_world, head_seen), FORWARD)

        *legs, apart = limbs[feet + 2 : feet + 5]
        if self._free is not None:
            left_x, left_y, _ = rotated(product(from_world, pelvis_seen), LEFT)
            across = hypot(left_x, left_y) or inf
            aside = (left_x / across, left_y / across)
            return self._asked_free(self._free, limbs, seen, gaze, aside=aside, carrying=human.carrying, dt=dt)
        pelvis = self._pelvis_asked(limbs, legs, apart[2], seen, dt)
        trunk = self._trunk_asked(seen, pelvis[2])
        # A trunk that cannot lean as far takes the limbs along that hang from it.
        lean_less = product(trunk, inverse(seen))
        landmarks: list[Vector] = []
        for row, mark in enumerate(self._marks):
            limb = rotated(lean_less, limbs[row]) if mark.role is Role.BORNE else limbs[row]
            limbs[row] = limb = plus(limb, mark.offset)
            if mark.role is Role.STILL:
                landmarks.append(mark.place)
            elif mark.role is Role.PELVIS:
                landmarks.append(pelvis)
            elif mark.role is Role.JOINED:
                landmarks.append(plus(landmarks[mark.joined], limb))
            else:
                landmarks.append(plus(plus(pelvis, rotated(trunk, mark.carried)), limb))
        if self._feet_apart is not None:
            self._feet_apart.ask(landmarks)
        return AskedLandmarks(landmarks, self._of_limbs(limbs, trunk), trunk, gaze)

    def _asked_free(
        self,
        free: FreeLegs,
        limbs: list[Vector],
        seen: Quat,
        gaze: Vector,
        *,
        aside: tuple[float, float],
        carrying: Carrying,
        dt: float,
    ) -> AskedLandmarks:
        """What is asked of a robot that goes where the performer does. limbs: all rows, in the robot's world. aside: to
        the left of the performer's pelvis, a unit vector on the ground, or zero."""
        feet = len(self.names) + 1
        hips, *ankles = limbs[feet + 5 :]
        turns, weights = free.turns(limbs[feet : feet + 2]), free.weights(carrying, dt)
        pelvis = free.place(hips)
        offsets = [mark.offset for mark in self._marks]
        for foot in free.feet:
            offsets[foot.row] = rotated(turns[foot.side], foot.offset)
        landmarks: list[Vector] = []
        for row, mark in enumerate(self._marks):
            limbs[row] = plus(limbs[row], offsets[row])
            if mark.role is Role.PELVIS:
                landmarks.append(pelvis)
            elif mark.role is Role.JOINED:
                landmarks.append(plus(landmarks[mark.joined], limbs[row]))
            else:
                landmarks.append(plus(plus(pelvis, rotated(seen, mark.carried)), limbs[row]))
        for foot in free.feet:
            landmarks[foot.row] = plus(free.place(ankles[foot.side]), offsets[foot.row])
        if self._feet_apart is not None:
            self._feet_apart.ask(landmarks, aside)
        spots = free.spots([landmarks[foot.row] for foot in free.feet], carrying, dt)
        for foot, spot in zip(free.feet, spots, strict=True):
            landmarks[foot.row] = spot
        up = (0.0, 0.0, free.lift(landmarks, turns, ankles))
        soles = tuple(
            AskedSole(self.names[foot.row], foot.frame, turns[foot.side], weights[foot.side]) for foot in free.feet
        )
        landmarks = [plus(place, up) for place in landmarks]
        return AskedLandmarks(landmarks, self._of_limbs(limbs, seen), seen, gaze, soles=soles)

    def _of_limbs(self, limbs: list[Vector], trunk: Quat) -> list[Vector]:
        """The lines of `limb_names`, m, from those of all landmarks and the orientation of the trunk."""
        return [limbs[row] for row in self._limbs] + [rotated(trunk, line) for line in self._trunk_line]

    def _pelvis_asked(self, limbs: list[Vector], legs: list[Vector], higher: float, seen: Quat, dt: float) -> Vector:
        """The pelvis over the planted ankles, on legs as long as the one that bears the performer, no lower than the
        robot gets, and no higher than it leans from as its trunk is seen to. legs: lines from hips to ankles; higher:
        by how much the left ankle is above the right one; m, scaled as a leg."""
        if self._envelope is None or self._pelvis is None:
            return (0.0, 0.0, 0.0) if self._pelvis is None else self._marks[self._pelvis].place
        limb = limbs[self._pelvis]
        if self._over_feet is not None:
            limb = self._over_feet.step(limb, legs, higher, dt)
        x, y, z = plus(plus(self._feet, limb), self._marks[self._pelvis].offset)
        ahead, aside, up = rotated(seen, UP)
        z = min(z, self._envelope.highest_for(arctan2(hypot(ahead, aside), up), ahead, aside))
        low, high = self._envelope.lowest, self._envelope.highest
        return x, y, high - soft_cap(high - z, high - low, CROUCH_KNEE)

    def _trunk_asked(self, seen: Quat, height: float) -> Quat:
        """The trunk as seen on the performer, leaning no further than the robot can with its pelvis at `height`."""
        if self._envelope is None:
            return NO_TURN
        x, y, z = rotated(seen, UP)
        across = hypot(x, y)
        if across < 1e-9:
            return seen
        lean = arctan2(across, z)
        # The axis of the lean is level, and square to the direction in which the trunk leans.
        less = soft_cap(lean, self._envelope.most_lean(height, x, y), LEAN_KNEE)
        return product(axis_turn((-y / across, x / across, 0.0), less - lean), seen)


def leg_scale(profile: RobotProfile, rest: Mapping[str, FloatArray]) -> float:
    """Scale of lengths, from the performer's leg to the robot's; 0 where the pelvis does not follow the hips from the
    ankles. rest: the performer's joints, m, standing."""
    pelvis = profile.landmarks.get("pelvis")
    if pelvis is None or (set(pelvis.follows), set(pelvis.measured_from)) != (set(HIPS), set(ANKLES)):
        return 0.0
    return limb_scale(pelvis, rest)


def _free_legs(
    profile: RobotProfile, dimensions: HumanDimensions, rest: Mapping[str, FloatArray], scale: float
) -> FreeLegs:
    """The free legs of a robot. Raises ConfigError: its profile has no landmarks for them."""
    frames = {foot.frame for foot in profile.feet.values()}
    rows = [(row, entry) for row, entry in enumerate(profile.landmarks.values()) if entry.frame in frames]
    feet = [
        FreeFoot(row, entry.frame, ANKLES.index(entry.follows[0]), entry.offset)
        for ankle in ANKLES
        for row, entry in rows
        if entry.follows == (ankle,)
    ]
    if not scale or len(feet) != len(ANKLES):
        raise ConfigError(
            "no landmarks for free legs",
            where=f"{profile.path}: landmarks",
            found=", ".join(profile.landmarks),
            allowed="a pelvis that follows the hips from the ankles, and a sole for each ankle",
            next_step="Add them to the profile, or leave --legs out",
        )
    return FreeLegs(feet, scale, dimensions, rest)


def _limb(entry: Landmark, rest: Mapping[str, FloatArray]) -> dict[str, float]:
    """The limb vector of a landmark as a sum of human joints, scaled to the robot."""
    scale = limb_scale(entry, rest)
    total: dict[str, float] = {}
    for names, sign in ((entry.follows, 1.0), (entry.measured_from, -1.0)):
        for name in names:
            total[name] = total.get(name, 0.0) + sign * scale / len(names)
    return total


def limb_scale(entry: Landmark, rest: Mapping[str, FloatArray]) -> float:
    """The length of a robot's limb over that of the performer's. rest: place (3,) m of each joint, standing upright."""
    chain = [np.mean([rest[name] for name in point], axis=0) for point in entry.human_length]
    return entry.robot_length / fsum(norm(b - a) for a, b in pairwise(chain))


def _weights(sums: Sequence[Mapping[str, float]], joint_names: Sequence[str]) -> FloatArray:
    """The sums as a matrix (rows, m) over joints in this order."""
    weights = np.zeros((len(sums), len(joint_names)))
    for row, joints in enumerate(sums):
        for name, weight in joints.items():
            weights[row, joint_names.index(name)] = weight
    return weights


@dataclass(frozen=True, eq=False, slots=True)
class Reached:
    """Points of the robot in a posture, m, in its world.

    points (k, 3), and the same as tuples in `landmarks`; limbs: lines in the order of `limb_names`; trunk: wxyz
    relative to its stance; gaze: unit direction of the eyes; centre_of_mass (3,).
    """

    points: FloatArray
    landmarks: list[Vector]
    limbs: list[Vector]
    trunk: Quat
    gaze: Vector
    centre_of_mass: FloatArray


# Where the landmarks, the trunk and the eyes of a robot are in a posture, and names of its parts in priorities.


class RobotReader:
    """Reads postures of one robot that stands in one stance."""

    def __init__(self, robot: RobotBody, stance: Stance) -> None:
        limbs = robot_limbs(robot).values()
        places = [robot.frame(landmark.frame) for landmark in robot.profile.landmarks.values()]
        self._ends = len(places), len(places) + len(limbs)
        places += [limb.begin for limb in limbs] + [limb.end for limb in limbs]
        local = np.array([place.position for place in places]).reshape(-1, 3)
        trunk, head = robot.frame(TRUNK), robot.frame(HEAD)
        body = robot.body.solver_body()
        self._probe = Probe(body, [place.body for place in places], local, [trunk.body, head.body])
        self._head = as_quat(head.quat)
        self.trunk_at_stance = as_quat(robot.orientations(stance.q[None], (TRUNK,))[0, 0])
        """Orientation wxyz of the trunk's frame in the stance: where the performer's trunk is upright."""
        self._trunk = product(as_quat(trunk.quat), inverse(self.trunk_at_stance))

    def read(self, q: FloatArray) -> Reached:
        """Read the points, m, and orientations that posture q (nq,) reaches."""
        points, oriented, centre_of_mass = self._probe.read(q)
        trunk, head = map(as_quat, oriented)
        first, second = self._ends
        return Reached(
            points[:first],
            points[:first].tolist(),
            (points[second:] - points[first:second]).tolist(),
            product(trunk, self._trunk),
            rotated(product(head, self._head), FORWARD),
            centre_of_mass,
        )


def robot_frames(robot: RobotBody) -> dict[str, Frame]:
    """What names in a priority file stand for: landmarks, frames of the profile, links and sites of the body."""
    frames = body_frames(robot.body) | {name: robot.frame(name) for name in robot.profile.frames}
    return frames | {name: robot.frame(entry.frame) for name, entry in robot.profile.landmarks.items()}


def limb_names(profile: RobotProfile) -> tuple[str, ...]:
    """The limbs of a robot: its landmarks with one anchor, from that to the landmark; last `neck`, the line of the
    trunk from the pelvis to it, where the profile has a pelvis."""
    joined = tuple(name for name, entry in profile.landmarks.items() if len(entry.anchor) == 1)
    return (*joined, TRUNK) if PELVIS in profile.frames else joined


def robot_limbs(robot: RobotBody) -> dict[str, Limb]:
    """What `limb_names` stand for."""
    marks, limbs = robot.profile.landmarks, dict[str, Limb]()
    for name in limb_names(robot.profile):
        end, begin = (marks[name].frame, marks[name].anchor[0]) if name in marks else (TRUNK, PELVIS)
        ends = robot.points(robot.body.qpos0[None], (begin, end))[0]
        length = marks[name].robot_length if name in marks else norm(ends[1] - ends[0])
        limbs[name] = Limb(robot.frame(begin), robot.frame(end), length)
    return limbs


def robot_postures(robot: RobotBody, stance: Stance) -> dict[str, FloatArray]:
    """The postures (nq,) of the profile, m, wxyz and rad, by name, with the root where the robot stands."""
    postures = {}
    for name, angles in robot.profile.postures.model_dump(exclude={"to_rest", "stays_at_rest"}).items():
        q = robot.posture(angles)
        free = 7 if robot.profile.root == "free" else 0
        q[:free] = stance.q[:free]
        postures[name] = q
    return postures


def standing_targets(hierarchy: Hierarchy, stance: Stance) -> FloatArray:
    """Make the target vector of a hierarchy for a robot that faces forward on its soles; nothing else is asked."""
    targets = hierarchy.blank()
    hierarchy.set_heading(targets, (1.0, 0.0))
    plant_soles(hierarchy, targets, stance)
    return targets


def plant_soles(hierarchy: Hierarchy, targets: FloatArray, stance: Stance) -> None:
    """Ask the soles to be in their places in the stance."""
    for sole in stance.soles:
        hierarchy.set_position(targets, sole.frame.name, sole.position)
        hierarchy.set_orientation(targets, sole.frame.name, sole.orientation)


def plant_back(
    hierarchy: Hierarchy, targets: FloatArray, stance: Stance, body: SolverBody, q: FloatArray, share: float
) -> None:
    """Ask the soles of posture q (nq,) for this share of the way back to their places in the stance."""
    frames = [sole.frame for sole in stance.soles]
    links, local = [frame.body for frame in frames], np.array([frame.position for frame in frames])
    places, turned = body.points(q[None], links, local)[0], body.orientations(q[None], links)[0]
    for sole, place, link in zip(stance.soles, places, turned, strict=True):
        here = product(as_quat(link), as_quat(sole.frame.quat))
        x, y, z = rotation_vector(product(as_quat(sole.orientation), inverse(here)))
        hierarchy.set_position(targets, sole.frame.name, place + share * (sole.position - place))
        back = product(turn((share * x, share * y, share * z)), here)
        hierarchy.set_orientation(targets, sole.frame.name, np.array(back))


def standing_dofs(robot: RobotBody, *frames: str) -> BoolArray:
    """Mask (nv,) of the DoFs that carry the robot: a free root, and every joint between it and a sole, or one of these
    frames."""
    ends = [robot.frame(name).body for name in (*(foot.frame for foot in robot.profile.feet.values()), *frames)]
    body = robot.body
    moved = np.repeat(body.joint_body, np.diff(body.joint_dof, append=body.nv))  # (nv,) link that each DoF moves
    return np.isin(moved, [link for end in ends for link in body.chain_to_root(end)])
