"""Landmarks of a robot: their desired places for a human posture, and their actual places in a robot posture.

Points are in the robot's world: origin on the ground between the soles, x forward. Desired landmarks depend on the
performer and on constants of the robot alone, so that tracking errors show any lag.
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
from retarget.robot.free_legs import LEFT, UP, FreeFoot, FreeLegs
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


# The slow heading in which a planted robot mirrors the performer, who may turn round.

SETTLE_S = 1.0
"""Time constant, s: slower than a twist of the trunk, faster than a turn of the whole body."""
CLEAR = 0.2
"""Least length of the mean of the unit directions; below it the heading is kept."""


class Facing:
    """Mean ground direction of pelvis (weight 1/2) and feet (1/4 each), through a first-order low pass."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Start again."""
        self._mean = 0j  # x + i y; zero: not started

    def update(
        self, pelvis: Quat, left_foot: Sequence[float], right_foot: Sequence[float], dt: float
    ) -> tuple[float, float]:
        """Heading (x, y), a unit vector on the ground, `dt` s later.

        pelvis: wxyz; forward is square to its left axis. feet: from ankle to toe, m. Non-finite values are left out.
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


# Performers' feet pass close and cross, where those of most hanging robots would collide.

SOFT_ZONE = 0.1
"""Share of the least distance over which the limit sets in."""


@dataclass(frozen=True)
class FootSeparation:
    """Rows of the landmarks of both feet, and their least distance sideways, m."""

    left: int
    right: int
    least: float

    def apply(self, landmarks: list[Vector], aside: tuple[float, float] = (0.0, 1.0)) -> None:
        """Separate both feet of `landmarks`, m, in place. aside: unit vector on the ground to the left."""
        (lx, ly, lz), (rx, ry, rz) = landmarks[self.left], landmarks[self.right]
        x, y = aside
        distance, room = x * (lx - rx) + y * (ly - ry), SOFT_ZONE * self.least
        missing = self.least + room - distance
        half = 0.5 * ((distance if missing <= 0.0 else self.least + room * exp(-missing / room)) - distance)
        x, y = half * x, half * y
        landmarks[self.left], landmarks[self.right] = (lx + x, ly + y, lz), (rx - x, ry - y, rz)


def foot_separation(profile: RobotProfile, stance: Stance, rows: Sequence[str]) -> FootSeparation | None:
    """Separation in the stance of the feet in these rows; None without two feet."""
    soles = {foot.frame for foot in profile.feet.values()}
    feet = [row for row, name in enumerate(rows) if profile.landmarks[name].frame in soles]
    if len(feet) != 2:
        return None
    sideways = {row: float(stance.points[profile.landmarks[rows[row]].frame][1]) for row in feet}
    left, right = sorted(feet, key=lambda row: -sideways[row])
    least = sideways[left] - sideways[right]
    return FootSeparation(left, right, least) if least > 0.0 else None


# The pelvis is as high as the performer's bearing leg is long: in their stride both legs are straight and the pelvis is
# low, but the robot's feet are side by side. Small changes, which need large ones of a straight knee, are filtered.

UNDER = 0.15
"""Distance of an ankle from below its hip, relative to the leg, that halves its share of the bearing."""
LIFT_COUNTS = 4.0
"""Weight of an ankle's height in this distance."""
STRAIGHT, STRAIGHT_ZONE = 0.97, 0.015
"""Share from which a performer's leg counts as stretched, as sensors measure it to 3 %, and width of the transition."""
HEIGHT_SETTLE_S, HEIGHT_BAND = 0.6, 0.02
"""Time constant (s) of small deviations, and deviation, relative to the leg, at which it is halved."""


