"""Raise your left arm: seen, or refused with what rose instead."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.clock import VirtualClock
from live_rig import WHERE, five, live_stream
from retarget.errors import InputError
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.side_check import RISE_M, SURE_S, SideCheck
from retarget.rotations import FloatArray
from sim.faults.sender import FakeSender, SenderFault, moved

BEGINS_S = 3.0
"""By then whoever stands still from 0.5 s on has been measured."""


def raising(name: str, by: float, *, begins: float = BEGINS_S) -> SenderFault:
    """One wrist goes up by so much within a second."""

    def fault(time: float, poses: dict[str, FloatArray]) -> dict[str, FloatArray]:
        share = float(np.clip(time - begins, 0.0, 1.0))
        return poses | {name: poses[name] + np.array([0.0, 0.1, by]) * share}

    return fault


def standing() -> FakeSender:
    """Somebody who stands still and does nothing else."""
    frames = FakeSender().frames
    return FakeSender(frames=frames.resample(np.linspace(0.0, 0.01, 4)))


def begun(*faults: SenderFault) -> list[str]:
    said: list[str] = []
    sender, clock = standing(), VirtualClock()
    sender.faults = list(faults)
    stream = live_stream(sender, five())
    options = LiveOptions(countdown=0.5, check_sides=True)
    begin_live(stream, options, clock=clock, rate_hz=100.0, where=WHERE, tell=said.append)
    assert clock.now() < BEGINS_S + 1.5
    return said


def test_whoever_raises_the_left_arm_passes() -> None:
    said = begun(raising("l_wrist", 0.5))
    assert said[-2:] == ["Raise your left arm, and only that: 10 s", "left is left, and up is up: lower the arm"]


@pytest.mark.parametrize(
    ("name", "by", "message"),
    [
        ("r_wrist", 0.5, "the right wrist rose: left and right are exchanged.* Swap the roles"),
        ("l_wrist", -0.5, "the left wrist went down: up is down"),
        ("r_wrist", -0.5, "the right wrist went down"),
        ("l_wrist", 0.2, r"not seen to rise; found the left wrist rose by 20 cm, the right wrist rose by \d cm"),
    ],
)
def test_whatever_else_moves_is_refused_by_name(name: str, by: float, message: str) -> None:
    with pytest.raises(InputError, match=f"{WHERE}, raise your left arm: .*{message}|{message}"):
        begun(raising(name, by))


def test_both_arms_prove_nothing() -> None:
    with pytest.raises(InputError, match="not seen to rise"):
        begun(raising("l_wrist", 0.5), raising("r_wrist", 0.5))


def test_a_wrist_that_leaps_proves_nothing() -> None:
    with pytest.raises(InputError, match="not seen to rise"):
        begun(moved("l_wrist", BEGINS_S, BEGINS_S + 0.1, (0.0, 0.0, 0.5)))


@settings(max_examples=60)
@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), max_size=30), st.floats(0.5, 1.5), st.booleans())
def test_only_a_left_wrist_that_stays_up_passes(rises: list[tuple[float, float]], rest: float, forgotten: bool) -> None:
    check = SideCheck(np.array([rest, rest]))
    up = 0.0
    for tick, rise in enumerate(rises):
        heights = rest + np.array([np.nan if forgotten else rise[0], rise[1]])
        check.take(0.05 * tick, heights)
        up = up + 0.05 if rise[0] > RISE_M and not forgotten else 0.0
        if check.passed:
            assert up >= SURE_S and check.refused is None
            return
        if check.refused:
            return
