"""The report of a finished run, measured on the record: from what was sent, not from a stage's own residuals."""

from dataclasses import replace
from typing import Any

import numpy as np

from hardware.guard_state import StopCause
from hardware.heat import HeatForecast
from retarget import rotations
from retarget.human.samples import Clip
from retarget.report import motion_metrics, tracking
from retarget.report.clearance import clearances, in_mm
from retarget.report.latency import latency_of
from retarget.report.likeness import LEAN, best_angles, legs_away, limb_angles
from retarget.report.motion_metrics import (
    LimitViolations,
    held_back,
    in_blocks,
    in_named_blocks,
    jerk_p95,
    limit_violations,
    moved_joints,
    observer_activity,
    physics_report,
)
from retarget.report.report import (
    BothMoved,
    BusReport,
    HeatReport,
    ImuReport,
    ObserversReport,
    Percentiles,
    Report,
    ServoExtreme,
    Soles,
    Spread,
    StopReport,
)
from retarget.report.tracking import ReferenceMotion, hands_from_shoulders, reachable_hands, top_level_error
from retarget.report.unfollowed import unfollowed_of
from retarget.run.prepare import limbs_of
from retarget.run.record import CYCLE
from retarget.run.run_result import RunResult
from retarget.schema.priorities import LimbTask
from retarget.types import MM, FloatArray

# What the bus's own clock and the guard recorded of a run.

LATE = 1.5
"""Periods between two ticks from which on one is missing between them."""
BUS_CAUSES = (StopCause.BUS, StopCause.BUS_SILENT)
SERVO_CAUSES = (StopCause.SERVO_LOST, StopCause.LIMB_LOST, StopCause.SERVO_ALERT, StopCause.SERVO_LIMP)


def fault_count(run: RunResult) -> int:
    """Servos silent or alarmed, summed over ticks, and failures that ended ticks before they had a row.

    A tick in which the bus fails sends nothing, nor does one in which a robot that stands is stopped: these are known
    from the guard's stop alone.
    """
    sent = run.record.robot
    seen = 0 if sent is None else int(sent.faults.sum())
    if run.stop is None:
        return seen
    if run.stop.cause in SERVO_CAUSES:
        seen = max(seen, 1)
    return seen + sum(cause in BUS_CAUSES for cause in (run.stop.cause, run.stop.then))


def pace(times: FloatArray, dt: float) -> tuple[float, float, int] | None:
    """Ticks per second; the longest time (s) from one tick to the next, because a long run hides a single stall in its
    rate; and deadlines that passed without a tick. Of the times (T,) s at which servos were read, in ticks that should
    be `dt` s apart; None where that was not measured."""
    known = times[np.isfinite(times)]
    periods = np.diff(known)
    lasted = float(periods.sum())
    if lasted <= 0.0:
        return None
    missed = np.rint(periods[periods > LATE * dt] / dt - 1.0).sum()
    return periods.size / lasted, float(periods.max()), int(missed)


def bus_report(run: RunResult) -> BusReport | None:
    """The report of the bus; None without one."""
    sent = run.record.robot
    if sent is None or not run.setup.has_bus:
        return None
    rate, longest, missed = pace(sent.bus_time, run.clip.dt) or (None, None, None)
    return BusReport(
        rate_hz=rate,
        cycle_ms=percentiles(run.record.cost[:, CYCLE], 1e3),
        faults=fault_count(run),
        longest_period_ms=None if longest is None else 1e3 * longest,
        missed_ticks=missed,
        retries=int(sent.retries.max(initial=0)),
        hottest=_extreme(run, sent.temperature),
        lowest_voltage=_extreme(run, -sent.voltage, sign=-1.0),
        warms=_warms(run),
    )


