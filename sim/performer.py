"""Synthetic performers: reach and crouch cycles, gestures, a stroll.

The cycles have the timing and heights of CMU trial 02_06 (bend over, scoop up, rise, lift the right arm). The body is a
skeleton of 1.7 m: trunk and arms by forward kinematics, legs by two-link inverse kinematics. All paths are
minimum-jerk.
"""

from typing import NamedTuple

import numpy as np

from retarget import rotations
from retarget.arithmetic import exp, log, norms, sin
from retarget.frames import JOINTS, SENSORS, JointTracks, SensorFrames, Skeleton
from retarget.model.rest_skeleton import limb_turns
from retarget.sources.skeletons import JointPoses, JointTree, forward_kinematics
from retarget.types import FloatArray

RATE_HZ = 120.0
DURATION_S = 18.6
CYCLES = 6
"""Rate, length and crouches of the trial 02_06 that the paper uses."""

FIRST_CROUCH_S = 1.22
CYCLE_S = 2.73
CROUCH_TO_REACH_S = 1.28
STANDING_HEIGHT = 0.97
CROUCH_HEIGHT = (0.545, 0.595)
"""Times of crouch and reach, s, and heights of the pelvis, m, standing and in the deepest and flattest crouch, rounded
from that trial."""

THIGH, SHANK = 0.42, 0.41
HIP = np.array([0.0, 0.09, -0.09])
ANKLE = np.array([0.0, 0.13, 0.08])
TOE = np.array([0.13, 0.0, -0.05])
FOOT_YAW = np.radians(8.0)
"""Lengths and offsets of the left leg, m, x forward, y left, z up, and outward turn of the feet, rad, of a person of
1.75 m."""

# Joint, parent, rest offset (m) of the left side; "s" is a side. The rest pose is a T-pose facing x.
_UPPER_BODY: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("pelvis", "", (0.0, 0.0, 0.0)),
    ("spine", "pelvis", (0.0, 0.0, 0.11)),
    ("chest", "spine", (0.0, 0.0, 0.12)),
    ("neck", "chest", (0.0, 0.0, 0.12)),
    ("head", "neck", (0.02, 0.0, 0.21)),
    ("s_collar", "chest", (0.0, 0.02, 0.11)),
    ("s_shoulder", "s_collar", (0.0, 0.16, 0.03)),
    ("s_elbow", "s_shoulder", (0.0, 0.29, 0.0)),
    ("s_wrist", "s_elbow", (0.0, 0.26, 0.0)),
    ("s_hand", "s_wrist", (0.0, 0.08, 0.0)),
)


class _Path(NamedTuple):
    """A quantity of the body when it stands, crouches and reaches; the variation (uniform, plus or minus) from cycle to
    cycle; its delay behind the reach of the hand, s."""

    standing: float
    crouched: float
    reached: float
    varies: float = 0.0
    delay: float = 0.0


# Lengths m, angles degrees; flexion bends forward, an arm hangs at 0. CROUCH_HEIGHT replaces the height of a crouch.
_PATHS = {
    "height": _Path(STANDING_HEIGHT, 0.0, STANDING_HEIGHT, delay=-0.15),
    "forward": _Path(0.0, -0.13, 0.0, varies=0.01, delay=-0.15),
    "pelvis_pitch": _Path(0.0, 35.0, -1.0, delay=-0.12),
    "spine_pitch": _Path(0.0, 22.0, -4.0, delay=-0.06),
    "chest_pitch": _Path(0.0, 15.0, -4.0),
    "head_pitch": _Path(0.0, -18.0, -14.0),
    "twist": _Path(0.0, 0.0, 7.0, varies=3.0),
    "sway": _Path(0.0, 0.0, -0.015, varies=0.006),
    "r_collar": _Path(0.0, 0.0, 14.0),
    "r_shoulder": _Path(4.0, 72.0, 135.0, varies=2.5),
    "r_elbow": _Path(14.0, 22.0, 10.0, delay=0.03),
    "l_collar": _Path(0.0, 0.0, 0.0),
    "l_shoulder": _Path(4.0, 70.0, 16.0, varies=5.0),
    "l_elbow": _Path(14.0, 24.0, 32.0, varies=6.0),
    "spread": _Path(12.0, 9.0, 8.0),
}


