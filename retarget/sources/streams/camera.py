"""A camera's body landmarks as a performer: frames of the page of `web://` -> poses of canonical sensors.

    {"axes": "camera", "time": 12.345, "frame": 741, "size": [640, 480],
     "landmarks": [[u, v, x, y, z, visibility], ... 33]}

Landmarks are MediaPipe's: u, v in the picture (0 to 1, right and down), x, y, z in m from the middle of the hips (right
in the picture, down, away from the camera). One camera shows directions well, depths badly, and no position in the
room. So a body of average size is built from directions alone:

* Feet stay in place; a foot moves while it is seen lifted, or is seen elsewhere.
* The height of the hips is that in the picture, as a share of the height while standing.
* A mean lean away from the camera is the camera's error and is sheared away.

World: REP-103, the performer faces x, towards the camera.
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
from retarget.sources.canonical import TYPICAL_HEIGHT_M
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
"""Value of `axes` in such a frame."""

LANDMARKS = 33
MAX_PIXELS = 16_384
"""Largest width and height of a picture."""
FARTHEST_M = 5.0
"""Largest distance of a landmark from the hips, and from the picture in picture sizes."""
_CAMERA_KEYS = {"axes", "time", "frame", "size", "landmarks"}

NOSE, EARS, SHOULDERS, ELBOWS, WRISTS = 0, [7, 8], [11, 12], [13, 14], [15, 16]
HIPS, KNEES, ANKLES = [23, 24], [25, 26], [27, 28]
"""Landmarks, the left one first."""


@dataclass(frozen=True, eq=False)
class Landmarks:
    """One frame; the arrays are empty if there is no person.

    time: s. point (33, 3): m from the middle of the hips, REP-103. picture (33, 2): pixels, right and down. inside
    (33,): in the picture. visibility (33,): 0 to 1.
    """

    time: float
    number: int | None
    point: FloatArray
    picture: FloatArray
    inside: BoolArray
    visibility: FloatArray


def _landmarks(message: Mapping[str, Any]) -> Landmarks:
    if not message.keys() <= _CAMERA_KEYS:
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


OUTSIDE = 0.02
"""Share of the picture by which a landmark may lie outside: half of a hand is seen there."""
SEEN, UNSEEN = 0.5, 0.35
"""Visibility from which a landmark counts, and below which it no longer does."""
FACING_M = 0.1
"""Least sum, m, by which the left shoulder and hip are left of the right ones (usual: 0.5): from behind they are mostly
swapped."""
SWAPPED_M, SWAPPED_S = 0.3, 0.3
"""A pair of limbs that jumps by this, m, to each other's place is swapped, for at most this time, s."""
_PAIRS = np.array([ELBOWS, WRISTS, KNEES, ANKLES])


class Sight:
    """The landmarks that count, from frame to frame."""

    def __init__(self) -> None:
        self._seen: BoolArray = np.zeros(LANDMARKS, dtype=bool)
        self._before: FloatArray | None = None  # (4, 2, 3) m, the last plausible pairs
        self._time = -math.inf  # [s] of these pairs

    def take(self, frame: Landmarks, dropped: Dropped) -> BoolArray:
        """Mask of the landmarks (33,) that count."""
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
        if self._before is not None and frame.time - self._time < SWAPPED_S:
            stays = norms(now - self._before).sum(axis=1)
            swaps = norms(now[:, ::-1] - self._before).sum(axis=1)
            swapped = (stays > 2.0 * SWAPPED_M) & (swaps < 0.5 * stays)
            if swapped.any():
                dropped.note("left and right limbs exchanged from one picture to the next")
                counts[_PAIRS[swapped]] = False
                return counts
        self._before, self._time = now, frame.time
        return counts


class RunningMean:
    """A slow mean: of all values at first, then with a time constant, s."""

    def __init__(self, seconds: float) -> None:
        self.value = math.nan
        self._seconds, self._age = seconds, 0.0

    def take(self, value: float, dt: float, *, slower: float = 1.0) -> float:
        """The mean after a value that held for `dt` s. slower: factor on the time constant."""
        if self._age == 0.0:
            self.value = value
        self._age = min(self._age + dt, self._seconds)
        self.value += (value - self.value) * min(dt / (self._age * slower), 1.0)
        return self.value


