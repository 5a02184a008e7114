"""Torque of a whole bus: everything is confirmed, and what was lost once is sent again."""

from collections.abc import Collection
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from bus_rig import FAR, TURN, BusRig, GuardedBus, bus_of, of_many_turns, spec, specs
from hardware.bus import ServoGoals
from hardware.dynamixel import torque
from hardware.dynamixel.codec import Instruction
from hardware.dynamixel.control_table import tables
from hardware.dynamixel.cyclic import BusLine
from hardware.dynamixel.torque import RESTART_TIMEOUT, BusDrive, restart
from hardware.errors import BusError
from hardware.servo import Layout, ServoGains, ServoMode
from messages import refuses, shows
from planted import failing
from sim.emulator.faults import Direction, Fault, FaultKind
from sim.emulator.line import LineTiming


def test_who_carries_the_robot_never_gets_less() -> None:
    rig = BusRig(specs(2)).ready(torque=True)
    rig.put(2, goal_pwm=300)
    (line,) = rig.bus.lines
    rig.bus.torque(True)  # reads all servos again, and raises the second one's drive from where it was
    assert rig.shown("goal_pwm") == [885, 885]
    rig.put(2, goal_pwm=300)
    line.images[2] = type(line.images[2])(line.images[2].table, bytes(rig.device(2).memory.image))
    drive = BusDrive(line, limp=())
    drive.confirm(0.1)
    assert rig.shown("goal_pwm") == [885, 300]
    assert drive.limited