def synthetic_performer(seed: int = 0, *, rate_hz: float = RATE_HZ) -> SensorFrames:
    """Make six reach and crouch cycles, 18.6 s, with all sensors, joint truth and skeleton, facing x.

    seed: of the variation between the cycles; the same seed gives the same bits.
    """
    time = np.arange(round(DURATION_S * rate_hz)) / rate_hz
    paths = _paths(time, np.random.default_rng(seed))
    return _performer(time, paths, rate_hz=rate_hz, source=f"synthetic performer, seed {seed}")


GESTURES_S = 40.0
GESTURES = {"shoulder": (45.0, 22.0), "elbow": (35.0, 20.0), "spread": (10.0, 6.0)}
"""Mean angle of the arms in gestures, from where they hang, and amplitude, degrees."""
GESTURE_HZ, GESTURE_FALL = (0.21, 0.37, 0.55, 0.83), 0.7
"""Frequencies of gestures, and the power with which their amplitudes fall, so that speeds are similar."""
RAISED_S = 2.0
"""Time in which the arms are raised first, s."""


def gesturing_performer(seed: int = 4, *, rate_hz: float = RATE_HZ) -> SensorFrames:
    """Make a performer who stands and moves both hands before the chest, in reach of a robot and slowly enough for it.
    seed: of the phases."""
    time, generator = np.arange(round(GESTURES_S * rate_hz)) / rate_hz, np.random.default_rng(seed)
    raised = np.minimum(time / RAISED_S, 1.0)
    paths = {name: np.full(len(time), path.standing) for name, path in _PATHS.items()}
    for part, (middle, amplitude) in GESTURES.items():
        for name in (part,) if part in paths else (f"l_{part}", f"r_{part}"):
            turns = [hz * time + generator.uniform() for hz in GESTURE_HZ]
            size = [exp(GESTURE_FALL * log(GESTURE_HZ[1] / hz)) for hz in GESTURE_HZ]
            wave = np.sum([a * sin(2.0 * np.pi * turn) for a, turn in zip(size, turns, strict=True)], axis=0)
            paths[name] += raised * (middle + 0.5 * amplitude * wave)
    return _performer(time, paths, rate_hz=rate_hz, source=f"gesturing performer, seed {seed}")


STROLL_S, STROLL_STEP_S = (1.5, 11.1, 14.0), 0.8
"""Begin and end of a stroll, end of its recording, and time of a step, s."""
STROLL_SPEED, STROLL_LIFT, STROLL_HEIGHT = 0.38, 0.07, 0.95
"""Speed, m/s, for a robot of a quarter of the size at half speed; lift of the feet and height of the pelvis, m."""
STROLL_ARMS = (22.0, 12.0)
"""Swing of shoulders and elbows, degrees."""


def strolling_performer(*, rate_hz: float = RATE_HZ) -> SensorFrames:
    """Make a performer who stands, walks some 3.6 m straight ahead and stands again, arms swinging. A foot touches down
    where the pelvis is half a step later."""
    begin, end, duration = STROLL_S
    time = np.arange(round(duration * rate_hz)) / rate_hz
    shares = minimum_jerk(time, np.array([begin, begin + STROLL_STEP_S]), np.array([0.0, 1.0]))
    walks = shares - minimum_jerk(time, np.array([end - STROLL_STEP_S, end]), np.array([0.0, 1.0]))
    forward = STROLL_SPEED * np.cumsum(walks) / rate_hz
    phase = np.pi * (time - begin) / STROLL_STEP_S
    paths = {name: np.full(len(time), path.standing) for name, path in _PATHS.items()}
    paths["forward"] = forward
    paths["height"] = paths["height"] - walks * (STANDING_HEIGHT - STROLL_HEIGHT)
    paths["sway"] = -0.025 * walks * sin(phase)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        paths[f"{side}_shoulder"] = paths[f"{side}_shoulder"] - sign * walks * STROLL_ARMS[0] * sin(phase + 0.5 * np.pi)
        paths[f"{side}_elbow"] = paths[f"{side}_elbow"] + walks * STROLL_ARMS[1]
    feet = dict[float, FloatArray]()
    for sign, first in ((1.0, 0), (-1.0, 1)):
        keys, places, lift = [0.0], [0.0], np.zeros(len(time))
        for step in range(first, round((end - begin) / STROLL_STEP_S), 2):
            off, on = begin + step * STROLL_STEP_S, begin + (step + 1) * STROLL_STEP_S
            keys += [off, on]
            places += [places[-1], float(forward[min(round((on + 0.5 * STROLL_STEP_S) * rate_hz), len(forward) - 1)])]
            u = np.clip((time - off) / STROLL_STEP_S, 0.0, 1.0)
            lift += STROLL_LIFT * sin(np.pi * u) * sin(np.pi * u)
        feet[sign] = np.stack([minimum_jerk(time, np.array(keys), np.array(places)), 0.0 * time, lift], axis=-1)
    return _performer(time, paths, rate_hz=rate_hz, source="strolling performer", feet=feet)


