"""How near the human can come to recorded people when every joint is known: the floor of every reconstruction."""

from pathlib import Path

import numpy as np
import pytest

from people import trial
from retarget._solver import Solver, Task
from retarget.calibration import calibrate
from retarget.frames import SensorFrames
from retarget.human import build_human
from retarget.human_dimensions import POINTS
from retarget.rotations import FloatArray

UNSENSED = [
    i for i, name in enumerate(POINTS) if name.split("_")[-1] in ("pelvis", "knee", "elbow", "shoulder", "neck")
]


def errors_mm(frames: SensorFrames, *, step: int) -> FloatArray:
    """Distance (T, 23) of every point from the recording, after a fit of all points inside the limits."""
    human = build_human(calibrate(frames))
    body, solver_body = human.body, human.body.solver_body()
    at = [body.frame(name) for name in POINTS]
    points = [Task.position(frame.body, tuple(frame.position), max_error=0.3) for frame in at]
    rest = Task.posture(np.where(np.arange(body.nv) < 6, 0.0, 1.0), gain=0.1)
    solver = Solver(
        solver_body,
        [points, [rest]],
        lower=body.lower,
        upper=body.upper,
        max_velocity=np.full(body.nv, 1e6),
        max_acceleration=np.full(body.nv, 1e9),
        locked=human.locked,
        n_ik=30,
        max_step=0.5,
        damping=0.05,
        early_stop=False,
    )
    assert frames.joints is not None
    truth = np.stack([frames.joints.of(name)[::step] for name in POINTS], axis=1)
    target = np.ones((len(truth), solver.target_size))
    for i in range(len(POINTS)):
        start, stop = solver.target_slice(0, i)
        target[:, start + 1 : stop] = truth[:, i]
    start, stop = solver.target_slice(1, 0)
    target[:, start + 1 : stop] = human.posture("natural")
    solver.reset(_standing_at(human.posture("natural"), truth[0]))
    for _ in range(5):
        solver.frame(target[0], 0.05)
    reached = solver_body.points(
        solver.clip(target, 0.05), [frame.body for frame in at], np.array([f.position for f in at])
    )
    return np.asarray(1000.0 * np.linalg.norm(reached - truth, axis=2))


def _standing_at(q: FloatArray, points: FloatArray) -> FloatArray:
    """The posture moved to the pelvis of points (23, 3) and turned to face as they do."""
    left = points[POINTS.index("l_hip")] - points[POINTS.index("r_hip")]
    heading = np.arctan2(-left[0], left[1])
    q[:3] = points[0]
    q[3:7] = [np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)]
    return q


@pytest.mark.parametrize(("name", "floor"), [("02_01", 4.0), ("01_01", 4.0)])
def test_the_human_can_take_recorded_postures(shared: Path, name: str, floor: float) -> None:
    assert errors_mm(trial(shared, name), step=60)[:, UNSENSED].mean() < floor


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "floor"), [("02_05", 4.0), ("02_06", 5.0), ("01_01", 4.0), ("49_18", 4.0), ("05_13", 8.0)]
)
def test_the_floor_over_whole_recordings(shared: Path, name: str, floor: float) -> None:
    assert errors_mm(trial(shared, name), step=6)[:, UNSENSED].mean() < floor
