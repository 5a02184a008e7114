"""Whether a robot follows its performer, by what a person sees who looks from one to the other."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from retarget.report.likeness import ARMS, LEAN, LEG_AWAY_DEG, LIMBS
from retarget.report.report import Report, Spread
from retarget.report.tracking import AWAY_M
from retarget.run.run_result import RunResult
from retarget.schema.priorities import LimbTask
from retarget.types import MM


@dataclass(frozen=True)
class DifferenceLimits:
    """From where on a person sees it that robot and performer differ, and from where on it is another motion."""

    difference: float
    lost: float = math.inf


LIMB_DEG = DifferenceLimits(20.0, LEG_AWAY_DEG)
"""Degrees, on average. The hands of a clock are 30 apart from hour to hour, so 20 are seen at a glance; limbs that have
nothing to do with each other are 90 apart, and 45 is half of that."""
LEG_AWAY_S = DifferenceLimits(0.3)
"""Longest time, s, that a thigh or shank is more than `LEG_AWAY_DEG` off: as for a hand. A robot that bears itself on
both feet is not another motion because the performer lifts one."""
LEAN_DEG = DifferenceLimits(15.0, 45.0)
"""Degrees, in all but a twentieth of the time. A trunk 15 off looks tired, one that is 45 off is folded over."""
HAND_SHARE = DifferenceLimits(0.2, 0.5)
"""Of the length of the arm, on average, within reach: 0.2 is a hand's length, 0.5 is from the chin to the belt."""
HAND_AWAY_S = DifferenceLimits(0.3, 2.0)
"""Longest time, s, that a hand is more than `AWAY_M` off, within reach: a gesture takes two seconds."""
SQUAT_SHARE = DifferenceLimits(0.15, 0.4)
"""Of the length of the leg, in all but a twentieth of the time: a squat with level thighs goes down by a half. 0.15 off
is seen beside the performer; with 0.4 off it is missed."""
RATIO = DifferenceLimits(0.3, 0.75)
"""Of what was asked is missing, or of what was done too much: a third is seen, a quarter of a motion is another one."""
TRAVEL_M, TURN_DEG = DifferenceLimits(0.5), DifferenceLimits(60.0)
"""A performer's step, and more than a planted robot turns: by so much performers go away who seemed to be followed."""


@dataclass(frozen=True)
class Verdict:
    """words: after the robot's name. differs: what a person sees, in words. kept: it follows; None: in part."""

    words: str
    differs: tuple[str, ...]
    kept: bool | None

    @property
    def broken(self) -> bool | None:
        """True if it does not follow; None: it does in part."""
        return None if self.kept is None else not self.kept

    @property
    def sentence(self) -> str:
        """The verdict, and what differs."""
        return f"{self.words}: {', '.join(self.differs)}" if self.differs else self.words


def verdict_of(run: RunResult, report: Report) -> Verdict | None:
    """Compare robot and performer; None where no robot followed."""
    if run.robot is None or not run.ticks_followed:
        return None
    whole, compared = Verdict("follows", (), True), _Compared(run, report)
    found = [(one, figure) for one in DIFFERENCES if (figure := one.figure(compared)) is not None]
    for words, kept in (("does not follow", False), ("follows in part", None)):
        differs = [one.sentence.format(*figure) for one, figure in found if figure[0] >= compared.limit(one, kept)]
        if differs:
            return Verdict(words, tuple(differs), kept)
    return whole


def to_follow(report: Report) -> str:
    """The limits of the verdict, in words."""
    whose = "reconstructed" if report.likeness_recorded_deg is None else "recorded"
    return (
        f"limbs within {LIMB_DEG.difference:g}° of the {whose} performer's (in part: {LIMB_DEG.lost:g}°), "
        f"no leg more than {LEG_AWAY_DEG:g}° off for {LEG_AWAY_S.difference:g} s, "
        f"trunk within {LEAN_DEG.difference:g}° (in part: {LEAN_DEG.lost:g}°), "
        f"pelvis within {SQUAT_SHARE.difference:.0%} of the leg (in part: {SQUAT_SHARE.lost:.0%}), "
        f"hands on their path, none more than {MM * AWAY_M:.0f} mm off for {HAND_AWAY_S.difference:g} s "
        f"(in part: {HAND_AWAY_S.lost:g} s)"
    )


