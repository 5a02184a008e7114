"""Every violation of the rules is found: traces of a correct run are changed, each in one way."""

from collections.abc import Callable
from dataclasses import replace
from unittest.mock import patch

import pytest

from hardware.dynamixel.codec import protocol2
from hardware.guard_state import StopCause
from messages import shows
from retarget.live.performer import LivePerformer
from retarget.types import RunState
from row_runs import always, forked, pair_wrongs, row
from sim.faults.bench import Bench, TickEnd, Trace
from sim.faults.bounds import BOUNDS
from sim.faults.cases import judged_seed
from sim.faults.judge import least, outdone, reached, violations
from sim.faults.rows import Reaction
from sim.faults.sender import FakeSender
from sim.faults.wire_checker import HEADER, Sent, goal_writes, torque_off, written


@pytest.fixture(scope="module")
def bench() -> Bench:
    """A run that a person stops while it is fast."""
    one = Bench(FakeSender(), duration=1.6)
    one.at(0.9, lambda: one.guard.latch(StopCause.REQUESTED, "space bar"))
    one.run()
    return one


def goals(ticks: dict[int, int]) -> bytes:
    return protocol2.sync_write(
        116, 4, [(device, value.to_bytes(4, "little", signed=True)) for device, value in ticks.items()]
    )


def last_goals(trace: Trace) -> dict[int, int]:
    return goal_writes(written(trace.sent))[-1][1]


def late_goal(trace: Trace) -> Trace:
    return replace(trace, sent=[*trace.sent, Sent(trace.ended + 0.1, goals(last_goals(trace)))])


def jump(trace: Trace) -> Trace:
    """In the middle of the run."""
    sent = list(trace.sent)
    at = next(k for k, one in enumerate(sent) if one.time > (trace.began or 0.0) + 0.3 and one.data[7] == 0x83)
    ticks = goal_writes(written(sent[: at + 1]))[-1][1]
    sent[at] = Sent(sent[at].time, goals(ticks | {19: ticks[19] + 200}))
    return replace(trace, sent=sent)


def beyond(trace: Trace) -> Trace:
    return replace(trace, sent=[Sent(0.0, goals(last_goals(trace) | {19: 4000})), *trace.sent])


def crossed(trace: Trace) -> Trace:
    """A leg in the other one, long before the run."""
    return replace(trace, sent=[Sent(0.0, goals(last_goals(trace) | {8: 1350})), *trace.sent])


def halfway_to_rest(trace: Trace) -> Trace:
    """It stops half-way to posture `rest`."""
    middle = (trace.latched or 0.0) + 0.5
    return replace(trace, sent=[one for one in trace.sent if one.time < middle or not goal_writes(written([one]))])


def no_torque_off(trace: Trace) -> Trace:
    off = HEADER + b"\xfe"
    kept = [one for one in trace.sent if not (one.data.startswith(off) and one.data[7:10] == b"\x83\x40\x00")]
    return replace(trace, sent=kept)


def slow_torque_off(trace: Trace) -> Trace:
    off = torque_off(written(trace.sent), trace.latched or 0.0)
    assert off is not None
    return replace(trace, sent=[Sent(one.time + 4.0, one.data) if one.time >= off else one for one in trace.sent])


def torque_again(trace: Trace) -> Trace:
    on = protocol2.sync_write(64, 1, [(6, b"\x01")])
    return replace(trace, sent=[*trace.sent, Sent((trace.latched or 0.0) + 0.2, on)])


def in_state(state: RunState, trace: Trace, since: float) -> Trace:
    return replace(trace, ticks=[replace(one, state=state) if one.time > since else one for one in trace.ticks])


def goes_on(trace: Trace) -> Trace:
    return in_state(RunState.FOLLOW, trace, (trace.latched or 0.0) + 0.5)


def holds_while_it_moves(trace: Trace) -> Trace:
    ticks = in_state(RunState.HOLD, trace, (trace.began or 0.0) + 0.2).ticks
    return replace(trace, ticks=[*ticks, TickEnd(ticks[-1].time + 0.01, RunState.FOLLOW, True, 1.0)])


def hurries(trace: Trace) -> Trace:
    """On the way to rest, four times as far in the same time."""
    begun, sent = (trace.latched or 0.0) + 0.4, []
    start = next(goal for time, goal in goal_writes(written(trace.sent)) if time >= begun)
    for one in trace.sent:
        own = goal_writes(written([one])) if one.time >= begun else []
        more = {device: start[device] + 4 * (tick - start[device]) for _, goal in own for device, tick in goal.items()}
        sent.append(Sent(one.time, goals(more)) if more else one)
    return replace(trace, sent=sent)


