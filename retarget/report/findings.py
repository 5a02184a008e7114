"""What is known of a run, in words: terminal and page show the lines of `findings.yaml`, a table of figures with their
bounds and sentences."""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hardware.errors import counted
from hardware.guard_state import StopCause
from retarget.live.stream_report import LiveReport
from retarget.report.motion_metrics import CONTACT_M, LimitUse, limit_use
from retarget.report.report import Report
from retarget.report.unfollowed import INSTEAD
from retarget.report.verdict import Verdict, to_follow, verdict_of
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.schema import strict_yaml
from retarget.types import MM


@dataclass(frozen=True)
class Finding:
    """What was measured, in words, with units. allowed: the limit, in words, if it needs any; kept: whether it was
    kept, None without a limit."""

    name: str
    measured: str
    allowed: str = ""
    kept: bool | None = None


# From figures to lines.

_FIELD = re.compile(r"{([^{}:]+):?([^{}]*)}")


def figure_of(seen: object, path: str) -> Any:
    """The figure at a path of attributes, keys and numbers; None where any of them is not known."""
    value: Any = seen
    for part in path.split("."):
        if isinstance(value, Mapping):
            value = value.get(part)
        elif isinstance(value, tuple) and part.isdecimal():
            value = value[int(part)]
        elif value is not None:
            value = getattr(value, part)
    return value


def in_words(text: str, seen: object) -> str:
    """A sentence with its figures; "" where one of them is not known or empty."""
    figures = {path: figure_of(seen, path) for path, _ in _FIELD.findall(text)}
    if any(value is None or value == "" for value in figures.values()):
        return ""
    return _FIELD.sub(lambda found: format(figures[found[1]], found[2]), text)


@cache
def _table() -> Mapping[str, Any]:
    return strict_yaml.load(Path(__file__).with_name("findings.yaml")).data


def found(table: str, seen: object, *, planned: str = "") -> Iterator[Finding]:
    """The lines of a table of `findings.yaml` that are known. planned: goes behind the names of lines of the plan."""
    for line in _table()[table]:
        ways = [line["says"]] if isinstance(line["says"], str) else line["says"]
        says = next(filter(None, (in_words(text, seen) for text in ways)), "")
        if not says:
            continue
        also = filter(None, (in_words(text, seen) for text in line.get("also", ())))
        broken = figure_of(seen, line["broken"]) if "broken" in line else None
        yield Finding(
            line["name"] + planned * line.get("planned", False),
            "; ".join([says, *also]),
            in_words(line.get("bound", ""), seen),
            None if broken is None else not broken,
        )


def findings(run: RunResult, report: Report) -> tuple[Finding, ...]:
    """Everything that is known of a run; what it has not (no feet, no scene, no bus) is left out."""
    return (*found("run", RunFigures(run, report), planned="" if report.physics is None else ", as planned"),)


# The figures of a run that are no keys of its report.

TIPS_MM = 0.05
"""Nearer to the edge of the soles than this, a robot begins to tip."""
ROUND_OFF = 1e-4
"""Nearer to its limit than this, rad, a joint is at it."""
MOST = 3
"""Reasons for data that were not used that the line names, those of which there were most; and times of a posture that
was not followed, the first ones."""
FOLLOWING, NOT_FOLLOWED = "following", "not followed"
STAGES = {"page": "from picture to page", "network": "from page to run", "goal": "from run to goals"}
"""Words for the stages of `LiveReport.latency_ms`."""
GAPS: Mapping[str, Callable[[Report], tuple[str, str] | None]] = {
    "self": lambda report: report.closest_links,
    "scene": lambda report: report.deep.obstacle,
    "ground": lambda report: report.deep.ground,
}
"""What came closest, by the keys of `Clearances`."""


