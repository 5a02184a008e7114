"""The report of a finished run, measured on the record: from what was sent, not from what a stage says of itself."""

from dataclasses import dataclass

import numpy as np

from retarget.human_posture import ORIENTED, PostureReader
from retarget.joint_limits import JointLimits
from retarget.metrics import bus, standing, tracking
from retarget.metrics.asked_arms import Performance
from retarget.metrics.clearances import RunClearances, clearances
from retarget.metrics.motion import LimitViolations, jerk_p95, limit_violations
from retarget.metrics.observer_activity import ModeSwitches, observer_activity
from retarget.metrics.physics import physics_report
from retarget.metrics.priority import top_level_error
from retarget.metrics.reach import reachable_hands
from retarget.report import (
    DeepReport,
    ObserversReport,
    Report,
    Soles,
    Spread,
    StepsReport,
    StopReport,
)
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["UNSENSED", "limits_broken", "measure"]

UNSENSED = ("pelvis", "l_knee", "r_knee", "l_elbow", "r_elbow", "l_shoulder", "r_shoulder", "neck")
"""Joints by which a reconstruction is judged, where no sensor sits on them."""
HANDS = ("l_hand", "r_hand", "l_wrist", "r_wrist")
MM = 1e3


def measure(run: RunResult) -> Report:
    """The report of a run."""
    (names, asked, reached), stand, (clear, switches, observers) = run.followed, _standing(run), _observers(run)
    return Report(
        frames=min(played := run.clip.frames_played(run.ticks_followed), run.clip.source_frames),
        ticks=len(run.record),
        duration_s=max(float(run.record.time[-1]), 0.0) if len(run.record) else 0.0,
        rate_hz=run.clip.rate_hz,
        frames_per_s=played / max(run.wall_s, 1e-9),
        solve_us=bus.percentiles(run.record.timing.reconstruct + run.record.timing.retarget, 1e6),
        reconstruct_us=bus.percentiles(run.record.timing.reconstruct, 1e6),
        retarget_us=None if run.record.robot is None else bus.percentiles(run.record.timing.retarget, 1e6),
        tracking_mm=_spreads(names, asked, reached),
        lag_s=tracking.lag(asked, reached, run.clip.dt),
        hand_path_ratio=_hand_path_ratio(names, asked, reached),
        pelvis_excursion_ratio=_pelvis_excursion_ratio(run),
        unsensed_mm=_unsensed(run),
        min_clearance_mm=clear.geoms,
        penetrating_frames=clear.penetrating,
        gated_frames=None if run.record.robot is None else int(np.count_nonzero(run.record.robot.gated)),
        limit_violations=limits_broken(run),
        priority_violation_max=_mm(top_level_error(run)),
        com_outside_support_frames=stand.outside,
        foot_slide_mm=_mm(stand.slide),
        jerk_p95=jerk_p95(_joint_positions(run)[run.record.following], run.clip.dt),
        fallen=None if run.physics is None else run.physics.fall is not None,
        mode_switches_per_s=switches,
        bus=bus.bus_report(run),
        stop=StopReport(run.state, run.reason),
        sensors_mm=_spreads(run.sensors, run.sensors_asked, run.sensors_reached),
        servo_tracking_mm=_servo_tracking(run),
        servo_error_deg=_servo_error(run),
        unled_frames=None if run.record.robot is None else int(np.count_nonzero(run.record.robot.unled)),
        reachable_hands_mm=(hands := _hands(run, reached)).errors,
        reachable_share=hands.shares,
        com_margin_mm=_mm(stand.margin),
        soles=stand.soles,
        closest_links=clear.closest,
        deep=DeepReport(clear.deep, clear.closest_obstacle, clear.closest_ground),
        observers=observers,
        physics=physics_report(run),
        steps=None if run.steps is None else StepsReport(run.steps.asked, run.steps.made, run.steps.declined),
        robot="human" if run.robot is None else run.robot.profile.name,
        live=run.live,
        source=run.live.address if run.live else run.clip.frames.source,
        performer=run.performer.name,
        priorities=tuple(priorities.name for priorities in run.priorities),
        speed=run.clip.speed,
        notes=run.notes,
    )