def wanders(trace: Trace) -> Trace:
    """The robot goes to rest through its stance, and not straight."""
    there, rest = RunState.RETURN_TO_STANCE, RunState.GO_TO_REST
    return replace(trace, ticks=[replace(one, state=rest if one.state is there else one.state) for one in trace.ticks])


def keeps_torque(trace: Trace) -> Trace:
    return replace(trace, torque=[*trace.torque[:-1], 1])


def test_a_correct_run_has_no_violation(bench: Bench) -> None:
    assert bench.trace.stop is not None and bench.trace.latched is not None
    assert violations(bench, bench.trace) == []
    # A tick that fails at once ends when the one before did, and is no tick after the stop.
    at = next(row for row, tick in enumerate(bench.trace.ticks) if tick.latched)
    held = TickEnd(bench.trace.ticks[at].time, RunState.HOLD, False, 1.0)
    sound = replace(bench.trace, ticks=[*bench.trace.ticks[:at], held, *bench.trace.ticks[at:]])
    assert not any("after a stop" in text for text in violations(bench, sound))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (late_goal, "address 116 was written"),
        (jump, "too fast"),
        (jump, "too hard"),
        (beyond, "beyond its limits"),
        (crossed, "mm in each other"),
        (halfway_to_rest, "is not at rest"),
        (no_torque_off, "torque off was never commanded"),
        (slow_torque_off, "torque went off"),
        (torque_again, "torque was switched on"),
        (goes_on, "follow after a stop"),
        (holds_while_it_moves, "still moves"),
        (wanders, "goes back and forth"),
        (hurries, "faster than 55% of its speed"),
        (keeps_torque, "torque is on in the end"),
    ],
)
def test_every_violation_is_found(bench: Bench, change: Callable[[Trace], Trace], expected: str) -> None:
    found = violations(bench, change(bench.trace))
    assert any(expected in line for line in found), found


def _endless(bench: Bench) -> Callable[[], object]:
    patch("sim.faults.bench.BOUNDS", BOUNDS.model_copy(update={"endless_s": -10.0})).start()
    return lambda: (bench.trace.endless, violations(bench, bench.trace))


@pytest.mark.long
def test_a_run_that_does_not_end_is_ended_and_found() -> None:
    endless, wrong = forked(_endless)
    assert endless
    shows(wrong)


def faster(trace: Trace, since: float, until: float) -> Trace:
    """As if goals of a time had come in a third of it, and stood then: every third is sent, and the last ones again."""
    slow = [one for one in trace.sent if since <= one.time < until and one.data[7:10] == b"\x83\x74\x00"]
    ahead = dict(zip(slow, slow[::3] + [slow[-1]] * len(slow), strict=False))
    return replace(trace, sent=[replace(one, data=ahead.get(one, one).data) for one in trace.sent])


def _hurried(bench: Bench) -> Callable[[], object]:
    """Goals that are too fast on the approach, and after a hold, of a performer whose stream was silent meanwhile."""
    row("stream silent for a while").inject(bench, BOUNDS.onset_s)

    def judged() -> tuple[list[str], list[str]]:
        trace = bench.trace
        assert trace.armed is not None and trace.approach_ended is not None and violations(bench, trace) == []
        middle = 0.5 * (trace.armed + trace.approach_ended)
        again = [last for first, last in trace.holds if last - first > 0.3][-1]
        changed = faster(trace, middle, trace.approach_ended), faster(trace, again, again + 0.7)
        return violations(bench, changed[0]), violations(bench, changed[1])

    bench.at(BOUNDS.onset_s + 1.9, bench.leave)
    return judged


@pytest.mark.long
def test_goals_that_are_too_fast_on_the_approach_and_when_following_resumes_are_found() -> None:
    approach, again = forked(_hurried)
    assert approach
    shows(approach)
    assert any("after a hold" in line for line in again)


# Two faults in one run: a missing reaction is found; the stronger of two is required, and by when.

