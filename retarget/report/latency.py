"""Latency by stage: how long a motion of the performer's hand takes to the shafts of the robot, and where.

Two things delay it. A tick takes time: its stages are stamped (fields `time_...` of a row). And what the sensors'
smoothing, the limits of a body and a servo hold back of a motion is a lag, taken where the cross-correlation of the
hand's speed before and after a stage is highest, in windows of 2 s in which the hand moves. Each stage begins where the
one before it ends, so their sum is the whole way, which is measured by itself, from the sensor to the shaft.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from retarget.live.playout import SMOOTHINGS
from retarget.live.stream_report import TimePercentiles, spread_of
from retarget.report import tracking
from retarget.run.run_result import RunResult
from retarget.types import FloatArray

WINDOW_S, MOVES_M_S = 2.0, 0.1
"""Length of a window, s, and mean speed of a hand, m/s, from which on it moves in one: slower, noise decides the lag."""
SMOOTHED_S = 0.04
"""Time, s, over which speeds are averaged: a tick of an encoder is 0.05 m/s at the end of an arm."""
SIDES = (("l_wrist", "l_hand"), ("r_wrist", "r_hand"))
"""Sensor and human joint, and landmark of the robot, of each hand."""
STAGES = ("capture", "arrival", "playout", "filter", "human", "robot", "bus", "servo")
"""In the order of a motion. capture: to the arrival of a frame; arrival: to the tick that uses it; playout: by how much
the poses that are shown are older; filter: group delay of the smoothing; human, robot: each with its limits, the robot
with its gate; bus: until the goal is written; servo: from there to the shafts."""


@dataclass(frozen=True)
class Latency:
    """stages: ms, by name, those that are known. hand_to_shaft: ms, the whole way. Over ticks, or over windows."""

    stages: dict[str, TimePercentiles]
    hand_to_shaft: TimePercentiles


def latency_of(run: RunResult) -> Latency | None:
    """The latency of a run; None without a robot whose servos answer, and where no hand has moved for long enough."""
    record, following = run.record, run.record.following
    known = record.robot is not None and run.setup.has_bus and following.stop > following.start
    windows = [*_windows(run)] if known else []
    if not windows:
        return None
    rows = record[following]
    ends = (rows.time_captured, rows.time_arrived, rows.time_used, rows.time_human, rows.time_gate, rows.time_written)
    captured, arrived, used, human, gate, written = ends
    ticks = {"capture": arrived - captured, "arrival": used - arrived, "playout": captured - rows.time_shown}
    ticks |= {"human": human - used, "robot": gate - human, "bus": written - gate}
    medians = {stage: float(np.nanmedian(times)) for stage, times in ticks.items() if np.isfinite(times).any()}
    waits = sum(medians.get(stage, 0.0) for stage in ("capture", "arrival", "playout"))
    # A lag between what is sent and the shafts begins with the tick in which it is sent.
    sent = sum(medians.get(stage, 0.0) for stage in ("human", "robot", "bus"))
    stages = {stage: times[np.isfinite(times)] for stage, times in ticks.items() if stage in medians}
    for stage in ("human", "robot"):
        stages[stage] = medians.get(stage, 0.0) + np.array([window.lags[stage] for window in windows])
    stages["servo"] = np.array([window.lags["servo"] for window in windows]) - sent
    if medians.keys() & {"playout"}:
        stages["filter"] = np.array([window.filter for window in windows])
    whole = [waits + window.filter + window.whole for window in windows]
    return Latency({stage: spread_of(stages[stage]) for stage in STAGES if stage in stages}, spread_of(whole))


@dataclass(frozen=True)
class _Window:
    """Times, s. lags: of stages; whole: from the sensor to the shaft; filter: group delay of the smoothing."""

    lags: dict[str, float]
    whole: float
    filter: float


def _windows(run: RunResult) -> Iterator[_Window]:
    """The windows in which a hand moves and its lags are known."""
    robot, dt, following = run.robot, run.clip.dt, run.record.following
    present = run.present_q(following)
    if robot is None or present is None:
        return
    rows, ticks = run.record[following], round(WINDOW_S / dt)
    for sensor, landmark in SIDES:
        if sensor not in run.sensors or landmark not in robot.profile.landmarks:
            continue
        frame = robot.landmark_frames((landmark,))
        tracks = (
            rows.sensors[:, run.sensors.index(sensor)],
            rows.human_joints[:, run.record.human_joint_names.index(sensor)],
            robot.points(np.ascontiguousarray(rows.q), frame)[:, 0],
            robot.points(present, frame)[:, 0],
        )
        speeds = [_speed(track, dt) for track in tracks]
        for first in range(0, len(rows) - ticks + 1, ticks // 2):
            window = [speed[first : first + ticks] for speed in speeds]
            if not np.isfinite(window).all() or window[0].mean() < MOVES_M_S:
                continue
            lags = [tracking.lag(_track(a), _track(b), dt) for a, b in (*pairwise(window), (window[0], window[-1]))]
            known = [lag for lag in lags if lag is not None]
            if len(known) == len(lags):
                yield _Window(dict(zip(("human", "robot", "servo"), known, strict=False)), known[-1], _filter(run, window[0]))


def _speed(track: FloatArray, dt: float) -> FloatArray:
    """Speed (T,) m/s along a track (T, 3) m, averaged over SMOOTHED_S without a delay."""
    size = max(round(SMOOTHED_S / dt), 1)
    speed = np.linalg.norm(np.gradient(track, dt, axis=0), axis=1)
    return np.convolve(speed, np.full(size | 1, 1.0 / (size | 1)), mode="same")


def _track(values: FloatArray) -> FloatArray:
    """Numbers (T,) as a track (T, 1, 3), whose other coordinates stand still."""
    return np.stack([values, np.zeros_like(values), np.zeros_like(values)], axis=1)[:, None]


def _filter(run: RunResult, speed: FloatArray) -> float:
    """Group delay, s, of the sensors' smoothing at the mean speed of a hand: 1 / (2 pi cutoff), of a low-pass filter of
    first order, whose cutoff the One-Euro filter raises with the speed."""
    cutoffs = None if run.live is None else SMOOTHINGS[run.live.smoothing]
    if cutoffs is None:
        return 0.0
    least, rises, _ = cutoffs[0]
    return float(1.0 / (2.0 * np.pi * (least + rises * speed.mean())))
