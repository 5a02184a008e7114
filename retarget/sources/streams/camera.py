"""A camera's body landmarks as a performer: frames of the page of `web://` -> poses of canonical sensors.

    {"axes": "camera", "time": 12.345, "frame": 741, "size": [640, 480],
     "landmarks": [[u, v, x, y, z, visibility], ... 33]}

The landmarks are MediaPipe's: u, v in the picture (0 to 1, right and down) and x, y, z in metres from the middle of
the hips (right in the picture, down, away from the camera). One camera knows directions well, depths badly, and not
where the performer stands. So directions alone are taken from it, and a body of usual proportions is built of them:

* The feet stay where they stand; a foot moves while it is seen to be lifted, or is seen elsewhere.
* The height of the hips is that of the picture, as a share of what it is while standing.
* What leans away from the camera as a whole, from the feet to the shoulders, is the camera's error: it is sheared away.
* What is not seen, not in the picture or not plausible is not tracked. Nothing is made up for it.

The body always has the same size: for a camera a tall performer looks like a near one, and a robot takes its own.
World: REP-103, the performer faces x, which points to the camera.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from retarget import rotations
from retarget._solver import PoseFilter
from retarget.arithmetic import arctan2, dot, matmul, norm, norms
from retarget.model.human_dimensions import FRACTIONS, proportional_dimensions
from retarget.sources.streams.json_pose import (
    MAX_FRAME,
    MAX_TIME,
    NUMBER,
    JsonPoseDecoder,
    UnusableDatagram,
    read_object,
)
from retarget.sources.streams.stream_frame import Dropped, StreamFrame
from retarget.types import BoolArray, FloatArray

AXES = "camera"
"""What such a frame has as `axes`."""

# What comes in.

LANDMARKS = 33
MAX_PIXELS = 16_384
"""Largest width and height of a picture."""
FARTHEST_M = 5.0
"""A landmark farther from the hips is none of a body; nor is one farther out of the picture, in pictures."""
_KEYS = {"axes", "time", "frame", "size", "landmarks"}

NOSE, EARS, SHOULDERS, ELBOWS, WRISTS = 0, [7, 8], [11, 12], [13, 14], [15, 16]
HIPS, KNEES, ANKLES = [23, 24], [25, 26], [27, 28]
"""Landmarks, the left one first."""


@dataclass(frozen=True, eq=False)
class Landmarks:
    """One frame. time: s; number: of the frame, None where none was sent. point (33, 3): m from the middle of the hips,
    REP-103; picture (33, 2): pixels, right and down; inside (33,): in the picture; visibility (33,): 0 to 1.

    Of a picture without a person, the arrays are empty.
    """

    time: float
    number: int | None
    point: FloatArray
    picture: FloatArray
    inside: BoolArray
    visibility: FloatArray


def _landmarks(message: Mapping[str, Any]) -> Landmarks:
    """The landmarks of a message. Raises UnusableDatagram."""
    if not message.keys() <= _KEYS:
        raise UnusableDatagram("a key other than axes, time, frame, size, landmarks")
    time: Any = message.get("time")
    number, size = message.get("frame"), message.get("size")
    if type(time) not in (float, int) or not abs(time) <= MAX_TIME:
        raise UnusableDatagram('"time" is missing or no finite number of seconds')
    if number is not None and (type(number) is not int or not 0 <= number <= MAX_FRAME):
        raise UnusableDatagram('"frame" is no whole number from 0')
    if type(size) is not list or len(size) != 2 or not all(type(n) is int and 0 < n <= MAX_PIXELS for n in size):
        raise UnusableDatagram(f'"size" is missing, or not two whole numbers of 1 to {MAX_PIXELS}')
    rows = message.get("landmarks")
    if type(rows) is not list or len(rows) not in (0, LANDMARKS):
        raise UnusableDatagram(f'"landmarks" is missing, or no list of {LANDMARKS} or of none')
    if not all(type(row) is list and len(row) == 6 and NUMBER.issuperset(map(type, row)) for row in rows):
        raise UnusableDatagram("a landmark is not 6 numbers")
    if not all(abs(number) <= FARTHEST_M for row in rows for number in row):
        raise UnusableDatagram("a landmark that is no part of a body")
    table = np.array(rows, float).reshape(-1, 6)
    inside = np.asarray((np.abs(table[:, :2] - 0.5) <= 0.5 + OUTSIDE).all(axis=1))
    picture, point = table[:, :2] * size, np.stack([-table[:, 4], table[:, 2], -table[:, 3]], axis=1)
    return Landmarks(float(time), number, point, picture, inside, table[:, 5])


# What of it counts.

OUTSIDE = 0.02
"""Share of the picture by which a landmark may lie outside: at its edge, half of a hand is seen."""
SEEN, UNSEEN = 0.5, 0.35
"""Visibility from which a landmark counts, and below which it no longer does."""
FACING_M = 0.1
"""The left shoulder and hip are to the left of the right ones by at least this, together, m (usual: 0.5): a performer
seen from behind, or from the side, has left and right exchanged more often than not."""
EXCHANGED_M, EXCHANGED_S = 0.3, 0.3
"""A pair of limbs that jumps by this, m, to where the other one was has been exchanged; for at most this time, s."""
_PAIRS = np.array([ELBOWS, WRISTS, KNEES, ANKLES])


class Sight:
    """Which landmarks count, from frame to frame."""

    def __init__(self) -> None:
        self._seen: BoolArray = np.zeros(LANDMARKS, dtype=bool)
        self._before: FloatArray | None = None  # (4, 2, 3) m, the pairs when they were last plausible
        self._time = -math.inf  # [s] of that

    def take(self, frame: Landmarks, dropped: Dropped) -> BoolArray:
        """Which of the landmarks (33,) count."""
        if not len(frame.point):
            self._seen, self._before = np.zeros(LANDMARKS, dtype=bool), None
            return self._seen
        self._seen = frame.inside & (frame.visibility >= np.where(self._seen, UNSEEN, SEEN))
        trunk = [*SHOULDERS, *HIPS]
        across = frame.point[SHOULDERS[0], 1] - frame.point[SHOULDERS[1], 1]
        across += frame.point[HIPS[0], 1] - frame.point[HIPS[1], 1]
        if self._seen[trunk].any() and across < FACING_M:
            dropped.note("performer seen from behind or from the side: face the camera")
            self._seen, self._before = np.zeros(LANDMARKS, dtype=bool), None
            return self._seen
        now = frame.point[_PAIRS]
        counts = self._seen.copy()
        if self._before is not None and frame.time - self._time < EXCHANGED_S:
            stays = norms(now - self._before).sum(axis=1)
            swaps = norms(now[:, ::-1] - self._before).sum(axis=1)
            exchanged = (stays > 2.0 * EXCHANGED_M) & (swaps < 0.5 * stays)
            if exchanged.any():
                dropped.note("left and right limbs exchanged from one picture to the next")
                counts[_PAIRS[exchanged]] = False
                return counts
        self._before, self._time = now, frame.time
        return counts


class RunningMean:
    """A slow mean: of all values at first, and with a time constant (s) later."""

    def __init__(self, seconds: float) -> None:
        self.value = math.nan
        self._seconds, self._age = seconds, 0.0

    def take(self, value: float, dt: float, *, slower: float = 1.0) -> float:
        """The mean with a value that held for `dt` s. slower: factor on the time constant."""
        if self._age == 0.0:
            self.value = value
        self._age = min(self._age + dt, self._seconds)
        self.value += (value - self.value) * min(dt / (self._age * slower), 1.0)
        return self.value


# The body that is built.

BODY = proportional_dimensions(1.70)
"""Its size, stature in m: that of a usual grown person, whatever that of the performer."""
THIGH, SHANK = BODY.length("l_knee"), BODY.length("l_ankle")
ANKLE_M = FRACTIONS.ankle_height * BODY.stature
"""Height of an ankle above the floor, m."""
HIP = BODY.of("l_hip")
"""From the pelvis to the left hip, m."""
SHEAR_S, STANDING_S, DISTANCE_S, FEET_S = 20.0, 20.0, 5.0, 5.0
"""Time constants, s: of the lean of everything, of the picture's measures while standing, of the distance (a crouch
takes less time), and of the difference in height of feet that stand."""
STANDS = 0.93
"""Share of the usual height of the hips from which the performer stands upright."""
CROUCHED = 4.0
"""While they do not, measures of standing are learned this many times slower."""
TALLER, STOOD_UP = 1.15, 0.05
"""Hips this many times higher than while standing: the performer sat when they were first seen. It is learned in this
share of the time."""
PITCH_SHARE = 0.4
"""Share of the lean forward of trunk and head that is believed."""
LIFT_M = (0.08, 0.13)
"""A foot that is this much higher in the picture than the other, m, begins to be lifted, and is lifted: of feet that
stand, one is seen up to 9 cm higher while the performer crouches."""
SLIDES_M = np.array([0.40, 0.12])
"""A foot that is seen this far from where it stands, m forward and sideward, has moved there unseen."""
FORWARD_SHARE = 0.5
"""Share of how far one foot is ahead of the other that is believed of a lifted foot."""
YIELDS = 0.01
"""Share that is shown of what planted feet seem to do: with nothing of it they would look like sensors that are lost,
which repeat one value."""
BACK_M = 0.3
"""The hips are no farther ahead of the feet or behind them, m."""
KNEE_M = 0.03
"""A straight knee bends forward by this much rather than any other way, m."""
_FORWARD, _UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
"""Unit vectors of the world."""


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / max(norm(vector), 1e-9))


def _frame(up: FloatArray, left: FloatArray) -> FloatArray:
    """Axes (3, 3) of a part in columns (forward, left, up), of its upward line and what is left of it."""
    up = _unit(up)
    left = _unit(left - dot(left, up) * up)
    (a, b, c), (x, y, z) = left, up
    return np.array([[b * z - c * y, a, x], [c * x - a * z, b, y], [a * y - b * x, c, z]])


class FootTracker:
    """Where the feet stand and how high the hips are, from frame to frame. The state is bounded."""

    def __init__(self) -> None:
        self.feet: FloatArray | None = None
        """(2, 2) m: where the left and right ankle are on the floor; None: not seen so far."""
        self.lift = np.zeros(2)
        """(2,) m: how far each is lifted."""
        self.scale = 1.0
        """Metres of the body per metre of the landmarks, by the legs."""
        self._seen_off = np.zeros(2)  # [m] what is shown of how the feet are seen apart but do not stand
        self._planted = np.ones(2)  # how much each foot stands, 0 to 1
        self._level, self._leg = RunningMean(FEET_S), RunningMean(STANDING_S)
        self._measures = [RunningMean(STANDING_S) for _ in range(3)]  # [pixels] leg, trunk, shoulders while standing
        self._distance = RunningMean(DISTANCE_S)
        self._pixels = 1.0  # of a metre of the body
        self._share = 1.0  # of the height of the hips while standing

    def take(self, frame: Landmarks, point: FloatArray, dt: float) -> None:
        """Take a frame that shows hips and ankles. point (33, 3) m: its landmarks, upright."""
        self._take_height(frame, dt)
        upright = self._share > STANDS
        ankles = point[ANKLES]
        leg = self._leg.take(float(-ankles[:, 2].min()), dt, slower=1.0 if upright else CROUCHED)
        self.scale = min(max((THIGH + SHANK) / max(leg, 0.1), 0.5), 2.0)
        self._take_lift(float(np.diff(frame.picture[ANKLES, 1])[0]) / self._pixels, dt)
        apart = self.scale * (ankles[0, :2] - ankles[1, :2]) * [FORWARD_SHARE, 1.0]
        if self.feet is None:
            half = np.array([0.0, 0.5 * apart[1]])
            self.feet = np.stack([half, -half])
        self._move_feet(apart)

    def _take_height(self, frame: Landmarks, dt: float) -> None:
        """The height of the hips as a share of that while standing: in the picture, at the distance of now."""
        hips, shoulders = frame.picture[HIPS].mean(axis=0), frame.picture[SHOULDERS]
        lowest = frame.picture[ANKLES, 1].max() if (self._planted < 0.5).any() else frame.picture[ANKLES, 1].mean()
        across = norm(shoulders[0] - shoulders[1])
        now = [float(lowest - hips[1]), norm(shoulders.mean(axis=0) - hips), across]
        leg, trunk, width = (max(measure.value, 1.0) for measure in self._measures)  # 1 pixel where none is known yet
        if math.isfinite(self._measures[0].value):
            # Turning narrows the shoulders and leaning shortens the trunk: neither does both.
            leg *= max(self._distance.take(max(now[1] / trunk, now[2] / width), dt), 0.1)
            self._share = min(max(now[0] / leg, 0.2), 1.05)
        else:
            leg = max(now[0], 1.0)
        self._pixels = leg / (THIGH + SHANK)
        # Who stands is measured anew all the time, who has stood up from a chair at once, who crouches hardly.
        slower = 1.0 if self._share > STANDS else CROUCHED
        for measure, value in zip(self._measures, now, strict=True):
            stood_up = measure is self._measures[0] and now[0] > TALLER * leg
            measure.take(value, dt, slower=STOOD_UP if stood_up else slower)

    def _take_lift(self, higher: float, dt: float) -> None:
        """higher: m by which the left ankle is above the right one."""
        level = self._level.value if math.isfinite(self._level.value) else 0.0
        off = higher - level
        low, high = LIFT_M
        share = min(max((abs(off) - low) / (high - low), 0.0), 1.0)
        lifted = share * share * (3.0 - 2.0 * share)
        self._level.take(higher, dt, slower=1.0 if abs(off) < low else 20.0)
        foot = 0 if off > 0.0 else 1
        self.lift, self._planted = np.zeros(2), np.ones(2)
        self.lift[foot], self._planted[foot] = min(abs(off) * lifted, THIGH), 1.0 - lifted

    def _move_feet(self, apart: FloatArray) -> None:
        """Move what is lifted, and what is seen elsewhere. apart (2,) m: from the right ankle to the left one."""
        assert self.feet is not None
        away = apart - (self.feet[0] - self.feet[1])
        band = SLIDES_M * self._planted.min()
        self._seen_off = YIELDS * away
        away = np.sign(away) * np.maximum(np.abs(away) - band, 0.0)
        lifted = 1.0 - self._planted
        share = lifted / lifted.sum() if lifted.sum() > 0.0 else np.array([0.5, 0.5])
        self.feet = self.feet + np.stack([share[0] * away, -share[1] * away])

    def hips(self, point: FloatArray | None) -> FloatArray:
        """Where the middle of the hips (3,) m is. point (33, 3) m: landmarks from there, None where no foot is seen."""
        if self.feet is None:
            return np.array([0.0, 0.0, ANKLE_M + THIGH + SHANK])
        planted = self._planted / self._planted.sum()
        over = matmul(planted, self.feet)
        if point is not None:
            over = over - self.scale * matmul(planted, point[ANKLES, :2])
            over[0] = min(max(over[0], -BACK_M), BACK_M)
        reach = THIGH + SHANK
        away = [norm(foot - over) - abs(HIP[1]) for foot in self.feet]
        farthest = max(max(off, 0.0) for off, stands in zip(away, planted, strict=True) if stands > 0.25)
        highest = math.sqrt(max(reach * reach - farthest * farthest, 0.04 * reach * reach)) - 0.002
        return np.array([over[0], over[1], ANKLE_M + min(self._share * reach, highest)])

    def ankles(self) -> FloatArray:
        """(2, 3) m."""
        assert self.feet is not None
        shown = self.feet + 0.5 * np.stack([self._seen_off, -self._seen_off])
        return np.concatenate([shown, (ANKLE_M + self.lift)[:, None]], axis=1)


def _knee(hip: FloatArray, ankle: FloatArray, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The knee (3,) m between hip and ankle that bends this way, and the ankle, drawn to where the leg reaches."""
    leg = ankle - hip
    length = min(max(norm(leg), 0.1), (THIGH + SHANK) * 0.9999)
    along = _unit(leg)
    share = (THIGH * THIGH - SHANK * SHANK + length * length) / (2.0 * length)
    side = _unit(bend - dot(bend, along) * along)
    knee = hip + share * along + math.sqrt(max(THIGH * THIGH - share * share, 0.0)) * side
    return knee, hip + length * along