BLIND_SEED = 11
"""A random run whose harsh fault is one of the stream."""
BLIND = always(LivePerformer, True, "_is_good")
"""Sensor validity that accepts everything."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("stream silent", "wrist frozen", "stream silent: not held in time"),
        ("left and right swapped", "deadline missed", "left and right swapped: not held in time"),
    ],
)
def test_a_missing_reaction_to_two_faults_is_found(first: str, second: str, expected: str) -> None:
    assert expected in pair_wrongs(first, second, gap=0.05, before=BLIND)


@pytest.mark.long
def test_a_random_run_without_a_reaction_is_found() -> None:
    with patch.object(LivePerformer, "_is_good", lambda self, state, now: True):
        shows(judged_seed(BLIND_SEED, seconds=1.0).wrong)


@pytest.mark.long
@pytest.mark.parametrize("gap", [0.0, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("names", [("wrist lost", "left and right swapped"), ("left and right swapped", "wrist lost")])
def test_a_wrist_that_is_lost_and_sides_that_change_places_are_a_swap(names: tuple[str, str], gap: float) -> None:
    """The sensor that is sent is where the other was: the robot must not follow it."""
    assert pair_wrongs(*names, gap=gap) == ()


@pytest.mark.parametrize(
    ("first", "second", "reaction", "limit"),
    [
        ("stream silent", "servo unplugged", Reaction.STOP, 0.1),
        ("servo unplugged", "stream silent", Reaction.STOP, 0.1),
        ("adapter unplugged", "servo unplugged", Reaction.TORQUE_OFF, 0.05),
        ("kill -9", "adapter unplugged", Reaction.GONE, 0.12),
        ("wrist lost", "servo warm", Reaction.SLOW, 1.1),
        ("wrist lost", "second source", Reaction.OUT, 0.3),
        ("stream silent", "ankle lost", Reaction.HOLD, 0.3),
        ("stream silent for ever", "wrist lost", Reaction.HOLD, 0.15),
        ("deadline missed", "30 % of answers damaged", Reaction.STOP, 0.44),
        ("deadline missed", "stream silent for a while", Reaction.HOLD, 0.33),
        ("30 % of packets damaged", "stream silent", Reaction.STOP, 0.2),
        ("servo warm", "servo too hot", Reaction.STOP, 1.1),
        ("servo too hot", "servo warm", Reaction.SLOW, 1.1),
        ("wrist lost", "left and right swapped", Reaction.HOLD, 0.1),
        ("left and right swapped", "wrist lost", Reaction.HOLD, 0.1),
        ("servo unplugged", "stopped for a second", Reaction.STOP, 2.04),
    ],
)
def test_the_stronger_reaction_of_two_is_required(first: str, second: str, reaction: Reaction, limit: float) -> None:
    need = outdone(row(first), row(second), gap=0.05)
    assert need.reaction is reaction and need.limit == pytest.approx(limit)


def seen(*states: tuple[float, RunState, bool]) -> Trace:
    """Ticks: time (s), state, whether a stop is latched."""
    return Trace(ticks=[TickEnd(time, state, latched, 1.0) for time, state, latched in states], torque=[1, 1])


MOVING, HOLDING, STOPPING = RunState.FOLLOW, RunState.HOLD, RunState.STOPPING


@pytest.mark.parametrize(
    ("name", "trace", "came"),
    [
        ("stream silent", seen((1.0, MOVING, False), (1.1, MOVING, False)), False),
        ("stream silent", seen((1.0, MOVING, False), (1.1, HOLDING, False)), True),
        ("stream silent", seen((0.5, HOLDING, False), (1.1, MOVING, False)), False),
        ("stream silent", seen((1.3, HOLDING, False)), False),
        ("stream silent", seen((1.1, STOPPING, True)), True),
        ("stream silent", seen((1.1, STOPPING, False)), False),
        ("servo unplugged", seen((1.1, HOLDING, False)), False),
        ("servo unplugged", seen((1.1, STOPPING, True)), True),
        ("adapter unplugged", seen((1.1, STOPPING, True)), False),
        ("adapter unplugged", seen((1.1, RunState.OFF, True)), True),
        ("kill -9", seen((1.0, MOVING, False)), False),
        ("sender's clock jumps forward", seen((1.0, MOVING, False)), False),
        ("servo warm", seen((1.0, MOVING, False)), False),
        ("wrist lost", seen((1.0, MOVING, False)), False),
        ("second source", seen((1.0, MOVING, False)), True),
    ],
)
def test_a_reaction_is_as_strong_as_needed_and_in_time(name: str, trace: Trace, came: bool) -> None:
    assert reached(trace, least(row(name)), 1.0, 1.2) is came
