"""What a live run tells of its stream afterwards is what happened."""

import json
from dataclasses import replace

import numpy as np

from live_rig import LiveRig
from retarget.cli.stream_line import stream_line
from retarget.live.account import Holds, LiveReport, Tally
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.live.trust_state import TrustState
from retarget.metrics.measure import measure
from sim.faults.sender import FakeSender, lost, silent

FRESH, STALE, NOT_WORN = TrustState.FRESH, TrustState.STALE, TrustState.NOT_WORN


def test_ticks_are_counted() -> None:
    tally = Tally(("head", "l_wrist", "pelvis"), 0.01)
    for ticks, followed, wrist in ((1, False, FRESH), (2, True, STALE), (2, False, FRESH), (1, True, FRESH)):
        for _ in range(ticks):
            tally.count(np.array([FRESH, wrist, NOT_WORN], dtype=np.uint8), followed=followed)
    assert tally.holds == Holds(1, 0.02)
    assert tally.lost_s == {"l_wrist": 0.02}


def test_a_run_tells_of_its_stream() -> None:
    sender = FakeSender(faults=[silent(5.0, 5.8), lost("l_wrist", 6.5, 7.0)])
    rig = LiveRig(sender, options=LiveOptions(countdown=0.5, duration=5.0))
    with rig.prepared() as prepared:
        result, performer = prepared.run(), prepared.samples
    assert isinstance(performer, LivePerformer)
    rig.stream.decoder.dropped.note("not JSON")
    rig.stream.clock_map.dropped.note("late")
    rig.stream.playout.dropped.note("older than what is kept")
    live = performer.report(address="json://:7000", person="anna")
    assert live.dropped["late"] == live.dropped["older than what is kept"] == 1
    assert live.holds.count >= 1 and 0.5 < live.holds.s < 2.5
    assert set(live.lost_s) >= {"l_wrist"} and 0.0 < live.playout_delay_ms < 200.0
    assert live.frames == rig.stream.frames > 100 and live.dropped["not JSON"] == 1 and not live.refused
    report = measure(replace(result, live=live))
    told = json.loads(report.as_json())
    assert told["source"] == told["live"]["address"] == "json://:7000" and told["live"]["person"] == "anna"
    assert told["live"]["holds"]["count"] == live.holds.count and measure(result).live is None


def test_the_summary_has_a_line_of_it() -> None:
    assert stream_line(None) == ""
    good = LiveReport("vmc://:1", 300, 310, {}, (), {}, Holds(0, 0.0), 35.4, None)
    assert stream_line(good) == "300 frames in 310 datagrams, played 35 ms late"
    bad = replace(
        good, dropped={"late": 3}, refused=("10.0.0.2: a second source",), lost_s={"head": 1.0}, holds=Holds(2, 3.0)
    )
    assert stream_line(bad).split("; ")[1:] == [
        "not used: 3 late",
        "lost: head 1.0 s",
        "held 2 times, 3.0 s",
        "not listened to: 10.0.0.2: a second source",
    ]
