"""Ticks that come in time where there is no robot whose side keeps it."""

from collections.abc import Callable

from hardware.clock import Clock

__all__ = ["in_time"]


def in_time(look: Callable[[], bool], dt: float, clock: Clock) -> Callable[[], bool]:
    """`look`, every `dt` s."""
    deadline = clock.now()

    def waited() -> bool:
        nonlocal deadline
        deadline = max(deadline + dt, clock.now())
        clock.sleep_until(deadline)
        return look()

    return waited
