"""Torque comes on only where everything is known: late answers, forgotten turns, foreign settings, 1.0 servos."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bus_rig import CYCLE, BusRig, Tapped, bus_of, spec, specs
from hardware.bus import ServoGoals
from hardware.dynamixel import powering, torque
from hardware.dynamixel.bus_line import BusLine
from hardware.errors import BusError
from hardware.guard import Guard
from hardware.guard_state import GuardState
from hardware.joint_map import JointMap
from hardware.servo import ServoGains, ServoMode
from retarget.gate import Gate
from sim.emulator.faults import Direction, Fault, FaultKind
from sim.emulator.wire import Timing
from support.messages import refuses, shows

TURN = 4096
FAR = 2048 + round(4.5 / math.tau * TURN)
"""Tick of a joint at 4.5 rad, on the second turn of its servo."""


def of_many_turns() -> BusRig:
    """A plain servo and one of many turns that stands on its second."""
    servos = [spec(1), replace(spec(2), mode=ServoMode.EXTENDED_POSITION, lower=3.5, upper=6.0)]
    return BusRig(servos, start=[2048, FAR])


def guard_of(rig: BusRig) -> Guard:
    joint_map = JointMap(rig.servos)
    return Guard(bus=rig.bus, joint_map=joint_map, goal_filter=Gate.for_servos(joint_map, dt=CYCLE), clock=rig.clock)


@pytest.mark.parametrize("late", [0.001, 0.0015, 0.003, 0.006, 0.012])
@pytest.mark.parametrize("lasts", [0.001, 0.003, 0.008])
def test_a_late_answer_to_another_question_confirms_no_goal(
    late: float, lasts: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    servos = [replace(one, lower=-0.5, upper=0.5) for one in specs(2)]
    rig = BusRig(servos, timing=Timing())
    for one in rig.devices:
        one.memory.put("min_position_limit", 1500)
        one.memory.put("max_position_limit", 2600)
        one.tune()
    second = rig.device(2)
    second.shaft.position = 2700.0  # beyond its limit: it refuses to hold its place
    second.memory.put("goal_position", 1600)
    second.tune()
    rig.bus.open()
    check = torque.check_still

    def hiccup(line: BusLine, goals: dict[int, int]) -> None:
        rig.fault(Fault(FaultKind.LATE, value=late, end=lasts, direction=Direction.TO_HOST))
        check(line, goals)

    monkeypatch.setattr(torque, "check_still", hiccup)
    rig.bus.write(ServoGoals(rig.bus.read().position))
    with pytest.raises(BusError):
        rig.bus.torque(True)
    assert rig.shown("torque_enable") == [0, 0]
    assert rig.shafts().tolist() == [2048, 2700]


def test_an_adapter_that_has_become_slow_confirms_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = BusRig(specs(2), timing=Timing()).ready()
    monkeypatch.setattr(Tapped, "latency", 1e-3)  # what it says of itself
    rig.line.timing = replace(rig.line.timing, latency=5e-3)
    (line,) = rig.bus.lines
    for name in ("present_position", "goal_position", "homing_offset"):
        assert line.read_all(line.images[1].table[name], [1, 2]) == {}
    for name in ("present_position", "goal_position", "homing_offset"):  # more patient, one by one
        register = line.images[1].table[name]
        assert line.client.read(1, register) == rig.device(1).memory.value(name)


@pytest.mark.parametrize("silent", [1, 2])
def test_turns_are_counted_whoever_misses_the_first_cycle(silent: int) -> None:
    rig = of_many_turns()
    two = rig.device(2)
    two.place(FAR)
    two.reboot(0.0)
    rig.clock.advance(1.0)
    begin = rig.bus._begin

    def deaf() -> None:
        rig.fault(Fault(FaultKind.MISSING, ids=(silent,), end=0.004))
        begin()

    rig.bus._begin = deaf  # type: ignore[method-assign]
    rig.bus.open()
    rig.clock.advance(0.2)
    states = rig.tick().states
    assert states.position.tolist() == [2048, FAR]
    assert guard_of(rig).arm() == pytest.approx([0.0, 4.5], abs=0.002)


def test_nobody_is_armed_whose_turns_are_not_known() -> None:
    rig = of_many_turns()
    begin = rig.bus._begin

    def deaf() -> None:
        rig.fault(Fault(FaultKind.MISSING, ids=(1,)))
        begin()

    rig.bus._begin = deaf  # type: ignore[method-assign]
    rig.bus.open()
    rig.bus.write(ServoGoals(rig.bus.read().position))
    with refuses(BusError, "j1", 1):
        rig.bus.torque(True)
    assert rig.shown("torque_enable") == [0, 0]


def test_a_servo_that_started_anew_is_counted_anew_before_it_is_armed_again() -> None:
    rig = of_many_turns()
    rig.bus.open()
    guard = guard_of(rig)
    held = guard.arm()

    def tick(count: int) -> None:
        for _ in range(count):
            if guard.active:
                begun = rig.clock.now()
                guard.tick(lambda _: held)
                rig.clock.sleep_until(begun + CYCLE)

    tick(5)
    rig.device(2).reboot(rig.clock.now())
    tick(100)
    assert guard.state is GuardState.STOPPED
    rig.clock.advance(1.0)
    guard.acknowledge()
    for _ in range(20):
        rig.clock.advance(0.05)
        rig.bus.read()
    with refuses(BusError, "j2", 2):
        guard.arm()
    guard.acknowledge()
    assert guard.arm() == pytest.approx([0.0, 4.5], abs=0.003)
    tick(5)
    assert rig.shafts()[1] == pytest.approx(FAR, abs=2) or rig.shafts()[1] % TURN == pytest.approx(FAR % TURN, abs=2)


@pytest.mark.parametrize(("protocol", "model"), [(2, "XM430-W350"), (1, "MX-28")])
def test_a_robot_that_somebody_left_half_powered_is_brought_to_its_profile(
    protocol: int, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    servos = [replace(one, gains=ServoGains(position_p=50)) for one in specs(2, model)]
    rig = BusRig(servos, buses=[bus_of(servos, protocol=protocol)])
    rig.ready()
    rig.tick()
    seen = 0

    class Killed(BaseException):
        """The process is no more."""

    def kill(*_: object) -> None:
        nonlocal seen
        seen += 1
        if seen == 6:
            raise Killed

    monkeypatch.setattr(rig.bus, "_watch_rise", kill)
    monkeypatch.setattr(rig.bus, "_torque_off", lambda: None)
    with pytest.raises(Killed):
        rig.bus.torque(True)
    drive, gain = ("goal_pwm", "position_p_gain") if protocol == 2 else ("torque_limit", "p_gain")
    full = rig.shown("pwm_limit" if protocol == 2 else "max_torque")
    assert rig.shown(drive) < full and rig.shown("torque_enable") == [1, 1]
    for one in rig.devices:
        one.memory.put(gain, 5)
        one.tune()
    rig.port.close()
    rig.clock.advance(0.05)
    rig.bus = rig.another()
    rig.ready(torque=True)
    assert rig.shown(drive) == full
    assert rig.shown(gain) == [50, 50]
    shows(rig.notes, "j1", 1, gain, 5, 50)


def test_a_servo_that_lets_go_while_torque_rises_ends_it() -> None:
    rig = BusRig(specs(3)).ready()
    rig.tick()
    watch: Callable[[], None] = rig.bus._watch_rise
    steps = 0

    def overheat() -> None:
        nonlocal steps
        steps += 1
        if steps == 5:
            rig.fault(Fault(FaultKind.OVER_TEMPERATURE, value=95.0, ids=(2,)))
        watch()

    rig.bus._watch_rise = overheat  # type: ignore[method-assign]
    with refuses(BusError, "j2", 2):
        rig.bus.torque(True)
    assert steps < round(powering.RAMP_TIME / powering.RAMP_STEP)
    assert rig.shown("torque_enable") == [0, 0, 0]


def test_limp_servos_of_protocol_1_get_no_goal_and_rise_from_a_tenth() -> None:
    servos = [replace(one, lower=-1.0, upper=1.0) for one in specs(2, "AX-12A")]
    rig = BusRig(servos, buses=[bus_of(servos, protocol=1, baud=1_000_000)], start=[512, 600])
    for one in rig.devices:
        one.memory.put("goal_position", 300)
        one.memory.put("moving_speed", 100)
        one.tune()
    rig.bus.open()
    assert rig.shown("torque_enable") == [0, 0]
    rig.bus.write(ServoGoals(rig.bus.read().position))
    assert rig.shown("torque_enable") == [0, 0] and rig.shown("goal_position") == [300, 300]
    limits: list[list[int]] = []
    send = rig.port.write

    def write(data: bytes) -> None:
        before = rig.shown("torque_enable")
        send(data)
        if rig.shown("torque_enable") != before:
            limits.append(rig.shown("torque_limit"))

    rig.port.write = write  # type: ignore[method-assign]
    rig.bus.torque(True)
    assert limits[0] == [102, 102]
    assert rig.shown("torque_limit") == [1023, 1023] and rig.shown("moving_speed") == [0, 0]
    assert rig.shafts().tolist() == [512, 600]
    rig.bus.torque(False)
    rig.bus.write(ServoGoals(np.array([512, 600])))
    assert rig.shown("torque_enable") == [0, 0]


def test_a_servo_of_protocol_1_that_started_anew_stays_limp() -> None:
    servos = [replace(one, lower=-1.0, upper=1.0) for one in specs(3, "AX-12A")]
    rig = BusRig(servos, buses=[bus_of(servos, protocol=1, baud=1_000_000)]).ready(torque=True)
    for _ in range(5):
        rig.tick(np.full(3, 512))
    rig.device1(2).reboot(rig.clock.now())
    for _ in range(80):
        states = rig.tick(np.full(3, 512)).states
    assert states.valid.all()
    assert rig.shown("torque_enable") == [1, 0, 1] and states.driven.tolist() == [True, False, True]


def test_an_open_bus_is_not_opened_again() -> None:
    rig = BusRig(specs(2)).ready(torque=True)
    with refuses(BusError):
        rig.bus.open()
    rig.bus.close()
    assert rig.shown("torque_enable") == [0, 0]
