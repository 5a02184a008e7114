"""How a live run begins: options out of range are refused before a port is opened; the help names every performer."""

import re
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.clock import VirtualClock
from live_rig import WHERE, five, live_stream
from messages import Facts, refuses
from retarget.cli.application import command_of
from retarget.cli.run import run
from retarget.errors import InputError, UsageError
from retarget.live.admission import SECOND_SOURCE
from retarget.live.begin import FRONT_M, RAISED, REFUSALS, RISE_M, SURE_S, LiveOptions, SideCheck, begin_live
from retarget.schema.catalogue import Kind, entries
from retarget.types import FloatArray
from sim.faults.sender import FakeSender, SenderFault, lost, silent


@pytest.mark.parametrize("countdown", [-5.0, -1e-9, 600.1, float("inf"), float("nan"), float("-inf")])
def test_a_countdown_out_of_range_is_refused(countdown: float) -> None:
    with refuses(UsageError, "--countdown", allowed=(0, 600)):
        LiveOptions(countdown=countdown)


def test_the_help_names_every_performer_that_is_shipped(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    help_text = signature(command_of(run)).parameters["performer"].annotation.__metadata__[0].help
    shipped = {entry.name for entry in entries(Kind.PERFORMER)}
    assert len(shipped) >= 9 and shipped <= set(re.findall(r"\w+", help_text))


BEGINS_S = 3.0
"""By then a performer who stands still from 0.5 s on has been measured."""


def raising(name: str, by: float, *, forward: float = 0.45, begins: float = BEGINS_S) -> SenderFault:
    """One wrist goes up and forward by so much within a second."""

    def fault(time: float, poses: dict[str, FloatArray]) -> dict[str, FloatArray]:
        share = float(np.clip(time - begins, 0.0, 1.0))
        return poses | {name: poses[name] + np.array([forward, 0.1, by]) * share}

    return fault


def reflected(axis: int) -> SenderFault:
    """One axis of the sender's world has the wrong sign."""
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda time, poses: {name: point * signs for name, point in poses.items()}


def standing() -> FakeSender:
    """A performer who stands still and does nothing else."""
    frames = FakeSender().frames
    return FakeSender(frames=frames.resample(np.linspace(0.0, 0.01, 4)))


def begun(*faults: SenderFault, within: float = 1.5) -> list[str]:
    said: list[str] = []
    sender, clock = standing(), VirtualClock()
    sender.faults = list(faults)
    stream = live_stream(sender, five())
    options = LiveOptions(countdown=0.5, check_sides=True)
    begin_live(stream, options, clock=clock, rate_hz=100.0, where=WHERE, notify=said.append)
    assert clock.now() < BEGINS_S + within
    return said


def test_a_raised_left_arm_passes() -> None:
    said = begun(raising("l_wrist", 0.5))
    assert said[-2:] == [
        "Raise your left arm forward, to the front, and only that: 10 s",
        "left is left, up is up, and the front is in front: lower the arm",
    ]


@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirrored_world_is_refused(axis: int) -> None:
    with refuses(InputError):
        begun(raising("l_wrist", 0.5), reflected(axis))


@pytest.mark.parametrize("axis", [None, 0, 1])
def test_an_arm_to_the_side_is_asked_again_and_never_enough(axis: int | None) -> None:
    faults = [raising("l_wrist", 0.5, forward=0.0)] + ([] if axis is None else [reflected(axis)])
    with refuses(InputError, "wrist", 50):
        begun(*faults)


def test_a_wrist_that_is_lost_meanwhile_is_named_and_the_check_not_left_out() -> None:
    with refuses(InputError, found="l_wrist") as refusal:
        begun(lost("l_wrist", BEGINS_S, 1e9))
    assert "--no-check-sides" not in str(refusal.value)


def test_a_stream_that_falls_silent_meanwhile_is_reported_at_once_and_is_the_reason() -> None:
    said: list[str] = []
    sender, clock = standing(), VirtualClock()
    sender.faults = [silent(BEGINS_S, 1e9)]
    with refuses(InputError) as refusal:
        begin_live(
            live_stream(sender, five()),
            LiveOptions(countdown=0.5, check_sides=True),
            clock=clock,
            rate_hz=100.0,
            where=WHERE,
            notify=said.append,
        )
    assert said[-1].startswith("nothing has arrived for 1.0 s") and "--no-check-sides" not in str(refusal.value)


def test_an_arm_that_comes_to_the_front_when_it_is_asked_again_passes() -> None:
    later = raising("l_wrist", 0.0, forward=0.45, begins=BEGINS_S + 2.0)
    said = begun(raising("l_wrist", 0.5, forward=0.0), later, within=4.0)
    assert [text.split(",")[0] for text in said[-3:]] == ["Raise your left arm forward", "To the front", "left is left"]


def test_turning_around_with_the_arm_proves_nothing() -> None:
    with refuses(InputError):
        begun(raising("l_wrist", 0.5), raising("r_wrist", 0.0, forward=0.3))


@pytest.mark.parametrize(
    ("name", "by", "facts"),
    [
        ("r_wrist", 0.5, ()),
        ("l_wrist", -0.5, ()),
        ("r_wrist", -0.5, ()),
        (
            "l_wrist",
            0.2,
            (20, 45),
        ),
    ],
)
def test_any_other_motion_is_refused_by_name(name: str, by: float, facts: Facts) -> None:
    with refuses(InputError, facts):
        begun(raising(name, by))


def test_a_measured_performer_keeps_the_stream_though_silent() -> None:
    """No other sender can raise the arm with its size when the owner is silent for 6 s after the calibration."""
    sender = standing()
    sender.faults = [silent(BEGINS_S, 60.0)]
    other = standing()
    other.source, other.faults = ("127.0.0.1", 40001), [raising("l_wrist", 0.5, begins=BEGINS_S + 6.0)]
    sender.others = [lambda since, until: other.poll(until)]
    stream = live_stream(sender, five())
    options = LiveOptions(countdown=0.5, check_sides=True)
    with refuses(InputError):
        begin_live(stream, options, clock=VirtualClock(), rate_hz=100.0, where=WHERE, notify=lambda text: None)
    assert stream.admission.owner == sender.source and stream.admission.refused.reasons[SECOND_SOURCE] > 900


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), max_size=30),
    st.floats(0.5, 1.5),
    st.booleans(),
)
def test_only_a_left_wrist_that_stays_up_in_front_passes(
    moves: list[tuple[float, float, float]], rest: float, forgotten: bool
) -> None:
    hung = np.array([[0.0, 0.2, rest], [0.0, -0.2, rest]])
    check, shown = SideCheck(hung), 0.0
    for tick, (forward, up, right_up) in enumerate(moves):
        left = [np.nan] * 3 if forgotten else [forward, 0.0, up]
        check.take(0.05 * tick, hung + np.array([left, [0.0, 0.0, right_up]]))
        shown = shown + 0.05 if up > RISE_M and forward > FRONT_M and not forgotten else 0.0
        if check.seen == RAISED:
            assert shown >= SURE_S
            return
        if check.seen in REFUSALS:
            return
