"""Performers without a stream: a recording whose sensors jump holds the robot, and is followed again slowly."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hardware.clock import VirtualClock
from retarget.frames import SensorFrames
from retarget.human.pose_validation import LIMITS
from retarget.human.samples import Clip, Playback
from retarget.live.performer import TOO_SHORT
from retarget.run.loop import RowObserver
from retarget.run.options import RunOptions
from retarget.run.performers import RecordedPerformer
from retarget.run.prepare import performance_of, prepare
from retarget.schema.performer import load_performer
from retarget.types import RunState
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer

TOGETHER = ("head", "l_wrist", "r_wrist")
AWAY = np.array([[0.5, 0.8, 0.2], [-1.0, 0.5, 0.7], [0.8, -0.8, 0.5]])
FIRST, LAST, END = 1.0, 1.4, 6.0
"""Wrists and head are elsewhere from 1 s to 1.4 s, in a recording of 6 s."""


@cache
def jumping() -> SensorFrames:
    frames = synthetic_performer(rate_hz=120.0)
    position, rows = frames.position.copy(), (frames.time >= FIRST) & (frames.time < LAST)
    position[:, [frames.index(name) for name in TOGETHER]] += np.where(rows[:, None, None], AWAY, 0.0)
    return replace(frames, position=position)


def test_a_sane_recording_is_its_own_performer() -> None:
    perform = performance_of(lambda: synthetic_performer(rate_hz=120.0), Playback(end=END))
    assert isinstance(perform(load_performer("five"), None).samples, Clip)


@pytest.mark.parametrize("speed", [0.5, 1.0])
def test_a_recording_whose_sensors_jump_is_held_as_a_live_performer_is(speed: float) -> None:
    perform = performance_of(jumping, Playback(speed=speed, end=END))
    samples = perform(load_performer("five"), None).samples
    assert isinstance(samples, RecordedPerformer) and samples.may_approach()
    sane = synthetic_performer(rate_hz=120.0)
    held, reasons = list[float](), set[str]()
    five = [sane.index(name) for name in load_performer("five").sensors]
    for tick in range(samples.ticks):
        found, time = samples.sample(tick), tick * samples.motion_dt
        if found is None:
            held.append(time)
            reasons.add(samples.hold_reason)
            continue
        assert found.valid.all()
        own = sane.sample(time).position[five]
        assert found.position == pytest.approx(own, abs=0.1), "what jumped is not followed"
    assert FIRST + 0.1 < held[0] <= FIRST + LIMITS.stale_after + samples.motion_dt
    assert held[-1] == pytest.approx(LAST + speed * LIMITS.healthy, abs=0.02)
    assert reasons == {"head: jumped, l_wrist: jumped, r_wrist: jumped", TOO_SHORT}


def test_a_run_of_such_a_recording_holds_says_why_and_goes_on() -> None:
    options = RunOptions(robot="op3", priorities="servo", playback=Playback(end=END))
    states = list[RunState]()
    with prepare(jumping, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        machine = prepared.machine
        assert machine is not None
        result = prepared.run(observers=[RowObserver(lambda record, row: states.append(machine.supervisor.state))])
        reason = machine.supervisor.hold_reason
    changes = [one for one, before in zip(states[1:], states, strict=False) if one is not before]
    assert changes[:3] == [RunState.FOLLOW, RunState.HOLD, RunState.FOLLOW]
    assert result.reason is None and reason
    assert any(all(name in note for name in TOGETHER) for note in result.notes)
    held = states.count(RunState.HOLD) * prepared.samples.dt
    assert held == pytest.approx(LAST - FIRST - LIMITS.stale_after + LIMITS.healthy, abs=0.05)
