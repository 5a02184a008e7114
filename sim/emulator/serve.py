"""Serve lines on pseudo-terminals until told to stop: asleep whenever nothing is due."""

import select
from collections.abc import Callable, Mapping, Sequence

from hardware.clock import Clock
from sim.emulator.pseudo_terminal import PseudoTerminal

EARLY = 50e-6
"""What is due within so many s is not slept for: a timer is no finer."""
BATCH = 0.5e-3
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
    deadline: float = float("inf"),
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
        changed = False
        for terminal in terminals:
            before = terminal.fd
            terminal.follow(now)
            changed |= terminal.fd != before
            due = _due(terminal)
            if due is not None and due <= now + EARLY:
                terminal.speak(now + EARLY)
        if changed:
            plugged = _by_fd(terminals)
        ready, _, _ = select.select([*plugged, *others], (), (), _sleep(terminals, clock.now(), deadline))
        now = clock.now()
        for fd in ready:
            if fd in plugged:
                plugged[fd].hear(now)
            elif not others[fd]():
                del others[fd]


def _by_fd(terminals: Sequence[PseudoTerminal]) -> dict[int, PseudoTerminal]:
    return {terminal.fd: terminal for terminal in terminals if terminal.fd >= 0}


def _due(terminal: PseudoTerminal) -> float | None:
    """When to hand over what is on its way, s."""
    line = terminal.line
    return line.last_due_within(min(BATCH, line.timing.latency))


def _sleep(terminals: Sequence[PseudoTerminal], now: float, deadline: float) -> float:
    """How long nothing is due, s."""
    wake = min(deadline, now + LONGEST_SLEEP)
    for terminal in terminals:
        due, change = _due(terminal), terminal.line.faults.next_change
        if due is not None and due - EARLY < wake:
            wake = due - EARLY
        if change is not None and change < wake:
            wake = change
    return max(0.0, wake - now)