def _performer(
    time: FloatArray,
    paths: dict[str, FloatArray],
    *,
    rate_hz: float,
    source: str,
    feet: dict[float, FloatArray] | None = None,
) -> SensorFrames:
    """The frames of a body with the values (T,) of `_PATHS` at times (T,) s. feet: displacement (T, 3) m of the
    left foot (1) and the right foot (-1)."""
    tree = upper_body()
    pose = _upper_pose(tree, paths)
    joints = {name: pose.position[:, i] for i, name in enumerate(tree.names)}
    segments = {name: pose.orientation[:, i] for i, name in enumerate(tree.names)}
    for side, sign in (("l", 1.0), ("r", -1.0)):
        gone = np.zeros((len(time), 3)) if feet is None else feet[sign]
        points, turns = leg(joints["pelvis"], segments["pelvis"], sign, gone)
        joints |= {f"{side}_{name}": track for name, track in points.items()}
        segments |= {f"{side}_{name}": track for name, track in turns.items()}
    names = tuple(name for name in JOINTS if name in joints)
    skeleton = rest_skeleton(tree, names)
    orientation = np.stack([segments[name] for name in SENSORS], axis=1)
    return SensorFrames(
        time=time,
        names=SENSORS,
        position=np.stack([joints[name] for name in SENSORS], axis=1),
        orientation=rotations.multiply(orientation, limb_turns(skeleton, SENSORS)),
        valid=np.ones((len(time), len(SENSORS)), bool),
        joints=JointTracks(names, np.stack([joints[name] for name in names], axis=1)),
        skeleton=skeleton,
        source=source,
        rate_hz=rate_hz,
    )


def minimum_jerk(time: FloatArray, key_times: FloatArray, key_values: FloatArray) -> FloatArray:
    """Return values (T,) that rest at each key and go between keys with least jerk (Flash and Hogan 1985): C2.

    Values are constant before the first key and after the last. key_times rise strictly.
    """
    left = np.clip(np.searchsorted(key_times, time, side="right") - 1, 0, len(key_times) - 2)
    u = np.clip((time - key_times[left]) / (key_times[left + 1] - key_times[left]), 0.0, 1.0)
    share = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
    return np.asarray(key_values[left] + share * (key_values[left + 1] - key_values[left]))


def _paths(time: FloatArray, generator: np.random.Generator) -> dict[str, FloatArray]:
    """The values (T,) of every quantity of `_PATHS`."""
    crouch_times = FIRST_CROUCH_S + CYCLE_S * np.arange(CYCLES) + generator.uniform(-0.03, 0.03, CYCLES)
    reach_times = crouch_times + CROUCH_TO_REACH_S + generator.uniform(-0.03, 0.03, CYCLES)
    heights = generator.uniform(*CROUCH_HEIGHT, CYCLES)
    end = reach_times[-1] + CROUCH_TO_REACH_S
    paths = {}
    for name, (standing, crouch, reach, varies, delay) in _PATHS.items():
        crouched = heights if name == "height" else crouch + varies * generator.uniform(-1.0, 1.0, CYCLES)
        reached = reach + (0.0 if name == "height" else varies * generator.uniform(-1.0, 1.0, CYCLES))
        values = np.column_stack([crouched, np.broadcast_to(reached, CYCLES)]).ravel()
        # Only the rise is delayed: all joints reach the bottom together, and leave it from the pelvis outwards.
        times = np.column_stack([crouch_times, reach_times + delay]).ravel()
        keys = np.concatenate([[0.0], times, [end]])
        paths[name] = minimum_jerk(time, keys, np.concatenate([[standing], values, [standing]]))
    return paths


def upper_body() -> JointTree:
    """Return pelvis, trunk, head and both arms as a tree."""
    rows = [row for row in _UPPER_BODY if not row[0].startswith("s_")]
    for side, sign in (("l_", 1.0), ("r_", -1.0)):
        for name, parent, (x, y, z) in _UPPER_BODY:
            if name.startswith("s_"):
                above = side + parent[2:] if parent.startswith("s_") else parent
                rows.append((side + name[2:], above, (x, sign * y, z)))
    names = tuple(row[0] for row in rows)
    return JointTree(
        names=names,
        parents=tuple(names.index(row[1]) if row[1] else -1 for row in rows),
        offsets=np.array([row[2] for row in rows]),
        ends=((),) * len(names),
    )


