"""Where the obstacles of experiments 2 and 3 stand: derived from the motion by a rule, never typed for one recording.

The motion is the one reconstructed without observers. An obstacle stands where the hand (the head) would run into it by
at least `HINDERED` in at least two crouch cycles, and clear of the whole body at the start. Of such places, the
cylinder takes the one that is farthest from everything but the hindered arm; the sphere the highest.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from benchmarks.paper.observed_distances import observed_distances
from benchmarks.paper.replay import Replay
from retarget.errors import InputError
from retarget.model.human import Human
from retarget.model.human_dimensions import POINTS
from retarget.model.observers import Observers, ObserverSet, human_observers
from retarget.schema.priorities import ObserverSettings
from retarget.schema.scene import Scene
from retarget.types import FloatArray

HINDERED = 0.05
"""m: how deep the body would be inside the obstacle."""
CYCLES = 2
"""At least so many cycles are hindered."""
FOREARM, HEAD = "r_elbow", "head"
"""Observers that the obstacles hinder: the line from the right elbow to the wrist, and the ball of the head."""
CYLINDER_RADIUS, CYLINDER_LENGTH, CYLINDER_INFLUENCE = 0.12, 0.80, 0.30
SPHERE_RADIUS, SPHERE_INFLUENCE = 0.12, 0.25
OVERLAP = 0.07
"""How deep the obstacle overlaps what it is placed on, m: more than HINDERED, because cycles differ."""
START_CLEAR = 0.03
"""m: nothing is nearer to the obstacle at the start."""
PLACES = 120
"""Places that are tried, evenly over the frames that come into question."""
LOOKED_AT = 8
"""Every so many frames are looked at while places are compared."""
_ARM = ("r_collar", "r_shoulder", "r_elbow", "r_wrist")


class _Survey:
    """Looks at a motion (every LOOKED_AT-th frame) beside obstacles."""

    def __init__(self, motion: Replay, evidence: str) -> None:
        self._motion, self._hindered = motion, evidence
        self._frames = np.arange(0, len(motion.q), LOOKED_AT)
        self._lines, self._capsules = (_worn(motion.human, worn) for worn in ("lines_and_head", "capsules"))

    def is_place(self, scene: Scene) -> bool:
        """Whether enough cycles are hindered, and the start is clear."""
        motion = self._motion
        start = observed_distances(motion.human.body, self._capsules, motion.q[:1], scene).least_scene
        if start[0] < START_CLEAR:
            return False
        looked = observed_distances(motion.human.body, self._lines, motion.q[self._frames], scene).of(self._hindered)
        return cycles_on_hold(motion, -np.interp(np.arange(len(motion.q)), self._frames, looked)) >= CYCLES

    def room(self, scene: Scene, spared: tuple[str, ...]) -> float:
        """Least distance (m) of anything that is not spared."""
        motion = self._motion
        whole = observed_distances(motion.human.body, self._capsules, motion.q[self._frames], scene)
        others = [k for k, name in enumerate(whole.names) if name not in spared]
        return float(whole.scene[:, others].min())


def clear_cylinder(motion: Replay) -> Scene:
    """A bar across the way of the right hand, between its lowest and its highest. Raises InputError: nowhere.

    Its axis runs from left to right of the performer; its place is a little farther out than the hand.
    """
    hand = motion.joints[:, POINTS.index("r_wrist")]
    low, high = np.percentile(hand[:, 2], [5, 95])
    share = (hand[:, 2] - low) / (high - low)
    between = np.flatnonzero((share > 0.3) & (share < 0.7))
    places = between[:: max(1, len(between) // PLACES)]
    across = motion.left
    survey = _Survey(motion, FOREARM)
    scenes = []
    for frame in places.tolist():
        out = _level(hand[frame] - motion.joints[frame, POINTS.index("pelvis")])
        out = out - (out @ across) * across
        centre = hand[frame] + (CYLINDER_RADIUS - OVERLAP) * out / max(float(np.linalg.norm(out)), 1e-9)
        scenes.append(_cylinder(centre, across))
    possible = [scene for scene in scenes if survey.is_place(scene)]
    if not possible:
        raise _nowhere("the right hand")
    return max(possible, key=lambda scene: survey.room(scene, _ARM))


def hindering_sphere(motion: Replay) -> Scene:
    """A ball over the head on its way up from a crouch. Raises InputError: nowhere."""
    head = motion.joints[:, POINTS.index("head")]
    radius = next(float(geom.size[0]) for geom in motion.human.body.geoms if geom.name == HEAD)
    low, high = np.percentile(head[:, 2], [5, 95])
    way_up = np.flatnonzero((np.gradient(head[:, 2]) > 0.0) & (head[:, 2] > low + 0.25 * (high - low)))
    survey = _Survey(motion, HEAD)
    above = np.array([0.0, 0.0, radius + SPHERE_RADIUS - OVERLAP])
    tried = way_up[:: max(1, len(way_up) // PLACES)]
    for frame in tried[np.argsort(-head[tried, 2], kind="stable")].tolist():
        scene = _sphere(head[frame] + above)
        if survey.is_place(scene):
            return scene
    raise _nowhere("the head")


def cycles_on_hold(motion: Replay, depth: FloatArray) -> int:
    """Cycles in which a depth (T,) m of the motion's frames reaches HINDERED."""
    head = motion.joints[:, POINTS.index("head"), 2]
    return sum(bool(depth[cycle].max() >= HINDERED) for cycle in crouch_cycles(head))