class PelvisOverFeet:
    """Filters the middle of the hips above the middle of both ankles, in the robot's size."""

    def __init__(self, leg: float) -> None:
        """leg: the performer's stretched leg in the robot's size, m."""
        self._leg = leg
        self.restart()

    def restart(self) -> None:
        """Start again."""
        self._height: float | None = None

    def step(self, hips: Vector, legs: Sequence[Vector], higher: float, dt: float) -> Vector:
        """Desired place of the hips, m, `dt` s later.

        hips: of the performer, from between the ankles; legs: from hips to ankles; higher: height of the left ankle
        above the right one, m; all scaled.
        """
        shares = []
        for (x, y, _), lift in zip(legs, (max(higher, 0.0), max(-higher, 0.0)), strict=True):
            off = (x * x + y * y + LIFT_COUNTS * LIFT_COUNTS * lift * lift) / (UNDER * UNDER * self._leg * self._leg)
            shares.append(1.0 / (1.0 + off * off))
        share = shares[0] / (shares[0] + shares[1])  # of the left leg
        # Common horizontal offset of both legs, as in a squat.
        x, y = (sorted((legs[0][axis], 0.0, legs[1][axis]))[1] for axis in (0, 1))
        left, right = (hypot(hypot(*leg[:2]), leg[2]) for leg in legs)
        length = soft_cap((share * left + (1.0 - share) * right) / STRAIGHT, self._leg, STRAIGHT_ZONE)
        desired = sqrt(max(length * length - x * x - y * y, 0.0))
        height = desired if self._height is None else self._height
        off = (desired - height) / (HEIGHT_BAND * self._leg)
        self._height = low_pass(height, desired, dt / HEIGHT_SETTLE_S * (1.0 + off * off))
        return hips[0], hips[1], self._height


CROUCH_KNEE = 0.1
"""Share of the range of heights in which the limit sets in."""
LEAN_KNEE = 0.3
"""Share of the greatest lean in which the limit sets in."""
TRUNK_LINE = {"neck": 1.0, "l_hip": -0.5, "r_hip": -0.5}
FEET = ({"l_toe": 1.0, "l_ankle": -1.0}, {"r_toe": 1.0, "r_ankle": -1.0})
PELVIS = "pelvis"
PELVIS_JOINTS = {"pelvis", "l_hip", "r_hip"}
"""The trunk carries limbs that are measured from these joints."""
HEAD_ALONE = ("head",)
ANKLES, HIPS = ("l_ankle", "r_ankle"), ("l_hip", "r_hip")
FORWARD = (1.0, 0.0, 0.0)  # unit vector


class Role(Enum):
    """Base of a landmark: its place in the stance, the pelvis, a limb that leans with the trunk, a limb that the trunk
    carries, or another landmark."""

    STILL = 0
    PELVIS = 1
    BORNE = 2
    LIMB = 3
    JOINED = 4


@dataclass(frozen=True, eq=False)
class DesiredLandmarks:
    """Desired places at one instant, in the robot's world.

    landmarks: in the order of the profile, m. limbs: lines, m, see `limb_names`. trunk: wxyz, the identity when
    upright. gaze: unit vector. soles: of free legs. whole: pelvis, m, and trunk without the envelope.
    """

    landmarks: list[Vector]
    limbs: list[Vector]
    trunk: Quat
    gaze: Vector
    soles: tuple["DesiredSole", ...] = ()
    whole: tuple[Vector, Quat] = ((0.0, 0.0, 0.0), NO_TURN)


@dataclass(frozen=True)
class DesiredSole:
    """Sole of free legs: landmark, frame, orientation wxyz, weight."""

    name: str
    frame: str
    orientation: Quat
    weight: float


@dataclass(frozen=True)
class _Mark:
    """One landmark. place: in the stance; offset: from the limb's end; carried: anchor from an upright trunk's pelvis,
    m; joined: row of its base."""

    role: Role
    place: Vector
    offset: Vector
    carried: Vector
    joined: int