SENSORS = (
    *("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle", "pelvis", "chest"),
    *("l_knee", "r_knee", "l_elbow", "r_elbow"),
)
"""Names of the poses, always all; those that are not seen are not tracked."""
_FEET = (*SHOULDERS, *HIPS, *ANKLES)
_SEES: Mapping[str, tuple[int, ...]] = {
    "head": (NOSE, *SHOULDERS),
    "pelvis": _FEET,  # without feet its height is not known
    "chest": tuple(SHOULDERS),
    "l_ankle": _FEET,
    "r_ankle": _FEET,
    **{f"{side}_knee": (*_FEET, knee) for side, knee in zip("lr", KNEES, strict=True)},
    **{f"{side}_elbow": (*SHOULDERS, elbow) for side, elbow in zip("lr", ELBOWS, strict=True)},
    **{f"{side}_wrist": (*SHOULDERS, *arm) for side, arm in zip("lr", zip(ELBOWS, WRISTS, strict=True), strict=True)},
}
"""The landmarks that a sensor needs."""


class Body:
    """Landmarks -> sensors of a body of usual size, from frame to frame. The state is bounded."""

    def __init__(self) -> None:
        self._lean, self._nod = RunningMean(SHEAR_S), RunningMean(SHEAR_S)
        self._stance = FootTracker()

    def take(self, frame: Landmarks, counts: BoolArray, dt: float) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Positions (11, 3) m, orientations (11, 4) wxyz and which are tracked (11,) of SENSORS; NaN where not.

        counts (33,): the landmarks that count. dt: s since the frame before.
        """
        position, orientation = np.full((len(SENSORS), 3), np.nan), np.full((len(SENSORS), 4), np.nan)
        tracked = np.array([counts[[*_SEES[name]]].all() for name in SENSORS])
        if not counts[SHOULDERS].all():
            return position, orientation, np.zeros(len(SENSORS), dtype=bool)
        has_hips, has_feet = bool(counts[HIPS].all()), bool(counts[[*HIPS, *ANKLES]].all())
        point = self._upright(frame.point, dt, has_hips=has_hips, has_feet=has_feet)
        if has_feet:
            self._stance.take(frame, point, dt)
        places = self._places(point, has_hips=has_hips, has_feet=has_feet)
        for row, name in enumerate(SENSORS):
            if tracked[row]:
                position[row] = places[name]
        if tracked[0] and counts[EARS].all():
            orientation[0] = self._head_turn(point, dt)
        return position, orientation, tracked

    def _upright(self, point: FloatArray, dt: float, *, has_hips: bool, has_feet: bool) -> FloatArray:
        """The landmarks sheared so that the usual line from the feet (or hips) to the shoulders is upright."""
        if has_hips:
            line = point[SHOULDERS].mean(axis=0) - (point[ANKLES].mean(axis=0) if has_feet else 0.0)
            self._lean.take(float(np.clip(line[0] / max(line[2], 0.2), -0.6, 0.6)), dt)
        lean = self._lean.value if math.isfinite(self._lean.value) else 0.0
        return np.asarray(point - point[:, 2:] * [lean, 0.0, 0.0])

    def _places(self, point: FloatArray, *, has_hips: bool, has_feet: bool) -> dict[str, FloatArray]:
        """Points (3,) m by name; legs only where feet are seen."""
        left = point[SHOULDERS[0]] - point[SHOULDERS[1]]
        trunk = point[SHOULDERS].mean(axis=0) if has_hips else _UP
        trunk = trunk * [PITCH_SHARE, 1.0, 1.0]
        chest = _frame(trunk, left)
        pelvis = _frame(trunk, point[HIPS[0]] - point[HIPS[1]]) if has_hips else chest
        hips = self._stance.hips(point if has_feet else None)
        at = {"pelvis": hips - matmul(pelvis, HIP * [1.0, 0.0, 1.0])}
        at["chest"] = at["pelvis"] + matmul(pelvis, BODY.of("spine")) + matmul(chest, BODY.of("chest"))
        neck = at["chest"] + matmul(chest, BODY.of("neck"))
        raised = (point[EARS].mean(axis=0) - point[SHOULDERS].mean(axis=0)) * [PITCH_SHARE, 1.0, 1.0]
        at["head"] = neck + BODY.length("head") * _unit(raised)
        for row, side in enumerate("lr"):
            shoulder = at["chest"] + matmul(chest, BODY.of(f"{side}_collar") + BODY.of(f"{side}_shoulder"))
            near, middle, far = point[SHOULDERS[row]], point[ELBOWS[row]], point[WRISTS[row]]
            at[f"{side}_elbow"] = shoulder + BODY.length("l_elbow") * _unit(middle - near)
            at[f"{side}_wrist"] = at[f"{side}_elbow"] + BODY.length("l_wrist") * _unit(far - middle)
            if has_feet:
                hip, ankle = at["pelvis"] + matmul(pelvis, BODY.of(f"{side}_hip")), self._stance.ankles()[row]
                bend = point[KNEES[row]] - 0.5 * (point[HIPS[row]] + point[ANKLES[row]])
                at[f"{side}_knee"], at[f"{side}_ankle"] = _knee(hip, ankle, bend + KNEE_M * _FORWARD)
        return at

    def _head_turn(self, point: FloatArray, dt: float) -> FloatArray:
        """Orientation (4,) wxyz of the head: who looks ahead most of the time holds it level."""
        left, forward = point[EARS[0]] - point[EARS[1]], point[NOSE] - point[EARS].mean(axis=0)
        flat = _frame(_UP, left)
        nod = arctan2(-dot(forward, flat[:, 2]), max(dot(forward, flat[:, 0]), 1e-3))
        nod = PITCH_SHARE * (nod - self._nod.take(nod, dt))
        roll = arctan2(float(left[2]), max(norm(left[:2]), 1e-3))
        yaw = arctan2(float(-left[0]), float(left[1]))
        return rotations.from_euler((yaw, nod, roll), "zyx")  # to the left, down, and the left ear up


# The decoders.

ACROSS, DEPTH, TURN = (0.3, 6.0, 1.0), (0.1, 1.5, 0.5), (0.4, 2.0, 1.0)
"""One-Euro filters (see `live.playout`) of positions across the line of sight and along it, and of orientations. At
rest landmarks tremble by 3 mm across and by 15 mm along it."""
GAP_S = 1.0
"""After a gap of this time, s, or a step back by it, all is learned anew: another page, perhaps another performer."""
FIRST_S, LONGEST_S = 1.0 / 30.0, 0.2
"""Time that the first frame stands for, s, and the longest that any does."""


class CameraDecoder:
    """Implements StreamDecoder. Names of poses are canonical sensors."""

    def __init__(self) -> None:
        self.dropped = Dropped()
        self._time: float | None = None
        self._begin()

    def _begin(self) -> None:
        self._sight, self._body = Sight(), Body()
        self._across = PoseFilter(len(SENSORS), position=ACROSS, orientation=TURN)
        self._depth = PoseFilter(len(SENSORS), position=DEPTH, orientation=None)

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The performer of one picture. See `StreamDecoder`."""
        try:
            message = read_object(datagram)
            if message.get("axes") != AXES:
                raise UnusableDatagram('"axes" is not "camera"')
            frame = _landmarks(message)
        except UnusableDatagram as refused:
            self.dropped.note(str(refused))
            return []
        since = FIRST_S if self._time is None else frame.time - self._time
        if abs(since) > GAP_S:
            self._begin()
        elif since <= 0.0:
            self.dropped.note("picture that is not newer than the one before")
            return []
        self._time = frame.time
        counts = self._sight.take(frame, self.dropped)
        if not len(frame.point):
            self.dropped.note("picture without a person")
        position, orientation, tracked = self._body.take(frame, counts, min(abs(since), LONGEST_S))
        times = np.full(len(SENSORS), frame.time)
        self._across.reset(~tracked)
        self._depth.reset(~tracked)
        across, orientation = self._across.step(times, position * [0.0, 1.0, 1.0], orientation)
        along, _ = self._depth.step(times, position * _FORWARD, orientation)
        return [StreamFrame(SENSORS, across + along, orientation, tracked, frame.time, frame.number, camera=True)]