def _worn(human: Human, worn: ObserverSet) -> Observers:
    observers = human_observers(human, ObserverSettings(human=worn))
    assert observers is not None
    return replace(observers, pairs=observers.pairs[:0])  # no self-collision here


def _nowhere(evidence: str) -> InputError:
    return InputError(
        f"no place for an obstacle that hinders {evidence}",
        allowed=f"{1e2 * HINDERED:.0f} cm deep in {CYCLES} crouch cycles or more, and clear at the start",
        next_step="Give a motion with several crouches, such as CMU 02_06",
    )


def _level(vector: FloatArray) -> FloatArray:
    return np.array([vector[0], vector[1], 0.0])


def _cylinder(centre: FloatArray, axis: FloatArray) -> Scene:
    half = 0.5 * CYLINDER_LENGTH * axis
    ends = {"from": _triple(centre - half), "to": _triple(centre + half), "radius": CYLINDER_RADIUS}
    return _scene("cylinder", {"cylinder": ends}, CYLINDER_INFLUENCE)


def _sphere(centre: FloatArray) -> Scene:
    return _scene("sphere", {"sphere": {"at": _triple(centre), "radius": SPHERE_RADIUS}}, SPHERE_INFLUENCE)


def _scene(name: str, shape: dict[str, object], influence: float) -> Scene:
    obstacle = {"shape": shape, "influence": influence, "margin": 0.0}
    content = {"name": name, "description": "Placed by the rule of the experiments", "obstacles": {name: obstacle}}
    return Scene.model_validate(content)


def _triple(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


# Crouch cycles of a performer, found by the height of the head.

LOWERED = 0.15
"""A crouch: the head comes lower than its usual height by more than this share of the height."""


def crouch_cycles(head_height: FloatArray) -> list[slice]:
    """Frames of each cycle: from the highest head before a crouch to the highest after it. Heights (T,) m."""
    low = head_height < (1.0 - LOWERED) * np.percentile(head_height, 90)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], low, [False]]).astype(int)))
    crouches = edges.reshape(-1, 2)
    if not len(crouches):
        return []
    tops = [0]
    for (_, out), (into, _) in pairwise(crouches.tolist()):
        tops.append(out + int(np.argmax(head_height[out : into + 1])))
    tops.append(len(head_height))
    return [slice(a, b) for a, b in pairwise(tops)]
