"""The sample recording that ships with the package (`--source sample`): who made it, and how to make it again.

The body of `sim.performer` stands at ease, raises the right arm and waves, looks left and right, sinks into a shallow
crouch and stands up again. Moves are minimum-jerk, feet stay where they are. `python -m tests.support.sample_recording
FILE` writes the file; a test compares it with the shipped one, byte by byte.
"""

import io
import re
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

from retarget import rotations
from retarget.recording.bvh_export import AXES, CM, HUMAN, BvhSkeleton, Node, write_skeleton
from retarget.types import FloatArray
from sim.performer import leg, minimum_jerk, rest_skeleton, upper_body

RATE_HZ = 30.0
DURATION_S = 11.0
DIGITS = 3
"""Decimals of the file: 0.01 mm and 0.001 degrees, far below what any motion capture resolves."""

ARM = ("collar", "shoulder", "elbow", "wrist")
LEG = ("hip", "knee", "ankle", "toe")
CHAINS = (
    ("pelvis", "spine", "chest", "neck", "head"),
    *(("chest", *(f"{side}_{part}" for part in ARM)) for side in "lr"),
    *(("pelvis", *(f"{side}_{part}" for part in LEG)) for side in "lr"),
)
"""The tree, limb by limb: each joint hangs on the one before it."""
HEAD_JOINT = np.array([0.01, 0.0, 0.11])
"""Base of the skull, from the neck on, m."""
ENDS = {"head": (0.02, 0.0, 0.20), "l_wrist": (0.0, 0.17, 0.0), "r_wrist": (0.0, -0.17, 0.0)}
ENDS |= {"l_toe": (0.06, 0.0, -0.02), "r_toe": (0.06, 0.0, -0.02)}
"""Ends of the last bones in the rest pose, from their joints on, m: top of the head, fingertips, tips of the toes."""

STANDING = {
    "height": 0.985,
    "forward": 0.0,
    "pelvis_pitch": 2.0,
    "spine_pitch": 0.0,
    "chest_pitch": 0.0,
    "twist": 0.0,
    "head_pitch": 0.0,
    "head_turn": 0.0,
    "head_tilt": 0.0,
    "wave": 0.0,
} | {
    f"{side}_{name}": value
    for side in "lr"
    for name, value in {"collar": 0.0, "flex": 3.0, "spread": 11.0, "turn": 0.0, "elbow": 16.0, "wrist": 0.0}.items()
}
"""Lengths m, angles degrees. Positive pitch bends forward; twist and turn of the head go left, its tilt right. Of an
arm: collar lifts, flex swings forward, spread lifts sideways, turn brings the forearm up about the upper arm, elbow
bends. `wave`: how far the waving forearm swings to either side."""

LOOKING_AHEAD = {"head_turn": 0.0, "head_pitch": 0.0, "twist": 0.0}
CROUCHED = {"height": 0.815, "forward": -0.06, "pelvis_pitch": 20.0, "spine_pitch": 12.0, "chest_pitch": 6.0}
CROUCHED |= {"head_pitch": -14.0, "l_flex": 42.0, "r_flex": 42.0, "l_elbow": 34.0, "r_elbow": 34.0}
WAVING = {"r_collar": 8.0, "r_spread": 80.0, "r_flex": 24.0, "r_turn": 56.0, "r_elbow": 92.0, "head_tilt": 5.0}
WAVING |= {"l_flex": 0.0, "twist": -3.0}
MOVES: tuple[tuple[float, float, dict[str, float]], ...] = (
    (0.9, 2.1, WAVING),
    (1.8, 2.3, {"wave": 24.0}),
    (3.9, 4.5, {"wave": 0.0}),
    (4.1, 5.3, {name: STANDING[name] for name in WAVING}),
    (5.2, 6.0, {"head_turn": 42.0, "head_pitch": -2.0, "twist": 8.0}),
    (6.3, 7.4, {"head_turn": -40.0, "head_pitch": 3.0, "twist": -7.0}),
    (7.6, 8.3, LOOKING_AHEAD),
    (8.1, 9.2, CROUCHED),
    (9.4, 10.5, {name: STANDING[name] for name in CROUCHED}),
)
"""Begin and end (s) of each move, and where it leads what it moves."""
WAVE_HZ = 1.5
SWAY_HZ, SWAY_M, SWAY_ROLL = 0.21, 0.008, 0.6
"""A standing person's weight wanders from foot to foot."""
BREATH_HZ, BREATH_DEG = 0.27, 0.7


def sample_recording() -> bytes:
    """The recording as a BVH file."""
    stream = io.BytesIO()
    write_skeleton(_in_motion(np.arange(round(DURATION_S * RATE_HZ)) / RATE_HZ), RATE_HZ, stream, digits=DIGITS)
    return re.sub(rb"-(0\.0+)(?=\s)", rb"\1", stream.getvalue())  # the sign of a zero is chance


