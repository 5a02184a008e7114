"""Findings about a run in words: the figures of `findings.yaml`."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hardware.errors import counted
from hardware.guard_state import StopCause
from retarget.live.stream_report import LiveReport
from retarget.report.likeness import LEAN
from retarget.report.lines import Finding, figure_of, in_words, lines_of, table
from retarget.report.motion_metrics import LimitUse, limit_use
from retarget.report.report import ImuReport, Report, Spread
from retarget.report.unfollowed import INSTEAD
from retarget.run.record import Phase
from retarget.run.run_result import CAPPED, RunResult
from retarget.safety.clearance import TIGHTEN
from retarget.schema.priorities import LimbTask
from retarget.types import MM, RunState

FOLLOWING, NOT_FOLLOWED = "following", "not followed"
"""Names of lines that are shown apart from the others."""
MOST_NAMED = 3
"""Largest number of reasons, senders or times that a line names."""
TIPS_MM, TOUCH_MM = 0.05, -1e-3
"""Margin of balance below which a robot tips, and clearance below which bodies overlap."""
NEAR_LIMIT_RAD = 1e-4
"""Distance, rad, from its limit at which a joint is at it."""
WALKED_M = 0.1
"""Path of a performer, m, scaled by the leg, from which on the missing share of a walk counts."""
STAYS = 0.7
"""Share of the performer's foot path below which a robot stays in place."""
STREAM_STAGES = {"page": "from picture to page", "network": "from page to run", "goal": "from run to goals"}
"""Words for the stages of `LiveReport.latency_ms`."""
SIDES = {"l": "left", "r": "right"}
CLOSEST: Mapping[str, Callable[[Report], tuple[str, str] | None]] = {
    "self": lambda report: report.closest_links,
    "scene": lambda report: report.deep.obstacle,
    "ground": lambda report: report.deep.ground,
}
"""The closest pair, by the keys of `Clearances`."""


def findings(run: RunResult, report: Report) -> tuple[Finding, ...]:
    """Every known finding of a run."""
    return (*lines_of("run", RunFigures(run, report), planned="" if report.physics is None else ", as planned"),)


@dataclass(frozen=True)
class FollowingVerdict:
    """The verdict on following, after the robot's name. differs: visible differences. broken: true if it does not
    follow, None if in part. why: the known cause."""

    words: str
    differs: tuple[str, ...]
    broken: bool | None
    why: str = ""

    @property
    def sentence(self) -> str:
        """The verdict, the differences, and the cause."""
        why = f"; {self.why}" if self.why else ""
        return f"{self.words}: {', '.join(self.differs)}{why}" if self.differs else self.words


def side_words(name: str) -> str:
    """The name of a body part such as l_hand, in words."""
    side, part = name.split("_", 1)
    return f"{SIDES[side]} {part.replace('_', ' ')}"


def gap_words(mm: float, pair: tuple[str, str] | None, *, inside: str = "inside each other") -> str:
    """A distance, mm, negative inside, in words."""
    gap = f"never closer than {mm:.1f} mm" if mm >= 0.0 else f"{-mm:.1f} mm {inside}"
    return gap + (f" ({' and '.join(pair)})" if pair else "")


SEEN_TILT_DEG = 1.0
"""Error, degrees, of a sensor at rest."""