def _upper_pose(tree: JointTree, paths: dict[str, FloatArray]) -> JointPoses:
    """The poses of trunk and arms. Positive pitch bends forward (about y), positive twist turns left (z)."""
    frames = len(paths["height"])
    angle = {name: np.radians(path) for name, path in paths.items() if name not in ("height", "forward", "sway")}
    zero = np.zeros(frames)
    turns = {
        "pelvis": ((zero, angle["pelvis_pitch"]), "zy"),
        "spine": ((0.5 * angle["twist"], angle["spine_pitch"]), "zy"),
        "chest": ((0.5 * angle["twist"], angle["chest_pitch"]), "zy"),
        "neck": ((-0.5 * angle["twist"], angle["head_pitch"]), "zy"),
    }
    for side, sign in (("l_", 1.0), ("r_", -1.0)):
        hang = sign * (np.radians(90.0) - angle["spread"])
        turns[f"{side}collar"] = ((sign * angle[f"{side}collar"], zero), "xy")
        turns[f"{side}shoulder"] = ((-angle[f"{side}shoulder"], -hang), "yx")
        turns[f"{side}elbow"] = ((-sign * angle[f"{side}elbow"], zero), "zy")
    local = np.broadcast_to(rotations.IDENTITY, (frames, len(tree.names), 4)).copy()
    for name, (angles, axes) in turns.items():
        local[:, tree.names.index(name)] = rotations.from_euler(np.stack(angles, axis=-1), axes)
    translation = np.broadcast_to(tree.offsets, (frames, len(tree.names), 3)).copy()
    translation[:, 0] = np.stack([paths["forward"], paths["sway"], paths["height"]], axis=-1)
    return forward_kinematics(tree, local, translation)


def leg(
    pelvis: FloatArray, turn: FloatArray, sign: float, gone: FloatArray | None = None
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return joint positions (T, 3) and segment orientations (T, 4) of a leg on its flat foot.

    sign: +1 left, -1 right. gone: displacement of the foot (T, 3) m; None: planted. The knee is in the vertical plane
    of the foot's direction through hip and ankle.
    """
    mirror = np.array([1.0, sign, 1.0])
    hip = pelvis + rotations.rotate(turn, HIP * mirror)
    foot = rotations.from_axis_angle([0.0, 0.0, 1.0], sign * FOOT_YAW)
    ankle = np.broadcast_to(ANKLE * mirror, hip.shape) + (0.0 if gone is None else gone)
    line = hip - ankle
    reach = norms(line)[:, None]
    up = line / reach
    along = (reach * reach + SHANK * SHANK - THIGH * THIGH) / (2.0 * reach)
    left = np.cross(up, rotations.rotate(foot, [1.0, 0.0, 0.0]))
    left /= norms(left)[:, None]
    knee = ankle + along * up + np.sqrt(SHANK * SHANK - along * along) * np.cross(left, up)
    foot_turn = np.broadcast_to(foot, (len(hip), 4))
    toe = ankle + rotations.rotate(foot, TOE * mirror)
    points = {"hip": hip, "knee": knee, "ankle": np.array(ankle), "toe": toe}
    turns = {"hip": _segment(knee, hip, left), "knee": _segment(np.array(ankle), knee, left)}
    return points, turns | {"ankle": foot_turn, "toe": foot_turn}


def _segment(bottom: FloatArray, top: FloatArray, left: FloatArray) -> FloatArray:
    """The orientation (T, 4) of a segment with z from bottom to top and y along the unit vector `left`."""
    up = (top - bottom) / norms(top - bottom)[:, None]
    return rotations.from_matrix(np.stack([np.cross(left, up), left, up], axis=-1))


def rest_skeleton(tree: JointTree, names: tuple[str, ...]) -> Skeleton:
    """The T-pose with straight legs."""
    rest = dict(zip(tree.names, tree.rest_positions(), strict=True))
    for side, sign in (("l", 1.0), ("r", -1.0)):
        mirror = np.array([1.0, sign, 1.0])
        hip = HIP * mirror
        knee = hip - [0.0, 0.0, THIGH]
        ankle = knee - [0.0, 0.0, SHANK]
        rest |= {f"{side}_hip": hip, f"{side}_knee": knee, f"{side}_ankle": ankle, f"{side}_toe": ankle + TOE * mirror}
    return Skeleton(names, np.stack([rest[name] for name in names]))