def _paths(time: FloatArray) -> dict[str, FloatArray]:
    """Value (T,) of every key of STANDING over time."""
    paths = {}
    for name, standing in STANDING.items():
        keys = [(0.0, standing)]
        for begin, end, values in MOVES:
            if name in values:
                keys += [(begin, keys[-1][1]), (end, values[name])]
        times, levels = np.array([*keys, (DURATION_S, keys[-1][1])]).T
        paths[name] = minimum_jerk(time, times, levels)
    swing = np.sin(2.0 * np.pi * WAVE_HZ * time)
    paths["r_elbow"] += paths["wave"] * swing
    paths["r_wrist"] += 0.4 * paths["wave"] * np.sin(2.0 * np.pi * WAVE_HZ * time - 0.9)
    paths["r_turn"] += 0.12 * paths["wave"] * swing
    breath = BREATH_DEG * np.sin(2.0 * np.pi * BREATH_HZ * time)
    paths["chest_pitch"] -= breath
    for side in "lr":
        paths[f"{side}_spread"] += breath
    paths["sway"] = SWAY_M * np.sin(2.0 * np.pi * SWAY_HZ * time)
    paths["roll"] = SWAY_ROLL * np.sin(2.0 * np.pi * SWAY_HZ * time - 0.5)
    return paths


def _turns(time: FloatArray, paths: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Rotation (T, 4) of trunk, head and arm joints in their parents' frames."""
    angle = {name: np.radians(path) for name, path in paths.items()}
    zero = np.zeros(len(time))

    def turn(axes: str, *angles: FloatArray) -> FloatArray:
        return rotations.from_euler(np.stack(angles, axis=-1), axes)

    turns = {
        "pelvis": turn("zyx", 0.2 * angle["twist"], angle["pelvis_pitch"], angle["roll"]),
        "spine": turn("zyx", 0.4 * angle["twist"], angle["spine_pitch"], -0.7 * angle["roll"]),
        "chest": turn("zyx", 0.4 * angle["twist"], angle["chest_pitch"], -0.3 * angle["roll"]),
        "neck": turn("zyx", 0.45 * angle["head_turn"], 0.5 * angle["head_pitch"], 0.5 * angle["head_tilt"]),
        "head": turn("zyx", 0.55 * angle["head_turn"], 0.5 * angle["head_pitch"], 0.5 * angle["head_tilt"]),
    }
    for side, sign in (("l", 1.0), ("r", -1.0)):
        arm = {name: angle[f"{side}_{name}"] for name in ("collar", "flex", "spread", "turn", "elbow", "wrist")}
        hang = sign * (np.radians(90.0) - arm["spread"])
        turns[f"{side}_collar"] = turn("x", sign * arm["collar"])
        turns[f"{side}_shoulder"] = turn("yxy", -arm["flex"], -hang, -arm["turn"])
        turns[f"{side}_elbow"] = turn("zy", -sign * arm["elbow"], zero)
        turns[f"{side}_wrist"] = turn("z", -sign * arm["wrist"])
    return turns


def _in_motion(time: FloatArray) -> BvhSkeleton:
    paths = _paths(time)
    turns = _turns(time, paths)
    root = np.stack([paths["forward"], paths["sway"], paths["height"]], axis=-1)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        _, segments = leg(root, turns["pelvis"], sign)
        above = turns["pelvis"]
        for name in LEG:
            turns[f"{side}_{name}"] = rotations.multiply(rotations.conjugate(above), segments[name])
            above = segments[name]
    parents = {joint: parent for chain in CHAINS for parent, joint in pairwise(chain)}
    names = ("pelvis", *parents)
    offsets = _offsets(names, parents)
    places = np.broadcast_to(offsets, (len(time), *offsets.shape)).copy()
    places[:, 0] = root
    zero = np.zeros(3)
    return BvhSkeleton(
        nodes=tuple(
            Node(HUMAN[name], 0, names.index(parents[name]) if name in parents else -1, zero, zero) for name in names
        ),
        offsets=CM * offsets[:, AXES],
        places=CM * places[..., AXES],
        turns=np.stack([turns[name] for name in names], axis=1)[..., [0, *(1 + axis for axis in AXES)]],
        ends=CM * np.array([ENDS.get(name, (0.0, 0.0, 0.0)) for name in names])[:, AXES],
    )


def _offsets(names: tuple[str, ...], parents: dict[str, str]) -> FloatArray:
    """Rest offsets (n, 3) from parent joints, m: T-pose, facing x, straight legs."""
    rest = rest_skeleton(upper_body(), names)
    offsets = np.array([rest.of(name) - rest.of(parents[name]) if name in parents else np.zeros(3) for name in names])
    offsets[names.index("head")] = HEAD_JOINT
    return offsets


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(sample_recording())