_OF_A_CAMERA = re.compile(rb'"axes"\s*:\s*"camera"')


class WebDecoder:
    """Implements StreamDecoder for a page of `web://`: a camera's landmarks, or a headset's poses as JSON.

    use_generated_legs: take over the legs that headsets make up, which do not see them.
    """

    def __init__(self, *, use_generated_legs: bool = False) -> None:
        self.dropped, self._takes_legs = Dropped(), use_generated_legs
        self._camera, self._poses = CameraDecoder(), JsonPoseDecoder()
        self._camera.dropped = self._poses.dropped = self.dropped

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The performer of one message. See `StreamDecoder`."""
        if _OF_A_CAMERA.search(datagram):
            return self._camera.decode(datagram)
        frames = self._poses.decode(datagram)
        return frames if self._takes_legs else [_without_legs(frame) for frame in frames]


_LEGS = frozenset({"l_knee", "r_knee", "l_ankle", "r_ankle"})


def _without_legs(frame: StreamFrame) -> StreamFrame:
    kept = [row for row, name in enumerate(frame.names) if name not in _LEGS]
    names = tuple(frame.names[row] for row in kept)
    parts = frame.position[kept], frame.orientation[kept], frame.tracked[kept]
    return StreamFrame(names, *parts, frame.stamp, frame.number)
