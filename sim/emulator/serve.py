"""Serve lines on pseudo-terminals until told to stop: asleep whenever nothing is due."""

import math
import select
from collections.abc import Callable, Mapping, Sequence

from hardware.clock import Clock
from sim.emulator.pseudo_terminal import PseudoTerminal

EARLY = 120e-6
"""What is due within so many s is not slept for: a timer is no finer than 50 us, and a pseudo-terminal takes some 70 us
for the way there and back, which no adapter has."""
BATCH = 0.3e-3
"""Answers that come within so many s of each other, and no more than the adapter's latency, are handed over together,
when the last of them is due: an adapter passes packets on, not bytes."""
LONGEST_SLEEP = 3600.0
"""Longest single sleep, s."""


def serve(
    terminals: Sequence[PseudoTerminal],
    clock: Clock,
    *,
    until: Callable[[], bool],
    listen: Mapping[int, Callable[[], bool]] | None = None,
    deadline: float = math.inf,
) -> None:
    """Serve opened terminals until `until()` or the `deadline`, s on the clock.

    listen: further file descriptors and what to call when they have something; one whose call returns False is at its
    end and listened to no more. A signal is noticed when a descriptor becomes readable by it (signal.set_wakeup_fd).
    """
    others = dict(listen or {})
    plugged = _by_fd(terminals)
    while not until():
        now = clock.now()
        if now >= deadline:
            return
        wake, changed = min(deadline, now + LONGEST_SLEEP), False
        for terminal in terminals:
            before = terminal.fd
            wake = min(wake, _attend(terminal, now))
            changed |= terminal.fd != before
        if changed:
            plugged = _by_fd(terminals)
        ready, _, _ = select.select([*plugged, *others], (), (), max(0.0, wake - clock.now()))
        now = clock.now()
        for fd in ready:
            if fd in plugged:
                plugged[fd].hear(now)
            elif not others[fd]():
                del others[fd]


def _by_fd(terminals: Sequence[PseudoTerminal]) -> dict[int, PseudoTerminal]:
    return {terminal.fd: terminal for terminal in terminals if terminal.fd >= 0}


def _attend(terminal: PseudoTerminal, now: float) -> float:
    """Do what is due on a terminal; returns when something will be, s."""
    terminal.follow(now)
    line = terminal.line
    span = min(BATCH, line.timing.latency)
    due = line.last_due_within(span)
    if due is not None and due <= now + EARLY:
        terminal.speak(now + EARLY)
        due = line.last_due_within(span)
    wake = math.inf if due is None else due - EARLY
    change = line.faults.next_change
    return wake if change is None else min(wake, change)