BODY = proportional_dimensions(TYPICAL_HEIGHT_M)
"""The body that is built for a performer of any size: a tall one looks like a near one."""
THIGH, SHANK = BODY.length("l_knee"), BODY.length("l_ankle")
ANKLE_M = FRACTIONS.ankle_height * BODY.stature
"""Height of an ankle above the floor, m."""
HIP = BODY.of("l_hip")
"""Offset from the pelvis to the left hip, m."""
SHEAR_S, STANDING_S, DISTANCE_S, FEET_S = 20.0, 20.0, 5.0, 5.0
"""Time constants, s: of the lean, of measures while standing, of the distance, and of the height difference of the
feet."""
STANDS = 0.93
"""Share of the usual hip height from which the performer stands upright."""
CROUCHED = 4.0
"""Factor on the time constants of measures while standing, when the performer does not stand."""
TALLER, STOOD_UP = 1.15, 0.05
"""Hips this many times higher show that the performer sat at first. The height is then learned in this share of the
time."""
PITCH_SHARE = 0.4
"""Share of the forward lean of trunk and head that is used: depths are poor."""
LIFT_M = (0.08, 0.13)
"""Height differences of the feet, m, from which one begins to be lifted, and is lifted: in a crouch 0.09 m is usual."""
SLIDES_M = np.array([0.40, 0.12])
"""Distance of a standing foot from its place, m forward and sideward, beyond which it has moved unseen."""
FORWARD_SHARE = 0.5
"""Share of the forward distance between the feet that is used: depths are poor."""
YIELDS = 0.01
"""Share of the apparent motion of planted feet that is shown, so that they do not look like lost sensors."""
BACK_M = 0.3
"""Largest distance of the hips ahead of the feet or behind them, m."""
KNEE_M = 0.03
"""Forward bend, m, that is added to knees, so that straight ones bend forward."""
_FORWARD, _UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])  # unit vectors


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / max(norm(vector), 1e-9))


def _frame(up: FloatArray, left: FloatArray) -> FloatArray:
    """Axes (3, 3) of a part as columns forward, left, up, from two lines along it."""
    up = _unit(up)
    left = _unit(left - dot(left, up) * up)
    (a, b, c), (x, y, z) = left, up
    return np.array([[b * z - c * y, a, x], [c * x - a * z, b, y], [a * y - b * x, c, z]])


class FootTracker:
    """Positions of the feet and height of the hips. The state is bounded."""

    def __init__(self) -> None:
        self.feet: FloatArray | None = None
        """Left and right ankle (2, 2) m on the floor; None before they were seen."""
        self.lift = np.zeros(2)
        """Lift (2,) m of each foot."""
        self.scale = 1.0
        """Metres of the body per metre of the landmarks, by the legs."""
        self._seen_off = np.zeros(2)  # [m] shown share of the apparent motion of planted feet
        self._planted = np.ones(2)  # by foot, 0 (lifted) to 1
        self._level, self._leg = RunningMean(FEET_S), RunningMean(STANDING_S)
        self._measures = [RunningMean(STANDING_S) for _ in range(3)]  # [pixels] leg, trunk, shoulders while standing
        self._distance = RunningMean(DISTANCE_S)
        self._share = 1.0  # of the hip height while standing

    def take(self, frame: Landmarks, point: FloatArray, dt: float) -> None:
        """Take a frame that shows hips and ankles. point (33, 3) m: its landmarks, upright."""
        # Height of the hips in the picture, as a share of that while standing at the present distance.
        hips, shoulders = frame.picture[HIPS].mean(axis=0), frame.picture[SHOULDERS]
        lowest = frame.picture[ANKLES, 1].max() if (self._planted < 0.5).any() else frame.picture[ANKLES, 1].mean()
        across = norm(shoulders[0] - shoulders[1])
        now = [float(lowest - hips[1]), norm(shoulders.mean(axis=0) - hips), across]
        leg, trunk, width = (max(measure.value, 1.0) for measure in self._measures)  # 1 pixel while unknown
        if math.isfinite(self._measures[0].value):
            # Turning narrows the shoulders and leaning shortens the trunk: neither does both.
            leg *= max(self._distance.take(max(now[1] / trunk, now[2] / width), dt), 0.1)
            self._share = min(max(now[0] / leg, 0.2), 1.05)
        else:
            leg = max(now[0], 1.0)
        pixels = leg / (THIGH + SHANK)  # per metre of the body
        slower = 1.0 if self._share > STANDS else CROUCHED
        for measure, value in zip(self._measures, now, strict=True):
            stood_up = measure is self._measures[0] and now[0] > TALLER * leg
            measure.take(value, dt, slower=STOOD_UP if stood_up else slower)
        ankles = point[ANKLES]
        length = self._leg.take(float(-ankles[:, 2].min()), dt, slower=slower)
        self.scale = min(max((THIGH + SHANK) / max(length, 0.1), 0.5), 2.0)
        # Lift, by the height of the left ankle above the right one, m, without the usual difference.
        higher = float(np.diff(frame.picture[ANKLES, 1])[0]) / pixels
        level = self._level.value if math.isfinite(self._level.value) else 0.0
        off = higher - level
        low, high = LIFT_M
        share = min(max((abs(off) - low) / (high - low), 0.0), 1.0)
        lifted = share * share * (3.0 - 2.0 * share)
        self._level.take(higher, dt, slower=1.0 if abs(off) < low else 20.0)
        foot = 0 if off > 0.0 else 1
        self.lift, self._planted = np.zeros(2), np.ones(2)
        self.lift[foot], self._planted[foot] = min(abs(off) * lifted, THIGH), 1.0 - lifted
        # Feet move if they are lifted, or seen elsewhere.
        apart = self.scale * (ankles[0, :2] - ankles[1, :2]) * [FORWARD_SHARE, 1.0]
        if self.feet is None:
            half = np.array([0.0, 0.5 * apart[1]])
            self.feet = np.stack([half, -half])
        away = apart - (self.feet[0] - self.feet[1])
        band = SLIDES_M * self._planted.min()
        self._seen_off = YIELDS * away
        away = np.sign(away) * np.maximum(np.abs(away) - band, 0.0)
        moving = 1.0 - self._planted
        shares = moving / moving.sum() if moving.sum() > 0.0 else np.array([0.5, 0.5])
        self.feet = self.feet + np.stack([shares[0] * away, -shares[1] * away])

    def hips(self, point: FloatArray | None) -> FloatArray:
        """Middle of the hips (3,) m. point (33, 3) m: landmarks from there, None if no foot is seen."""
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
        """Ankles (2, 3) m."""
        assert self.feet is not None
        shown = self.feet + 0.5 * np.stack([self._seen_off, -self._seen_off])
        return np.concatenate([shown, (ANKLE_M + self.lift)[:, None]], axis=1)