class RunFigures:
    """Figures of a run by the names of `findings.yaml`: keys of its report, and those derived here."""

    tips_mm, touch_mm = TIPS_MM, TOUCH_MM

    def __init__(self, run: RunResult, report: Report) -> None:
        self.run, self.report, self.robot = run, report, run.robot

    def __getattr__(self, name: str) -> Any:
        return getattr(self.report, name)

    # Following.

    @cached_property
    def verdict(self) -> FollowingVerdict | None:
        """Comparison of robot and performer; None without following."""
        if self.robot is None or not self.run.ticks_followed:
            return None
        known = [(one, figure_of(self, one["figure"])) for one in table("differences")]
        for words, broken in (("does not follow", True), ("follows in part", None)):
            differs = [one for one, value in known if value is not None and value >= self._limit(one, broken)]
            if differs:
                why = self._why({one.get("limb", "") for one in differs})
                return FollowingVerdict(words, tuple(in_words(one["says"], self) for one in differs), broken, why)
        return FollowingVerdict("follows", (), False)

    def _why(self, limbs: Collection[str]) -> str:
        """The pair of most refused goals, or the limit that restrains one of these limbs most."""
        pair, held = self.report.refused_pair, self.report.held_back
        if pair is not None and (self.report.gated_frames or 0) > MOST_CHANGED * self.report.ticks:
            return f"most goals refused for {pair.first} - {pair.second}"
        return next((one.words for one in held if one.limb.split()[-1] in limbs), "")

    def _limit(self, of: Mapping[str, Any], broken: bool | None) -> float:
        if broken and of.get("arms") and self._hands_first:
            return math.inf
        return float(of.get("lost", math.inf) if broken else of["seen"])

    @property
    def _hands_first(self) -> bool:
        """True if a level has hands without forearms, whose likeness then depends on the hands."""
        levels = self.run.setup.priorities[-1].levels if self.run.setup.priorities else ()
        of = [{name for task in level.tasks if isinstance(task, LimbTask) for name in task.of} for level in levels]
        return any("l_hand" in names and "l_forearm" not in names for names in of)

    @property
    def whose(self) -> str:
        """The body that the robot is compared with."""
        return "reconstructed" if self.report.likeness_recorded_deg is None else "recorded"

    @property
    def tilt(self) -> ImuReport | None:
        """The IMU's measurement where the robot tilted."""
        imu = self.report.imu
        return imu if imu is not None and (imu.tilt_deg > SEEN_TILT_DEG or imu.invalid) else None

    @property
    def limbs(self) -> dict[str, Spread | None]:
        """Angles of limbs and trunk, degrees, to that body."""
        reached = dict(self.report.likeness_deg or {}) | {LEAN: self.report.trunk_lean_deg}
        return self.report.likeness_recorded_deg or reached  # type: ignore[return-value]

    @property
    def best(self) -> dict[str, Spread]:
        """The best such angles, which are known for the reconstructed body alone."""
        return {} if self.report.likeness_recorded_deg else self.report.best_likeness_deg or {}

    @property
    def leg_away(self) -> dict[str, Any]:
        """The part of a leg that was away for the longest time."""
        away = self.report.legs_away_s or {}
        name = max(away, key=away.__getitem__, default=None)
        return {} if name is None else {"part": side_words(name), "s": away[name]}

    def _share(self, mm: float | None, landmark: str) -> float | None:
        return None if mm is None else mm / (MM * self.robot.profile.landmarks[landmark].robot_length)  # type: ignore[union-attr]

    @property
    def hand_share(self) -> float | None:
        """Error of the worse hand, as a share of the arm."""
        return self._share(figure_of(self, "reachable_hands_mm.worse"), "l_hand")

    @property
    def squat_share(self) -> float | None:
        """Error of the pelvis height, as a share of the leg."""
        return self._share(figure_of(self, "pelvis_height_mm.p95"), "pelvis")

    @property
    def hand_away_s(self) -> float:
        """Longest time that a hand was away."""
        return max((self.report.hands_away_s or {}).values(), default=0.0)

    @property
    def path_missing(self) -> float | None:
        """Missing or excess share of the hands' path."""
        ratio = self.report.hand_path_ratio
        return None if ratio is None else 1.0 - min(ratio, 1.0 / max(ratio, 1e-9))

    @property
    def left_behind_m(self) -> float | None:
        """Travel of the performer while the robot stays in place."""
        left = self.report.walk is None and (self.report.foot_path_ratio or 0.0) < STAYS
        return self.report.travelled_m.performer if left else None

    @property
    def walk_missing(self) -> float | None:
        """Missing share of a walk; None if the performer goes nowhere."""
        walk = self.report.walk
        return None if walk is None or walk.asked_m < WALKED_M else 1.0 - walk.walked_m / walk.asked_m

    @property
    def not_turned_deg(self) -> float | None:
        """Turn of the performer beyond that of the robot."""
        turn = self.report.turned_deg
        return None if turn.performer is None or turn.robot is None else turn.performer - turn.robot

    # Details of following.

    @property
    def not_followed(self) -> str:
        """Times of postures that the robot cannot take."""
        said = []
        for what, instead in INSTEAD.items():
            known = [one for one in self.report.unfollowed or () if one.what == what]
            times = [f"from {one.from_s:.1f} to {one.to_s:.1f} s" for one in known[:MOST_NAMED]]
            times += [counted(len(known) - MOST_NAMED, "more time")] if len(known) > MOST_NAMED else []
            said += [f"the performer {what} {', '.join(times)}: the robot {instead} instead"] if known else []
        return "; ".join(said)

    @property
    def held_back(self) -> str:
        """The restrained limbs, and the causes."""
        return "; ".join(one.words for one in self.report.held_back)

    @property
    def likeness(self) -> dict[str, str]:
        """Mean angles of limbs and trunk: `reached`, `recorded`, and at `best`."""
        report = self.report
        angles: dict[str, Mapping[str, Spread | None]] = {
            "reached": dict(report.likeness_deg or {}, trunk_lean=report.trunk_lean_deg),
            "recorded": report.likeness_recorded_deg or {},
            "best": report.best_likeness_deg or {},
        }
        return {
            whose: ", ".join(f"{name.replace('_', ' ')} {off.mean:.0f}°" for name, off in of.items() if off is not None)
            for whose, of in angles.items()
        }

    @property
    def hands(self) -> str:
        """Error of each hand where its target is within reach."""
        off, shares = self.report.reachable_hands_mm or {}, self.report.reachable_share or {}
        return "; ".join(
            f"{side_words(name)} {off[name]:.1f} mm off where it gets there ({share:.0%} of ticks)"
            if name in off
            else f"{side_words(name)} never gets there"
            for name, share in shares.items()
            if self.run.ticks_followed
        )

    @property
    def latency(self) -> str:
        """`latency_line` of a robot."""
        return "" if self.robot is None else latency_line(self.report)

    @property
    def stream(self) -> str:
        """`stream_line` of the run."""
        return stream_line(self.report.live)

    @property
    def strategies_taken(self) -> str:
        """Share of time with each strategy; "" without any."""
        taken = self.report.strategies or {}
        return ", ".join(f"{name} {seconds / max(sum(taken.values()), 1e-9):.0%}" for name, seconds in taken.items())

    @property
    def stays(self) -> str:
        """ "none" where the feet stay planted while the performer's move."""
        return "none" if self.report.foot_path_ratio == 0.0 else ""

    # Joints and servos.

    @property
    def servos(self) -> dict[str, Any] | None:
        """Errors of servos to their goals, degrees, and the joint with the largest."""
        servos, robot = self.report.servo_error_deg, self.robot
        if not servos or robot is None:
            return None
        worst = max(servos, key=lambda name: servos[name].max)
        mean = sum(spread.mean for spread in servos.values()) / len(servos)
        allowed = np.rad2deg(robot.profile.safety.following_error)
        return {"mean": mean, "max": servos[worst].max, "joint": worst, "allowed": allowed}

    @property
    def stopped_by_servos(self) -> bool:
        """True if the guard stopped the robot for a following error."""
        return self.run.stop is not None and self.run.stop.cause is StopCause.FOLLOWING_ERROR

    @cached_property
    def use(self) -> LimitUse:
        """The use of joint limits."""
        return limit_use(self.run)

    @property
    def room(self) -> str:
        """The joint that came nearest to a position limit."""
        if self.use.room is None:
            return "no limit came near"
        joint, room = self.use.room
        if abs(room) <= NEAR_LIMIT_RAD:
            return f"{joint} reached its limit"
        return f"nearest: {joint}, {abs(np.rad2deg(room)):.2f}° {'from' if room > 0.0 else 'beyond'} its limit"

    # Balance, contact and the gate.

    @property
    def com_beyond_mm(self) -> float | None:
        """Distance of the centre of mass outside the support; None inside."""
        margin = self.report.com_margin_mm
        return None if margin is None or margin > 0.0 else -margin

    @property
    def gaps(self) -> dict[str, str]:
        """The least distances and their pairs, in words."""
        known = {kind: mm for kind, mm in vars(self.report.min_clearance_mm).items() if mm is not None}
        return {kind: gap_words(mm, CLOSEST[kind](self.report)) for kind, mm in known.items()}

    @property
    def refused(self) -> str:
        """The pair for which the gate refused goals most often, and the next step."""
        pair = self.report.refused_pair
        if pair is None or not self.report.gated_frames:
            return ""
        step = "" if pair.obstacle else f": {TIGHTEN}"
        return f"refused for {pair.first} - {pair.second} in {counted(pair.ticks, 'tick')}{step}"

    # A simulated robot.

    @property
    def stands(self) -> str:
        """A fall, the mount, and the perturbations."""
        seen = self.report.physics
        if seen is None:
            return ""
        how = {"floor": "did not fall", "stand": "on a stand", "gantry": "hangs on a gantry"}[seen.mount]
        if seen.fallen:
            how = f"fallen at {seen.fallen_at_s or 0.0:.2f} s: {seen.how}"
        if seen.perturbations:
            how += f" (perturbations: {', '.join(seen.perturbations)}; seed {seen.seed})"
        return how

    @property
    def torque(self) -> dict[str, Any] | None:
        """The joint with the largest torque."""
        return _most(figure_of(self, "physics.torque_nm"), lambda torque: float(torque.max))

    @property
    def heat(self) -> dict[str, Any] | None:
        """The joint with the hottest servo."""
        return _most(figure_of(self, "physics.temperature_c"), float)

    @property
    def contacts(self) -> str:
        """Contacts of a simulated body."""
        seen = self.report.physics
        if seen is None:
            return ""
        counts = {"itself": seen.self_contacts, "fixtures or the floor": seen.fixture_contacts}
        return ", ".join(f"touches {what} in {counted(n, 'tick')}" for what, n in counts.items() if n) or "none"

    # The bus, the computer, and the end.

    @property
    def missed_ticks(self) -> int | None:
        """Ticks that did not come in time; None where none can."""
        bus = self.report.bus
        return bus.missed_ticks if bus is not None and self.run.setup.real_time else None

    @property
    def cost(self) -> str:
        """CPU time of a tick by stage."""
        costs = {"human": self.report.reconstruct_us, "robot": self.report.retarget_us}
        ran = {stage: cost for stage, cost in costs.items() if cost and math.isfinite(cost.p50)}
        return ", ".join(f"{stage} {cost.p50:.0f} us (p99 {cost.p99:.0f})" for stage, cost in ran.items())

    @property
    def tick_ms(self) -> float:
        """Time between two ticks."""
        return 1e3 * self.run.clip.dt

    @property
    def ended_early(self) -> bool:
        """True if something other than the operator ended the run."""
        stop = self.run.stop
        by_person = self.robot is None or (stop is not None and stop.cause is StopCause.REQUESTED)
        return self.report.stop.reason is not None and not by_person

    # Figures of the sentence alone.

    @property
    def sensors_off_mm(self) -> float | None:
        """Mean distance of a reconstructed performer from the sensors."""
        known = [spread.mean for spread in self.report.sensors_mm.values()] if self.robot is None else []
        return sum(known) / len(known) if known else None

    @property
    def unsensed_off_mm(self) -> float | None:
        """Mean error of a reconstructed performer's joints without a sensor."""
        return figure_of(self, "unsensed_mm.mean") if self.robot is None else None

    @property
    def touching_ticks(self) -> int | None:
        """Ticks with unwanted contact, in the simulation if there is one."""
        seen = self.report.physics
        if seen is None:
            return self.report.penetrating_frames
        return None if seen.fallen else seen.self_contacts + seen.fixture_contacts  # what lies touches the floor

    @property
    def still_stands(self) -> str:
        """Reason why it still stands with torque; "" where it does not."""
        return self.run.tally.standing if self.run.state == RunState.STANDING.value else ""

    @property
    def near_falling_mm(self) -> float | None:
        """Least distance of the centre of pressure, or of mass, from the edge of the soles; 0 beyond it."""
        seen, stands = self.report.physics, self.robot is not None and self.robot.stands
        margin = self.report.com_margin_mm if seen is None else seen.min_zmp_margin_mm
        fell = seen is not None and seen.fallen
        return None if margin is None or fell or not stands else max(margin, 0.0)