class LandmarkMap:
    """Maps the postures of one performer to desired landmarks of one robot."""

    def __init__(
        self,
        profile: RobotProfile,
        dimensions: HumanDimensions,
        stance: Stance,
        envelope: Envelope | None,
        *,
        floats: bool = False,
    ) -> None:
        """envelope: None keeps pelvis and trunk in place. floats: with `FreeLegs`. Raises ConfigError."""
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
        self._foot_separation = None if stance.soles else foot_separation(profile, stance, self.names)

    def _plan(self, profile: RobotProfile, entries: list[Landmark], stance: Stance) -> None:
        soles = {foot.frame for foot in profile.feet.values()} if stance.soles else set()
        pelvis = profile.landmarks.get("pelvis")
        place = np.zeros(3) if pelvis is None else stance.points[pelvis.frame]
        stays = self._envelope is None and self._free is None
        anchors = [np.mean([stance.points[name] for name in entry.anchor], axis=0) for entry in entries]
        self._pelvis = None if pelvis is None else self.names.index("pelvis")
        self._feet = as_vector(anchors[self._pelvis]) if self._pelvis is not None else (0.0, 0.0, 0.0)
        ends = [as_vector(stance.points[entry.frame]) for entry in entries]
        rows: dict[str, int] = {}  # by frame
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
        self.standing = DesiredLandmarks(ends, self._of_limbs(limbs, NO_TURN), NO_TURN, FORWARD)

    @property
    def note(self) -> str:
        """Note for the operator if the robot can hardly crouch, else ""."""
        return "" if self._envelope is None else self._envelope.note

    def restart(self) -> None:
        """Start a new performance."""
        self._facing.restart()
        if self._over_feet is not None:
            self._over_feet.restart()
        if self._free is not None:
            self._free.restart()

    def desired(self, human: "HumanPosture", dt: float) -> DesiredLandmarks:
        """Desired landmarks for a posture, `dt` s after the last one."""
        names, weights = self._summed
        if human.joint_names is not names:
            weights = _weights(self._sums, human.joint_names)
            self._summed = human.joint_names, weights
        # Rows, in the performer's world: k limbs, trunk, two feet, two legs, line between ankles, free legs.
        rows = matmul(weights, human.joints).tolist()
        pelvis_seen, chest_seen, head_seen = map(as_quat, human.orientations)
        feet = len(self.names) + 1
        x, y = self._facing.update(pelvis_seen, rows[feet], rows[feet + 1], dt if self._free is None else 0.0)
        # (x, y), the unit vector of the heading, becomes the robot's x axis.
        limbs: list[Vector] = [(x * a + y * b, x * b - y * a, c) for a, b, c in rows]
        from_world = (sqrt(max(0.5 + 0.5 * x, 0.0)), 0.0, 0.0, -copysign(sqrt(max(0.5 - 0.5 * x, 0.0)), y))
        chest = product(from_world, chest_seen)
        seen = product(product(arc(rotated(chest, UP), limbs[feet - 1]), chest), self._upright)
        gaze = rotated(product(from_world, head_seen), FORWARD)

        *legs, ankles = limbs[feet + 2 : feet + 5]
        if self._free is not None:
            left_x, left_y, _ = rotated(product(from_world, pelvis_seen), LEFT)
            across = hypot(left_x, left_y) or inf
            aside = (left_x / across, left_y / across)
            return self._desired_free(self._free, limbs, seen, gaze, aside=aside, carrying=human.carrying, dt=dt)
        pelvis, whole = self._desired_pelvis(limbs, legs, ankles[2], seen, dt)
        trunk = self._desired_trunk(seen, pelvis[2])
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
        if self._foot_separation is not None:
            self._foot_separation.apply(landmarks)
        return DesiredLandmarks(landmarks, self._of_limbs(limbs, trunk), trunk, gaze, whole=(whole, seen))

    def _desired_free(
        self,
        free: FreeLegs,
        limbs: list[Vector],
        seen: Quat,
        gaze: Vector,
        *,
        aside: tuple[float, float],
        carrying: Carrying,
        dt: float,
    ) -> DesiredLandmarks:
        """limbs: all rows. aside: unit vector on the ground to the performer's left, or zero."""
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
        if self._foot_separation is not None:
            self._foot_separation.apply(landmarks, aside)
        spots = free.spots([landmarks[foot.row] for foot in free.feet], carrying, dt)
        for foot, spot in zip(free.feet, spots, strict=True):
            landmarks[foot.row] = spot
        up = (0.0, 0.0, free.lift(landmarks, turns, ankles))
        soles = tuple(
            DesiredSole(self.names[foot.row], foot.frame, turns[foot.side], weights[foot.side]) for foot in free.feet
        )
        landmarks = [plus(place, up) for place in landmarks]
        return DesiredLandmarks(landmarks, self._of_limbs(limbs, seen), seen, gaze, soles=soles)

    def _of_limbs(self, limbs: list[Vector], trunk: Quat) -> list[Vector]:
        return [limbs[row] for row in self._limbs] + [rotated(trunk, line) for line in self._trunk_line]

    def _desired_pelvis(
        self, limbs: list[Vector], legs: list[Vector], higher: float, seen: Quat, dt: float
    ) -> tuple[Vector, Vector]:
        """The pelvis within the envelope, and without these bounds."""
        if self._envelope is None or self._pelvis is None:
            place = (0.0, 0.0, 0.0) if self._pelvis is None else self._marks[self._pelvis].place
            return place, place
        limb = limbs[self._pelvis]
        if self._over_feet is not None:
            limb = self._over_feet.step(limb, legs, higher, dt)
        x, y, z = whole = plus(plus(self._feet, limb), self._marks[self._pelvis].offset)
        ahead, aside, up = rotated(seen, UP)
        z = min(z, self._envelope.highest_for(arctan2(hypot(ahead, aside), up), ahead, aside))
        low, high = self._envelope.lowest, self._envelope.highest
        return (x, y, high - soft_cap(high - z, high - low, CROUCH_KNEE)), whole

    def _desired_trunk(self, seen: Quat, height: float) -> Quat:
        if self._envelope is None:
            return NO_TURN
        x, y, z = rotated(seen, UP)
        across = hypot(x, y)
        if across < 1e-9:
            return seen
        lean = arctan2(across, z)
        less = soft_cap(lean, self._envelope.most_lean(height, x, y), LEAN_KNEE)
        return product(axis_turn((-y / across, x / across, 0.0), less - lean), seen)