def _knee(hip: FloatArray, ankle: FloatArray, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Knee (3,) m that bends in the direction `bend`, and the ankle, within reach of the leg."""
    leg = ankle - hip
    length = min(max(norm(leg), 0.1), (THIGH + SHANK) * 0.9999)
    along = _unit(leg)
    share = (THIGH * THIGH - SHANK * SHANK + length * length) / (2.0 * length)
    side = _unit(bend - dot(bend, along) * along)
    knee = hip + share * along + math.sqrt(max(THIGH * THIGH - share * share, 0.0)) * side
    return knee, hip + length * along


CAMERA_SENSORS = (
    *("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle", "pelvis", "chest"),
    *("l_knee", "r_knee", "l_elbow", "r_elbow"),
)
"""Names of the poses of every frame."""
_WHOLE_BODY = (*SHOULDERS, *HIPS, *ANKLES)
_NEEDED: Mapping[str, tuple[int, ...]] = {
    "head": (NOSE, *SHOULDERS),
    "pelvis": _WHOLE_BODY,  # its height needs the feet
    "chest": tuple(SHOULDERS),
    "l_ankle": _WHOLE_BODY,
    "r_ankle": _WHOLE_BODY,
    **{f"{side}_knee": (*_WHOLE_BODY, knee) for side, knee in zip("lr", KNEES, strict=True)},
    **{f"{side}_elbow": (*SHOULDERS, elbow) for side, elbow in zip("lr", ELBOWS, strict=True)},
    **{f"{side}_wrist": (*SHOULDERS, *arm) for side, arm in zip("lr", zip(ELBOWS, WRISTS, strict=True), strict=True)},
}
"""Sensor -> the landmarks that it needs."""


class Body:
    """Landmarks -> sensors of a body of average size. The state is bounded."""

    def __init__(self) -> None:
        self._lean, self._nod = RunningMean(SHEAR_S), RunningMean(SHEAR_S)
        self._stance = FootTracker()

    def take(self, frame: Landmarks, counts: BoolArray, dt: float) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Positions (11, 3) m, orientations (11, 4) wxyz and tracked (11,) of CAMERA_SENSORS; NaN where not tracked.
        counts (33,): mask of landmarks. dt: s since the last frame."""
        position, orientation = np.full((len(CAMERA_SENSORS), 3), np.nan), np.full((len(CAMERA_SENSORS), 4), np.nan)
        tracked = np.array([counts[[*_NEEDED[name]]].all() for name in CAMERA_SENSORS])
        if not counts[SHOULDERS].all():
            return position, orientation, np.zeros(len(CAMERA_SENSORS), dtype=bool)
        has_hips, has_feet = bool(counts[HIPS].all()), bool(counts[[*HIPS, *ANKLES]].all())
        point = self._upright(frame.point, dt, has_hips=has_hips, has_feet=has_feet)
        if has_feet:
            self._stance.take(frame, point, dt)
        places = self._places(point, has_hips=has_hips, has_feet=has_feet)
        for row, name in enumerate(CAMERA_SENSORS):
            if tracked[row]:
                position[row] = places[name]
        if tracked[0] and counts[EARS].all():
            orientation[0] = self._head_turn(point, dt)
        return position, orientation, tracked

    def _upright(self, point: FloatArray, dt: float, *, has_hips: bool, has_feet: bool) -> FloatArray:
        """The landmarks, sheared so that the mean line from feet (or hips) to shoulders is upright."""
        if has_hips:
            line = point[SHOULDERS].mean(axis=0) - (point[ANKLES].mean(axis=0) if has_feet else 0.0)
            self._lean.take(float(np.clip(line[0] / max(line[2], 0.2), -0.6, 0.6)), dt)
        lean = self._lean.value if math.isfinite(self._lean.value) else 0.0
        return np.asarray(point - point[:, 2:] * [lean, 0.0, 0.0])

    def _places(self, point: FloatArray, *, has_hips: bool, has_feet: bool) -> dict[str, FloatArray]:
        """Points (3,) m by name; legs only if feet are seen."""
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
        """Orientation (4,) wxyz of the head; its mean nod is level."""
        left, forward = point[EARS[0]] - point[EARS[1]], point[NOSE] - point[EARS].mean(axis=0)
        flat = _frame(_UP, left)
        nod = arctan2(-dot(forward, flat[:, 2]), max(dot(forward, flat[:, 0]), 1e-3))
        nod = PITCH_SHARE * (nod - self._nod.take(nod, dt))
        roll = arctan2(float(left[2]), max(norm(left[:2]), 1e-3))
        yaw = arctan2(float(-left[0]), float(left[1]))
        return rotations.from_euler((yaw, nod, roll), "zyx")


ACROSS, DEPTH, TURN = (0.3, 6.0, 1.0), (0.1, 1.5, 0.5), (0.4, 2.0, 1.0)
"""One-Euro filters (see `live.playout`) of positions across the line of sight and along it, and of orientations: at
rest landmarks tremble by 3 mm across and 15 mm along it."""
GAP_S = 1.0
"""Gap, s, or step back, after which all is learned anew: another page, perhaps another performer."""
FIRST_S, LONGEST_S = 1.0 / 30.0, 0.2
"""Duration of the first frame, s, and the longest of any frame."""


class CameraDecoder:
    """Implements StreamDecoder. Names of poses are canonical sensors."""

    def __init__(self) -> None:
        self.dropped = Dropped()
        self._time: float | None = None
        self._begin()

    def _begin(self) -> None:
        self._sight, self._body = Sight(), Body()
        self._across = PoseFilter(len(CAMERA_SENSORS), position=ACROSS, orientation=TURN)
        self._depth = PoseFilter(len(CAMERA_SENSORS), position=DEPTH, orientation=None)

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
        times = np.full(len(CAMERA_SENSORS), frame.time)
        self._across.reset(~tracked)
        self._depth.reset(~tracked)
        across, orientation = self._across.step(times, position * [0.0, 1.0, 1.0], orientation)
        along, _ = self._depth.step(times, position * _FORWARD, orientation)
        return [
            StreamFrame(CAMERA_SENSORS, across + along, orientation, tracked, frame.time, frame.number, camera=True)
        ]


_OF_A_CAMERA = re.compile(rb'"axes"\s*:\s*"camera"')


class WebDecoder:
    """Implements StreamDecoder for a page of `web://`: a camera's landmarks, or a headset's poses. use_generated_legs:
    keep the legs that headsets make up."""

    def __init__(self, *, use_generated_legs: bool = False) -> None:
        self.dropped, self._use_legs = Dropped(), use_generated_legs
        self._camera, self._poses = CameraDecoder(), JsonPoseDecoder()
        self._camera.dropped = self._poses.dropped = self.dropped

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The performer of one message. See `StreamDecoder`."""
        if _OF_A_CAMERA.search(datagram):
            return self._camera.decode(datagram)
        frames = self._poses.decode(datagram)
        return frames if self._use_legs else [_without_legs(frame) for frame in frames]


_LEGS = frozenset({"l_knee", "r_knee", "l_ankle", "r_ankle"})


def _without_legs(frame: StreamFrame) -> StreamFrame:
    kept = [row for row, name in enumerate(frame.names) if name not in _LEGS]
    names = tuple(frame.names[row] for row in kept)
    parts = frame.position[kept], frame.orientation[kept], frame.tracked[kept]
    return StreamFrame(names, *parts, frame.stamp, frame.number)
