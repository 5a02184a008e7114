"""Latency by stage, from a motion of the performer's hand to the shafts of the robot.

Computing times come from stamps of the tick (fields `time_...`). Lags of smoothing, body limits and servos are at the
highest cross-correlation of hand speeds before and after a stage.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from retarget.live.playout import smoothing_delay
from retarget.live.stream_report import TimePercentiles, spread_of
from retarget.report import tracking
from retarget.run.run_result import RunResult
from retarget.types import FloatArray

WINDOW_S, MOVES_M_S = 2.0, 0.1
"""Length of a window, s, and least mean speed of its hand, m/s, above the noise."""
ALIKE = 0.9
"""Least correlation of speeds whose lag counts: a hand out of reach has none."""
SMOOTHED_S = 0.04
"""Averaging time, s, of speeds: an encoder tick is 0.05 m/s at the hand."""
HAND_NAMES = (("l_wrist", "l_hand"), ("r_wrist", "r_hand"))
"""Sensor and landmark of each hand."""
LATENCY_STAGES = ("capture", "arrival", "playout", "filter", "human", "robot", "bus", "servo")
"""In order. capture: to the arrival of a frame; arrival: to the tick that uses it; playout: age of the poses; filter:
group delay of the smoothing; human, robot: each with its limits; bus: until the goal is written; servo: from there to
the shafts."""


@dataclass(frozen=True)
class Latency:
    """stages: ms, of the known ones. hand_to_shaft: ms, measured; together: ms, sum of the stages; None: not known."""

    stages: dict[str, TimePercentiles]
    hand_to_shaft: TimePercentiles | None
    together: TimePercentiles | None


def latency_of(run: RunResult) -> Latency | None:
    """The latency of a run; None without a robot whose servos answer, or without following. Lags are known where a hand
    moved and was followed for WINDOW_S. A recorded stream lacks its smoothing, so its whole latency is not known."""
    following = run.record.following
    if run.record.robot is None or not run.setup.has_bus or following.stop <= following.start:
        return None
    rows, windows = run.record[following], [*_windows(run)]
    captured, arrived, used = rows.time_captured, rows.time_arrived, rows.time_used
    ticks = {"capture": arrived - captured, "arrival": used - arrived, "playout": captured - rows.time_shown}
    ticks |= {"human": rows.time_human - used, "robot": rows.time_gate - rows.time_human}
    ticks |= {"bus": rows.time_written - rows.time_gate}
    stages = {stage: times[np.isfinite(times)] for stage, times in ticks.items() if np.isfinite(times).any()}
    is_live = "playout" in stages
    median = {stage: float(np.median(stages[stage])) if stage in stages else 0.0 for stage in LATENCY_STAGES}
    waits = median["capture"] + median["arrival"] + median["playout"]
    lags = {stage: np.array([window.lags[stage] for window in windows]) for stage in ("human", "robot", "servo")}
    for stage in ("human", "robot") if windows else ():
        # Quantiles stand for the ticks, so that the sums of a long run stay small.
        spread = np.quantile(stages.get(stage, np.zeros(1)), np.linspace(0.0, 1.0, 101))
        stages[stage] = np.add.outer(spread, lags[stage]).ravel()
    if windows:  # a lag between what is sent and the shafts begins with the tick in which it is sent
        stages["servo"] = lags["servo"] - (median["human"] + median["robot"] + median["bus"])
    else:
        stages = {stage: times for stage, times in stages.items() if stage not in ("human", "robot")}
    whole = [waits + window.filter + window.whole for window in windows]
    if is_live and run.live is not None and windows:
        stages["filter"] = np.array([window.filter for window in windows])
    is_known = windows and (run.live is not None or not is_live)
    found = {stage: spread_of(stages[stage].tolist()) for stage in LATENCY_STAGES if stage in stages}
    if not is_known:
        return Latency(found, None, None)
    return Latency(found, spread_of(whole), spread_of([waits + one.filter + sum(one.lags.values()) for one in windows]))


@dataclass(frozen=True)
class _Window:
    """Times, s. lags: of stages; whole: from the sensor to the shaft; filter: group delay of the smoothing."""

    lags: dict[str, float]
    whole: float
    filter: float


def _windows(run: RunResult) -> Iterator[_Window]:
    names = run.record.human_joint_names
    rows = run.record[run.record.following]
    sensors = {name: rows.sensors[:, column] for column, name in enumerate(run.sensors)}
    for sensor, sent, shaft in _hands(run):
        if sensor in sensors:
            tracks = sensors[sensor], rows.human_joints[:, names.index(sensor)], sent, shaft
            for first, *speeds in _moving([_speed(track, run.clip.dt) for track in tracks], run.clip.dt):
                pairs = *pairwise((first, *speeds)), (first, speeds[-1])
                lags = [_lag(a, b, run.clip.dt) for a, b in pairs]
                known = [lag for lag in lags if lag is not None]
                if len(known) == len(lags):
                    human, robot, servo, whole = known
                    yield _Window({"human": human, "robot": robot, "servo": servo}, whole, _filter(run, first))


def lags(run: RunResult, tracks: Mapping[str, FloatArray]) -> list[float]:
    """Delay, s, of the shafts behind tracks (T, 3) m of wrists, by sensor, in each window in which a hand moves."""
    found = []
    for sensor, _, shaft in _hands(run):
        for first, last in _moving([_speed(track, run.clip.dt) for track in (tracks[sensor], shaft)], run.clip.dt):
            lag = _lag(first, last, run.clip.dt)
            found += [] if lag is None else [lag]
    return found


def _hands(run: RunResult) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """Yield the sensor of each hand, and its positions (T, 3) m as sent and by the servos."""
    robot, rows = run.robot, run.record.following
    present = run.present_q(rows)
    if robot is None or present is None:
        return
    sent = np.ascontiguousarray(run.record.q[rows])
    for sensor, landmark in HAND_NAMES:
        if landmark in robot.profile.landmarks:
            frame = robot.landmark_frames((landmark,))
            yield sensor, robot.points(sent, frame)[:, 0], robot.points(present, frame)[:, 0]


def _moving(speeds: Sequence[FloatArray], dt: float) -> Iterator[list[FloatArray]]:
    """Yield windows of speeds (T,) m/s, half a window apart, in which the first one shows a moving hand."""
    ticks = round(WINDOW_S / dt)
    for first in range(0, len(speeds[0]) - ticks + 1, ticks // 2):
        window = [speed[first : first + ticks] for speed in speeds]
        if np.isfinite(window).all() and window[0].mean() >= MOVES_M_S:
            yield window


def _speed(track: FloatArray, dt: float) -> FloatArray:
    """Speed (T,) m/s along a track (T, 3) m, averaged over SMOOTHED_S without a delay."""
    if len(track) < 2:
        return np.full(len(track), np.nan)
    size = max(round(SMOOTHED_S / dt), 1)
    speed = np.linalg.norm(np.gradient(track, dt, axis=0), axis=1)
    return np.convolve(speed, np.full(size | 1, 1.0 / (size | 1)), mode="same")


def _lag(before: FloatArray, after: FloatArray, dt: float) -> float | None:
    """Delay, s, of speeds (T,) behind others; None if not ALIKE or not known."""
    first, last = (np.pad(speed[:, None, None], ((0, 0), (0, 0), (0, 2))) for speed in (before, after))
    lag = tracking.lag(first, last, dt)
    if lag is None:
        return None
    ticks = round(lag / dt)
    alike = np.corrcoef(before[: len(before) - ticks], after[ticks:])[0, 1]
    return lag if alike >= ALIKE else None


def _filter(run: RunResult, speed: FloatArray) -> float:
    """Group delay, s, of the sensors' smoothing at the mean speed over the path, because fast parts of a motion show
    the lag."""
    return 0.0 if run.live is None else smoothing_delay(run.live.smoothing, float((speed**2).mean() / speed.mean()))