@pytest.mark.parametrize("late", [0.001, 0.0015, 0.003, 0.006, 0.012])
@pytest.mark.parametrize("lasts", [0.001, 0.003, 0.008])
def test_a_late_answer_to_another_question_confirms_no_goal(
    late: float, lasts: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    servos = [replace(one, lower=-0.5, upper=0.5) for one in specs(2)]
    rig = BusRig(servos, timing=LineTiming())
    rig.put(min_position_limit=1500, max_position_limit=2600)
    rig.device(2).shaft.position = 2700.0  # beyond its limit: it refuses to hold its place
    rig.put(2, goal_position=1600)
    rig.bus.open()
    check = torque.check_still

    def hiccup(line: BusLine, goals: dict[int, int]) -> None:
        rig.fault(Fault(FaultKind.LATE, value=late, end=lasts, direction=Direction.TO_HOST))
        check(line, goals)

    monkeypatch.setattr("hardware.dynamixel.bus.check_still", hiccup)
    rig.bus.write(ServoGoals(rig.bus.read().position))
    with pytest.raises(BusError):
        rig.bus.torque(True)
    assert rig.shown("torque_enable") == [0, 0]
    assert rig.shafts().tolist() == [2048, 2700]


def struck(rig: BusRig, fault: Fault) -> BusRig:
    """A fault begins with the first cycle of the bus, behind all that opening asks."""
    begin = rig.bus._begin

    def first_cycle() -> None:
        rig.fault(fault)
        begin()

    rig.bus._begin = first_cycle  # type: ignore[method-assign]
    return rig


@pytest.mark.parametrize("silent", [1, 2])
def test_turns_are_counted_whichever_servo_misses_the_first_cycle(silent: int) -> None:
    rig = of_many_turns()
    rig.device(2).place(FAR)
    rig.device(2).reboot(0.0)
    rig.clock.advance(1.0)
    struck(rig, Fault(FaultKind.MISSING, ids=(silent,), end=0.004)).bus.open()
    rig.clock.advance(0.2)
    states = rig.tick().states
    assert states.position.tolist() == [2048, FAR]
    assert GuardedBus(rig).arm() == pytest.approx([0.0, 4.5], abs=0.002)


def test_torque_stays_off_where_turns_are_not_known() -> None:
    rig = struck(of_many_turns(), Fault(FaultKind.MISSING, ids=(1,))).ready()
    rig.bus.write(ServoGoals(rig.bus.read().position))
    with refuses(BusError, "j1", 1):
        rig.bus.torque(True)
    assert rig.shown("torque_enable") == [0, 0]


def test_a_servo_that_started_anew_is_counted_anew_before_it_is_armed_again() -> None:
    rig = of_many_turns()
    rig.bus.open()
    guarded = GuardedBus(rig)
    guarded.arm()
    guarded.run(5)
    rig.device(2).reboot(rig.clock.now())
    guarded.run(100)
    assert guarded.guard.stop is not None
    rig.clock.advance(1.0)
    for _ in range(20):
        rig.clock.advance(0.05)
        rig.bus.read()
    with refuses(BusError, "j2", 2):
        GuardedBus(rig).arm()
    guarded = GuardedBus(rig)
    assert guarded.arm() == pytest.approx([0.0, 4.5], abs=0.003)
    guarded.run(5)
    assert rig.shafts()[1] == pytest.approx(FAR, abs=2) or rig.shafts()[1] % TURN == pytest.approx(FAR % TURN, abs=2)


@pytest.mark.parametrize(
    ("protocol", "model", "drive"),
    [(2, "XM430-W350", "goal_pwm"), (2, "XM430-W350", "goal_current"), (1, "MX-28", "torque_limit")],
)
def test_a_robot_that_falls_gives_way(protocol: int, model: str, drive: str) -> None:
    """Also a servo that carried the robot; and torque that comes on again is whole."""
    servos = specs(2, model)
    if drive == "goal_current":
        servos = [replace(one, mode=ServoMode.CURRENT_BASED_POSITION, current_limit=2.0) for one in servos]
    rig = BusRig(servos, protocol=protocol).ready(torque=True)
    full, other = rig.shown(drive)
    rig.bus.torque(True)  # finds them with torque: they carry the robot
    for _ in range(2):
        assert rig.shown(drive) == [full] * 2 and full == other
        rig.bus.limit_drive(0.3)
        rig.tick()
        assert rig.shown(drive) == [round(0.3 * full)] * 2
        assert rig.shown("torque_enable") == [1, 1]
        rig.bus.torque(False)
        rig.bus.torque(True)
    assert rig.shown(drive) == [full] * 2


@pytest.mark.parametrize(("protocol", "model"), [(2, "XM430-W350"), (1, "MX-28")])
def test_a_robot_left_half_powered_is_brought_to_its_profile(
    protocol: int, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    gains = ServoGains(position_p=50)
    rig = BusRig([replace(one, gains=gains) for one in specs(2, model)], protocol=protocol).ready()
    rig.tick()
    monkeypatch.setattr(rig.bus, "_watch_rise", failing(lambda: None, SystemExit(), [6]))
    monkeypatch.setattr(rig.bus, "_torque_off", lambda: None)
    with pytest.raises(SystemExit):
        rig.bus.torque(True)
    drive, gain = ("goal_pwm", "position_p_gain") if protocol == 2 else ("torque_limit", "p_gain")
    full = rig.shown("pwm_limit" if protocol == 2 else "max_torque")
    assert rig.shown(drive) < full and rig.shown("torque_enable") == [1, 1]
    rig.put(**{gain: 5})
    rig.port.close()
    rig.clock.advance(0.05)
    rig.bus = rig.another()
    rig.ready(torque=True)
    assert rig.shown(drive) == full and rig.shown(gain) == [50, 50]
    shows(rig.notes, "j1", 1, gain, 5, 50)


def test_a_servo_that_lets_go_while_torque_rises_ends_it() -> None:
    rig = BusRig(specs(3)).ready()
    rig.tick()
    begun = rig.clock.now()
    rig.fault(Fault(FaultKind.OVER_TEMPERATURE, value=95.0, ids=(2,), start=0.2))
    with refuses(BusError, "j2", 2):
        rig.bus.torque(True)
    assert rig.clock.now() - begun < torque.RAMP_TIME
    assert rig.shown("torque_enable") == [0, 0, 0]


def test_limp_servos_of_protocol_1_get_no_goal_and_rise_from_a_tenth() -> None:
    servos = [replace(one, lower=-1.0, upper=1.0) for one in specs(2, "AX-12A")]
    rig = BusRig(servos, protocol=1, start=[512, 600])
    rig.put(goal_position=300, moving_speed=100)
    rig.bus.open()
    assert rig.shown("torque_enable") == [0, 0]
    rig.bus.write(ServoGoals(rig.bus.read().position))
    assert rig.shown("torque_enable") == [0, 0] and rig.shown("goal_position") == [300, 300]
    limits, send = list[list[int]](), rig.port.write

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


GAINS = {"position_p": 400, "position_i": 10, "position_d": 20, "feedforward_1": 5, "feedforward_2": 6}


def test_what_differs_is_written_once_and_kept() -> None:
    """Three servos with gains, one of many turns and one that limits its current, as they are delivered."""
    servos = [replace(one, gains=ServoGains(**GAINS)) for one in specs(3)]
    servos[1] = replace(servos[1], mode=ServoMode.EXTENDED_POSITION)
    servos[2] = replace(servos[2], mode=ServoMode.CURRENT_BASED_POSITION, current_limit=1.0)
    rig = BusRig(servos)
    rig.put(operating_mode=3)
    rig.ready()

    def writes(device: int) -> list[int]:
        """Addresses that were written to one servo, in order."""
        frames = [packet for packet in rig.port.sent if packet[4] == device and packet[7] == Instruction.WRITE]
        return [packet[8] | packet[9] << 8 for packet in frames]

    assert rig.shown("operating_mode") == [3, 4, 5]
    gains = [
        f"{name}_gain" for name in ("position_p", "position_i", "position_d", "feedforward_1st", "feedforward_2nd")
    ]
    still = ("return_delay_time", "profile_velocity", "profile_acceleration", "torque_enable")
    for name, value in (*zip(gains, GAINS.values(), strict=True), *((name, 0) for name in still)):
        assert rig.shown(name) == [value] * 3
    table = rig.device(1).table
    for device in (1, 2, 3):
        written = writes(device)
        assert len(written) == len(set(written))
        assert written.count(table["operating_mode"].address) == (device > 1)
        # A change of mode resets the gains: they come after everything in EEPROM.
        first_gain = min(written.index(table[name].address) for name in ("position_p_gain", "feedforward_1st_gain"))
        assert all(address >= table.eeprom_end for address in written[first_gain:])
    shows(rig.notes, "j2", 2, "return_delay_time", 250, 0, "operating_mode", 3, 4)
    rig.bus.close()
    rig.port.sent.clear()
    rig.notes.clear()
    rig.bus = rig.another()
    rig.ready()
    assert [writes(device) for device in (1, 2, 3)] == [[], [], []] and rig.notes == []


def test_a_value_that_is_not_kept_is_named_and_the_ports_are_closed() -> None:
    rig = BusRig([replace(one, gains=ServoGains(**GAINS)) for one in specs(2)])
    one = rig.device(2)
    store, address = one.memory.store, one.table["position_p_gain"].address

    def forgetful(register: object, value: int) -> None:
        if getattr(register, "address", None) != address:
            store(register, value)  # type: ignore[arg-type]

    one.memory.store = forgetful  # type: ignore[method-assign]
    with refuses(BusError, 2, "position_p_gain", 400, 800):
        rig.bus.open()
    assert not rig.port.opened


def test_a_restart_ends_before_the_next_servo_and_names_in_bounded_time_who_stays_away() -> None:
    rig = BusRig(specs(3))
    rig.port.open(2_000_000)
    line = BusLine(bus_of(rig.servos), rig.port, list(enumerate(rig.servos)))
    rig.put(led=1)
    asked = iter([False, True])
    done = restart(line, [1, 2, 3], lambda: next(asked))
    assert done.ids == (1,) and done.problems == ()
    assert rig.shown("led") == [0, 1, 1] and not rig.devices[0].booting(rig.clock.now())
    rig.fault(Fault(FaultKind.MISSING, ids=(2,)))
    begun = rig.clock.now()
    done = restart(line, [1, 2])
    assert done.ids == (1, 2) and done.problems == ("j2 (id 2) has not come back: check its power and its wiring",)
    assert rig.clock.now() - begun < RESTART_TIMEOUT + 1.0


def test_a_lost_packet_is_sent_again_and_who_does_not_take_its_torque_is_named() -> None:
    rig = BusRig(specs(4)).ready()
    (line,) = rig.bus.lines
    # The broadcast write, and nothing else: it is the first packet from here on.
    lost = Fault(FaultKind.DROP, direction=Direction.TO_SERVOS, end=1e-6)
    rig.fault(lost)
    torque.enable(line, [1, 2, 3, 4])
    assert rig.shown("torque_enable") == [1] * 4
    rig.fault(lost)
    assert torque.off_everywhere({line: line.servos}) == []
    assert rig.shown("torque_enable") == [0] * 4
    rig.fault(Fault(FaultKind.MISSING, ids=(1,)))
    with refuses(BusError, "j1", 1):
        torque.enable(line, [1, 2, 3])


def two_buses() -> BusRig:
    return BusRig([*specs(3), spec(4, bus="two"), spec(5, bus="two")]).ready(torque=True)


def off_everywhere(rig: BusRig) -> list[str]:
    return torque.off_everywhere({line: line.servos for line in rig.bus.lines})


def test_all_servos_are_asked_before_any_is_waited_for_and_a_port_that_is_gone_is_named() -> None:
    rig = two_buses()
    rig.lines["main"].faults.add(Fault(FaultKind.MISSING), rig.clock.now())
    begun, sent, send = rig.clock.now(), list[float](), rig.ports["two"].write

    def write(data: bytes) -> None:
        sent.append(rig.clock.now() - begun)
        send(data)

    rig.ports["two"].write = write  # type: ignore[method-assign]
    assert off_everywhere(rig) == ["j1 (id 1)", "j2 (id 2)", "j3 (id 3)"]
    assert sent[0] < 0.001
    assert rig.shown("torque_enable") == [1, 1, 1, 0, 0]
    rig = two_buses()
    rig.ports["main"].write = Mock(side_effect=BusError("unplugged"))  # type: ignore[method-assign]
    assert off_everywhere(rig) == ["all of bus main (unplugged)"]
    assert rig.shown("torque_enable") == [1, 1, 1, 0, 0]


@pytest.mark.parametrize("act", ["_send_off", "_confirm_off"])
def test_an_interrupt_keeps_no_bus_powered(act: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = two_buses()
    real = getattr(torque, act)

    def interrupted(line: BusLine, ids: Collection[int]) -> list[str]:
        if line.spec.name == "main":
            real(line, ids)
            raise KeyboardInterrupt
        return list(real(line, ids))

    monkeypatch.setattr(torque, act, interrupted)
    with pytest.raises(KeyboardInterrupt):
        off_everywhere(rig)
    assert rig.shown("torque_enable") == [0] * 5


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_line_without_known_servos_switches_them_off_and_asks(protocol: int) -> None:
    rig = BusRig(specs(4, "MX-28"), protocol=protocol, baud=1_000_000)
    rig.port.open(1_000_000)
    line = BusLine(rig.buses[0], rig.port, [])
    rig.put(1, 2, 3, torque_enable=1)
    rig.fault(Fault(FaultKind.MISSING, ids=(3,)))
    assert torque.not_limp(line, [1, 2, 3, 4]) == [1, 2, 3]
    assert torque.off_everywhere({line: [1, 3]}) == ["id 3"]
    assert rig.shown("torque_enable") == [0, 1, 1, 0]


def test_every_model_of_a_layout_has_its_torque_and_goal_in_the_same_places() -> None:
    """What is sent to all servos of a bus fits each of them."""
    places = set()
    for table in tables():
        torque_on, goal = table["torque_enable"], table["goal_position"]
        places.add((table.protocol, table.layout, torque_on.address, torque_on.size, goal.address, goal.size))
    older = {(protocol, Layout.OLDER, 24, 1, 30, 2) for protocol in (1, 2)}
    assert places == older | {(2, Layout.X, 64, 1, 116, 4)}


def test_a_servo_that_keeps_torque_keeps_its_watchdog() -> None:
    rig = BusRig(specs(2)).ready(torque=True)
    two = rig.device(2)
    write = two.write

    def ignored(address: int, data: bytes, now: float, *, secondary: bool = False) -> None:
        if address != 64:
            write(address, data, now, secondary=secondary)

    two.write = ignored  # type: ignore[method-assign]
    assert off_everywhere(rig) == ["j2 (id 2)"]
    assert rig.shown("torque_enable") == [0, 1] and rig.shown("bus_watchdog") == [0, 5]


def test_how_far_a_limp_joint_may_move_is_an_angle() -> None:
    servos = [replace(one, lower=-1.0, upper=1.0) for one in specs(1, "AX-12A")]
    rig = BusRig(servos, protocol=1, start=[512]).ready()
    (line,) = rig.bus.lines
    torque.check_still(line, {1: 512 + 11})
    with refuses(BusError, 524, 512, "3.4"):
        torque.check_still(line, {1: 512 + 12})


# Torque for robots that are not as they were left: turns of driven servos, slow buses, noise.


@pytest.mark.parametrize("fault", ["silent", "beyond"])
def test_turns_of_a_servo_that_has_torque_are_counted_before_it_is_driven(fault: str) -> None:
    """A run was killed. The next one finds torque on, and at first another servo does not answer."""
    rig = of_many_turns().ready()
    rig.bus.close()
    two = rig.device(2)
    two.reboot(rig.clock.now())
    rig.clock.advance(1.0)
    two.execute(Instruction.WRITE, b"\x40\x00\x01", rig.clock.now(), broadcast=False)
    assert two.memory.value("torque_enable") == 1
    if fault == "beyond":
        rig.servos[0] = replace(rig.servos[0], mode=ServoMode.EXTENDED_POSITION, lower=1.0, upper=1.4)
    rig.bus = rig.another()
    if fault == "silent":
        struck(rig, Fault(FaultKind.MISSING, ids=(1,), end=0.004))
    rig.bus.open()
    for _ in range(5):
        rig.clock.advance(0.05)
        states = rig.bus.read()
    assert int(states.position[1]) == FAR
    rig.bus.write(ServoGoals(states.position))
    if fault == "beyond":
        with refuses(BusError, "j1", 1):
            rig.bus.torque(True)


def test_two_slow_buses_are_armed_before_a_watchdog_runs_out() -> None:
    servos = [*specs(20), *(replace(one, joint=f"k{one.id}", bus="two") for one in specs(20))]
    rig = BusRig(servos, baud=57_600).ready(torque=True)
    assert rig.shown("torque_enable") == [1] * 40