def _most(values: Mapping[str, Any] | None, size: Callable[[Any], float]) -> dict[str, Any] | None:
    known = {joint: value for joint, value in (values or {}).items() if not math.isnan(size(value))}
    most = max(known, key=lambda joint: size(known[joint]), default=None)
    return None if most is None else {"joint": most, "value": known[most]}


def latency_line(report: Report) -> str:
    """The latency from hand to shaft, and the stages above a millisecond; "" if nothing is known."""
    whole, stages = report.hand_to_shaft_ms, report.latency_ms or {}
    taken = ", ".join(f"{stage} {time.p50:.0f}" for stage, time in stages.items() if time.p50 >= 1.0)
    if whole is None:
        return taken and f"{taken} ms; from hand to shaft it is not known"
    stages_too = f"medians of its stages, which need not add up to it: {taken}; all others below 1"
    return f"{whole.p50:.0f} ms from hand to shaft (median; p99 {whole.p99:.0f}); {stages_too}"


def stream_line(live: LiveReport | None) -> str:
    """The stream of a live run; "" for a file."""
    if live is None:
        return ""
    came = f"{counted(live.frames, 'frame')} in {counted(live.datagrams, 'datagram')}"
    parts = [f"{came}, played {live.playout_delay_ms:.0f} ms late"]
    parts += [
        f"{STREAM_STAGES[stage]} {taken.p50:.0f} ms (p99 {taken.p99:.0f})" for stage, taken in live.latency_ms.items()
    ]
    if live.dropped:
        reasons = [*live.dropped.items()][:MOST_NAMED]
        parts.append("not used: " + ", ".join(f"{reason} ({count})" for reason, count in reasons))
    if live.lost_s:
        longest = sorted(live.lost_s.items(), key=lambda item: -item[1])[:MOST_NAMED]
        parts.append("lost: " + ", ".join(f"{name} {seconds:.1f} s" for name, seconds in longest))
    if live.holds.count:
        parts.append(f"held {counted(live.holds.count, 'time')}, {live.holds.s:.1f} s")
    if live.refused:
        parts.append(f"refused senders: {', '.join(live.refused[:MOST_NAMED])}")
    return "; ".join(parts)