def _pelvis_excursion_ratio(run: RunResult) -> float | None:
    heights = _pelvis_heights(run)
    return None if heights is None else tracking.excursion_ratio(*heights)


def _pelvis_heights(run: RunResult) -> tuple[FloatArray, FloatArray] | None:
    """Heights (T,) m of the pelvis asked and reached: a robot's landmark, or of the recorded body and the human."""
    sent, human, truth = run.record.robot, run.record.human, run.human_truth
    reached = run.landmarks_reached
    if sent is not None and reached is not None:
        if "pelvis" not in sent.landmark_names:
            return None
        column = sent.landmark_names.index("pelvis")
        return sent.landmarks_asked[:, column, 2], reached[:, column, 2]
    if truth is None or "pelvis" not in human.joint_names:
        return None
    column = human.joint_names.index("pelvis")
    return truth[:, column, 2], human.joints[:, column, 2]


def _hand_path_ratio(names: tuple[str, ...], asked: FloatArray, reached: FloatArray) -> float | None:
    hands = [column for column, name in enumerate(names) if name in HANDS]
    return tracking.path_ratio(asked[:, hands], reached[:, hands]) if hands else None


@dataclass(frozen=True)
class _Hands:
    errors: dict[str, float] | None = None
    shares: dict[str, float] | None = None


def _hands(run: RunResult, reached: FloatArray) -> _Hands:
    """Hands at the ticks at which they were asked within reach; nothing without a robot that has both."""
    robot, sent, human = run.robot, run.record.robot, run.record.human
    if robot is None or sent is None or not len(sent.q):
        return _Hands()
    pelvis = PostureReader(run.human).orientations(human.q)[:, ORIENTED.index("pelvis")]
    asked = Performance(
        dimensions=run.human.dimensions,
        joint_names=human.joint_names,
        joints=human.joints,
        pelvis=pelvis,
        landmark_names=sent.landmark_names,
        landmarks=sent.landmarks_asked,
        dt=run.clip.dt,
    )
    found = reachable_hands(robot, asked, reached)
    if not found:
        return _Hands()
    errors = {name: MM * hand.error for name, hand in found.items() if hand.error is not None}
    ticks = [found[name].share for name in errors]
    both = (
        {"mean": float(np.average(list(errors.values()), weights=ticks)), "worse": max(errors.values())}
        if errors
        else {}
    )
    return _Hands(errors | both or None, {name: hand.share for name, hand in found.items()})


def _unsensed(run: RunResult) -> dict[str, float] | None:
    """Mean error, mm, of each joint that no sensor sits on, and the mean of those; None where no truth is known."""
    truth, human = run.human_truth, run.record.human
    if truth is None:
        return None
    sensed = {sensor.joint for sensor in run.performer.sensors.values()}
    errors = tracking.distances(truth, human.joints)
    means = {}
    for joint in UNSENSED:
        if joint in human.joint_names and joint not in sensed:
            known = errors[:, human.joint_names.index(joint)]
            known = known[np.isfinite(known)]
            if known.size:
                means[joint] = MM * float(known.mean())
    return means | {"mean": float(np.mean(list(means.values())))} if means else None


def _joint_positions(run: RunResult) -> FloatArray:
    """Positions (T, n) rad that were sent, servo order; of a human, all DoFs that are single hinges."""
    if run.robot is not None and run.record.robot is not None:
        return np.asarray(run.record.robot.q[:, run.robot.servo_columns])
    single, address = run.human.body.scalar_joints()
    return np.asarray(run.record.human.q[:, address[single]])