def leg_scale(profile: RobotProfile, rest: Mapping[str, FloatArray]) -> float:
    """Scale of lengths from the performer's leg to the robot's, or 0 for a pelvis without it. rest: places (3,) m of
    joints, standing."""
    pelvis = profile.landmarks.get("pelvis")
    if pelvis is None or (set(pelvis.follows), set(pelvis.measured_from)) != (set(HIPS), set(ANKLES)):
        return 0.0
    return limb_scale(pelvis, rest)


def _free_legs(
    profile: RobotProfile, dimensions: HumanDimensions, rest: Mapping[str, FloatArray], scale: float
) -> FreeLegs:
    """Raises ConfigError if the profile lacks landmarks for free legs."""
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
    scale = limb_scale(entry, rest)
    total: dict[str, float] = {}
    for names, sign in ((entry.follows, 1.0), (entry.measured_from, -1.0)):
        for name in names:
            total[name] = total.get(name, 0.0) + sign * scale / len(names)
    return total


def limb_scale(entry: Landmark, rest: Mapping[str, FloatArray]) -> float:
    """Length of a robot's limb relative to the performer's. rest: places (3,) m of joints, standing."""
    chain = [np.mean([rest[name] for name in point], axis=0) for point in entry.human_length]
    return entry.robot_length / fsum(norm(b - a) for a, b in pairwise(chain))


def _weights(sums: Sequence[Mapping[str, float]], joint_names: Sequence[str]) -> FloatArray:
    weights = np.zeros((len(sums), len(joint_names)))
    for row, joints in enumerate(sums):
        for name, weight in joints.items():
            weights[row, joint_names.index(name)] = weight
    return weights


