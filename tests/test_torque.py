"""Torque of a whole bus: everything is confirmed, and what was lost once is sent again."""

from dataclasses import replace

import pytest

from bus_rig import BusRig, bus_of, spec, specs
from hardware.dynamixel import torque
from hardware.dynamixel.bus_line import BusLine
from hardware.errors import BusError
from sim.emulator.faults import Direction, Fault, FaultKind
from support.messages import refuses


def test_who_is_limp_is_told() -> None:
    rig = BusRig(specs(4)).ready(torque=True)
    rig.device(3).reboot(rig.clock.now())
    rig.clock.advance(0.3)
    (line,) = rig.bus.lines
    assert torque.limp(line) == [3]


@pytest.mark.parametrize("on", [True, False])
def test_a_lost_packet_is_sent_again(on: bool) -> None:
    rig = BusRig(specs(4)).ready(torque=not on)
    (line,) = rig.bus.lines
    # The broadcast write, and nothing else: it is the first packet from here on.
    rig.fault(Fault(FaultKind.DROP, direction=Direction.TO_SERVOS, end=1e-6))
    if on:
        torque.enable(line, [1, 2, 3, 4])
    else:
        assert torque.off_everywhere([line]) == []
    assert rig.shown("torque_enable") == [int(on)] * 4


def test_who_does_not_take_its_torque_is_named() -> None:
    rig = BusRig(specs(3)).ready()
    (line,) = rig.bus.lines
    rig.fault(Fault(FaultKind.MISSING, ids=(1,)))
    with refuses(BusError, "j1", 1):
        torque.enable(line, [1, 2, 3])


def two_buses() -> BusRig:
    servos = [*specs(3), spec(4, bus="two"), spec(5, bus="two")]
    return BusRig(servos, buses=[bus_of(servos), bus_of(servos, name="two")]).ready(torque=True)


def test_everybody_is_told_before_anybody_is_waited_for() -> None:
    rig = two_buses()
    rig.lines["main"].faults.add(Fault(FaultKind.MISSING), rig.clock.now())
    begun, told = rig.clock.now(), list[float]()
    send = rig.ports["two"].write

    def write(data: bytes) -> None:
        told.append(rig.clock.now() - begun)
        send(data)

    rig.ports["two"].write = write  # type: ignore[method-assign]
    unsure = torque.off_everywhere(rig.bus.lines)
    assert unsure == ["j1 (id 1)", "j2 (id 2)", "j3 (id 3)"]
    assert told[0] < 0.001
    assert rig.shown("torque_enable") == [1, 1, 1, 0, 0]


@pytest.mark.parametrize("act", ["_tell_off", "_confirm_off"])
def test_an_interrupt_keeps_no_bus_powered(act: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = two_buses()
    real = getattr(torque, act)

    def interrupted(line: BusLine) -> list[str]:
        if line.spec.name == "main":
            real(line)
            raise KeyboardInterrupt
        return list(real(line))

    monkeypatch.setattr(torque, act, interrupted)
    with pytest.raises(KeyboardInterrupt):
        torque.off_everywhere(rig.bus.lines)
    assert rig.shown("torque_enable") == [0] * 5


def test_a_port_that_is_gone_is_named_and_the_others_are_told() -> None:
    rig = two_buses()

    def gone(_: bytes) -> None:
        raise BusError("unplugged")

    rig.ports["main"].write = gone  # type: ignore[assignment]
    assert torque.off_everywhere(rig.bus.lines) == ["all of bus main (unplugged)"]
    assert rig.shown("torque_enable") == [1, 1, 1, 0, 0]


def test_whoever_keeps_torque_keeps_its_watchdog() -> None:
    rig = BusRig(specs(2)).ready(torque=True)
    two = rig.device(2)
    write = two.write

    def deaf(address: int, data: bytes, now: float, *, secondary: bool = False) -> None:
        if address != 64:
            write(address, data, now, secondary=secondary)

    two.write = deaf  # type: ignore[method-assign]
    assert torque.off_everywhere(rig.bus.lines) == ["j2 (id 2)"]
    assert rig.shown("torque_enable") == [0, 1]
    assert rig.shown("bus_watchdog") == [0, 5]


def test_how_far_a_limp_joint_may_move_is_an_angle() -> None:
    servos = [replace(one, lower=-1.0, upper=1.0) for one in specs(1, "AX-12A")]
    rig = BusRig(servos, buses=[bus_of(servos, protocol=1, baud=1_000_000)], start=[512]).ready()
    (line,) = rig.bus.lines
    torque.check_still(line, {1: 512 + 11})
    with refuses(BusError, 524, 512, "3.4"):
        torque.check_still(line, {1: 512 + 12})
