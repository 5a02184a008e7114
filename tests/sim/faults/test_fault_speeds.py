"""Speeds of the goals on the wire where they must be slow: on the approach, and when following resumes."""

from dataclasses import replace

import numpy as np
import pytest

from messages import shows
from retarget.types import FloatArray
from sim.faults.bench import Bench, Trace
from sim.faults.reactions import violations
from sim.faults.sender import FakeSender, SenderFault, pausing

REACH_M, HEIGHT_M = 0.75, 1.42


def t_pose() -> SenderFault:
    """Arms straight out to the sides, all the time."""

    def fault(time: float, poses: dict[str, FloatArray]) -> dict[str, FloatArray]:
        ahead = poses["head"][0]
        out = {"l_wrist": (ahead, REACH_M, HEIGHT_M), "r_wrist": (ahead, -REACH_M, HEIGHT_M)}
        return poses | {name: np.array(at) + (poses[name] - poses[name].round(2)) for name, at in out.items()}

    return fault


@pytest.fixture(scope="module")
def paused() -> Bench:
    """A performer whose stream is silent for a second and who moves on meanwhile."""
    bench = Bench(FakeSender(), duration=3.9)
    bench.leaves = True
    bench.at(0.8, lambda: bench.sender.faults.append(pausing(1.0)))
    bench.run()
    return bench


def test_arms_straight_out_are_approached_slowly() -> None:
    bench = Bench(FakeSender(faults=[t_pose()]), duration=0.7)
    bench.leaves = True
    trace = bench.run()
    assert trace.began is not None and trace.armed is not None and trace.approach_ended is not None
    assert trace.approach_ended - trace.armed > 1.0
    assert violations(bench, trace) == []


def test_following_resumes_slowly_at_first(paused: Bench) -> None:
    assert len([last for first, last in paused.trace.holds if last - first > 0.3]) >= 2
    assert violations(paused, paused.trace) == []


def faster(trace: Trace, since: float, until: float) -> Trace:
    """As if goals of a time had come in a third of it, and stood then: every third is sent, and the last ones again."""
    sent, held = [], None
    goals = [one for one in trace.sent if since <= one.time < until and one.data[7:10] == b"\x83\x74\x00"]
    ahead = dict(zip((one.time for one in goals), goals[::3] + [goals[-1]] * len(goals), strict=False))
    for one in trace.sent:
        held = ahead.get(one.time) if one in goals else None
        sent.append(one if held is None else replace(one, data=held.data))
    return replace(trace, sent=sent)


def test_goals_that_are_too_fast_are_found(paused: Bench) -> None:
    trace = paused.trace
    assert trace.armed is not None and trace.approach_ended is not None
    middle = 0.5 * (trace.armed + trace.approach_ended)
    shows(violations(paused, faster(trace, middle, trace.approach_ended)))
    again = [last for first, last in trace.holds if last - first > 0.3][-1]
    assert any("after a hold" in line for line in violations(paused, faster(trace, again, again + 0.7)))
