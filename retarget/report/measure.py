"""The report of a finished run, measured on its record of what was sent."""

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

LATE = 1.5
"""Periods between two ticks from which on one is missing between them."""
BUS_CAUSES = (StopCause.BUS, StopCause.BUS_SILENT)
SERVO_CAUSES = (StopCause.SERVO_LOST, StopCause.LIMB_LOST, StopCause.SERVO_ALERT, StopCause.SERVO_LIMP)


def fault_count(run: RunResult) -> int:
    """Silent or alarmed servos, summed over ticks, and failures that ended ticks. A tick in which the bus fails has no
    row, nor has one in which a standing robot is stopped, so the guard's stop counts them."""
    sent = run.record.robot
    seen = 0 if sent is None else int(sent.faults.sum())
    if run.stop is None:
        return seen
    if run.stop.cause in SERVO_CAUSES:
        seen = max(seen, 1)
    return seen + sum(cause in BUS_CAUSES for cause in (run.stop.cause, run.stop.then))


def pace(times: FloatArray, dt: float) -> tuple[float, float, int] | None:
    """Ticks per second, the longest period (s), and the number of missed ticks. times (T,) s: reads of servos, in ticks
    of `dt` s. None where nothing was measured."""
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
    """Forecast of the load-bearing servo that reaches its warning temperature first; None where it is not known."""
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
    """Median, p99 and maximum of the finite times, s, times `scale`."""
    seconds = seconds[np.isfinite(seconds)]  # a stage that did not run in a tick has no cost there
    if not seconds.size:
        return Percentiles(float("nan"), float("nan"), float("nan"))
    p50, p99 = np.percentile(seconds, [50, 99])
    return Percentiles(scale * float(p50), scale * float(p99), scale * float(seconds.max()))


def _extreme(run: RunResult, values: FloatArray, *, sign: float = 1.0) -> ServoExtreme | None:
    if run.robot is None or not np.isfinite(values).any():
        return None
    column = int(np.nanargmax(values)) % values.shape[1]
    return ServoExtreme(run.robot.joint_map.joints[column], sign * float(np.nanmax(values)))


UNSENSED = ("pelvis", "l_knee", "r_knee", "l_elbow", "r_elbow", "l_shoulder", "r_shoulder", "neck")
"""Joints that show the error of a reconstruction if no sensor is on them."""
HAND_TRACKS = ("l_hand", "r_hand", "l_wrist", "r_wrist")