@dataclass(frozen=True, eq=False, slots=True)
class Reached:
    """Actual landmarks of a posture, in the robot's world.

    points: (k, 3) m, and as tuples in `landmarks`. limbs, gaze: as desired. trunk: wxyz relative to the stance.
    centre_of_mass: (3,) m.
    """

    points: FloatArray
    landmarks: list[Vector]
    limbs: list[Vector]
    trunk: Quat
    gaze: Vector
    centre_of_mass: FloatArray


class RobotReader:
    """Actual landmarks, trunk and gaze of one robot."""

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
        """Orientation wxyz of the trunk's frame in the stance."""
        self._trunk = product(as_quat(trunk.quat), inverse(self.trunk_at_stance))

    def read(self, q: FloatArray) -> Reached:
        """Actual landmarks of posture q (nq,)."""
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
    """Frames for a priority file: landmarks, frames of the profile, links and sites of the body."""
    frames = body_frames(robot.body) | {name: robot.frame(name) for name in robot.profile.frames}
    return frames | {name: robot.frame(entry.frame) for name, entry in robot.profile.landmarks.items()}


def limb_names(profile: RobotProfile) -> tuple[str, ...]:
    """Landmarks with one anchor; and `neck`, the line from the pelvis to it, if there is one."""
    joined = tuple(name for name, entry in profile.landmarks.items() if len(entry.anchor) == 1)
    return (*joined, TRUNK) if PELVIS in profile.frames else joined


def robot_limbs(robot: RobotBody) -> dict[str, Limb]:
    """The limbs of `limb_names`: frames and length, m."""
    marks, limbs = robot.profile.landmarks, dict[str, Limb]()
    for name in limb_names(robot.profile):
        end, begin = (marks[name].frame, marks[name].anchor[0]) if name in marks else (TRUNK, PELVIS)
        ends = robot.points(robot.body.qpos0[None], (begin, end))[0]
        length = marks[name].robot_length if name in marks else norm(ends[1] - ends[0])
        limbs[name] = Limb(robot.frame(begin), robot.frame(end), length)
    return limbs


def robot_postures(robot: RobotBody, stance: Stance) -> dict[str, FloatArray]:
    """Postures (nq,) of the profile by name, with the root of the stance."""
    postures = {}
    for name, angles in robot.profile.postures.model_dump(exclude={"to_rest", "stays_at_rest"}).items():
        q = robot.posture(angles)
        free = 7 if robot.profile.root == "free" else 0
        q[:free] = stance.q[:free]
        postures[name] = q
    return postures


def standing_targets(hierarchy: Hierarchy, stance: Stance) -> FloatArray:
    """Targets of a robot that faces forward on its soles."""
    targets = hierarchy.blank()
    hierarchy.set_heading(targets, (1.0, 0.0))
    plant_soles(hierarchy, targets, stance)
    return targets


def plant_soles(hierarchy: Hierarchy, targets: FloatArray, stance: Stance) -> None:
    """Set the targets of the soles to their places."""
    for sole in stance.soles:
        hierarchy.set_position(targets, sole.frame.name, sole.position)
        hierarchy.set_orientation(targets, sole.frame.name, sole.orientation)


def plant_back(
    hierarchy: Hierarchy, targets: FloatArray, stance: Stance, body: SolverBody, q: FloatArray, share: float
) -> None:
    """Set the targets of the soles of posture q (nq,) to a share of the path back to their places."""
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
    """Mask (nv,) of the DoFs that carry the robot: a free root, and joints from the root to soles and `frames`."""
    ends = [robot.frame(name).body for name in (*(foot.frame for foot in robot.profile.feet.values()), *frames)]
    body = robot.body
    moved = np.repeat(body.joint_body, np.diff(body.joint_dof, append=body.nv))  # (nv,) link that each DoF moves
    return np.isin(moved, [link for end in ends for link in body.chain_to_root(end)])
