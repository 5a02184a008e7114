"""Limbs that a sender makes up: they hang from the trunk, to the millimetre, however the trunk goes.

SlimeVR tells arms and hands that nobody tracks; nothing on the wire marks them (facts on streams, section 2).
"""

import numpy as np

from retarget import rotations
from retarget.doctor.finding import Finding, mend, note
from retarget.doctor.listening import Listening
from retarget.live.roles import CONVENTIONS, Place
from retarget.rotations import FloatArray

__all__ = ["invented_findings"]

RIGID_M = 1e-3
"""A limb that a person carries is never so still within the trunk while the trunk goes."""
MOVED_M, MOVED_RAD = 0.05, 0.15
"""So far must the trunk have gone, or turned, to say anything."""
STEP_M, STEP_RAD = 0.001, 0.002
LEAST_STEPS = 10
"""Looks between which the trunk went on: a reset of the trackers takes the whole body along at once."""
LEAST_LOOKS = 20
_CARRIERS = {"chest": ("wrist", "elbow"), "pelvis": ("ankle", "knee")}
"""Parts of the trunk and the limbs that hang from them."""


def invented_findings(convention: str, listening: Listening) -> list[Finding]:
    """Of the performer's sensors; nothing where the sender tells no trunk. A note where nobody moved at all."""
    known = CONVENTIONS.get(convention, {})
    if not listening.frames or len(listening.looks) < LEAST_LOOKS:
        return []
    if not any(_moves(_track(listening, name)) for name in listening.told):
        step = "Walk and turn while the doctor listens: frozen and made-up sensors show only then"
        return [note("sensors", "nobody moved", step)]
    found = []
    for carrier, limbs in _CARRIERS.items():
        if carrier not in known:
            continue
        for sensor, place in zip(listening.stream.roles.sensors, listening.stream.roles.places, strict=True):
            if sensor[2:] in limbs and _hangs(place, known[carrier], listening):
                what = f"hangs from the {carrier} as if nobody tracked it: the sender makes it up ({place.position})"
                step = f"Wear and assign a tracker there, or leave {sensor} out (another --performer)"
                found.append(mend(sensor, what, step))
    return found


def _track(listening: Listening, name: str) -> FloatArray:
    """Poses (n, 7) of a name, at the looks at which it is known."""
    return np.array([look[name] for look in listening.looks if name in look]).reshape(-1, 7)


def _moves(track: FloatArray) -> bool:
    """Whether poses (n, 7) go or turn by so much that somebody must be moving."""
    places, turns = track[np.isfinite(track[:, 0]), :3], track[np.isfinite(track[:, 3]), 3:]
    gone = len(places) > 1 and float(np.ptp(places, axis=0).max()) > MOVED_M
    return gone or (len(turns) > 1 and _turned(turns) > MOVED_RAD)


def _turned(turns: FloatArray) -> float:
    """How far orientations (n, 4) are from the first at most, rad."""
    return float(rotations.angle_between(turns, np.broadcast_to(turns[0], turns.shape)).max())


def _hangs(limb: Place, trunk: Place, listening: Listening) -> bool:
    both = [
        (look[limb.position], look[trunk.position], look[trunk.orientation])
        for look in listening.looks[listening.settled :]
        if limb.position in look and trunk.position in look and trunk.orientation in look
    ]
    if len(both) < LEAST_LOOKS:
        return False
    rows = np.array(both)
    place, base, turn = rows[:, 0, :3], rows[:, 1, :3], rows[:, 2, 3:]
    sound = np.isfinite(np.concatenate((place, base, turn), axis=1)).all(axis=1)
    place, base, turn = place[sound], base[sound], turn[sound]
    if len(place) < LEAST_LOOKS:
        return False
    if np.ptp(base, axis=0).max() < MOVED_M and _turned(turn) < MOVED_RAD:
        return False
    went = (np.linalg.norm(np.diff(base, axis=0), axis=1) > STEP_M) | (
        rotations.angle_between(turn[1:], turn[:-1]) > STEP_RAD
    )
    if np.count_nonzero(went) < LEAST_STEPS:
        return False
    inside = rotations.rotate(rotations.conjugate(turn), place - base)
    return bool(np.ptp(inside, axis=0).max() < RIGID_M)