def _warms(run: RunResult) -> HeatReport | None:
    """How the servos that carry the robot will warm, if it goes on so; None where that is not known."""
    sent, robot = run.record.robot, run.robot
    assert sent is not None and robot is not None, "a bus has a robot"
    safety = robot.profile.safety
    limbs = np.array(limbs_of(robot) or (False,) * len(robot.joint_map))
    forecast = HeatForecast(safety.temperature_warn_c or safety.temperature_c, ~limbs)
    for time, temperature in zip(sent.bus_time.tolist(), sent.temperature, strict=True):
        forecast.look(time, temperature)
    first = forecast.soonest
    if first is None:
        return None
    left = first.left / 60.0 if np.isfinite(first.left) else None
    joint = robot.joint_map.joints[first.column]
    return HeatReport(joint, first.temperature, first.warns_at, first.per_minute, left)


def percentiles(seconds: FloatArray, scale: float) -> Percentiles:
    """Compute median, p99 and maximum of the times, s, that are known, times `scale`."""
    seconds = seconds[np.isfinite(seconds)]  # a stage that did not run in a tick has no cost there
    if not seconds.size:
        return Percentiles(float("nan"), float("nan"), float("nan"))
    p50, p99 = np.percentile(seconds, [50, 99])
    return Percentiles(scale * float(p50), scale * float(p99), scale * float(seconds.max()))


def _extreme(run: RunResult, values: FloatArray, *, sign: float = 1.0) -> ServoExtreme | None:
    """The servo with the largest of the values (T, n), and that value times `sign`."""
    if run.robot is None or not np.isfinite(values).any():
        return None
    column = int(np.nanargmax(values)) % values.shape[1]
    return ServoExtreme(run.robot.joint_map.joints[column], sign * float(np.nanmax(values)))


UNSENSED = ("pelvis", "l_knee", "r_knee", "l_elbow", "r_elbow", "l_shoulder", "r_shoulder", "neck")
"""Joints by which a reconstruction is judged, where no sensor sits on them."""
HANDS = ("l_hand", "r_hand", "l_wrist", "r_wrist")


def measure(run: RunResult) -> Report:
    """The report of a run."""
    names, asked, reached = run.followed
    performance, moved, latency = tracking.performance_of(run), _moved(run, reached), latency_of(run)
    reconstruct, retarget, _ = run.record.cost.T
    return Report(
        frames=min(played := run.clip.frames_played(run.ticks_followed), run.clip.source_frames),
        ticks=len(run.record),
        duration_s=max(float(run.record.time[-1]), 0.0) if len(run.record) else 0.0,
        rate_hz=run.clip.rate_hz,
        frames_per_s=played / max(run.wall_s, 1e-9),
        solve_us=percentiles(reconstruct + retarget, 1e6),
        reconstruct_us=percentiles(reconstruct, 1e6),
        tracking_mm=_spreads(names, asked, reached),
        lag_s=tracking.lag(asked, reached, run.clip.dt),
        unsensed_mm=_unsensed(run),
        limit_violations=limits_broken(run),
        priority_violation_max=in_mm(top_level_error(run)),
        jerk_p95=jerk_p95(_joint_positions(run)[run.record.following], run.clip.dt),
        fallen=None if run.physics is None else run.physics.fall is not None,
        bus=bus_report(run),
        stop=StopReport(run.state, run.reason),
        sensors_mm=_spreads(run.sensors, run.sensors_asked, run.sensors_reached),
        **_sent(run),
        **_ways(run, performance, moved),
        **_clearances(run),
        **_standing(run),
        **_likeness(run, performance),
        **_hands(run, performance, moved),
        unfollowed=unfollowed_of(run, performance),
        physics=physics_report(run),
        strategies=run.tally.strategies,
        walk=run.tally.walk,
        imu=_imu(run),
        refused_pair=run.tally.refused_pair,
        presses=run.tally.presses,
        held_back=held_back(run),
        robot="human" if run.robot is None else run.robot.profile.name,
        live=run.live,
        latency_ms=None if latency is None else latency.stages,
        hand_to_shaft_ms=None if latency is None else latency.hand_to_shaft,
        source=run.live.address if run.live else run.clip.frames.source,
        performer=run.setup.performer.name,
        priorities=tuple(priorities.name for priorities in run.setup.priorities),
        speed=run.clip.speed,
        notes=run.notes,
    )


