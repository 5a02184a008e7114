"""The wire checker finds every kind of violation that is planted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.dynamixel.codec import protocol2
from hardware.servo import ServoSpec, find_model
from messages import shows
from sim.faults.bench import Bench
from sim.faults.judge import violations
from sim.faults.rows import ROWS
from sim.faults.sender import FakeSender
from sim.faults.wire_checker import (
    Sent,
    Track,
    after_latch,
    beyond_limits,
    detours,
    goal_writes,
    once,
    packets,
    still_moving,
    stood,
    too_fast,
    torque_on_again,
    tracks,
    written,
)

DT = 0.01
SERVO = ServoSpec("knee", 7, find_model("XM430-W350"), "main", -1, 2048, -1.0, 1.0, 4.0, 40.0, gear=2.0)


def goals(angles: list[float], *, dt: float = DT, start: float = 5.0) -> list[Sent]:
    """Goals of the joint, rad, one every dt s."""
    sent = []
    for k, angle in enumerate(angles):
        tick = round(SERVO.zero_tick + SERVO.ticks_per_rad * angle)
        data = protocol2.sync_read(126, 10, [7], fast=True) + protocol2.sync_write(
            116, 4, [(7, tick.to_bytes(4, "little", signed=True))]
        )
        sent.append(Sent(start + k * dt, data))
    return sent


def tracked(sent: list[Sent]) -> list[Track]:
    return tracks(once(goal_writes(written(sent)), within=0.5 * DT), [SERVO])


def gentle(last: float = 0.9) -> list[float]:
    """From rest, within all limits."""
    angles, speed = [0.0], 0.0
    while angles[-1] < last:
        speed = min(speed + 35.0 * DT, 3.5)
        angles.append(angles[-1] + speed * DT)
    return angles


def test_goals_within_limits_are_good_and_goals_sent_twice_are_one() -> None:
    assert beyond_limits(tracked(goals(gentle())), DT) == []
    twice = [again for one in goals(gentle()) for again in (one, Sent(one.time + 1e-4, one.data))]
    assert beyond_limits(tracked(twice), DT) == []
    assert beyond_limits(tracked([*twice, *goals([0.0], start=twice[-1].time + DT)]), DT) != []
    far_apart = goals([0.0, 0.0]) + goals([0.5, 0.5], start=9.0)  # torque was off in between
    assert beyond_limits(tracked(far_apart), DT) == []
    lost = Track(SERVO, np.array([0.0, DT]), np.array([0.0, np.nan]), 0.001)
    assert beyond_limits([lost], DT) == ["knee (id 7): not finite"]


def test_goals_that_still_move_go_fast_or_make_a_detour_are_found() -> None:
    still, fast = tracked(goals([0.1, 0.2, 0.2, 0.2, 0.3])), tracked(goals([0.0, 0.0, 0.03, 0.06, 0.09]))
    assert still_moving(still, 5.005, 5.035) == still_moving(still, 8.0, 9.0) == []
    shows(still_moving(still, 5.005, 5.045)[0], "0.0997")
    assert [stood(still, time) for time in (4.0, 5.015, 5.025, 5.035, 5.045)] == [True, False, True, True, False]
    assert too_fast(fast, 5.0, 5.1, share=1.0, dt=DT) == too_fast(fast, 5.0, 5.015, share=0.5, dt=DT) == []
    shows(too_fast(fast, 5.0, 5.1, share=0.5, dt=DT)[0], "50%")
    assert detours(fast, 5.0, 6.0) == detours(tracked(goals([0.0, 0.1, 0.099, 0.4])), 5.0, 6.0) == []
    shows(detours(tracked(goals([0.0, 0.1, 0.0, 0.3])), 5.0, 6.0)[0], "0.199")


def test_after_a_latch_only_torque_off_is_good() -> None:
    off = written([Sent(2.0, protocol2.sync_write(64, 1, [(7, b"\0")]) + protocol2.sync_write(98, 1, [(7, b"\0")]))])
    assert after_latch(off, 1.0) == []
    assert after_latch(written(goals([0.0])), 5.0) == []
    assert "address 116" in after_latch(written(goals([0.0])), 4.9)[0]
    on = written([Sent(2.0, protocol2.sync_write(64, 1, [(6, b"\0"), (7, b"\1")]))])
    assert after_latch(on, 1.0) == ["address 64 was written 1.000 s after the latch"]
    assert torque_on_again(on, 1.0) == ["torque was switched on 1.000 s after the stop began"]
    assert torque_on_again(on, 2.0) == [] and torque_on_again(off, 1.0) == []


@pytest.mark.long
def test_without_a_gate_the_forced_stage_is_a_collision() -> None:
    row = next(one for one in ROWS if one.name == "clearance below margin")
    bench = Bench(FakeSender(), duration=2.0, gate=False)
    row.inject(bench, 0.2)
    bench.at(1.4, bench.leave)
    found = violations(bench, bench.run())
    shows(found)


@given(st.dictionaries(st.integers(0, 252), st.integers(-(2**31), 2**31 - 1), min_size=1, max_size=30))
@settings(max_examples=60)
def test_goals_are_read_from_the_bytes(ticks: dict[int, int]) -> None:
    """Those that hold a header, and are stuffed, too."""
    data = protocol2.sync_write(
        116, 4, [(device, tick.to_bytes(4, "little", signed=True)) for device, tick in ticks.items()]
    )
    sent = [Sent(1.5, protocol2.sync_read(126, 10, [7], fast=True) + data + protocol2.ping(3))]
    assert goal_writes(written(sent)) == [(1.5, ticks)]
    assert [(one.id, one.instruction) for one in packets(sent)] == [(254, 0x8A), (254, 0x83), (3, 0x01)]


@given(st.binary(max_size=40))
@settings(max_examples=60)
def test_damaged_packets_are_no_packets(data: bytes) -> None:
    list(packets([Sent(0.0, data), Sent(0.0, b"\xff\xff\xfd\x00\x01\xff\xff" + data)]))