class RunFigures:
    """Figures of a run by the names of `findings.yaml`: keys of the report, and what is made of them."""

    contact_mm, tips_mm = MM * CONTACT_M, TIPS_MM

    def __init__(self, run: RunResult, report: Report) -> None:
        self.run, self.report, self.robot = run, report, run.robot

    def __getattr__(self, name: str) -> Any:
        return getattr(self.report, name)

    # How it followed.

    @cached_property
    def verdict(self) -> Verdict | None:
        """Whether the robot follows."""
        return verdict_of(self.run, self.report)

    @property
    def to_follow(self) -> str:
        """What the verdict allows."""
        return to_follow(self.report)

    @property
    def not_followed(self) -> str:
        """When the performer did what the robot cannot."""
        said = []
        for what, instead in INSTEAD.items():
            known = [one for one in self.report.unfollowed or () if one.what == what]
            times = [f"from {one.from_s:.1f} to {one.to_s:.1f} s" for one in known[:MOST]]
            times += [counted(len(known) - MOST, "more time")] if len(known) > MOST else []
            said += [f"the performer {what} {', '.join(times)}: the robot {instead} instead"] if known else []
        return "; ".join(said)

    @property
    def likeness(self) -> dict[str, str]:
        """How far the limbs and the trunk are off: as `reached`, from the body as `recorded`, and at `best`."""
        report = self.report
        angles = {
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
        """How far each hand is off where it gets to the performer's."""
        off, shares = self.report.reachable_hands_mm or {}, self.report.reachable_share or {}
        return "; ".join(
            f"{side_words(name)} {off[name]:.1f} mm off where it gets there ({share:.0%} of ticks)"
            if name in off
            else f"{side_words(name)} never gets there"
            for name, share in shares.items()
            if self.run.ticks_followed
        )

    @property
    def lag_ms(self) -> float | None:
        """Lag of a robot."""
        return None if self.robot is None or self.report.lag_s is None else 1e3 * self.report.lag_s

    @property
    def latency(self) -> str:
        """As `latency_line`, of a robot."""
        return "" if self.robot is None else latency_line(self.report)

    @property
    def stays(self) -> str:
        """Not empty where the feet stay planted while the performer's move."""
        return "none" if self.report.foot_path_ratio == 0.0 else ""

    # Joints and servos.

    @property
    def servos(self) -> dict[str, Any] | None:
        """How far the servos were behind their goals, degrees, and the joint that was farthest."""
        servos, robot = self.report.servo_error_deg, self.robot
        if not servos or robot is None:
            return None
        worst = max(servos, key=lambda name: servos[name].max)
        mean = sum(spread.mean for spread in servos.values()) / len(servos)
        allowed = np.rad2deg(robot.profile.safety.following_error)
        return {"mean": mean, "max": servos[worst].max, "joint": worst, "allowed": allowed}

    @property
    def stopped_by_servos(self) -> bool:
        """True if the guard stopped the robot because a servo was too far behind."""
        return self.run.stop is not None and self.run.stop.cause is StopCause.FOLLOWING_ERROR

    @cached_property
    def use(self) -> LimitUse:
        """The use of joint limits."""
        return limit_use(self.run)

    @property
    def room(self) -> str:
        """The joint that came nearest to a limit of its position."""
        if self.use.room is None:
            return "no limit came near"
        joint, room = self.use.room
        if abs(room) <= ROUND_OFF:
            return f"{joint} reached its limit"
        return f"nearest: {joint}, {abs(np.rad2deg(room)):.2f}° {'from' if room > 0.0 else 'beyond'} its limit"

    @property
    def beyond(self) -> dict[str, str]:
        """Values beyond a limit, by its kind."""
        return {kind: counted(count, "value") for kind, count in vars(self.report.limit_violations).items() if count}

    # Balance, contact and the gate.

    @property
    def mass(self) -> str:
        """Where the centre of mass was."""
        outside, margin = self.report.com_outside_support_frames, self.report.com_margin_mm
        if outside:
            by = "" if margin is None or margin > 0 else f", by up to {-margin:.1f} mm"
            return f"outside in {counted(outside, 'tick')}{by}"
        nearest = "nothing touched the ground" if margin is None else f"never nearer to the edge than {margin:.1f} mm"
        return "" if outside is None else nearest

    @property
    def gaps(self) -> dict[str, str]:
        """The least distances, and between what they were."""
        known = {kind: mm for kind, mm in vars(self.report.min_clearance_mm).items() if mm is not None}
        return {kind: gap_words(mm, GAPS[kind](self.report)) for kind, mm in known.items()}

    @property
    def inside(self) -> dict[str, bool]:
        """True where something was in something else, by the keys of `gaps`."""
        gaps, deep = vars(self.report.min_clearance_mm), bool(self.report.penetrating_frames)
        return {kind: deep and mm is not None and mm < 0.0 for kind, mm in gaps.items()}

    @property
    def penetrating(self) -> str:
        """Ticks in which something was in something else."""
        ticks = self.report.penetrating_frames
        return counted(ticks, "tick") if ticks else ""

    @property
    def contact(self) -> float | None:
        """Share of the ticks in which an observer was in contact; None without any."""
        return (self.report.observers.reactive_share or None) if self.report.observers else None

    @property
    def braked(self) -> str:
        """Ticks without a goal."""
        return counted(self.report.no_command_frames, "tick") if self.report.no_command_frames else ""

    @property
    def refused(self) -> str:
        """The pair for which the gate refused goals most often, and what to do."""
        pair = self.report.refused_pair
        if pair is None or not self.report.gated_frames:
            return ""
        step = "" if pair.obstacle else f": {TIGHTEN}"
        return f"refused for {pair.first} - {pair.second} in {counted(pair.ticks, 'tick')}{step}"

    @property
    def stream(self) -> str:
        """The stream of a live run."""
        return stream_line(self.report.live)

    # A simulated robot.

    @property
    def stands(self) -> str:
        """Whether it fell, and what was done to it."""
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
    def tips(self) -> bool:
        """True if the pressure came to the edge of the soles."""
        return figure_of(self, "physics.min_zmp_margin_mm") <= TIPS_MM  # type: ignore[no-any-return]

    @property
    def torque(self) -> dict[str, Any] | None:
        """The joint with the largest torque."""
        return _most(figure_of(self, "physics.torque_nm"), lambda torque: float(torque.max))

    @property
    def heat(self) -> dict[str, Any] | None:
        """The joint with the hottest servo."""
        return _most(figure_of(self, "physics.temperature_c"), float)

    @property
    def touching_ticks(self) -> int:
        """Ticks in which a simulated body touched itself, a fixture or the floor."""
        seen = self.report.physics
        return 0 if seen is None else seen.self_contacts + seen.fixture_contacts

    @property
    def contacts(self) -> str:
        """What a simulated body touched."""
        seen = self.report.physics
        if seen is None:
            return ""
        counts = {"itself": seen.self_contacts, "fixtures or the floor": seen.fixture_contacts}
        return ", ".join(f"touches {what} in {counted(n, 'tick')}" for what, n in counts.items() if n) or "none"

    # The bus, the computer, and the end.

    @property
    def safety(self) -> Any:
        """Limits of the profile."""
        return None if self.robot is None else self.robot.profile.safety

    @property
    def faults(self) -> str:
        """Faults of the bus."""
        bus = self.report.bus
        return "" if bus is None or self.robot is None else counted(bus.faults, "fault") if bus.faults else "none"

    @property
    def missed(self) -> str:
        """Ticks that did not come in time."""
        bus = self.report.bus
        if bus is None or bus.missed_ticks is None or not self.run.setup.real_time:
            return ""
        missed = f"{bus.missed_ticks} of {self.report.ticks + bus.missed_ticks}" if bus.missed_ticks else "none"
        longest = "" if bus.longest_period_ms is None else f"; the longest took {bus.longest_period_ms:.1f} ms"
        return missed + longest + (", see retarget doctor" if bus.missed_ticks else "")

    @property
    def tick_ms(self) -> float:
        """Time between two ticks."""
        return 1e3 * self.run.clip.dt

    @property
    def too_hot(self) -> bool:
        """True if a servo was as hot as it may not be."""
        return figure_of(self, "bus.hottest.value") >= self.safety.temperature_c  # type: ignore[no-any-return]

    @property
    def voltage_off(self) -> bool:
        """True if the lowest voltage is none that the servos may have."""
        low, high = self.safety.voltage
        return not low <= figure_of(self, "bus.lowest_voltage.value") <= high

    @property
    def cost(self) -> str:
        """What a tick took."""
        costs = {"human": self.report.reconstruct_us, "robot": self.report.retarget_us}
        ran = {stage: cost for stage, cost in costs.items() if cost and math.isfinite(cost.p50)}
        known = [f"{stage} {cost.p50:.0f} us (p99 {cost.p99:.0f})" for stage, cost in ran.items()]
        return f"{', '.join(known)}; {counted(round(self.report.frames_per_s), 'frame')}/s" if known else ""

    @property
    def end(self) -> str:
        """How the run ended."""
        stop = self.report.stop
        return "to its end" if stop.reason is None else ": ".join(part for part in (stop.state, stop.reason) if part)

    @property
    def ended_early(self) -> bool:
        """True if the run did not go on to its end."""
        return self.report.stop.reason is not None

    # What only the sentence says.

    @property
    def sensors(self) -> float | None:
        """Mean distance, mm, of a reconstructed performer from the sensors."""
        known = [spread.mean for spread in self.report.sensors_mm.values()] if self.robot is None else []
        return sum(known) / len(known) if known else None

    @property
    def unsensed(self) -> float | None:
        """Mean error, mm, of a reconstructed performer's joints that no sensor is on."""
        return (self.report.unsensed_mm or {}).get("mean") if self.robot is None else None

    @property
    def touched(self) -> str:
        """Ticks in which something touched that should not."""
        ticks = self.report.penetrating_frames if self.report.physics is None else self.touching_ticks
        return counted(ticks, "tick") if ticks else ""

    @property
    def untouched(self) -> str:
        """Not empty where anything was looked at."""
        known = self.report.physics is not None or self.report.penetrating_frames is not None
        return "nothing touched" if known else ""

    @property
    def near_falling_mm(self) -> float | None:
        """Least distance of the centre of pressure from the edge of the soles; without mass, of the centre of mass."""
        seen = self.report.physics
        margin = self.report.com_margin_mm if seen is None else seen.min_zmp_margin_mm
        return margin if self.robot is not None and self.robot.stands else None

    @property
    def edge(self) -> str:
        """Not empty for a robot that was at the edge of its soles and did not fall."""
        margin = self.near_falling_mm
        return "at the edge of falling" if margin is not None and margin < TIPS_MM and not self.report.fallen else ""


TIGHTEN = "fit their observers closer (retarget fit-observers), or put the pair into ignore_pairs if it cannot meet"
SIDES = {"l": "left ", "r": "right "}


def side_words(name: str) -> str:
    """A name like l_hand in words."""
    side, _, part = name.partition("_")
    return (SIDES[side] + part if side in SIDES else name).replace("_", " ")


def gap_words(mm: float, pair: tuple[str, str] | None, *, inside: str = "inside each other") -> str:
    """A distance of two things, mm, negative inside, in words."""
    gap = f"never closer than {mm:.1f} mm" if mm >= 0.0 else f"{-mm:.1f} mm {inside}"
    return gap + (f" ({' and '.join(pair)})" if pair else "")


def _most(values: Mapping[str, Any] | None, size: Callable[[Any], float]) -> dict[str, Any] | None:
    """The joint with the largest of some values, of those that are known; None where there is none."""
    known = {joint: value for joint, value in (values or {}).items() if not math.isnan(size(value))}
    most = max(known, key=lambda joint: size(known[joint]), default=None)
    return None if most is None else {"joint": most, "value": known[most]}


def latency_line(report: Report) -> str:
    """The path from the performer's hand to the robot's shafts, and the stages that take a millisecond; "" where
    nothing is known."""
    whole, stages = report.hand_to_shaft_ms, report.latency_ms or {}
    taken = ", ".join(f"{stage} {time.p50:.0f}" for stage, time in stages.items() if time.p50 >= 1.0)
    if whole is None:
        return taken and f"{taken} ms; from hand to shaft it is not known"
    return f"{whole.p50:.0f} ms from hand to shaft (p99 {whole.p99:.0f}): {taken}"


def stream_line(live: LiveReport | None) -> str:
    """The stream of a live run; "" for a file."""
    if live is None:
        return ""
    came = f"{counted(live.frames, 'frame')} in {counted(live.datagrams, 'datagram')}"
    parts = [f"{came}, played {live.playout_delay_ms:.0f} ms late"]
    parts += [f"{STAGES[stage]} {taken.p50:.0f} ms (p99 {taken.p99:.0f})" for stage, taken in live.latency_ms.items()]
    if live.dropped:
        reasons = [*live.dropped.items()][:MOST]
        parts.append("not used: " + ", ".join(f"{reason} ({count})" for reason, count in reasons))
    if live.lost_s:
        longest = sorted(live.lost_s.items(), key=lambda item: -item[1])[:MOST]
        parts.append("lost: " + ", ".join(f"{name} {seconds:.1f} s" for name, seconds in longest))
    if live.holds.count:
        parts.append(f"held {counted(live.holds.count, 'time')}, {live.holds.s:.1f} s")
    if live.refused:
        parts.append(f"refused senders: {', '.join(live.refused[:MOST])}")
    return "; ".join(parts)


# The moments at which a run went wrong, on the time of the run: what stopped it, and a fall.


@dataclass(frozen=True)
class Moment:
    """what: "Stopped" or "Fell". time: s on the run's time. text: why, in words. more: what else there is to say."""

    what: str
    time: float
    text: str
    more: tuple[str, ...] = ()


def moments(run: RunResult) -> tuple[Moment, ...]:
    """In the order of their time; none of a run that went on to its end.

    A stop is at the first tick that braked, or at the last that was sent.
    """
    found = []
    if run.reason is not None and len(run.record):
        braking = np.flatnonzero(run.record.phase == Phase.BRAKE)
        row = int(braking[0]) if braking.size else len(run.record) - 1
        said, stop = [], run.stop
        if stop is not None:
            said.append(f"Cause, as the guard latched it: {stop.cause.value}.")
            said += [f"The braking was ended by: {stop.then.value}."] if stop.then else []
            said += ["Not every servo confirmed that its torque is off."] if stop.powered else []
        found.append(Moment("Stopped", float(run.record.time[row]), run.reason, tuple(said)))
    fall = None if run.physics is None else run.physics.fall
    if fall is not None:
        found.append(Moment("Fell", fall.time, fall.how))
    return tuple(sorted(found, key=lambda moment: moment.time))
