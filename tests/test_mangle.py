"""What faults make of a packet: by kind, by rate, the same for the same seed."""

import random

import pytest

from sim.emulator.faults import Fault, FaultKind, Unit
from sim.emulator.mangle import Part, mangled

PACKET = bytes(range(40))


def _all(fault: Fault, packet: bytes = PACKET, seed: int = 1) -> bytes:
    return b"".join(part.data for part in mangled(packet, [fault], random.Random(seed)))


def _bits(first: bytes, second: bytes) -> int:
    return sum((a ^ b).bit_count() for a, b in zip(first, second, strict=True))


def test_of_packets() -> None:
    assert mangled(PACKET, [Fault(FaultKind.DROP)], random.Random(1)) == []
    assert _bits(_all(Fault(FaultKind.FLIP)), PACKET) == 1
    assert _all(Fault(FaultKind.DUPLICATE)) == PACKET + PACKET
    assert mangled(PACKET, [Fault(FaultKind.LATE, value=0.5)], random.Random(1)) == [Part(0.5, PACKET)]
    noisy = _all(Fault(FaultKind.NOISE, value=6.0))
    assert noisy.endswith(PACKET) and 1 <= len(noisy) - len(PACKET) <= 6
    assert _all(Fault(FaultKind.CRC_STORM)) == PACKET[:-1] + bytes((PACKET[-1] ^ 0xFF,))


def test_of_bytes() -> None:
    assert _all(Fault(FaultKind.DROP, unit=Unit.BYTES)) == b""
    assert _bits(_all(Fault(FaultKind.FLIP, unit=Unit.BYTES)), PACKET) == len(PACKET)
    assert _all(Fault(FaultKind.DUPLICATE, unit=Unit.BYTES)) == bytes(byte for byte in PACKET for _ in range(2))
    late = mangled(PACKET[:3], [Fault(FaultKind.LATE, unit=Unit.BYTES, value=0.5)], random.Random(1))
    assert late == [Part(0.5, PACKET[:1]), Part(0.5, PACKET[1:2]), Part(0.5, PACKET[2:3])]
    assert len(_all(Fault(FaultKind.NOISE, unit=Unit.BYTES))) > len(PACKET)


@pytest.mark.parametrize("unit", Unit)
@pytest.mark.parametrize("kind", [FaultKind.DROP, FaultKind.FLIP, FaultKind.DUPLICATE])
def test_a_rate_hits_its_share(kind: FaultKind, unit: Unit) -> None:
    chance = random.Random(3)
    fault = Fault(kind, rate=0.1, unit=unit)
    packet = PACKET if unit is Unit.PACKETS else PACKET[:1]
    hit = sum(mangled(packet, [fault], chance) != [Part(0.0, packet)] for _ in range(3000))
    assert 230 <= hit <= 370


def test_the_same_seed_does_the_same() -> None:
    fault = Fault(FaultKind.FLIP, rate=0.3, unit=Unit.BYTES)
    assert _all(fault, seed=5) == _all(fault, seed=5)
    assert _all(fault, seed=5) != _all(fault, seed=6)


def test_faults_add_up() -> None:
    faults = [Fault(FaultKind.LATE, value=0.5), Fault(FaultKind.DUPLICATE), Fault(FaultKind.LATE, value=0.25)]
    assert mangled(b"ab", faults, random.Random(1)) == [Part(0.75, b"abab")]


def test_two_storms_leave_a_packet_as_wrong_as_one() -> None:
    storm = Fault(FaultKind.CRC_STORM)
    assert mangled(PACKET, [storm, storm], random.Random(0)) == mangled(PACKET, [storm], random.Random(0))
