"""dynamixel-sdk, a client that knows nothing of us, makes every kind of call to emulated servos by a pty."""

from collections.abc import Iterator
from pathlib import Path

import dynamixel_sdk as sdk
import pytest

from emulated_port import served
from hardware.dynamixel.control_table import code_of, find_table
from hardware.servo import find_model
from sim.emulator.device import Device
from sim.emulator.line import Line
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo2 import EmulatedServo
from sim.emulator.servo_body import ServoBuild

BAUD = 4_000_000
GOAL, GOAL1 = 116, 30
TORQUE, LED, RETURN_DELAY, POSITION = 64, 65, 9, 132


def _servo2(device: int) -> EmulatedServo:
    table = find_table("XM430-W350", 2)
    servo = EmulatedServo(table, find_model("XM430-W350"), ServoBuild(1000.0 + device, boot_time=0.05))
    servo.memory.put("id", device)
    servo.memory.put("baud_rate", code_of(table, BAUD) or 0)
    servo.memory.put("return_delay_time", 0)
    servo.place(1000.0 + device)
    return servo


def _servo1(device: int) -> EmulatedServo1:
    servo = EmulatedServo1(find_table("MX-28", 1), find_model("MX-28"), ServoBuild(1000.0 + device))
    servo.memory.put("id", device)
    servo.memory.put("baud_rate", 1)
    servo.memory.put("return_delay_time", 0)
    servo.place(1000.0 + device)
    return servo


def _open(path: Path, baud: int) -> sdk.PortHandler:
    port = sdk.PortHandler(str(path))
    assert port.openPort()
    assert port.setBaudRate(baud)
    return port


@pytest.fixture(scope="module")
def line2(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Line, sdk.PortHandler]]:
    path = tmp_path_factory.mktemp("sdk") / "servos"
    with served([_servo2(device) for device in (1, 2, 3)], path) as line:
        port = _open(path, BAUD)
        yield line, port
        port.closePort()


@pytest.fixture(scope="module")
def line1(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Line, sdk.PortHandler]]:
    path = tmp_path_factory.mktemp("sdk1") / "servos"
    with served([_servo1(device) for device in (1, 2)], path) as line:
        port = _open(path, 1_000_000)
        yield line, port
        port.closePort()


@pytest.fixture
def port(line2: tuple[Line, sdk.PortHandler]) -> sdk.PortHandler:
    return line2[1]


@pytest.fixture
def port1(line1: tuple[Line, sdk.PortHandler]) -> sdk.PortHandler:
    return line1[1]


P2 = sdk.PacketHandler(2.0)
P1 = sdk.PacketHandler(1.0)


def test_ping(port: sdk.PortHandler) -> None:
    assert P2.ping(port, 1) == (1020, 0, 0)
    assert P2.ping(port, 9)[1] == sdk.COMM_RX_TIMEOUT


def test_broadcast_ping(port: sdk.PortHandler) -> None:
    found, result = P2.broadcastPing(port)
    assert result == sdk.COMM_SUCCESS
    assert {device: reply[0] for device, reply in found.items()} == {1: 1020, 2: 1020, 3: 1020}


def test_read_and_write_of_every_size(port: sdk.PortHandler) -> None:
    assert P2.write1ByteTxRx(port, 1, LED, 1) == (0, 0)
    assert P2.read1ByteTxRx(port, 1, LED) == (1, 0, 0)
    assert P2.write2ByteTxRx(port, 1, 84, 700) == (0, 0)
    assert P2.read2ByteTxRx(port, 1, 84) == (700, 0, 0)
    assert P2.write4ByteTxRx(port, 1, 108, 40) == (0, 0)
    assert P2.read4ByteTxRx(port, 1, 108) == (40, 0, 0)
    assert P2.write4ByteTxRx(port, 1, 108, 0) == (0, 0)
    assert P2.read4ByteTxRx(port, 2, POSITION) == (1002, 0, 0)
    assert P2.readTxRx(port, 2, 126, 10)[0][6:] == [1002 & 255, 1002 >> 8, 0, 0]


def test_refusals(port: sdk.PortHandler) -> None:
    assert P2.write1ByteTxRx(port, 1, 0, 1) == (0, 7)
    assert P2.write4ByteTxRx(port, 1, GOAL, 70_000) == (0, 6)
    assert P2.write1ByteTxRx(port, 1, GOAL, 1) == (0, 5)
    assert P2.write1ByteTxRx(port, 1, TORQUE, 1) == (0, 0)
    assert P2.write1ByteTxRx(port, 1, 11, 4) == (0, 7)
    assert P2.write1ByteTxRx(port, 1, TORQUE, 0) == (0, 0)


def test_reg_write_and_action(port: sdk.PortHandler) -> None:
    assert P2.regWriteTxRx(port, 2, LED, 1, [1]) == (0, 0)
    assert P2.read1ByteTxRx(port, 2, LED) == (0, 0, 0)
    assert P2.read1ByteTxRx(port, 2, 69) == (1, 0, 0)
    assert P2.action(port, sdk.BROADCAST_ID) == 0
    assert P2.read1ByteTxRx(port, 2, LED) == (1, 0, 0)


