"""Buses as data."""

import numpy as np
import pytest

from bus_rig import BusRig, spec, specs
from hardware.bus import BusSpec, ServoGoals
from hardware.dynamixel.torque import FIRST_DRIVE, RAMP_TIME
from hardware.errors import BusError
from messages import refuses
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import LineTiming


@pytest.mark.parametrize(("watchdog", "value"), [(0.0, 0), (0.02, 1), (0.2, 10), (2.54, 127)])
def test_the_watchdog_counts_in_steps_of_20_ms(watchdog: float, value: int) -> None:
    assert BusSpec("main", "p", 1000000, 2, (1,), watchdog=watchdog).watchdog_value == value


FULL = 885  # PWM limit as delivered
LINES = ("one", "two", "three")


def test_ports_cost_the_slowest_and_not_the_sum() -> None:
    servos = [spec(number, bus=LINES[number % 3]) for number in range(1, 16)]
    wires = {name: LineTiming(latency=latency) for name, latency in zip(LINES, (0.0005, 0.001, 0.003), strict=True)}

    def cost(names: tuple[str, ...]) -> float:
        rig = BusRig([servo for servo in servos if servo.bus in names], timing=wires).ready()
        for _ in range(3):
            cycle = rig.tick()
            assert cycle.states.valid.all()
        return float(np.median([rig.tick().took for _ in range(9)]))

    alone = [cost((name,)) for name in LINES]
    assert cost(LINES) == pytest.approx(max(alone), abs=5e-5)
    assert sum(alone) > 1.5 * max(alone)


@pytest.mark.parametrize("ticks", [(2048, 4096), (-1, 2048), (2048,)])
def test_goals_that_a_servo_does_not_have_are_not_sent(ticks: tuple[int, ...]) -> None:
    rig = BusRig(specs(2)).ready()
    before = len(rig.port.sent)
    with refuses(BusError):
        rig.bus.write(ServoGoals(np.array(ticks)))
    assert len(rig.port.sent) == before


def test_a_closed_bus_does_nothing() -> None:
    rig = BusRig(specs(2))

    def act() -> None:
        goals = ServoGoals(np.array([2048, 2048]))
        for use in (rig.bus.read, lambda: rig.bus.write(goals), lambda: rig.bus.torque(False)):
            with refuses(BusError):
                use()

    act()
    rig.ready().bus.close()
    rig.bus.close()
    act()
    assert not rig.port.opened


def test_torque_rises_from_a_tenth_within_half_a_second() -> None:
    rig = BusRig(specs(3)).ready()
    rig.tick()
    drives, enabled, send = list[int](), list[list[int]](), rig.port.write

    def write(data: bytes) -> None:
        torque_before = rig.shown("torque_enable")
        send(data)
        drives.append(rig.shown("goal_pwm")[0])
        if rig.shown("torque_enable") != torque_before:
            enabled.append(rig.shown("goal_pwm"))
            assert rig.shown("goal_position") == rig.shafts().tolist()
            assert rig.shown("bus_watchdog") == [5] * 3

    rig.port.write = write  # type: ignore[method-assign]
    begun = rig.clock.now()
    rig.bus.torque(True)
    assert enabled == [[round(FIRST_DRIVE * FULL)] * 3]
    rising = drives[drives.index(88) :]
    steps = np.diff(rising)
    assert (steps[: rising.index(FULL)] >= 0).all() and steps.max() <= 0.05 * FULL
    assert rig.shown("goal_pwm") == [FULL] * 3
    assert RAMP_TIME <= rig.clock.now() - begun <= RAMP_TIME + 0.1
    assert rig.bus.read().driven.all()
    with refuses(BusError):  # an open bus is not opened again
        rig.bus.open()
    rig.bus.close()
    assert rig.shown("torque_enable") == [0, 0, 0]


def test_torque_needs_goals_first_of_an_arm_that_has_not_moved_since_and_no_latched_error() -> None:
    rig = BusRig(specs(3)).ready()

    def refused(*facts: str | int) -> None:
        with refuses(BusError, facts):
            rig.bus.torque(True)
        assert rig.shown("torque_enable") == [0, 0, 0]

    refused()
    rig.tick()
    rig.devices[1].shaft.position += 100
    refused("j2", 2, 2048, "2148")
    assert not rig.bus.read().driven.any()
    rig.devices[1].shaft.position -= 100
    rig.fault(Fault(FaultKind.OVER_TEMPERATURE, ids=(2,)))
    refused("j2", 2, "OVERHEATING")
    rig.bus.close()
    assert rig.shown("torque_enable") == [0, 0, 0]


def test_an_exception_while_torque_rises_leaves_it_to_closing() -> None:
    rig = BusRig(specs(3)).ready()
    rig.tick()
    rig.fault(Fault(FaultKind.UNPLUG, start=0.2, end=0.3))
    with pytest.raises(BusError):
        rig.bus.torque(True)
    assert rig.shown("torque_enable") == [1, 1, 1]
    with refuses(BusError):
        rig.bus.close()


def test_torque_that_others_switched_on_stays() -> None:
    rig = BusRig(specs(3)).ready()
    rig.bus.close()
    rig.put(torque_enable=1)
    rig.bus = rig.another()
    rig.ready()
    rig.tick()
    rig.bus.close()
    assert rig.shown("torque_enable") == [1, 1, 1]


def test_a_host_that_is_silent_finds_its_servos_stopped() -> None:
    rig = BusRig(specs(4)).ready(torque=True)
    rig.tick([2300] * 4)
    rig.clock.advance(0.5)
    stopped = rig.shafts()
    for _ in range(20):
        states = rig.tick([2300] * 4).states
    assert not states.driven.any()
    assert np.abs(rig.shafts() - stopped).max() <= 1
    rig.tick()
    rig.bus.torque(True)
    for _ in range(60):
        states = rig.tick([2300] * 4).states
    assert states.driven.all() and np.abs(states.position - 2300).max() <= 1
