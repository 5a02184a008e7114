"""Postures in which a drafted robot does not touch itself, in the shapes of its observers."""

from dataclasses import dataclass

import numpy as np

from hardware.joint_map import JointMap
from retarget import _solver
from retarget.body import load_body
from retarget.importing.posed import Posed
from retarget.importing.postures_found import CROUCHES, SPREADS, Postures, find_postures
from retarget.observer_pairs import NEAR_LINKS, placed, steps_between
from retarget.observers import Observers, robot_observers
from retarget.profile import RobotProfile
from retarget.profile_parts import IgnorePair
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["Cleared", "clear_postures"]

NEAREST_M = 0.002
"""Parts that are nearer than this to each other in a posture touch."""

Links = tuple[str, str]


@dataclass(frozen=True)
class Cleared:
    """The postures, and pairs of links that touch in them whatever the arms do."""

    postures: Postures
    touching: tuple[Links, ...]


def clear_postures(profile: RobotProfile, posed: Posed, first: Postures) -> Cleared:
    """Arms as near to the trunk, and the crouch at rest as deep, as nothing touches. profile: with its observers.
    first: the postures with the arms nearest to the trunk."""
    bench, soles = _Bench(profile), bool(profile.feet)
    best, spread = Cleared(first, bench.touching(first.angles)), SPREADS[0]
    for further in SPREADS[1:] if posed.anatomy.arms else ():
        if not best.touching:
            break
        postures = find_postures(posed, spread=further, soles=soles)
        touching = bench.touching(postures.angles)
        if len(touching) < len(best.touching):
            best, spread = Cleared(postures, touching), further
    while soles and bench.touches_at_rest(best.postures.angles):
        crouches = tuple(share for share in CROUCHES if share > best.postures.crouch)
        if not crouches:
            break
        postures = find_postures(posed, spread=spread, crouches=crouches, soles=soles)
        best = Cleared(postures, best.touching)
    return best


class _Bench:
    """The observers of a profile, looked at in any posture."""

    def __init__(self, profile: RobotProfile) -> None:
        body = load_body(profile.body_path, root=profile.root)
        servos = JointMap(profile.servo_specs())
        columns = body.joint_qpos[[body.joint_index(joint) for joint in servos.joints]]
        links = list(dict.fromkeys(entry.link for entry in profile.observers.values()))
        everything = tuple(
            IgnorePair(pair=(a, b), reason="not now") for place, a in enumerate(links) for b in links[:place]
        )
        blind = profile.model_copy(update={"ignore_pairs": everything})
        self._robot = RobotBody(blind, body, servos, columns)
        self._observers: Observers = robot_observers(self._robot)
        ignored = {frozenset(entry.pair) for entry in profile.ignore_pairs}
        first, second = np.triu_indices(len(self._observers.names), 1)
        names = body.body_names
        of = [names[int(link)] for link in self._observers.links]
        steps = np.array(
            [
                steps_between(body, int(self._observers.links[a]), int(self._observers.links[b]))
                if frozenset((of[a], of[b])) not in ignored
                else 0
                for a, b in zip(first, second, strict=True)
            ],
            dtype=int,
        )
        looked = steps > 1
        self._pairs, self._steps = np.stack([first, second], axis=1)[looked], steps[looked]
        self._of = of

    def touching(self, postures: dict[str, dict[str, float]]) -> tuple[Links, ...]:
        """Pairs of links that keep a run from beginning: they touch, farther apart along the body than neighbours."""
        neighbours = self._steps <= NEAR_LINKS
        neutral = self._distances(postures["neutral"])
        found = (neutral <= NEAREST_M) & ~neighbours
        for name in ("stand", "attractor"):
            distance = self._distances(postures[name])
            # Neighbours that touch in the neutral posture are never looked at, and others may well be near.
            found |= np.where(neighbours, (distance <= 0.0) & (neutral > 0.0), distance <= NEAREST_M)
        return self._named(found)

    def touches_at_rest(self, postures: dict[str, dict[str, float]]) -> bool:
        """Whether the posture at rest touches where the neutral one does not."""
        rest, neutral = self._distances(postures["rest"]), self._distances(postures["neutral"])
        return bool(((rest <= NEAREST_M) & (neutral > NEAREST_M)).any())

    def _distances(self, angles: dict[str, float]) -> FloatArray:
        """Signed distance (p,) m of each pair in a posture."""
        observers = self._observers
        position, quat = placed(self._robot.body, observers, self._robot.posture(angles))
        a, b = (np.ascontiguousarray(column) for column in self._pairs.T)
        kinds, sizes = observers.kinds, observers.sizes
        return _solver.shape_distances(
            kinds[a], sizes[a], position[a], quat[a], kinds[b], sizes[b], position[b], quat[b]
        )[0]

    def _named(self, found: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> tuple[Links, ...]:
        pairs = ((self._of[int(a)], self._of[int(b)]) for a, b in self._pairs[found])
        return tuple(dict.fromkeys(pairs))
