"""A recorded performer as a benchmark motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import Motion
from benchmarks.ours import OursOverRoot
from retarget.frames import SensorFrames
from retarget.sources.open import open_source

SETTLE = 240  # frames of standing still, so that no side begins with a jump


def recording(body: BenchBody, path: Path) -> Motion:
    """Five sensors of a performer of the body's size, and the path of the centre of mass that goes with them.

    The paper keeps the centre of mass over the root. The peers take world targets only, so the path is the one that
    our own solver reaches with the paper's task.
    """
    source = open_source(path)
    points = source.position[:, [source.names.index(point.name) for point in body.points]]
    over_root = Motion(path.stem, np.zeros((len(points), 3)), points, first_guess(body, source), (1.0, 1.0, 0.0))
    ours = OursOverRoot(body, over_root)
    ours.aim(over_root.com[0], points[0])
    for _ in range(SETTLE):
        ours.solve()
    start = ours.posture()
    postures = np.zeros((len(points), body.model.nq))
    for k in range(len(points)):
        ours.aim(over_root.com[k], points[k])
        ours.solve()
        postures[k] = ours.posture()
    return replace(over_root, com=body.model.solver_body().centre_of_mass(postures), start=start)


def first_guess(body: BenchBody, source: SensorFrames) -> Floats:
    """The attractor posture (nq,) at the recorded pelvis, facing the way the hips face."""
    joints = source.joints
    assert joints is not None, "the recording must know the hips"
    pelvis, left, right = (joints.position[0, joints.names.index(name)] for name in ("pelvis", "l_hip", "r_hip"))
    across = left - right
    heading = np.arctan2(-across[0], across[1])
    q = body.attractor.copy()
    q[:3], q[3:7] = pelvis, [np.cos(heading / 2.0), 0.0, 0.0, np.sin(heading / 2.0)]
    return q
