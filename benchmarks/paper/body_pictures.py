"""Pictures of the virtual human in the experiments, after the paper's Figures 3, 7, 9 and 10."""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from benchmarks.paper.crouching import Outcome
from benchmarks.paper.placement import crouch_cycles
from benchmarks.paper.replay import Replay
from benchmarks.paper.strips import Row, View, body_row, draw_strips
from retarget.frames import SensorFrames
from retarget.model.human_dimensions import POINTS
from retarget.types import FloatArray

POSES, CLOSE_POSES = 8, 6
HAND_S, HEAD_S = 0.14, 0.22
"""How long before and after the deepest penetration without observers is shown, s: a hand is faster than a head."""
SIDE_DEG, FRONT_RIGHT_DEG = -80.0, -50.0
_HEAD = POINTS.index("head")

TRAVELS = 0.5
"""m: who gets farther than this is seen from the side of the way that they go."""

Frames = list[int]


def figure_3(name: str, frames: SensorFrames, replay: Replay, shown: Frames) -> Figure:
    """A motion above, its reconstruction below, each posture at its own place."""
    joints = replay.joints[shown]
    ankles = [POINTS.index("l_ankle"), POINTS.index("r_ankle")]
    origin = joints[:, [POINTS.index("pelvis")]] * [1.0, 1.0, 0.0]
    origin[..., 2] = replay.joints[:, ankles, 2].min() - 0.08
    view = _view(replay, SIDE_DEG)
    travel = joints[-1, _HEAD] - joints[0, _HEAD]
    if np.hypot(*travel[:2]) > TRAVELS:
        view = replace(view, facing=(float(travel[0]), float(travel[1])))
    captions = [f"{k * replay.dt:.2f} s" for k in shown]
    rows = [
        body_row("recorded", _recorded(frames, replay)[shown], view, origin),
        body_row(
            "reconstructed from five sensors",
            joints,
            view,
            origin,
            sensors=_sensors(frames, replay)[shown],
            captions=captions,
        ),
    ]
    return draw_strips(f"{name} (the paper's Figure 3)", rows)


def figure_7(frames: SensorFrames, outcome: Outcome) -> Figure:
    """Experiment 1: a crouch and the way up, recorded and reconstructed."""
    replay = outcome.replay
    shown = _spread(crouch_cycles(replay.joints[:, _HEAD, 2])[0], POSES)
    view, origin = _view(replay, FRONT_RIGHT_DEG), _ground(replay)
    captions = [f"{k * replay.dt:.1f} s" for k in shown]
    rows = [
        body_row("recorded", _recorded(frames, replay)[shown], view, origin),
        body_row(
            "reconstructed from five sensors (boxes)",
            replay.joints[shown],
            view,
            origin,
            sensors=_sensors(frames, replay)[shown],
            captions=captions,
        ),
    ]
    return draw_strips("Experiment 1: no obstacles (the paper's Figure 7)", rows)


def figure_9(frames: SensorFrames, outcome: Outcome, free: FloatArray) -> Figure:
    """Experiment 2: the cylinder in two cycles; thin: without observers (T, m, 3)."""
    cycles = _deepest_cycles(outcome, free)[:2]
    rows = []
    for cycle in sorted(cycles, key=lambda c: c.start):
        worst = cycle.start + int(np.argmin(outcome.free_distances[cycle]))
        half = round(HAND_S / outcome.replay.dt)
        shown = _spread(slice(max(worst - half, 0), min(worst + half, len(free))), CLOSE_POSES)
        rows.append(_scene_row(frames, outcome, free, shown, _view(outcome.replay, -90.0, 0.0)))
    return draw_strips("Experiment 2: a cylinder in the right hand's way (the paper's Figure 9)", rows)


def figure_10(frames: SensorFrames, outcome: Outcome, free: FloatArray) -> Figure:
    """Experiment 3: up from a crouch under the sphere; thin: without observers (T, m, 3)."""
    rows = []
    for cycle in sorted(_deepest_cycles(outcome, free)[:2], key=lambda c: c.start):
        low = cycle.start + int(np.argmin(free[cycle, _HEAD, 2]))
        worst = low + int(np.argmin(outcome.free_distances[low : cycle.stop]))
        half = round(HEAD_S / outcome.replay.dt)
        shown = _spread(slice(max(worst - half, low), min(worst + half, cycle.stop)), CLOSE_POSES)
        rows.append(_scene_row(frames, outcome, free, shown, _view(outcome.replay, SIDE_DEG)))
    return draw_strips("Experiment 3: a sphere over the head (the paper's Figure 10)", rows)


def _scene_row(frames: SensorFrames, outcome: Outcome, free: FloatArray, shown: Frames, view: View) -> Row:
    replay = outcome.replay
    return body_row(
        "thin: without observers",
        replay.joints[shown],
        view,
        _ground(replay),
        scene=outcome.experiment.scene,
        sensors=_sensors(frames, replay)[shown],
        beside=free[shown],
        captions=[f"{k * replay.dt:.2f} s" for k in shown],
    )


def _deepest_cycles(outcome: Outcome, free: FloatArray) -> list[slice]:
    """Crouch cycles, that with the deepest penetration without observers first."""
    cycles = crouch_cycles(free[:, _HEAD, 2])
    return sorted(cycles, key=lambda cycle: float(outcome.free_distances[cycle].min()))


def _spread(cycle: slice, count: int) -> Frames:
    return [round(frame) for frame in np.linspace(cycle.start, cycle.stop - 1, count).tolist()]


def _view(replay: Replay, azimuth_deg: float, elevation_deg: float = 12.0) -> View:
    x, y, _ = replay.left.tolist()
    return View((y, -x), azimuth_deg, float(replay.joints[0, _HEAD, 2]), elevation_deg)


def _ground(replay: Replay) -> FloatArray:
    """The point (3,) on the ground between the feet at the start."""
    ankles = replay.joints[0, [POINTS.index("l_ankle"), POINTS.index("r_ankle")]].mean(axis=0)
    return np.array([ankles[0], ankles[1], 0.0])


def _sensors(frames: SensorFrames, replay: Replay) -> FloatArray:
    """(T, k, 3)."""
    return frames.select(replay.sensors).position


def _recorded(frames: SensorFrames, replay: Replay) -> FloatArray:
    """Recorded joints (T, m, 3) of POINTS; NaN where the file knows none."""
    recorded = np.full(replay.joints.shape, np.nan)
    if frames.joints is not None:
        for name in frames.joints.names:
            if name in POINTS:
                recorded[:, POINTS.index(name)] = frames.joints.of(name)
    return recorded