class _Compared:
    """Robot and performer of a run. limbs: angles, degrees, against the recorded body, or else the reconstructed one;
    best: the same at the robot's best, which is known of the reconstructed body alone."""

    def __init__(self, run: RunResult, report: Report) -> None:
        assert run.robot is not None, "a robot follows"
        self.report, self.marks = report, run.robot.profile.landmarks
        lean = {} if report.trunk_lean_deg is None else {LEAN: report.trunk_lean_deg}
        self.limbs: Mapping[str, Spread] = report.likeness_recorded_deg or (report.likeness_deg or {}) | lean
        self.best = {} if report.likeness_recorded_deg else report.best_likeness_deg or {}
        # Where a level asks for hands and not for forearms, these are as like as the hands leave them.
        levels = run.setup.priorities[-1].levels if run.setup.priorities else ()
        of = [{name for task in level.tasks if isinstance(task, LimbTask) for name in task.of} for level in levels]
        self.hands_first = any("l_hand" in names and "l_forearm" not in names for names in of)

    def limit(self, of: "Difference", kept: bool | None) -> float:
        """The limit of a difference that is seen (kept: None), or that makes it another motion (False)."""
        if kept is None:
            return of.limits.difference
        return math.inf if of.arms and self.hands_first else of.limits.lost

    def size(self, landmark: str) -> float:
        """Length, mm, of the robot's limb that ends at a landmark."""
        return MM * self.marks[landmark].robot_length


Figure = tuple[Any, ...]


@dataclass(frozen=True)
class Difference:
    """Something that robot and performer may differ in. figure: first what is compared with the limits, then what else
    the sentence needs; None: not known. arms: of the arms, which hands may come before."""

    sentence: str
    figure: Callable[[_Compared], Figure | None]
    limits: DifferenceLimits
    arms: bool = False


def _limb(limb: str, of: _Compared) -> Figure | None:
    if limb not in of.limbs:
        return None
    at_best = f" ({of.best[limb].mean:.0f}° at best)" if limb in of.best else ""
    return of.limbs[limb].mean, limb.replace("_", " "), at_best


def _leg(of: _Compared) -> Figure | None:
    away = of.report.legs_away_s
    if not away:
        return None
    name = max(away, key=away.__getitem__)
    side, part = name.split("_")
    return away[name], f"{'left' if side == 'l' else 'right'} {part}"


def _hand(of: _Compared) -> Figure | None:
    hands = of.report.reachable_hands_mm
    return None if hands is None else (hands["worse"] / of.size("l_hand"), hands["worse"])


def _squat(of: _Compared) -> Figure | None:
    height = of.report.pelvis_height_mm
    return None if height is None else (height.p95 / of.size("pelvis"), height.p95)


def _path(of: _Compared) -> Figure | None:
    ratio = of.report.hand_path_ratio
    return None if ratio is None else (1.0 - min(ratio, 1.0 / max(ratio, 1e-9)), ratio)


def _travel(of: _Compared) -> Figure | None:
    went, stays = of.report.travelled_m.performer, (of.report.foot_path_ratio or 0.0) < 1.0 - RATIO.difference
    return (went,) if went is not None and stays else None


def _turn(of: _Compared) -> Figure | None:
    turn = of.report.turned_deg
    known = turn.performer is not None and turn.robot is not None
    return (turn.performer - turn.robot, turn.robot, turn.performer) if known else None


DIFFERENCES = (
    Difference("it fell", lambda of: (math.inf,) if of.report.fallen else None, DifferenceLimits(0.0, 0.0)),
    *(Difference("{1} {0:.0f}° off on average{2}", partial(_limb, limb), LIMB_DEG, limb in ARMS) for limb in LIMBS),
    Difference(f"its {{1}} more than {LEG_AWAY_DEG:g}° off for {{0:.1f}} s", _leg, LEG_AWAY_S),
    Difference(
        "its trunk {0:.0f}° off (p95)", lambda of: (of.limbs[LEAN].p95,) if LEAN in of.limbs else None, LEAN_DEG
    ),
    Difference("a hand {1:.0f} mm off on average", _hand, HAND_SHARE),
    Difference(
        f"a hand more than {MM * AWAY_M:.0f} mm off for {{0:.1f}} s",
        lambda of: (max((of.report.hands_away_s or {}).values(), default=0.0),),
        HAND_AWAY_S,
    ),
    Difference("its pelvis {1:.0f} mm too high or low (p95)", _squat, SQUAT_SHARE),
    Difference("hands on {1:.0%} of their path", _path, RATIO),
    Difference("feet that stay (the performer travels {0:.1f} m)", _travel, TRAVEL_M),
    Difference("{1:.0f}° turned of the performer's {2:.0f}°", _turn, TURN_DEG),
)
"""What may differ: a figure, its limits, and the sentence."""
