"""What a person reads after a run: followed how well, by what was sent and by the servos."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from retarget.report.measure import measure
from retarget.report.report import Report
from retarget.report.summary import show_summary
from rig import Rig, person, result, short_clip


@pytest.fixture(scope="module")
def report() -> Report:
    """A robot whose left elbow swings faster than servos follow at once."""
    script = np.zeros((51, 20))
    script[:, 5] = 0.15 * (1.0 - np.cos(2.0 * np.pi * np.arange(51) / 50.0))
    rig, human, clip = Rig(script), person(), short_clip()
    ending = rig.loop(clip).run()
    return measure(result(ending, clip, human, rig.robot))


def shown(report: Report) -> list[str]:
    text = io.StringIO()
    show_summary(report, Console(file=text, width=120))
    return [" ".join(line.split()) for line in text.getvalue().splitlines()]


def line(lines: list[str], start: str) -> str:
    (found,) = [text for text in lines if text.startswith(start)]
    return found


def test_the_servos_stand_beside_what_was_sent(report: Report) -> None:
    assert report.servo_tracking_mm is not None and report.servo_error_deg is not None
    sent, servos = report.tracking_mm["l_hand"], report.servo_tracking_mm["l_hand"]
    assert servos.max > sent.max + 1.0
    numbers = [f"{value:.1f}" for spread in (sent, servos) for value in (spread.mean, spread.p95, spread.max)]
    lines = shown(report)
    assert line(lines, "l_hand") == " ".join(["l_hand", *numbers])
    late = report.servo_error_deg["l_el"]
    assert 0.5 < late.max < 8.6 and late.mean < late.max  # the swing is 17 degrees
    assert report.servo_error_deg["r_el"].max < 0.1
    assert line(lines, "servos").endswith(f"{late.max:.1f} at most (l_el)")


def test_hands_within_reach_are_shown_one_by_one(report: Report) -> None:
    reported = replace(
        report, reachable_hands_mm={"l_hand": 4.66, "mean": 4.66}, reachable_share={"l_hand": 0.715, "r_hand": 0.0}
    )
    assert line(shown(reported), "hands within reach").endswith("l_hand 4.7 mm off in 72% of ticks, r_hand never")


def test_a_good_hand_does_not_hide_a_bad_one(report: Report) -> None:
    hands = {"l_hand": 2.0, "r_hand": 30.0, "mean": 3.3, "worse": 30.0}
    reported = replace(report, reachable_hands_mm=hands, reachable_share={"l_hand": 0.95, "r_hand": 0.05})
    text = line(shown(reported), "hands within reach")
    assert text.endswith("l_hand 2.0 mm off in 95% of ticks, r_hand 30.0 mm off in 5% of ticks") and "3.3" not in text


def test_without_servos_nothing_is_said_of_them(report: Report) -> None:
    bare = replace(report, servo_tracking_mm=None, servo_error_deg=None, reachable_share=None)
    lines = shown(bare)
    assert len(line(lines, "l_hand").split()) == 4
    assert not [text for text in lines if text.startswith(("servos", "hands within"))]


def test_ticks_that_the_gate_braked_by_itself_are_shown(report: Report) -> None:
    led = replace(report, no_command_frames=0)
    assert line(shown(led), "gate") == f"gate changed 0 of {report.ticks} goals"
    alone = line(shown(replace(report, gated_frames=3, no_command_frames=7)), "gate")
    assert alone == f"gate changed 3 of {report.ticks} goals; no goal in 7 ticks: joints braked"
