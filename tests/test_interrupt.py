"""Signals ask to stop, a second Ctrl-C insists; none of them raises in the middle of a tick."""

import signal
import threading

import pytest

from hardware.clock import VirtualClock
from retarget.cli.interrupt import REASONS, SIGNALS, all_as_ctrl_c, stop_on_signals
from support.messages import shows


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_asks_to_stop(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with stop_on_signals() as asked:
        assert not asked()
        signal.raise_signal(number)
        assert asked() and not asked.insisted()
        assert asked.why() == REASONS[number.name] and number.name in asked.why().replace("Ctrl-C", "SIGINT")
        signal.raise_signal(signal.SIGINT)
        assert asked.why() == REASONS[number.name], "the first one stays"
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("first", [number for number in SIGNALS if number != signal.SIGINT])
def test_ctrl_c_after_another_signal_insists_and_does_not_raise(first: signal.Signals) -> None:
    with stop_on_signals() as asked:
        signal.raise_signal(first)
        assert asked() and not asked.insisted()
        for _ in range(3):
            signal.raise_signal(signal.SIGINT)
            assert asked() and asked.insisted()


def test_ctrl_c_that_is_held_asks_and_pressed_again_it_insists() -> None:
    clock = VirtualClock()
    with stop_on_signals(clock) as asked:
        for _ in range(60):  # as a keyboard repeats it
            signal.raise_signal(signal.SIGINT)
            clock.advance(0.03)
            assert asked() and not asked.insisted()
        clock.advance(0.3)
        signal.raise_signal(signal.SIGINT)
        assert asked.insisted()


def test_ctrl_z_suspends_no_robot_that_moves() -> None:
    """It would stand there with torque, and nobody would look after it."""
    before = signal.getsignal(signal.SIGTSTP)
    with stop_on_signals():
        assert signal.getsignal(signal.SIGTSTP) is before, "where nothing moves, it suspends"
    with stop_on_signals(moves=True) as asked:
        signal.raise_signal(signal.SIGTSTP)
        assert asked() and not asked.insisted()
        shows(asked.why())
    assert signal.getsignal(signal.SIGTSTP) is before


def test_a_service_that_is_told_twice_still_brakes() -> None:
    with stop_on_signals() as asked:
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGTERM):
            signal.raise_signal(number)
        assert asked() and not asked.insisted()


def test_what_is_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_on_signals() as asked:
            signal.raise_signal(signal.SIGHUP)
            assert not asked()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", SIGNALS)
def test_outside_of_a_motion_each_of_them_is_as_ctrl_c(number: signal.Signals) -> None:
    before = {each: signal.getsignal(each) for each in SIGNALS}
    with pytest.raises(KeyboardInterrupt), all_as_ctrl_c():
        with stop_on_signals() as asked:
            signal.raise_signal(number)
            assert asked()
        signal.raise_signal(number)
    assert {each: signal.getsignal(each) for each in SIGNALS} == before


@pytest.mark.parametrize("handler", [signal.SIG_IGN, lambda number, frame: None])
def test_what_somebody_else_handles_or_ignores_is_left_to_them(handler: signal.Handlers) -> None:
    before = signal.signal(signal.SIGTERM, handler)
    try:
        with all_as_ctrl_c():
            signal.raise_signal(signal.SIGTERM)
        assert signal.getsignal(signal.SIGTERM) is handler
    finally:
        signal.signal(signal.SIGTERM, before)


def test_another_thread_sets_no_handlers() -> None:
    seen: list[object] = []

    def command() -> None:
        with all_as_ctrl_c():
            seen.append(signal.getsignal(signal.SIGTERM))

    before = signal.getsignal(signal.SIGTERM)
    thread = threading.Thread(target=command)
    thread.start()
    thread.join()
    assert seen == [before]
