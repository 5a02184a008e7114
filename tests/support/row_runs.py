"""Runs of the fault table's rows. Moving robots of one kind share a warm-up: the process is forked where faults begin.

Up to the onset of its fault a run does not depend on the fault: the first 3 s, most of its cost, are the same to
the bit. So a child runs them once and waits; each row is run to its end, and judged, in a child of that child.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NoReturn

from sim.faults.bench import Bench
from sim.faults.judge import ENGAGING_S, ONSET, OUTLIVED, When, run_row, verdict_of
from sim.faults.reactions import Row
from sim.faults.rows import ROWS
from sim.faults.sender import FakeSender

Claims = Mapping[str, Any]
"""Keys of a row, other than the table has them."""
FORKED_S = ONSET - 0.05
"""Before any fault begins, s of following."""


def row(name: str) -> Row:
    """The row of that name."""
    return next(one for one in ROWS if one.name == name)


def wrongs(name: str, when: When, claims: Sequence[Claims]) -> list[tuple[str, ...]]:
    """Run a row, and return its violations as judged by each of some claims; {}: by the row itself."""
    one = row(name)
    if when is not When.MOVING:
        bench = run_row(one, when=when)
        return _judged(one, bench, when, claims)
    asking = _warm(one.performer, one.mass, one.after)
    asking.send((name, claims))
    found: list[tuple[str, ...]] | str = asking.recv()
    assert isinstance(found, list), found
    return found


def _judged(one: Row, bench: Bench, when: When, claims: Sequence[Claims]) -> list[tuple[str, ...]]:
    return [verdict_of(replace(one, **claim), bench, when=when).wrong for claim in claims]


@cache
def _warm(performer: str, mass: bool, after: float) -> Connection:
    """A connection to a child that waits with a robot that moves; it ends with this process."""
    ours, theirs = Pipe()
    if os.fork() == 0:
        ours.close()
        _serve(theirs, performer, mass, after)
    theirs.close()
    return ours


def _serve(asked: Connection, performer: str, mass: bool, after: float) -> NoReturn:
    """Run until shortly before the onset; then run and judge each row that is asked for in a child. Never returns."""
    chosen: list[tuple[Row, Sequence[Claims]]] = []
    bench = Bench(FakeSender(seed=3), duration=ENGAGING_S + ONSET + after, performer=performer, mass=mass)

    def wait() -> None:
        while True:
            try:
                name, claims = asked.recv()
            except EOFError:  # the tests are over
                os._exit(0)
            child = os.fork()
            if child == 0:
                one = row(name)
                chosen.append((one, claims))
                bench.leaves = one.reaction in OUTLIVED
                one.inject(bench, ONSET)
                return
            os.waitpid(child, 0)

    try:
        bench.at(FORKED_S, wait)
        bench.run()
        ((one, claims),) = chosen
        asked.send(_judged(one, bench, When.MOVING, claims))
    except BaseException as error:  # noqa: BLE001 - it is the test that must fail
        asked.send(f"{type(error).__name__}: {error}")
    finally:
        os._exit(0)