def measure(run: RunResult) -> Report:
    """The report of a run."""
    names, desired, actual = run.followed
    reference, moved, latency = tracking.reference_of(run), _moved(run, actual), latency_of(run)
    reconstruct, retarget, _ = run.record.cost.T
    return Report(
        frames=min(played := run.clip.frames_played(run.ticks_followed), run.clip.source_frames),
        ticks=len(run.record),
        duration_s=max(float(run.record.time[-1]), 0.0) if len(run.record) else 0.0,
        rate_hz=run.clip.rate_hz,
        frames_per_s=played / max(run.wall_s, 1e-9),
        solve_us=percentiles(reconstruct + retarget, 1e6),
        reconstruct_us=percentiles(reconstruct, 1e6),
        tracking_mm=_spreads(names, desired, actual),
        lag_s=tracking.lag(desired, actual, run.clip.dt),
        unsensed_mm=_unsensed(run),
        limit_violations=limits_broken(run),
        priority_violation_max=in_mm(top_level_error(run)),
        jerk_p95=jerk_p95(_joint_positions(run)[run.record.following], run.clip.dt),
        fallen=None if run.physics is None else run.physics.fall is not None,
        bus=bus_report(run),
        stop=StopReport(run.state, run.reason),
        sensors_mm=_spreads(run.sensors, run.sensors_desired, run.sensors_reached),
        **_sent(run),
        **_travelled(run, reference, moved),
        **_clearances(run),
        **_standing(run),
        **_likeness(run, reference),
        **_hands(run, reference, moved),
        unfollowed=unfollowed_of(run, reference),
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


# Parts of the report, by its keys. A key that is left out is null.

Part = dict[str, Any]


def _sent(run: RunResult) -> Part:
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
    frames, desired, columns = robot.landmark_frames(sent.landmark_names), sent.landmarks_asked, robot.servo_columns
    goals, present = sent.q[:-1], sent.present[1:]  # servos are read before the goal of their tick is sent

    def off(rows: slice) -> FloatArray:
        q = run.present_q(rows)
        assert q is not None, "there is a bus"
        return tracking.distances(desired[rows], robot.points(q, frames))

    error = in_blocks(lambda rows: np.rad2deg(np.abs(present[rows] - goals[rows, columns])), len(present))
    return found | {
        "servo_tracking_mm": _spread_of(sent.landmark_names, MM * in_blocks(off, len(desired))),
        "servo_error_deg": _spread_of(robot.joint_map.joints, error),
    }


def _travelled(run: RunResult, reference: ReferenceMotion | None, moved: FloatArray) -> Part:
    """Paths and travel of robot and performer. moved (T, k, 3) m: the landmarks as the body moved."""
    (names, desired, _), (travelled, turned) = run.followed, travel(run)
    hands = [column for column, name in enumerate(names) if name in HAND_TRACKS]
    found: Part = {
        "hand_path_ratio": tracking.path_ratio(desired[:, hands], moved[:, hands]) if hands else None,
        "foot_path_ratio": _foot_path_ratio(run, reference),
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


def _moved(run: RunResult, actual: FloatArray) -> FloatArray:
    """Landmarks (T, k, 3) m as the simulated body moved, else as sent; along the axes of the stance of a walking
    robot."""
    robot, sent, q = run.robot, run.record.robot, run.seen_q
    if robot is None or sent is None or q is None or run.physics is None:
        return run.seen(actual)
    return robot.points(q, robot.landmark_frames(sent.landmark_names))


def _pelvis_heights(run: RunResult, moved: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Heights (T,) m of the pelvis, desired and actual: of a robot's landmark, or of recorded body and human."""
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
    """Distance over the ground, m, and turn, degrees, of performer and robot while it followed."""
    record, robot, q, rows = run.record, run.robot, run.moved_q, run.record.following
    if not run.ticks_followed:
        return BothMoved(None, None), BothMoved(None, None)
    place = record.human_joints[rows, record.human_joint_names.index("pelvis"), :2]
    travelled = tracking.extent(place)
    turned = float(np.degrees(tracking.turn_extent(tracking.performer_headings(run))))
    if robot is None or q is None:
        return BothMoved(travelled, None), BothMoved(turned, None)
    q = np.ascontiguousarray(q[rows])
    place = robot.points(q, (tracking.pelvis_frame(robot),))[:, 0, :2]
    turn = tracking.turn_extent(tracking.robot_headings(robot, q, run.clip.dt))
    return BothMoved(travelled, tracking.extent(place)), BothMoved(turned, float(np.degrees(turn)))


def _foot_path_ratio(run: RunResult, reference: ReferenceMotion | None) -> float | None:
    robot, q, rows = run.robot, run.moved_q, run.record.following
    if robot is None or reference is None or q is None or not run.ticks_followed:
        return None
    ankles = tracking.ankle_references(robot, reference)
    if not ankles:
        return None
    actual = robot.points(np.ascontiguousarray(q[rows]), tuple(ankles))
    return tracking.foot_path_ratio(np.stack(list(ankles.values()), axis=1)[rows], actual, run.clip.dt)


def _hands(run: RunResult, reference: ReferenceMotion | None, moved: FloatArray) -> Part:
    robot, q = run.robot, run.seen_q
    if robot is None or q is None or reference is None:
        return {}
    seen = in_blocks(lambda rows: hands_from_shoulders(robot, reference.of(rows), q[rows], moved[rows]), len(moved))
    found = reachable_hands(robot, reference, seen)
    errors = {name: MM * hand.error for name, hand in found.items() if hand.error is not None}
    if errors:
        mean = np.average(list(errors.values()), weights=[found[name].share for name in errors])
        errors |= {"mean": float(mean), "worse": max(errors.values())}
    return {
        "reachable_hands_mm": errors or None,
        "reachable_share": {name: hand.share for name, hand in found.items()} or None,
        "hands_away_s": {name: hand.away for name, hand in found.items()} or None,
    }


def _likeness(run: RunResult, reference: ReferenceMotion | None) -> Part:
    robot, q = run.robot, run.seen_q
    if robot is None or q is None or reference is None:
        return {}
    found = _limb_angles(run, q, reference, recorded=False)
    known = run.truth_of(reference.joint_names, slice(0, 0)) is not None
    recorded = _limb_angles(run, q, reference, recorded=True) if known else {}
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


def _limb_angles(run: RunResult, q: FloatArray, reference: ReferenceMotion, *, recorded: bool) -> dict[str, FloatArray]:
    robot, following = run.robot, run.record.following
    assert robot is not None, "a robot follows"

    def angles(rows: slice) -> dict[str, FloatArray]:
        rows = slice(following.start + rows.start, following.start + rows.stop)
        truth = run.truth_of(reference.joint_names, rows) if recorded else None
        return limb_angles(robot, q[rows], reference.of(rows), recorded=truth)

    return in_named_blocks(angles, following.stop - following.start)


def best_likeness(run: RunResult) -> dict[str, Spread] | None:
    """Like `likeness_deg`, with `trunk_lean`, at the best that the joints allow; takes seconds. None where both hands
    followed nothing."""
    robot, reference = run.robot, tracking.reference_of(run)
    if robot is None or reference is None or not run.setup.priorities:
        return None
    tasks = [task for level in run.setup.priorities[-1].levels for task in level.tasks if isinstance(task, LimbTask)]
    weights = {name: task.weight for task in tasks for name in task.of}
    return _degrees(best_angles(robot, reference, weights)) or None


def _degrees(angles: dict[str, FloatArray]) -> dict[str, Spread]:
    return {name: spread for name, found in angles.items() if (spread := _spread(np.degrees(found)))}


def _unsensed(run: RunResult) -> dict[str, float] | None:
    """Mean error, mm, of each joint without a sensor, and their mean; None where the recorded body is not known."""
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
    """Positions (T, n) rad that were sent, servo order; for a human all single hinges."""
    if run.robot is not None and run.record.robot is not None:
        return np.asarray(run.record.robot.q[:, run.robot.servo_columns])
    single, address = run.human.body.scalar_joints()
    return np.asarray(run.record.human_q[:, address[single]])


def limits_broken(run: RunResult) -> LimitViolations:
    """Limit violations of `limited_positions`."""
    moved, kept, positions = moved_joints(run), run.record, motion_metrics.limited_positions(run)
    if kept.robot is None:
        return limit_violations(positions, moved.limits, moved.dt, from_rest=False)
    return limit_violations(positions, moved.limits, moved.dt, from_rest=kept.from_start, to_rest=kept.to_end)


def _clearances(run: RunResult) -> Part:
    """Clearance of the last stage's body, and activity of its observers in the ticks that followed."""
    found, sent = clearances(run), run.record.robot
    modes = run.record.human_observer_modes if sent is None else sent.observer_modes
    dt = run.clip.motion_dt if sent is None else run.clip.dt
    seen = observer_activity(modes[run.record.following], run.observer_names, dt)
    if seen is None:
        return found
    return found | {"mode_switches_per_s": seen[0], "observers": ObserversReport(seen[1])}


def _standing(run: RunResult) -> Part:
    """Balance and soles of the postures that were sent: of a robot that made steps balance alone, of one that does not
    stand slide alone."""
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


def _spreads(names: tuple[str, ...], desired: FloatArray, actual: FloatArray) -> dict[str, Spread]:
    return _spread_of(names, MM * in_blocks(lambda rows: tracking.distances(desired[rows], actual[rows]), len(desired)))


def _spread_of(names: tuple[str, ...], errors: FloatArray) -> dict[str, Spread]:
    spreads = {name: _spread(errors[:, column]) for column, name in enumerate(names)}
    return {name: spread for name, spread in spreads.items() if spread is not None}


def _spread(errors: FloatArray) -> Spread | None:
    known = errors[np.isfinite(errors)]
    return Spread(float(known.mean()), float(np.percentile(known, 95)), float(known.max())) if known.size else None


LATEST_S = 5.0
"""Length of a run, s, whose distances are measured within 0.3 s on a slow core, while an operator waits."""


def measure_latest(run: RunResult, seconds: float = LATEST_S) -> Report:
    """Measure the last `seconds` of the run. Ticks, duration, limits and the bus are those of the whole run."""
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
    """The last `seconds` of a run; a shorter or simulated run is returned whole."""
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
