"""Real processes, a pseudo-terminal, real datagrams: killed, stopped, asked to end, unplugged."""

import signal
from pathlib import Path

import numpy as np
import pytest

from hardware.guard import Torque
from live_processes import CLOCK, MOVING, POSITION, TORQUE, VELOCITY, WATCHDOG, Live, goal_speeds, live_run
from retarget.cli.exit import REASONS, STOPPED, SUSPENDED
from retarget.cli.operator import TORQUE_WORDS

pytestmark = pytest.mark.long

WATCHED_S = 0.12
TRIPPED = 0xFF
BRAKES_S = 0.02
REST_S = 0.35
ENDS_S = 4.5
"""As docs/stops.md promises."""


def stopped_within(live: Live, since: float) -> float:
    """When the last watchdog stopped its servo, s after a time; all twenty must have."""
    later = [time - since for time in live.tripped() if time >= since]
    assert len(later) == 20, f"{len(later)} watchdogs stopped their servos"
    return max(later)


def test_killed_the_servos_stop_by_themselves(tmp_path: Path) -> None:
    with live_run(tmp_path) as live:
        live.raise_arms()
        killed = CLOCK.now()
        live.run.kill()
        live.run.wait(5.0)
        CLOCK.sleep_until(killed + 0.2)
        assert live.registers(WATCHDOG) == [TRIPPED] * 20
        assert stopped_within(live, killed) <= WATCHED_S
        _, speeds = goal_speeds(live.sent())
        assert np.abs(speeds[-1]).max() > 2.0  # it was moving
        stands = live.registers(POSITION)
        assert live.registers(VELOCITY) == [0] * 20
        CLOCK.sleep_until(killed + 0.5)
        assert live.registers(POSITION) == stands and live.registers(TORQUE) == [1] * 20


def test_frozen_for_a_second_it_stops_when_it_is_back(tmp_path: Path) -> None:
    with live_run(tmp_path) as live:
        live.raise_arms()
        frozen = CLOCK.now()
        live.run.send_signal(signal.SIGSTOP)
        CLOCK.sleep_until(frozen + 1.0)
        live.run.send_signal(signal.SIGCONT)
        code, said = live.ended(10.0)
        assert code == STOPPED, said
        assert stopped_within(live, frozen) <= WATCHED_S
        assert live.registers(TORQUE) == [0] * 20


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGTSTP])
def test_asked_to_end_it_brakes_goes_to_rest_and_torque_is_off(tmp_path: Path, number: signal.Signals) -> None:
    with live_run(tmp_path) as live:
        live.raise_arms()
        asked = CLOCK.now()
        live.run.send_signal(number)
        code, said = live.ended(ENDS_S)
        took = CLOCK.now() - asked
        assert took <= ENDS_S
        times, speeds = goal_speeds(live.sent())
        before = np.flatnonzero(times <= asked)
        fastest = int(np.abs(speeds[before[-5:]]).sum(axis=0).argmax())
        speed = np.abs(speeds[:, fastest])
        assert speed[before[-1]] > MOVING
        after = times >= asked
        braking = np.concatenate([speed[before[-1:]], speed[after & (times < asked + REST_S)]])
        began, rests = int(braking.argmax()), int(braking.argmin())
        # A goal may be on its way when the signal comes; the next one brakes.
        assert times[after][began] - asked <= BRAKES_S, braking.tolist()
        assert (np.diff(braking[began : rests + 1]) <= 1.0).all() and braking[rests] <= 1.0, braking.tolist()
        assert code == STOPPED and {**REASONS, **SUSPENDED}[number] in said, said
        assert live.tripped() == [] and live.registers(TORQUE) == [0] * 20


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_asked_to_end_it_does_not_wait_for_a_terminal_that_takes_nothing(
    tmp_path: Path, number: signal.Signals
) -> None:
    with live_run(tmp_path) as live:
        live.raise_arms()
        live.stick()
        asked = CLOCK.now()
        live.run.send_signal(number)
        assert live.run.wait(2.0 * ENDS_S) == STOPPED
        assert CLOCK.now() - asked <= ENDS_S
        assert live.tripped() == [] and live.registers(TORQUE) == [0] * 20


def test_unplugged_it_is_latched_and_the_servos_stop_by_themselves(tmp_path: Path) -> None:
    with live_run(tmp_path) as live:
        live.raise_arms()
        pulled = CLOCK.now()
        live.type("unplug")
        code, said = live.ended(5.0)
        assert code == STOPPED, said
        assert TORQUE_WORDS[Torque.UNCONFIRMED] in said, said
        live.type("clear")
        CLOCK.sleep_until(CLOCK.now() + 0.2)
        assert live.registers(WATCHDOG) == [TRIPPED] * 20
        assert stopped_within(live, pulled) <= WATCHED_S