CHANGED = 0.05
"""Share of goals that the gate may change before a remark."""
MOST_CHANGED = 0.5
"""Share from which on they are the cause that the sentence names first."""
MOST_DIFFERENCES = 2
"""Number of differences that the sentence names."""


def heading(run: RunResult, report: Report) -> str:
    """The line with motion, robot and priorities."""
    return f"{report.source} on {report.robot} by {' and '.join(report.priorities)}: {measured_words(run, report)}"


def measured_words(run: RunResult, report: Report) -> str:
    """The seconds of following, and those of all other figures."""
    time, rows = run.record.time, run.record.following
    followed = f" from {time[rows][0]:.1f} to {time[rows][-1]:.1f} s" if run.ticks_followed else ""
    whole = f", limits checked over all {time[-1] - time[0]:.0f} s" if run.robot is not None and len(time) else ""
    speed = f", speed {report.speed:g}" if report.speed != 1.0 else ""
    return f"{counted(report.frames, 'frame')} followed{followed}{whole}, at {report.rate_hz:g} Hz{speed}"


def remarks(run: RunResult, report: Report, notes: Sequence[str], *, room: int, kept_back: int = 0) -> list[str]:
    """The lines that matter: broken limits, then, as `room` allows, postures not followed, the pair that the gate
    refused most, and notes. One more line counts the rest."""
    known = findings(run, report)
    lost = [one for one in known if one.kept is False and one.name not in (FOLLOWING, "end")]
    broken = [f"not kept: {one.name}: {one.measured} [allowed: {one.allowed}]" for one in lost]
    said = [one.measured for one in known if one.name == NOT_FOLLOWED]
    refused = RunFigures(run, report).refused
    if refused and (report.gated_frames or 0) > CHANGED * report.ticks:
        said.append(f"the gate changed {report.gated_frames} of {report.ticks} goals, {refused}")
    said += [text for text in notes if not text.endswith(CAPPED)]
    counts = [] if run.live is None or not run.live.holds.count else [f"held {counted(run.live.holds.count, 'time')}"]
    counts += [counted(kept_back, "more notice")] if kept_back else []
    left = max(room - len(broken), 0)
    shown = len(said) if len(said) + bool(counts) <= left + 1 else left
    counts += [counted(len(said) - shown, "more note")] if shown < len(said) else []
    return [
        *broken,
        *(f"note: {text}" for text in said[:shown]),
        *([f"{', '.join(counts)}: --verbose"] if counts else []),
    ]