def test_sync_write_and_sync_reads(port: sdk.PortHandler) -> None:
    write = sdk.GroupSyncWrite(port, P2, GOAL, 4)
    for device in (1, 2, 3):
        assert write.addParam(device, (500 * device).to_bytes(4, "little"))
    assert write.txPacket() == 0
    read = sdk.GroupSyncRead(port, P2, GOAL, 4)
    for device in (3, 1, 2):
        assert read.addParam(device)
    for ask in (read.txRxPacket, read.fastSyncRead):
        assert ask() == 0
        assert [read.getData(device, GOAL, 4) for device in (1, 2, 3)] == [500, 1000, 1500]


def test_bulk_write_and_bulk_reads(port: sdk.PortHandler) -> None:
    write = sdk.GroupBulkWrite(port, P2)
    assert write.addParam(1, 84, 2, (321).to_bytes(2, "little"))
    assert write.addParam(2, GOAL, 4, (1234).to_bytes(4, "little"))
    assert write.txPacket() == 0
    read = sdk.GroupBulkRead(port, P2)
    assert read.addParam(1, 84, 2)
    assert read.addParam(2, GOAL, 4)
    for ask in (read.txRxPacket, read.fastBulkRead):
        assert ask() == 0
        assert (read.getData(1, 84, 2), read.getData(2, GOAL, 4)) == (321, 1234)


def test_a_missing_servo_voids_the_sync_read(port: sdk.PortHandler) -> None:
    read = sdk.GroupSyncRead(port, P2, POSITION, 4)
    for device in (1, 9, 2):
        assert read.addParam(device)
    assert read.txRxPacket() == sdk.COMM_RX_TIMEOUT
    assert not read.isAvailable(2, POSITION, 4)


def test_clear_multi_turn(port: sdk.PortHandler) -> None:
    assert P2.clearMultiTurn(port, 2) == (0, 0)


def test_reboot_is_silent_for_a_while_and_loses_ram(port: sdk.PortHandler) -> None:
    assert P2.write1ByteTxRx(port, 3, LED, 1) == (0, 0)
    assert P2.reboot(port, 3) == (0, 0)
    assert P2.ping(port, 3)[1] == sdk.COMM_RX_TIMEOUT
    assert _waited(port, 3) == 1020
    assert P2.read1ByteTxRx(port, 3, LED) == (0, 0, 0)


def test_factory_reset_but_id_and_baud(port: sdk.PortHandler) -> None:
    assert P2.write2ByteTxRx(port, 3, 38, 500) == (0, 0)
    assert P2.factoryReset(port, 3, 2) == (0, 0)
    assert _waited(port, 3) == 1020
    assert P2.read2ByteTxRx(port, 3, 38) == (1193, 0, 0)


def test_another_speed_receives_nothing(port: sdk.PortHandler) -> None:
    assert port.setBaudRate(57_600)
    assert P2.ping(port, 1)[1] == sdk.COMM_RX_TIMEOUT
    assert port.setBaudRate(BAUD)
    assert P2.ping(port, 1)[1] == 0


def test_a_vanished_servo_is_back_when_the_fault_is_cleared(line2: tuple[Line, sdk.PortHandler]) -> None:
    line, port = line2
    device: Device = line.devices[0]
    device.baud = 9600
    assert P2.ping(port, 1)[1] == sdk.COMM_RX_TIMEOUT
    device.baud = BAUD
    assert P2.ping(port, 1) == (1020, 0, 0)


def test_protocol_1(port1: sdk.PortHandler) -> None:
    assert P1.ping(port1, 1) == (29, 0, 0)
    assert P1.read2ByteTxRx(port1, 1, 36) == (1001, 0, 0)
    assert P1.write1ByteTxRx(port1, 1, 25, 1) == (0, 0)
    assert P1.read1ByteTxRx(port1, 1, 25) == (1, 0, 0)
    assert P1.regWriteTxRx(port1, 2, 25, 1, [1]) == (0, 0)
    assert P1.action(port1, sdk.BROADCAST_ID) == 0
    assert P1.read1ByteTxRx(port1, 2, 25) == (1, 0, 0)
    write = sdk.GroupSyncWrite(port1, P1, GOAL1, 2)
    for device in (1, 2):
        assert write.addParam(device, (600 * device).to_bytes(2, "little"))
    assert write.txPacket() == 0
    assert [P1.read2ByteTxRx(port1, device, GOAL1)[0] for device in (1, 2)] == [600, 1200]


def _waited(port: sdk.PortHandler, device: int) -> int:
    """The model number of a servo that starts."""
    for _ in range(20):
        model, result, _ = P2.ping(port, device)
        if result == sdk.COMM_SUCCESS:
            return int(model)
    raise AssertionError("it never came back")
