"""A jog and a vertical jump for those who have no recordings: joint angles of the virtual human over time."""

from collections.abc import Callable

import numpy as np

from retarget.frames import SENSORS, JointTracks, SensorFrames, Skeleton
from retarget.model.human import Human, PostureReader, build_human
from retarget.model.human_dimensions import POINTS, proportional_dimensions
from retarget.types import FloatArray

RATE_HZ, STATURE = 120.0, 1.7
STRIDES_PER_S, JOG_SPEED = 1.4, 2.4
"""Strides (two steps) per second; m/s."""
GRAVITY, JUMP_HEIGHT = 9.81, 0.35

SOLES = ("l_sole", "r_sole", "l_toe", "r_toe")

Angles = dict[str, float]
"""Degrees by motion; without a side both sides."""


def made_jog(seconds: float = 1.8) -> SensorFrames:
    """Jogging on the spot with the world moving under it, so forward at a steady speed."""

    def angles(time: float) -> Angles:
        turn = 2.0 * np.pi * STRIDES_PER_S * time
        made: Angles = {"spine_flexion": 6.0, "elbow_flexion": 85.0}
        for side, phase in (("l", turn), ("r", turn + np.pi)):
            swing = np.sin(phase)
            made[f"{side}_hip_flexion"] = 18.0 + 30.0 * swing
            made[f"{side}_knee_flexion"] = 22.0 + 45.0 * max(0.0, float(np.cos(phase))) ** 1.5
            made[f"{side}_ankle_dorsiflexion"] = -4.0 + 8.0 * swing
            made[f"{side}_shoulder_elevation"] = 10.0 - 26.0 * swing
        return made

    def height(time: float) -> float:
        return 0.03 * max(0.0, float(np.sin(4.0 * np.pi * STRIDES_PER_S * time + 0.6)))

    return _made("made jog", seconds, angles, lambda time: JOG_SPEED * time, height)


def made_jump(seconds: float = 2.2) -> SensorFrames:
    """Crouch, leap, land in a crouch, stand."""
    flight = 2.0 * float(np.sqrt(2.0 * JUMP_HEIGHT / GRAVITY))
    leaves = 0.9
    lands = leaves + flight
    keys = np.array([0.0, 0.25, 0.7, leaves, leaves + 0.3 * flight, lands, lands + 0.2, lands + 0.7])
    crouch = np.array([0.0, 0.0, 1.0, 0.02, 0.1, 0.15, 0.75, 0.0])
    arms = np.array([0.0, 0.0, -0.25, 0.9, 1.0, 0.7, 0.2, 0.0])

    def angles(time: float) -> Angles:
        low, up = (float(np.interp(time, keys, values)) for values in (crouch, arms))
        return {
            "hip_flexion": 85.0 * low,
            "knee_flexion": 100.0 * low,
            "ankle_dorsiflexion": float(np.interp(time, [leaves - 0.1, leaves, lands], [18.0 * low, -35.0, 0.0])),
            "spine_flexion": 25.0 * low,
            "shoulder_elevation": 150.0 * up + 5.0,
            "elbow_flexion": 15.0,
        }

    def height(time: float) -> float:
        after = np.clip(time - leaves, 0.0, flight)
        return float(0.5 * GRAVITY * after * (flight - after))

    return _made("made jump", seconds, angles, lambda time: 0.0, height)


def _made(
    source: str,
    seconds: float,
    angles: Callable[[float], Angles],
    forward: Callable[[float], float],
    height: Callable[[float], float],
) -> SensorFrames:
    """Sensors of the human whose lower sole is `height` m above the ground and whose pelvis is `forward` m ahead."""
    human = build_human(proportional_dimensions(STATURE))
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    q = np.array([_posture(human, angles(t)) for t in time.tolist()])
    links, places = zip(*((frame.body, frame.position) for frame in map(human.body.frame, SOLES)), strict=True)
    soles = human.body.solver_body().points(q, list(links), np.array(places))
    q[:, 0] += [forward(t) for t in time.tolist()]
    q[:, 2] += np.array([height(t) for t in time.tolist()]) - soles[..., 2].min(axis=1)
    points = PostureReader(human).joints(q)
    position = points[:, [POINTS.index(name) for name in SENSORS]]
    return SensorFrames(
        time=time,
        names=SENSORS,
        position=position,
        orientation=np.full((*position.shape[:2], 4), np.nan),
        valid=np.ones(position.shape[:2], bool),
        joints=JointTracks(POINTS, points),
        skeleton=Skeleton(POINTS, human.dimensions.standing()),
        source=source,
        rate_hz=RATE_HZ,
    )


def _posture(human: Human, angles: Angles) -> FloatArray:
    """Posture (nq,), inside the joint limits."""
    limits = {
        name: np.rad2deg([human.body.lower[k], human.body.upper[k]]) for k, name in enumerate(human.body.dof_names)
    }
    sided = {
        name: value
        for motion, value in angles.items()
        for name in ([motion] if motion in limits else [f"l_{motion}", f"r_{motion}"])
    }
    return human.posture_from((name, float(np.clip(value, *limits[name]))) for name, value in sided.items())