def sentence(run: RunResult, report: Report) -> str:
    """The result of the run in one sentence without a full stop."""
    seen = RunFigures(run, report)
    verdict, figures = seen.verdict, ", ".join(one.measured for one in lines_of("sentence", seen))
    whose = "the performer" if run.robot is None else report.robot
    words = "is reconstructed" if run.robot is None else "did not follow"
    if verdict is not None:
        more = len(verdict.differs) - MOST_DIFFERENCES
        differs = [*verdict.differs[:MOST_DIFFERENCES], *([f"{more} more"] if more > 0 else [])]
        differs = [verdict.why, *differs] if verdict.why else differs
        words = verdict.words + (f" ({', '.join(differs)})" if differs else "")
    ends = moments(run)
    if ends:
        said = [f"{end.what.lower()} at {end.time:.2f} s" + f" ({end.text})" * (end.what == STOPPED) for end in ends]
        whose = f"{whose} {' and '.join(said)}"
        if not run.ticks_followed:
            return f"{whose} before it followed"
        if any(end.what == FELL for end in ends):
            return f"{whose}; until then {figures}" if figures else whose
        whose += "; until then it"
    return f"{whose} {words}" + (f": {figures}" if figures and run.ticks_followed else "")


STOPPED, FELL = "Stopped", "Fell"


@dataclass(frozen=True)
class Moment:
    """what: STOPPED or FELL. time: s on the run's time. text: the reason. more: details."""

    what: str
    time: float
    text: str
    more: tuple[str, ...] = ()


def moments(run: RunResult) -> tuple[Moment, ...]:
    """The stop and the fall of a run, by time. A stop is at the first tick that braked, or at the last one."""
    found = []
    if run.reason is not None and len(run.record):
        braking = np.flatnonzero(run.record.phase == Phase.BRAKE)
        row = int(braking[0]) if braking.size else len(run.record) - 1
        said, stop = [], run.stop
        if stop is not None:
            said.append(f"Cause, as the guard latched it: {stop.cause.value}.")
            said += [f"The braking was ended by: {stop.then.value}."] if stop.then else []
            said += ["Not every servo confirmed that its torque is off."] if stop.powered else []
        found.append(Moment(STOPPED, float(run.record.time[row]), run.reason, tuple(said)))
    fall = None if run.physics is None else run.physics.fall
    if fall is not None:
        found.append(Moment(FELL, fall.time, fall.how))
    return tuple(sorted(found, key=lambda moment: moment.time))
