"""Signals ask to stop, a second Ctrl-C insists; none of them raises in the middle of a tick."""

import signal

import pytest

from retarget.cli.interrupt import SIGNALS, stop_on_signals


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_asks_to_stop(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with stop_on_signals() as asked:
        assert not asked()
        signal.raise_signal(number)
        assert asked() and not asked.insisted()
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("first", SIGNALS)
def test_a_second_ctrl_c_insists_and_does_not_raise(first: signal.Signals) -> None:
    with stop_on_signals() as asked:
        signal.raise_signal(first)
        assert asked() and not asked.insisted()
        for _ in range(3):
            signal.raise_signal(signal.SIGINT)
            assert asked() and asked.insisted()


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
