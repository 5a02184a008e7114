"""Runs of faults. Moving robots of one kind share a warm-up: the process is forked where faults begin.

Up to the onset of its fault a run does not depend on the fault: the first 3 s, most of its cost, are the same to
the bit. So a child runs them once and waits; each run goes on to its end, and is judged, in a child of that child.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NoReturn

from retarget.live.performer import LivePerformer
from sim.faults.bench import Bench
from sim.faults.bounds import BOUNDS
from sim.faults.judge import (
    Struck,
    When,
    least,
    run_row,
    verdict_of,
    verdict_of_pair,
)
from sim.faults.rows import ROWS, Row
from sim.faults.sender import FakeSender

Claims = Mapping[str, Any]
"""Keys of a row, other than the table has them."""
Job = Callable[[Bench], Callable[[], Any]]
"""Injects faults into a bench whose robot moves; what it returns is called after the run, for the result."""
Change = Callable[[Bench], object]
FORKED_S = BOUNDS.onset_s - 0.1
"""Before any fault begins, s of following."""


def row(name: str) -> Row:
    """The row of that name."""
    return next(one for one in ROWS if one.name == name)


def wrongs(name: str, when: When, claims: Sequence[Claims]) -> list[tuple[str, ...]]:
    """Run a row, and return its violations as judged by each of some claims; {}: by the row itself.

    Of a moving robot a claim may also name the state `when` in which it is judged.
    """
    one = row(name)
    if when is When.MOVING and not one.recorded:
        return list(forked(partial(_row_job, name, claims), performer=one.performer, mass=one.mass))
    return _judged(one, run_row(one, when=when), when, claims)


def forked(job: Job, *, performer: str = "five", mass: bool = False) -> Any:
    """The result of a job, a function of a module or a partial of one, for a robot that moves."""
    asking = _warm(performer, mass)
    asking.send(job)
    result, error = asking.recv()
    assert not error, error
    return result


def follow_for(bench: Bench, seconds: float) -> None:
    """End following in time, as at the end of a run."""
    assert isinstance(bench.samples, LivePerformer)
    bench.samples.ticks = round((BOUNDS.engaging_s + seconds) * bench.robot.profile.safety.rate_hz)


def pair_wrongs(first: str, second: str, *, gap: float, before: Change | None = None) -> tuple[str, ...]:
    """Run two faults of a moving robot, and return the violations.

    before: changes the bench before the faults; a function of a module, or a partial of one.
    """
    return tuple(forked(partial(_pair_job, first, second, gap, before)))


def always(owner: type, value: object, *names: str) -> Change:
    """These methods answer with a value."""
    return partial(_replaced, owner, value, names)


def _replaced(owner: type, value: object, names: tuple[str, ...], bench: Bench) -> None:
    for name in names:
        setattr(owner, name, lambda *args, **words: value)


def _judged(one: Row, bench: Bench, when: When, claims: Sequence[Claims]) -> list[tuple[str, ...]]:
    return [
        verdict_of(
            replace(one, **{key: value for key, value in claim.items() if key != "when"}), bench, when=state
        ).wrong
        for claim in claims
        for state in (claim.get("when", when),)
    ]


def _row_job(name: str, claims: Sequence[Claims], bench: Bench) -> Callable[[], Any]:
    one = row(name)
    follow_for(bench, BOUNDS.onset_s + one.after)
    bench.leaves = BOUNDS.reactions[one.reaction.name].outlived
    one.inject(bench, BOUNDS.onset_s)
    return lambda: _judged(one, bench, When.MOVING, claims)


def _pair_job(first: str, second: str, gap: float, before: Change | None, bench: Bench) -> Callable[[], Any]:
    onset = BOUNDS.onset_s
    strikes = Struck(row(first), onset), Struck(row(second), onset + gap)
    follow_for(bench, onset + gap + max(BOUNDS.longer_s, *(least(one.row).limit + 0.1 for one in strikes)))
    if before is not None:
        before(bench)
    for one, at in strikes:
        one.inject(bench, at)
    return lambda: verdict_of_pair(bench, bench.trace, *strikes).wrong


@cache
def _warm(performer: str, mass: bool) -> Connection:
    """A connection to a child that waits with a robot that moves; it ends with this process."""
    ours, theirs = Pipe()
    if os.fork() == 0:
        ours.close()
        _serve(theirs, performer, mass)
    theirs.close()
    return ours


def _serve(asked: Connection, performer: str, mass: bool) -> NoReturn:
    """Run until shortly before the onset; then do each job that is asked for in a child. Never returns."""
    done: list[Callable[[], Any]] = []
    longest = max(one.after for one in ROWS)
    bench = Bench(
        FakeSender(seed=3), duration=BOUNDS.engaging_s + BOUNDS.onset_s + longest, performer=performer, mass=mass
    )

    def wait() -> None:
        while True:
            try:
                job = asked.recv()
            except EOFError:  # the tests are over
                os._exit(0)
            child = os.fork()
            if child == 0:
                done.append(job(bench))
                return
            os.waitpid(child, 0)

    try:
        bench.at(FORKED_S, wait)
        bench.run()
        asked.send((done[0](), ""))
    except BaseException as error:  # noqa: BLE001 - it is the test that must fail
        asked.send((None, f"{type(error).__name__}: {error}"))
    finally:
        os._exit(0)