def _imu(run: RunResult) -> ImuReport | None:
    """How the link of the IMU was tilted, and how its plan was."""
    record, robot = run.record.robot, run.robot
    if record is None or robot is None or robot.profile.imu is None:
        return None
    known = record.imu_valid & np.isfinite(record.imu_orientation).all(axis=1)
    if not known.any():
        return None
    measured, z = record.imu_orientation[known], [0.0, 0.0, 1.0]
    link = robot.body.body_index(robot.profile.imu.link)
    planned = robot.kinematics.orientations(np.ascontiguousarray(record.q[known]), [link])[:, 0]
    up, planned_up = (rotations.rotate(rotations.conjugate(q), z) for q in (measured, planned))
    tilt, off = (
        np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))) for cosine in (up[:, 2], (up * planned_up).sum(axis=1))
    )
    return ImuReport(float(tilt.max()), _spread(off), int(np.count_nonzero(~record.imu_valid)))


# Parts of the report, by its keys. A key that does not apply to a run is left out: it is null.

Part = dict[str, Any]


def _sent(run: RunResult) -> Part:
    """Goals that were sent to a robot, and how far its servos stood from them and from the landmarks asked for."""
    sent, robot = run.record.robot, run.robot
    if sent is None or robot is None:
        return {}
    found: Part = {
        "retarget_us": percentiles(run.record.cost[:, 1], 1e6),
        "gated_frames": int(np.count_nonzero(sent.gated)),
        "no_command_frames": int(np.count_nonzero(sent.no_command)),
    }
    if not run.setup.has_bus:
        return found
    frames, asked, columns = robot.landmark_frames(sent.landmark_names), sent.landmarks_asked, robot.servo_columns
    goals, present = sent.q[:-1], sent.present[1:]  # servos are read before the goal of their tick is sent

    def off(rows: slice) -> FloatArray:
        q = run.present_q(rows)
        assert q is not None, "there is a bus"
        return tracking.distances(asked[rows], robot.points(q, frames))

    error = in_blocks(lambda rows: np.rad2deg(np.abs(present[rows] - goals[rows, columns])), len(present))
    return found | {
        "servo_tracking_mm": _spread_of(sent.landmark_names, MM * in_blocks(off, len(asked))),
        "servo_error_deg": _spread_of(robot.joint_map.joints, error),
    }


def _ways(run: RunResult, performance: ReferenceMotion | None, moved: FloatArray) -> Part:
    """How far robot and performer got. moved (T, k, 3) m: what was followed, as the body moved."""
    (names, asked, _), (travelled, turned) = run.followed, travel(run)
    hands = [column for column, name in enumerate(names) if name in HANDS]
    found: Part = {
        "hand_path_ratio": tracking.path_ratio(asked[:, hands], moved[:, hands]) if hands else None,
        "foot_path_ratio": _foot_path_ratio(run, performance),
        "travelled_m": travelled,
        "turned_deg": turned,
    }
    heights = _pelvis_heights(run, moved)
    if heights is None:
        return found
    found["pelvis_excursion_ratio"] = ratio = tracking.excursion_ratio(*heights)
    if ratio is not None:
        found["pelvis_height_mm"] = _spread(MM * np.abs(heights[1] - heights[0]))
    return found


def _moved(run: RunResult, reached: FloatArray) -> FloatArray:
    """What was followed (T, k, 3) m as the body moved, the simulated one, else as it was sent; along the axes of the
    stance of a robot that walks."""
    robot, sent, q = run.robot, run.record.robot, run.seen_q
    if robot is None or sent is None or q is None or run.physics is None:
        return run.seen(reached)
    return robot.points(q, robot.landmark_frames(sent.landmark_names))


