"""A host on an emulated port: bytes, waiting, clocks, several ports, what a real port refuses."""

import pytest

from hardware.clock import VirtualClock
from hardware.dynamixel import protocol2
from hardware.dynamixel.byte_port import BytePort
from hardware.errors import BusError
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line
from sim.emulator.loopback import EmulatedPort
from sim.emulator.wire import Timing
from stub_devices import StubDevice
from support.messages import refuses

PING_STATUS = bytes.fromhex("FF FF FD 00 01 07 00 55 00 06 04 26 65 5D")


def _port(clock: VirtualClock, timing: Timing | None = None, baud: int = 1_000_000) -> EmulatedPort:
    port = EmulatedPort(Line([StubDevice(baud=1_000_000)], timing=timing), clock)
    port.open(baud)
    return port


def test_it_is_a_byte_port() -> None:
    port: BytePort = EmulatedPort(Line([]), VirtualClock(), name="line")
    assert port.name == "line"


def test_a_ping_is_answered_after_wire_time_and_latency() -> None:
    clock = VirtualClock(5.0)
    port = _port(clock)
    port.write(protocol2.ping(1))
    assert port.read() == b""
    assert port.wait(6.0)
    assert clock.now() == pytest.approx(5.0 + 10e-6 * (10 + 14) + 20e-6 + 1e-3)
    assert port.read() == PING_STATUS
    assert port.read() == b""


def test_waiting_for_nothing_ends_at_the_deadline() -> None:
    clock = VirtualClock()
    port = _port(clock)
    assert not port.wait(0.25)
    assert clock.now() == 0.25


def test_an_answer_behind_the_deadline_is_not_there_yet() -> None:
    clock = VirtualClock()
    port = _port(clock)
    port.write(protocol2.ping(1))
    assert not port.wait(0.0005)
    assert port.wait(1.0)


def test_without_wire_delay_the_answer_is_there_at_once() -> None:
    clock = VirtualClock(1.0)
    port = _port(clock, Timing.none())
    port.write(protocol2.ping(1))
    assert port.read() == PING_STATUS
    assert clock.now() == 1.0


def test_another_baud_rate_hears_nothing_until_it_is_right() -> None:
    clock = VirtualClock()
    port = _port(clock, baud=57600)
    port.write(protocol2.ping(1))
    assert not port.wait(1.0)
    port.set_baud(1_000_000)
    port.write(protocol2.ping(1))
    assert port.wait(2.0)
    assert port.baud == 1_000_000


def test_ports_on_one_clock_wait_for_each_other() -> None:
    clock = VirtualClock()
    first, second = _port(clock), _port(clock)
    first.write(protocol2.ping(1))
    second.write(protocol2.ping(1))
    assert first.wait(1.0)
    then = clock.now()
    assert second.wait(1.0)
    assert clock.now() == then
    assert first.read() == second.read() == PING_STATUS


def test_drop_forgets_what_has_arrived_and_not_what_is_coming() -> None:
    clock = VirtualClock()
    port = _port(clock)
    port.write(protocol2.ping(1))
    clock.advance(0.01)
    port.write(protocol2.ping(1))
    port.drop()
    assert port.wait(1.0)
    assert port.read() == PING_STATUS


def test_a_closed_port_refuses_everything_and_closes_twice() -> None:
    port = _port(VirtualClock())
    port.close()
    port.close()
    for use in (port.read, port.drop, lambda: port.write(b"x"), lambda: port.wait(1.0), lambda: port.set_baud(9600)):
        with refuses(BusError):
            use()


def test_it_is_opened_once_and_at_a_rate_above_zero() -> None:
    port = _port(VirtualClock())
    with refuses(BusError):
        port.open(57600)
    with refuses(BusError):
        port.set_baud(0)


def test_a_lost_adapter_raises_and_is_opened_again_when_it_is_back() -> None:
    clock = VirtualClock()
    devices = [StubDevice(baud=1_000_000)]
    state = FaultState(devices, faults=[Fault(FaultKind.UNPLUG, start=1.0, end=2.0)])
    port = EmulatedPort(Line(devices, faults=state), clock)
    port.open(1_000_000)
    with refuses(BusError):
        while not port.wait(1.5):
            pass
    with refuses(BusError):
        port.open(1_000_000)
    clock.sleep_until(2.5)
    port.open(1_000_000)
    port.write(protocol2.ping(1))
    assert port.wait(3.0)
    assert port.read() == PING_STATUS
