"""Every limit of the page of a report: kept where the numbers say so, and not where they say otherwise."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.physics_runs import play
from messages import shows
from retarget.cli.operator import RunLines
from retarget.cli.run import show_summary
from retarget.frames import JointTracks, SensorFrames
from retarget.model.observers import robot_observers
from retarget.report.findings import findings, remarks, sentence
from retarget.report.lines import Finding, in_words, lines_of
from retarget.report.measure import measure
from retarget.report.motion_metrics import REACTIVE, HeldBack, held_back, limit_use
from retarget.report.report import BothMoved, Percentiles, Report, Spread
from retarget.robot.walking.travel import WalkTally
from retarget.rotations import from_axis_angle, multiply, rotate
from retarget.run.options import RunOptions
from retarget.run.record import Phase
from retarget.run.run_result import CAPPED, RefusedPair, RunResult
from retarget.schema.priorities import load_priorities
from rig import Rig, person, result, scripted_run, short_clip
from sim.performer import minimum_jerk, synthetic_performer


@pytest.fixture(scope="module")
def run() -> RunResult:
    return scripted_run()


@pytest.fixture(scope="module")
def report(run: RunResult) -> Report:
    found = measure(run)
    clearance = replace(found.min_clearance_mm, self=3.0, scene=7.0, ground=9.0)
    return replace(found, min_clearance_mm=clearance, penetrating_frames=0)


def of(name: str, run: RunResult, report: Report) -> Finding:
    (found,) = [finding for finding in findings(run, report) if finding.name == name]
    return found


def changed(report: Report, **values: Any) -> Report:
    """With other values; those of a dictionary are of a part."""
    parts = {name: getattr(report, name) for name, value in values.items() if isinstance(value, dict)}
    return replace(report, **(values | {name: replace(part, **values[name]) for name, part in parts.items()}))


def inside(where: str, mm: float) -> dict[str, Any]:
    return {"min_clearance_mm": {where: -mm}, "penetrating_frames": 2}


CASES: list[tuple[str, dict[str, Any], str]] = [
    ("joint positions", {"limit_violations": {"position": 3}}, "3 values beyond"),
    ("joint speeds", {"limit_violations": {"velocity": 1}}, "1 value beyond"),
    ("joint accelerations", {"limit_violations": {"acceleration": 2}}, "2 values beyond"),
    ("centre of mass", {"com_outside_support_frames": 4, "com_margin_mm": -2.0}, "4 ticks, by up to 2.0"),
    ("its own links", inside("self", 1.5), "1.5 mm inside each other"),
    ("obstacles", inside("scene", 4.0), "4.0 mm inside each other"),
    ("the floor", inside("ground", 2.0), "2.0 mm inside each other"),
    ("faults", {"bus": {"faults": 2}}, "2 faults"),
    ("ticks missed", {"bus": {"missed_ticks": 5, "longest_period_ms": 30.0}}, "longest took 30.0 ms"),
    ("end", {"stop": {"reason": "a hand in the way"}}, "a hand in the way"),
]


@pytest.mark.parametrize(("limit", "change", "measured"), CASES, ids=[case[0] for case in CASES])
def test_a_limit_that_was_not_kept_is_one_and_all_others_stay(
    limit: str, change: dict[str, Any], measured: str, run: RunResult, report: Report
) -> None:
    report = changed(report, bus={"missed_ticks": 0})
    assert of(limit, run, report).kept
    broken = changed(report, **change)
    assert not of(limit, run, broken).kept and measured in of(limit, run, broken).measured
    before = {finding.name: finding.kept for finding in findings(run, report)}
    after = {finding.name: finding.kept for finding in findings(run, broken)}
    assert {name for name in before if before[name] is not after[name]} == {limit}


def test_what_could_not_be_broken_has_no_verdict(run: RunResult, report: Report) -> None:
    bare = changed(report, min_clearance_mm={"scene": None, "self": None, "ground": None})
    bare = replace(bare, bus=None, com_outside_support_frames=None)
    judged = [finding.name for finding in findings(run, bare) if finding.kept is not None]
    assert judged == ["servos", "joint positions", "joint speeds", "joint accelerations", "end"]


BAD, LEGS, FINE = Spread(60.0, 80.0, 90.0), Spread(33.0, 50.0, 60.0), Spread(5.0, 9.0, 12.0)
ALIKE: dict[str, Any] = {
    "likeness_deg": {"upper_arms": FINE},
    "trunk_lean_deg": Spread(2.0, 4.0, 5.0),
    "hand_path_ratio": 1.0,
    **dict.fromkeys(("likeness_recorded_deg", "legs_away_s", "reachable_hands_mm", "hands_away_s", "pelvis_height_mm")),
}
TURNS = {"travelled_m": BothMoved(3.2, 0.1), "turned_deg": BothMoved(180.0, 20.0), "foot_path_ratio": 0.0}
STAYS = "feet that stay (the performer travels 3.2 m), 20° turned of the performer's 180°"
FAR, BEST = {"forearms": BAD}, {"forearms": Spread(9.0, 9.0, 9.0)}
WELL, ARMS = {"upper_arms": FINE}, {"upper_arms": LEGS, "trunk_lean": FINE}
YES, PART, NO = "follows", "follows in part: ", "does not follow: "
FOLLOWS: list[tuple[dict[str, Any], str, str]] = [
    ({}, YES, ""),
    ({"hand_path_ratio": 0.6}, PART, "hands travel 0.60 times as far as desired"),
    ({"hand_path_ratio": 0.1}, NO, "hands travel 0.10 times as far as desired"),
    ({"fallen": True}, NO, "it fell"),
    ({"trunk_lean_deg": Spread(6.0, 30.0, 68.0)}, PART, "its trunk 30° off (p95)"),
    ({"likeness_deg": FAR, "foot_path_ratio": 0.5}, NO, "forearms 60° off on average"),
    ({"likeness_deg": FAR, "best_likeness_deg": BEST}, NO, "forearms 60° off on average (9° at best)"),
    (TURNS, PART, STAYS),
    ({"reachable_hands_mm": {"worse": 0.3 * 230.0}}, PART, "a hand 69 mm off on average"),
    ({"hands_away_s": {"l_hand": 0.1, "r_hand": 0.2}}, YES, ""),
    ({"hands_away_s": {"l_hand": 0.1, "r_hand": 1.2}}, PART, "a hand more than 150 mm off for 1.2 s"),
    ({"hands_away_s": {"l_hand": 3.2, "r_hand": 0.2}}, NO, "a hand more than 150 mm off for 3.2 s"),
    ({"likeness_deg": {"thighs": LEGS}}, PART, "thighs 33° off on average"),
    ({"likeness_deg": WELL, "likeness_recorded_deg": ARMS}, PART, "upper arms 33° off on average"),
    ({"likeness_deg": {"upper_arms": BAD}, "likeness_recorded_deg": WELL}, YES, ""),
    ({"likeness_recorded_deg": WELL | {"trunk_lean": BAD}}, NO, "its trunk 80° off (p95)"),
    ({"legs_away_s": {"l_thigh": 0.2, "r_shank": 0.1}}, YES, ""),
    ({"legs_away_s": {"l_thigh": 0.2, "r_shank": 0.8}}, PART, "its right shank more than 45° off for 0.8 s"),
    ({"legs_away_s": {"l_thigh": 8.0, "r_thigh": 0.0}}, PART, "its left thigh more than 45° off for 8.0 s"),
    ({"pelvis_height_mm": Spread(2.0, 20.0, 90.0)}, YES, ""),
    ({"pelvis_height_mm": Spread(9.0, 60.0, 90.0)}, PART, "its pelvis 60 mm too high or low (p95)"),
    ({"pelvis_height_mm": Spread(9.0, 95.0, 99.0)}, NO, "its pelvis 95 mm too high or low (p95)"),
]


@pytest.mark.parametrize(("differs", "verdict", "why"), FOLLOWS)
def test_a_sentence_says_whether_it_follows(
    differs: dict[str, Any], verdict: str, why: str, run: RunResult, report: Report
) -> None:
    found = of("following", run, replace(report, **(ALIKE | differs)))
    assert (found.measured, found.kept) == (verdict + why, {YES: True, PART: None, NO: False}[verdict])


def test_what_it_takes_to_follow_is_said_whatever_the_verdict(run: RunResult, report: Report) -> None:
    said = {of("following", run, replace(report, fallen=fallen)).allowed for fallen in (False, True)}
    assert len(said) == 1
    shows(said.pop(), "20° of the recorded performer's (in part: 45°)", "15° (in part: 45°)", "s (in part: 2 s)")
    shows(of("following", run, replace(report, likeness_recorded_deg=None)).allowed, "20°")


KICK_S, LEG = (0.3, 0.7, 1.1, 1.5), ("r_knee", "r_ankle", "r_toe")
"""When the leg begins to rise, is up, begins to sink and is down again, s."""


def kicking(height: float) -> SensorFrames:
    """A performer who stands still and lifts the straight right leg forward by so many rad."""
    frames = synthetic_performer().cut(0.0, 1.8)
    lift = minimum_jerk(frames.time, np.array(KICK_S), height * np.array([0.0, 1.0, 1.0, 0.0]))
    turn = from_axis_angle(np.array([0.0, -1.0, 0.0]), lift)
    assert frames.joints is not None
    joints, names = frames.joints, (frames.names, frames.joints.names)
    position, body = (np.repeat(track[:1], len(lift), axis=0) for track in (frames.position, joints.position))
    orientation = np.repeat(frames.orientation[:1], len(lift), axis=0)
    hip = body[:, joints.names.index("r_hip")]
    for track, known in ((position, names[0]), (body, names[1])):
        for name in LEG:
            column = known.index(name)
            track[:, column] = hip + rotate(turn, track[:, column] - hip)
    for name in ("r_hip", *LEG):
        column = names[0].index(name)
        orientation[:, column] = multiply(turn, orientation[:, column])
    return replace(frames, position=position, orientation=orientation, joints=JointTracks(names[1], body))


@pytest.mark.parametrize(("height", "kept"), [pytest.param(0.0, True, marks=pytest.mark.long), (1.4, None)])
def test_a_robot_that_keeps_both_feet_down_does_not_follow_a_kick(height: float, kept: bool | None) -> None:
    run = play(kicking(height), RunOptions(robot="wolfgang"))
    report = measure(run)
    found = of("following", run, report)
    seen = re.search(r"its right (thigh|shank) more than 45° off for 0\.[7-9] s", found.measured)
    assert found.kept is kept and (seen is not None) is bool(height)
    assert report.legs_away_s is not None and report.likeness_recorded_deg is not None
    assert report.legs_away_s["l_thigh"] == 0.0


def test_likeness_is_given_against_the_recorded_body_too(run: RunResult, report: Report) -> None:
    off = replace(report, likeness_deg={"thighs": FINE}, likeness_recorded_deg={"thighs": LEGS}, trunk_lean_deg=None)
    assert of("likeness", run, off).measured == "thighs 5° off on average; from the recorded body thighs 33°"


def test_arms_that_hands_come_before_differ_in_part(run: RunResult, report: Report) -> None:
    report = replace(
        report, **(ALIKE | {"likeness_recorded_deg": {"upper_arms": BAD}, "likeness_deg": report.likeness_deg})
    )
    priorities = (*run.setup.priorities[:-1], load_priorities("hands_first"))
    manipulates = replace(run, setup=replace(run.setup, priorities=priorities))
    assert (of("following", run, report).kept, of("following", manipulates, report).kept) == (False, None)


def test_the_height_of_the_pelvis_is_shown_where_it_was_to_move(run: RunResult, report: Report) -> None:
    squatted = replace(report, pelvis_height_mm=Spread(9.4, 60.0, 90.0))
    assert of("pelvis height", run, squatted).measured == "9 mm off, 60 at p95, 90 at most"
    still = replace(report, pelvis_height_mm=None)
    assert len(findings(run, still)) == len(findings(run, squatted)) - 1


def test_feet_that_are_to_stay_are_said_to_stay(run: RunResult, report: Report) -> None:
    still = replace(report, foot_path_ratio=0.0)
    assert of("foot path", run, still).measured == "none: the performer's feet move, its own stay planted"
    steps = replace(report, foot_path_ratio=0.4, walk=WalkTally(2, 0.4, 0.5))
    assert of("foot path", run, steps).measured == "40.0% of the performer's"


def test_a_number_says_what_it_is_of(run: RunResult, report: Report) -> None:
    missed = of("highest priority", run, replace(report, priority_violation_max=0.25))
    assert missed.measured == "off by 0.250 mm or mrad at most"


def test_the_joint_that_turned_used_most_of_its_speed(run: RunResult) -> None:
    """One joint turns by 0.02 rad in 50 ticks; no other moves."""
    use, robot = limit_use(run), run.robot
    assert robot is not None and use.velocity is not None and use.acceleration is not None and use.room is not None
    assert use.velocity.joint == robot.joint_map.joints[1] == use.acceleration.joint
    assert use.velocity.value == pytest.approx(0.02 / 50 / run.clip.dt, rel=0.05)
    assert use.velocity.limit == robot.limits.max_velocity[1]
    name, room = use.room
    at = robot.joint_map.joints.index(name)
    q = np.vstack([run.record.start, run.record.q[:, robot.servo_columns]])[:, at]
    assert room == pytest.approx(min((q - robot.limits.lower[at]).min(), (robot.limits.upper[at] - q).min()))


# The summary on the terminal.


@pytest.fixture(scope="module")
def swung() -> tuple[RunResult, Report]:
    """A robot whose left elbow swings faster than servos follow at once."""
    script = np.zeros((51, 20))
    script[:, 5] = 0.15 * (1.0 - np.cos(2.0 * np.pi * np.arange(51) / 50.0))
    rig, human, clip = Rig(script), person(), short_clip()
    run = result(rig.loop(clip).run(), clip, human, rig.robot)
    return run, measure(run)


@pytest.fixture
def shown(capsys: pytest.CaptureFixture[str]) -> Callable[[RunResult, Report], list[str]]:
    """Prints every figure of a run, and returns the lines."""

    def lines(run: RunResult, report: Report) -> list[str]:
        show_summary(run, report, RunLines(verbose=True))
        return [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]

    return lines


Shown = Callable[[RunResult, Report], list[str]]


def line(lines: list[str], start: str) -> str:
    (found,) = [text for text in lines if text.startswith(start)]
    return found


def test_the_servos_stand_beside_what_was_sent(swung: tuple[RunResult, Report], shown: Shown) -> None:
    run, report = swung
    assert report.servo_tracking_mm is not None and report.servo_error_deg is not None
    sent, servos = report.tracking_mm["l_hand"], report.servo_tracking_mm["l_hand"]
    assert servos.max > sent.max + 1.0
    numbers = [f"{value:.1f}" for spread in (sent, servos) for value in (spread.mean, spread.p95, spread.max)]
    lines = shown(run, report)
    assert line(lines, "l_hand") == " ".join(["l_hand", *numbers])
    late = report.servo_error_deg["l_el"]
    assert 0.5 < late.max < 8.6 and late.mean < late.max  # the swing is 17 degrees
    assert report.servo_error_deg["r_el"].max < 0.1
    assert line(lines, "servos").endswith(f"{late.max:.1f} at most (l_el)")


def test_a_good_hand_does_not_hide_a_bad_one(swung: tuple[RunResult, Report]) -> None:
    run, report = swung
    hands = {"l_hand": 2.0, "r_hand": 30.0, "mean": 3.3, "worse": 30.0}
    reported = replace(report, reachable_hands_mm=hands, reachable_share={"l_hand": 0.95, "r_hand": 0.05})
    text = of("hands within reach", run, reported).measured
    shows(text, "left hand 2.0 mm", "95%", "right hand 30.0 mm", "5%")
    assert "3.3" not in text


def test_a_run_that_followed_nobody_has_no_empty_rows(run: RunResult, shown: Shown) -> None:
    braked = replace(run.record, phase=np.full(len(run.record), Phase.BRAKE))
    stopped = replace(run, record=braked)
    nothing = Percentiles(np.nan, np.nan, np.nan)
    reported = replace(measure(stopped), tracking_mm={}, lag_s=None, reconstruct_us=nothing, retarget_us=nothing)
    lines = shown(stopped, reported)
    rows = ("tracking", "hands", "cost per tick", "lag")
    assert [text for text in lines if text.startswith(rows)] == []


def test_on_virtual_time_no_tick_is_missed(run: RunResult, report: Report) -> None:
    timed = changed(report, bus={"missed_ticks": 0, "longest_period_ms": 8.0})
    virtual = replace(run, setup=replace(run.setup, real_time=False))
    names, without = ({finding.name for finding in findings(one, timed)} for one in (run, virtual))
    assert names - without == {"ticks missed"}


def test_ticks_that_the_gate_braked_by_itself_are_shown(swung: tuple[RunResult, Report]) -> None:
    run, report = swung
    led = replace(report, no_command_frames=0)
    assert of("gate", run, led).measured == f"changed 0 of {report.ticks} goals"
    alone = of("gate", run, replace(report, gated_frames=3, no_command_frames=7)).measured
    assert alone == f"changed 3 of {report.ticks} goals; no goal in 7 ticks: joints braked"


PAIR = RefusedPair("MP_BACK_R", "MP_ARM_HIGH_R", 300, obstacle=False)


def test_the_pair_that_the_gate_refused_most_is_named_with_what_to_do(run: RunResult, report: Report) -> None:
    changed = replace(report, gated_frames=335, refused_pair=PAIR)
    shows(of("gate", run, changed).measured, "MP_BACK_R", "MP_ARM_HIGH_R", "300", "ignore_pairs")
    (note,) = [one for one in remarks(run, changed, (), room=6) if "MP_BACK_R" in one]
    shows(note, "335")
    assert not any("MP_BACK_R" in one for one in remarks(run, replace(changed, gated_frames=1), (), room=6)), "no harm"
    assert "MP_BACK_R" not in sentence(run, replace(changed, gated_frames=1))
    most = replace(changed, gated_frames=report.ticks - 1)
    differs = replace(most, hands_away_s={"l_hand": 0.1, "r_hand": 1.2})
    shows(sentence(run, differs), "most goals refused for MP_BACK_R - MP_ARM_HIGH_R")
    wall = replace(changed, refused_pair=replace(PAIR, second="wall", obstacle=True))
    assert "ignore_pairs" not in of("gate", run, wall).measured, "an obstacle is there"
    assert "refused" not in of("gate", run, replace(changed, gated_frames=0)).measured


def test_the_limit_that_holds_a_limb_back_is_named_where_that_limb_differs(run: RunResult, report: Report) -> None:
    blocked = (HeldBack("left arm", "l_sho_pitch", 10.0, 0.82),)
    held = replace(report, **(ALIKE | {"held_back": blocked, "trunk_lean_deg": report.trunk_lean_deg}))
    away = replace(held, hands_away_s={"l_hand": 1.2, "r_hand": 0.1})
    said = "the left arm is held back by l_sho_pitch at its limit of 10° in 82% of ticks"
    assert said in sentence(run, away) and said in of("following", run, away).measured
    assert of("held back", run, held).measured == said and said not in sentence(run, held), "it follows all the same"
    legs = replace(held, likeness_deg={"thighs": BAD})
    assert said not in sentence(run, legs), "arms hinder no leg"


def test_a_joint_at_its_limit_holds_back_where_going_on_would_bring_the_hand_nearer(run: RunResult) -> None:
    """An elbow is at its upper limit in three quarters of the ticks, and the hand is asked beyond it, or not."""
    robot, record = run.robot, run.record
    assert robot is not None and held_back(run) == ()
    rows, elbow = record.following, robot.joint_map.joints.index("l_el")
    column, goals, q, asked = (
        robot.servo_columns[elbow],
        record.goals.copy(),
        record.q.copy(),
        record.landmarks_asked.copy(),
    )
    at = np.arange(rows.start, rows.stop - (rows.stop - rows.start) // 4)
    goals[at, elbow] = q[at, column] = robot.limits.upper[elbow]
    for by, expected in ((0.3, ["l_el"]), (-0.3, [])):
        beyond = q.copy()
        beyond[at, column] += by
        asked[at] = robot.points(beyond[at], robot.landmark_frames(record.landmark_names))
        found = held_back(replace(run, record=replace(record, goals=goals, q=q, landmarks_asked=asked)))
        assert [(one.limb, one.by) for one in found] == [("left arm", name) for name in expected]
        assert all(one.share == pytest.approx(0.75, abs=0.02) for one in found), [one.share for one in found]


def test_an_observer_in_contact_holds_back_its_limb(run: RunResult) -> None:
    assert run.robot is not None
    observers = robot_observers(run.robot)
    modes = np.zeros((len(run.record), len(observers.names)), dtype=np.uint8)
    modes[:, observers.names.index("r_forearm")] = REACTIVE
    (found,) = held_back(replace(run, observers=observers, record=replace(run.record, observer_modes=modes)))
    assert found.words == "the right arm is held back by observer r_forearm in 100% of ticks"


# A table of lines: a figure that is not known leaves the sentence out.


def test_a_sentence_without_its_figure_is_left_out() -> None:
    known = {"a": {"b": 0.5}, "none": None, "empty": "", "pair": (1.0, 2.0)}
    assert in_words("{a.b:.1f} of {pair.1:g}", known) == "0.5 of 2"
    assert in_words("{a.b} and {none}", known) == in_words("{empty}", known) == in_words("{a.c.d}", known) == ""


# The end of a run on a terminal.


def test_a_run_ends_with_one_sentence(run: RunResult, report: Report) -> None:
    hands = {"mean": 26.2, "worse": 27.0}
    alike = ALIKE | {"likeness_deg": None, "trunk_lean_deg": None, "pelvis_height_mm": report.pelvis_height_mm}
    fine = replace(report, **(alike | {"reachable_hands_mm": hands, "com_margin_mm": 43.4}))
    shows(sentence(run, fine), "op3 follows", "26 mm", "43 mm")
    shows(sentence(run, replace(fine, penetrating_frames=1)), "1 tick")
    shows(sentence(run, replace(fine, com_margin_mm=-2.0)), "0 mm")
    half = replace(fine, hand_path_ratio=0.5, likeness_deg={"thighs": LEGS, "shanks": LEGS})
    shows(sentence(run, half), "33°", "1 more")
    reason = "a hand in the way"
    shows(sentence(replace(run, reason=reason), changed(fine, stop={"reason": reason})), "op3 stopped at", reason)


def test_few_lines_come_before_it(run: RunResult, report: Report) -> None:
    assert remarks(run, report, (), room=0) == []
    bad = changed(report, limit_violations={"position": 3}, stop={"reason": "a hand in the way"})
    limit, note = remarks(run, bad, ("a note",), room=1)
    shows(limit, "joint positions", "3 values")
    assert note == "note: a note"
    many = remarks(run, bad, tuple("abcdefghi"), room=6)
    assert len(many) == 7, "and one that counts"
    shows(many[-1], "4", "--verbose")


def test_a_limit_that_was_not_kept_is_shown_where_no_room_is_left(run: RunResult, report: Report) -> None:
    bad = changed(report, limit_violations={"position": 3, "velocity": 2})
    first, second, count = remarks(run, bad, ("a note",), room=0, kept_back=7)
    shows(first, "not kept", "joint positions")
    shows(second, "not kept")
    shows(count, "7 more notices", "1 more note", "--verbose")


def test_a_human_alone_has_a_sentence_of_its_own(run: RunResult, report: Report) -> None:
    alone = replace(run, robot=None)
    shows(sentence(alone, replace(report, robot="human", unsensed_mm={"mean": 31.0})), "the performer", "31 mm")
    assert [*lines_of("sentence", {})] == []


def test_counts_of_the_solver_are_not_among_what_matters(run: RunResult, report: Report) -> None:
    assert remarks(run, report, [f"4 {CAPPED}", "the file has no rate"], room=6)[-1:] == ["note: the file has no rate"]