def _pelvis_heights(run: RunResult, moved: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Heights (T,) m of the pelvis, asked and reached: of a robot's landmark, or of the recorded body and the human."""
    sent, record, truth = run.record.robot, run.record, run.truth_of(("pelvis",))
    if sent is not None:
        if "pelvis" not in sent.landmark_names:
            return None
        column = sent.landmark_names.index("pelvis")
        return sent.landmarks_asked[:, column, 2], moved[:, column, 2]
    if truth is None or "pelvis" not in record.human_joint_names:
        return None
    column = record.human_joint_names.index("pelvis")
    return truth[:, 0, 2], record.human_joints[:, column, 2]


def travel(run: RunResult) -> tuple[BothMoved, BothMoved]:
    """How far performer and robot got over the ground, m, and how far they turned, degrees, while it followed."""
    record, robot, q, rows = run.record, run.robot, run.moved_q, run.record.following
    if not run.ticks_followed:
        return BothMoved(None, None), BothMoved(None, None)
    place = record.human_joints[rows, record.human_joint_names.index("pelvis"), :2]
    travelled, turned = (
        tracking.extent(place),
        float(np.degrees(tracking.turn_extent(tracking.performer_headings(run)))),
    )
    if robot is None or q is None:
        return BothMoved(travelled, None), BothMoved(turned, None)
    q = np.ascontiguousarray(q[rows])
    place = robot.points(q, (tracking.pelvis_frame(robot),))[:, 0, :2]
    turn = tracking.turn_extent(tracking.robot_headings(robot, q, run.clip.dt))
    return BothMoved(travelled, tracking.extent(place)), BothMoved(turned, float(np.degrees(turn)))


def _foot_path_ratio(run: RunResult, performance: ReferenceMotion | None) -> float | None:
    """Of the ticks that followed; None for a robot without feet that follow."""
    robot, q, rows = run.robot, run.moved_q, run.record.following
    if robot is None or performance is None or q is None or not run.ticks_followed:
        return None
    asked = tracking.asked_feet(robot, performance)
    if not asked:
        return None
    reached = robot.points(np.ascontiguousarray(q[rows]), tuple(asked))
    return tracking.foot_path_ratio(np.stack(list(asked.values()), axis=1)[rows], reached, run.clip.dt)


def _hands(run: RunResult, asked: ReferenceMotion | None, moved: FloatArray) -> Part:
    """How the hands followed, moved (T, k, 3) m, at the ticks at which they were asked within reach; nothing without a
    robot that has both."""
    robot, q = run.robot, run.seen_q
    if robot is None or q is None or asked is None:
        return {}
    seen = in_blocks(lambda rows: hands_from_shoulders(robot, asked.of(rows), q[rows], moved[rows]), len(moved))
    found = reachable_hands(robot, asked, seen)
    errors = {name: MM * hand.error for name, hand in found.items() if hand.error is not None}
    if errors:
        mean = np.average(list(errors.values()), weights=[found[name].share for name in errors])
        errors |= {"mean": float(mean), "worse": max(errors.values())}
    return {
        "reachable_hands_mm": errors or None,
        "reachable_share": {name: hand.share for name, hand in found.items()} or None,
        "hands_away_s": {name: hand.away for name, hand in found.items()} or None,
    }


def _likeness(run: RunResult, asked: ReferenceMotion | None) -> Part:
    """Angles between the limbs of robot and performer, and of the lean of their trunks, degrees, while it followed."""
    robot, q = run.robot, run.seen_q
    if robot is None or q is None or asked is None:
        return {}
    found = _limb_angles(run, q, asked, recorded=False)
    known = run.truth_of(asked.joint_names, slice(0, 0)) is not None
    recorded = _limb_angles(run, q, asked, recorded=True) if known else {}
    spreads, of_recorded = _degrees(found), _degrees(recorded)
    if set(of_recorded) != set(spreads):  # a file that knows only some of the joints
        of_recorded = {}
    away = legs_away(recorded if of_recorded else found, run.clip.dt)
    lean = spreads.pop(LEAN, None)
    return {
        "likeness_deg": spreads or None,
        "trunk_lean_deg": lean,
        "likeness_recorded_deg": of_recorded or None,
        "legs_away_s": away or None,
    }


def _limb_angles(run: RunResult, q: FloatArray, asked: ReferenceMotion, *, recorded: bool) -> dict[str, FloatArray]:
    """As `limb_angles`, at the ticks that followed. recorded: from the recorded body."""
    robot, following = run.robot, run.record.following
    assert robot is not None, "a robot follows"

    def angles(rows: slice) -> dict[str, FloatArray]:
        rows = slice(following.start + rows.start, following.start + rows.stop)
        truth = run.truth_of(asked.joint_names, rows) if recorded else None
        return limb_angles(robot, q[rows], asked.of(rows), recorded=truth)

    return in_named_blocks(angles, following.stop - following.start)


def best_likeness(run: RunResult) -> dict[str, Spread] | None:
    """As `likeness_deg` and, as `trunk_lean`, `trunk_lean_deg`, at the best that the joints allow; takes seconds. None
    where nothing was followed by both hands."""
    robot, asked = run.robot, tracking.performance_of(run)
    if robot is None or asked is None or not run.setup.priorities:
        return None
    tasks = [task for level in run.setup.priorities[-1].levels for task in level.tasks if isinstance(task, LimbTask)]
    weights = {name: task.weight for task in tasks for name in task.of}
    return _degrees(best_angles(robot, asked, weights)) or None


def _degrees(angles: dict[str, FloatArray]) -> dict[str, Spread]:
    """Spreads, degrees, of the angles, rad, of which any is known."""
    return {name: spread for name, found in angles.items() if (spread := _spread(np.degrees(found)))}


def _unsensed(run: RunResult) -> dict[str, float] | None:
    """Mean error, mm, of each joint that no sensor sits on, and the mean of those; None where no truth is known."""
    record, sensed = run.record, {sensor.joint for sensor in run.setup.performer.sensors.values()}
    means = {}
    for joint in UNSENSED:
        if joint in record.human_joint_names and joint not in sensed:
            column = record.human_joint_names.index(joint)
            truth = run.truth_of((joint,))
            if truth is None:
                continue
            known = tracking.distances(truth, record.human_joints[:, [column]])[:, 0]
            known = known[np.isfinite(known)]
            if known.size:
                means[joint] = MM * float(known.mean())
    return means | {"mean": float(np.mean(list(means.values())))} if means else None


def _joint_positions(run: RunResult) -> FloatArray:
    """Positions (T, n) rad that were sent, servo order; of a human, all DoFs that are single hinges."""
    if run.robot is not None and run.record.robot is not None:
        return np.asarray(run.record.robot.q[:, run.robot.servo_columns])
    single, address = run.human.body.scalar_joints()
    return np.asarray(run.record.human_q[:, address[single]])


def limits_broken(run: RunResult) -> LimitViolations:
    """Measured on `limited_positions`."""
    moved, kept, positions = moved_joints(run), run.record, motion_metrics.limited_positions(run)
    if kept.robot is None:
        return limit_violations(positions, moved.limits, moved.dt, from_rest=False)
    return limit_violations(positions, moved.limits, moved.dt, from_rest=kept.from_start, to_rest=kept.to_end)


def _clearances(run: RunResult) -> Part:
    """How near the last stage's body came to anything, and what its observers did in the ticks that followed."""
    found, sent = clearances(run), run.record.robot
    modes = run.record.human_observer_modes if sent is None else sent.observer_modes
    dt = run.clip.motion_dt if sent is None else run.clip.dt
    seen = observer_activity(modes[run.record.following], run.observer_names, dt)
    if seen is None:
        return found
    return found | {"mode_switches_per_s": seen[0], "observers": ObserversReport(seen[1])}


def _standing(run: RunResult) -> Part:
    """Centre of mass and soles of the postures that were sent: the former alone of a robot that made steps, slide
    alone where nothing stands; nothing for a body without feet or without free root."""
    robot, sent = run.robot, run.record.robot
    if robot is None or sent is None or not robot.on_floor or not len(sent.q):
        return {}
    stand = motion_metrics.standing_of(robot, sent.q if robot.stands else sent.q[run.record.following])
    known = stand.margin[np.isfinite(stand.margin)]
    margin = MM * float(known.min()) if known.size else None
    found = {"com_outside_support_frames": int(np.count_nonzero(stand.outside)), "com_margin_mm": margin}
    if run.tally.walk is not None and run.tally.walk.steps:  # soles that go elsewhere do not slide
        return found
    soles = zip(np.moveaxis(stand.place, 1, 0), stand.soles, strict=True)
    slides = [motion_metrics.foot_slide(place, corners[..., 2].min(axis=1)) for place, corners in soles]
    if not robot.stands:
        return {"foot_slide_mm": MM * max(slides)}
    return found | {
        "foot_slide_mm": MM * max(slides),
        "soles": Soles(MM * float(np.abs(stand.place[..., 2]).max()), float(np.rad2deg(stand.tilt.max()))),
    }


def _spreads(names: tuple[str, ...], asked: FloatArray, reached: FloatArray) -> dict[str, Spread]:
    """Mean, 95th percentile and largest distance, mm, of each track that is known at all."""
    return _spread_of(names, MM * in_blocks(lambda rows: tracking.distances(asked[rows], reached[rows]), len(asked)))


def _spread_of(names: tuple[str, ...], errors: FloatArray) -> dict[str, Spread]:
    """Spread of each column of errors (T, k) that is known at all."""
    spreads = {name: _spread(errors[:, column]) for column, name in enumerate(names)}
    return {name: spread for name, spread in spreads.items() if spread is not None}


def _spread(errors: FloatArray) -> Spread | None:
    """Of the errors that are known, of any shape; None where none is."""
    known = errors[np.isfinite(errors)]
    return Spread(float(known.mean()), float(np.percentile(known, 95)), float(known.max())) if known.size else None


# The report of a run that the operator ended and now waits for: what costs much is measured on its last seconds only.

LATEST_S = 5.0
"""Length of a run whose distances are measured within 0.3 s on a slow core."""


def measure_latest(run: RunResult, seconds: float = LATEST_S) -> Report:
    """Measure as `measure` does, over the last `seconds` of the run; ticks, duration, limits and the bus are those of
    the whole run."""
    latest = latest_of(run, seconds)
    if latest is run:
        return measure(run)
    note = f"measured on the last {seconds:g} s, but for ticks, limits and the end; --report measures the whole run"
    report = measure(latest)
    return replace(
        report,
        frames=min(run.clip.frames_played(run.ticks_followed), run.clip.source_frames),
        ticks=len(run.record),
        limit_violations=limits_broken(run),
        bus=bus_report(run),
        notes=(*report.notes, note),
    )


def latest_of(run: RunResult, seconds: float) -> RunResult:
    """The last `seconds` of a run; itself where it is no longer, and where it was simulated, as a whole."""
    record, clip = run.record, run.clip
    first = len(record) - round(seconds / clip.dt)
    if first <= 0 or run.physics is not None:
        return run
    following = record.following
    begun = max(first - following.start, 0)
    kept = record[first:]
    if record.robot is not None:
        kept = replace(kept, start=record.goals[first - 1].copy())
    return replace(run, record=replace(kept, from_start=False), clip=_from(clip, begun, run.ticks_followed))


def _from(clip: Clip, first: int, end: int) -> Clip:
    """The ticks of a clip from `first` to before `end`; at least one."""
    rows = clip.rows(max(end, first + 1))[first:]
    return replace(
        clip,
        frames=clip.frames.at_rows(rows, np.arange(len(rows)) / clip.rate_hz),
        ticks=len(rows),
        source_frames=len(rows),
    )
