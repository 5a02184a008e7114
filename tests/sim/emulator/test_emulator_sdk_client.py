"""dynamixel-sdk, a client that knows nothing of us, makes every kind of call to emulated servos by a pty."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import dynamixel_sdk as sdk

from bus_rig import four_servos
from emulated import served
from hardware.servo import find_model
from sim.emulator.conversation import Conduct
from sim.emulator.robot_lines import devices_of

BAUD = 4_000_000
GOAL, GOAL1 = 116, 30
TORQUE, LED, POSITION = 64, 65, 132
P1, P2 = sdk.PacketHandler(1.0), sdk.PacketHandler(2.0)


@contextmanager
def _opened(path: Path, model: str, ids: Sequence[int], protocol: int, baud: int) -> Iterator[sdk.PortHandler]:
    """A client's port to servos of one model, each at tick 1000 + its id."""
    specs = [replace(four_servos()[0], id=own, model=find_model(model), bus="main") for own in ids]
    devices = devices_of(
        specs,
        protocols={"main": protocol},
        bauds={"main": baud},
        return_delays={"main": 0},
        start=[1000 + own for own in ids],
        conduct=Conduct(boot_time=0.05),
    )
    # Patience of the client, ms: on a busy machine its 16 ms are too short.
    with patch.object(sdk.port_handler, "LATENCY_TIMER", 50), served(devices, path):
        port = sdk.PortHandler(str(path))
        assert port.openPort() and port.setBaudRate(baud)
        yield port
        port.closePort()


def _model_once_started(port: sdk.PortHandler, device: int) -> int:
    for _ in range(20):
        model, result, _ = P2.ping(port, device)
        if result == sdk.COMM_SUCCESS:
            return int(model)
    raise AssertionError("it never came back")


def test_every_kind_of_call_of_protocol_2(tmp_path: Path) -> None:
    with _opened(tmp_path / "servos", "XM430-W350", (1, 2, 3), 2, BAUD) as port:
        _every_kind(port)


def _every_kind(port: sdk.PortHandler) -> None:
    # Reads and writes of every size.
    assert P2.write1ByteTxRx(port, 1, LED, 1) == (0, 0)
    assert P2.read1ByteTxRx(port, 1, LED) == (1, 0, 0)
    assert P2.write2ByteTxRx(port, 1, 84, 700) == (0, 0)
    assert P2.read2ByteTxRx(port, 1, 84) == (700, 0, 0)
    assert P2.write4ByteTxRx(port, 1, 108, 40) == (0, 0)
    assert P2.read4ByteTxRx(port, 1, 108) == (40, 0, 0)
    assert P2.write4ByteTxRx(port, 1, 108, 0) == (0, 0)
    assert P2.read4ByteTxRx(port, 2, POSITION) == (1002, 0, 0)
    assert P2.readTxRx(port, 2, 126, 10)[0][6:] == [1002 & 255, 1002 >> 8, 0, 0]
    # Refusals.
    assert P2.write1ByteTxRx(port, 1, 0, 1) == (0, 7)
    assert P2.write4ByteTxRx(port, 1, GOAL, 70_000) == (0, 6)
    assert P2.write1ByteTxRx(port, 1, GOAL, 1) == (0, 5)
    assert P2.write1ByteTxRx(port, 1, TORQUE, 1) == (0, 0)
    assert P2.write1ByteTxRx(port, 1, 11, 4) == (0, 7)
    assert P2.write1ByteTxRx(port, 1, TORQUE, 0) == (0, 0)
    assert P2.clearMultiTurn(port, 2) == (0, 0)
    # Reg Write and Action.
    assert P2.regWriteTxRx(port, 2, LED, 1, [1]) == (0, 0)
    assert P2.read1ByteTxRx(port, 2, LED) == (0, 0, 0)
    assert P2.action(port, sdk.BROADCAST_ID) == 0
    assert P2.read1ByteTxRx(port, 2, LED) == (1, 0, 0)
    # Sync Write and Sync Reads.
    write, read = sdk.GroupSyncWrite(port, P2, GOAL, 4), sdk.GroupSyncRead(port, P2, GOAL, 4)
    for device in (3, 1, 2):
        assert write.addParam(device, (500 * device).to_bytes(4, "little")) and read.addParam(device)
    assert write.txPacket() == 0
    for request in (read.txRxPacket, read.fastSyncRead):
        assert request() == 0
        assert [read.getData(device, GOAL, 4) for device in (1, 2, 3)] == [500, 1000, 1500]
    assert read.addParam(9)  # missing: it voids the read
    assert read.txRxPacket() == sdk.COMM_RX_TIMEOUT
    # Bulk Write and Bulk Reads.
    write, read = sdk.GroupBulkWrite(port, P2), sdk.GroupBulkRead(port, P2)
    assert write.addParam(1, 84, 2, (321).to_bytes(2, "little"))
    assert write.addParam(2, GOAL, 4, (1234).to_bytes(4, "little"))
    assert write.txPacket() == 0
    assert read.addParam(1, 84, 2) and read.addParam(2, GOAL, 4)
    for request in (read.txRxPacket, read.fastBulkRead):
        assert request() == 0
        assert (read.getData(1, 84, 2), read.getData(2, GOAL, 4)) == (321, 1234)
    # A reboot is silent for a while and loses RAM; a reset spares id and baud rate.
    assert P2.write1ByteTxRx(port, 3, LED, 1) == (0, 0)
    assert P2.reboot(port, 3) == (0, 0)
    assert P2.ping(port, 3)[1] == sdk.COMM_RX_TIMEOUT
    assert _model_once_started(port, 3) == 1020 and P2.read1ByteTxRx(port, 3, LED) == (0, 0, 0)
    assert P2.write2ByteTxRx(port, 3, 38, 500) == (0, 0)
    assert P2.factoryReset(port, 3, 2) == (0, 0)
    assert _model_once_started(port, 3) == 1020 and P2.read2ByteTxRx(port, 3, 38) == (1193, 0, 0)


def test_protocol_1(tmp_path: Path) -> None:
    with _opened(tmp_path / "servos", "MX-28", (1, 2), 1, 1_000_000) as port:
        assert P1.ping(port, 1) == (29, 0, 0)
        assert P1.read2ByteTxRx(port, 1, 36) == (1001, 0, 0)
        assert P1.write1ByteTxRx(port, 1, 25, 1) == (0, 0)
        assert P1.read1ByteTxRx(port, 1, 25) == (1, 0, 0)
        assert P1.regWriteTxRx(port, 2, 25, 1, [1]) == (0, 0)
        assert P1.action(port, sdk.BROADCAST_ID) == 0
        assert P1.read1ByteTxRx(port, 2, 25) == (1, 0, 0)
        write = sdk.GroupSyncWrite(port, P1, GOAL1, 2)
        for device in (1, 2):
            assert write.addParam(device, (600 * device).to_bytes(2, "little"))
        assert write.txPacket() == 0
        assert [P1.read2ByteTxRx(port, device, GOAL1)[0] for device in (1, 2)] == [600, 1200]
