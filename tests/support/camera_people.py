"""A known body before a known camera: landmarks as a perfect body tracker gives them, by MediaPipe's convention."""

import json
from typing import Any

import numpy as np

from rendered import CAMERA_HEIGHT, FIELD_DEG, HEIGHT, RATE, WIDTH, Motion
from retarget.sources.streams.camera import ANKLES, EARS, ELBOWS, HIPS, KNEES, LANDMARKS, SHOULDERS, WRISTS
from retarget.types import FloatArray

JOINTS = {"shoulder": SHOULDERS, "elbow": ELBOWS, "wrist": WRISTS, "hip": HIPS, "knee": KNEES, "ankle": ANKLES}
EAR, NOSE_AHEAD = 0.075, 0.11
"""m from the middle of the head: sideward, and forward."""


def landmarks(
    motion: Motion,
    *,
    distance: FloatArray | float = 3.0,
    noise: float = 0.0,
    turn: float = 0.0,
    visibility: float = 0.9,
) -> FloatArray:
    """Rows (T, 33, 6) of a motion before a level pinhole camera.

    distance (T,): m. noise: standard deviation of each landmark, m. turn: of the head to the left, rad.
    """
    random, frames = np.random.default_rng(1), len(motion.q)
    world = np.zeros((frames, LANDMARKS, 3))
    for name, rows in JOINTS.items():
        for row, side in zip(rows, "lr", strict=True):
            world[:, row] = motion.of(f"{side}_{name}")
    ahead, left = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
    face = [row for row in range(LANDMARKS) if row < SHOULDERS[0]]
    world[:, face] = (motion.of("head") + NOSE_AHEAD * ahead)[:, None]
    world[:, EARS] = motion.of("head")[:, None] + EAR * np.stack([left, -left])
    for rest, like in (
        ((17, 19, 21), WRISTS[0]),
        ((18, 20, 22), WRISTS[1]),
        ((29, 31), ANKLES[0]),
        ((30, 32), ANKLES[1]),
    ):
        world[:, rest] = world[:, [like]]
    world += noise * random.standard_normal(world.shape)
    focal = 0.5 * HEIGHT / np.tan(np.deg2rad(0.5 * FIELD_DEG))
    away = np.reshape(distance, (-1, 1)) - world[..., 0]
    u = 0.5 + focal * world[..., 1] / away / WIDTH
    v = 0.5 - focal * (world[..., 2] - CAMERA_HEIGHT) / away / HEIGHT
    local = world - world[:, HIPS].mean(axis=1, keepdims=True)
    seen = np.full((frames, LANDMARKS), visibility)
    return np.stack([u, v, local[..., 1], -local[..., 2], -local[..., 0], seen], axis=2)


def datagram(rows: FloatArray, *, time: float, number: int = 0, changed: dict[str, Any] | None = None) -> bytes:
    """One frame as the page sends it, with some keys changed."""
    frame = {"axes": "camera", "time": time, "frame": number, "size": [WIDTH, HEIGHT]}
    return json.dumps(frame | {"landmarks": np.round(rows, 5).tolist()} | (changed or {})).encode()


def datagrams(rows: FloatArray, *, rate: float = RATE, start: float = 1.0) -> list[bytes]:
    """Frames of rows (T, 33, 6) at a rate, Hz."""
    return [datagram(row, time=start + number / rate, number=number) for number, row in enumerate(rows)]