def limits_broken(run: RunResult) -> LimitViolations:
    """Of the goals that were sent; of a human alone, of its posture."""
    if run.robot is not None and run.record.robot is not None:
        limits, kept = run.robot.limits, run.record
        sent = np.vstack([run.record.robot.start, run.record.robot.goals])
        return limit_violations(sent, limits, run.clip.dt, from_rest=kept.from_start, to_rest=kept.to_end)
    single, _ = run.human.body.scalar_joints()
    whole = run.human_limits
    limits = JointLimits(
        whole.lower[single], whole.upper[single], whole.max_velocity[single], whole.max_acceleration[single]
    )
    return limit_violations(_joint_positions(run), limits, run.clip.motion_dt, from_rest=False)


def _observers(run: RunResult) -> tuple[RunClearances, ModeSwitches | None, ObserversReport | None]:
    """How near the last stage's body came to anything, and what its observers did in the ticks that followed."""
    clear = clearances(run)
    sent = run.record.robot
    modes = run.record.human.observer_modes if sent is None else sent.observer_modes
    dt = run.clip.motion_dt if sent is None else run.clip.dt
    seen = observer_activity(modes[run.record.following], run.observer_names, dt)
    if seen is None:
        return clear, None, None
    return clear, seen.switches, ObserversReport(clear.observers, seen.activations, seen.reactive)


@dataclass(frozen=True)
class _Standing:
    outside: int | None = None
    margin: float | None = None
    slide: float | None = None
    soles: Soles | None = None


def _standing(run: RunResult) -> _Standing:
    """Centre of mass and soles of the postures that were sent; nothing for a body without feet or without free root."""
    robot, sent = run.robot, run.record.robot
    if robot is None or sent is None or not robot.stands or not len(sent.q):
        return _Standing()
    soles = standing.soles_of(robot, sent.q)
    corners = np.concatenate([standing.sole_corners(sole) for sole in soles], axis=1)
    com = robot.body.solver_body().centre_of_mass(np.ascontiguousarray(sent.q))
    margin = standing.support_margin(com, corners)
    known = margin[np.isfinite(margin)]
    height = max(float(np.abs(sole.position[:, 2]).max()) for sole in soles)
    tilt = max(float(standing.sole_tilt(sole).max()) for sole in soles)
    return _Standing(
        # Where nothing touches, nothing supports.
        outside=int(np.count_nonzero(~(margin >= -standing.OUTSIDE_M))),
        margin=float(known.min()) if known.size else None,
        slide=max(standing.foot_slide(sole) for sole in soles),
        soles=Soles(MM * height, float(np.rad2deg(tilt))),
    )


def _servo_tracking(run: RunResult) -> dict[str, Spread] | None:
    """As `tracking_mm`, for where the servos stood."""
    q, sent = run.present_q, run.record.robot
    if q is None or sent is None or run.robot is None:
        return None
    reached = run.robot.points(q, run.robot.landmark_frames(sent.landmark_names))
    return _spreads(sent.landmark_names, sent.landmarks_asked, reached)


def _servo_error(run: RunResult) -> dict[str, Spread] | None:
    """How far, degrees, each servo stood at the start of a tick from the goal of the tick before."""
    sent, robot = run.record.robot, run.robot
    if sent is None or robot is None or not run.has_bus:
        return None
    off = np.rad2deg(np.abs(sent.present[1:] - sent.q[:-1, robot.servo_columns]))
    return _spread_of(robot.joint_map.joints, off)


def _spreads(names: tuple[str, ...], asked: FloatArray, reached: FloatArray) -> dict[str, Spread]:
    """Mean, 95th percentile and largest distance, mm, of each track that is known at all."""
    return _spread_of(names, MM * tracking.distances(asked, reached))


def _spread_of(names: tuple[str, ...], errors: FloatArray) -> dict[str, Spread]:
    """Spread of each column of errors (T, k) that is known at all."""
    spreads = {}
    for column, name in enumerate(names):
        known = errors[np.isfinite(errors[:, column]), column]
        if known.size:
            spreads[name] = Spread(float(known.mean()), float(np.percentile(known, 95)), float(known.max()))
    return spreads


def _mm(metres: float | None) -> float | None:
    return None if metres is None else MM * metres
