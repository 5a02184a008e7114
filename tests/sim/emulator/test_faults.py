"""Faults as data: windows, usual values, plans from a seed."""

import math
import random

import pytest

from sim.emulator.faults import BYTE_KINDS, KEYS, VALUES, Fault, FaultKind, Part, Unit, mangled, random_faults


def test_windows_of_time_and_cycles_begin_inside_and_end_outside() -> None:
    fault = Fault(FaultKind.SHORT, start=1.0, end=2.0, from_cycle=3, to_cycle=5)
    assert [fault.lasts(time, 3) for time in (0.9, 1.0, 1.9, 2.0)] == [False, True, True, False]
    assert [fault.lasts(1.5, cycle) for cycle in (2, 3, 4, 5)] == [False, True, True, False]
    assert Fault(FaultKind.SHORT).lasts(math.nextafter(math.inf, 0.0), 10**9)


def test_a_value_is_the_usual_one_unless_given() -> None:
    assert Fault(FaultKind.OVER_TEMPERATURE).amount == VALUES[FaultKind.OVER_TEMPERATURE][0]
    assert Fault(FaultKind.OVER_TEMPERATURE, value=70.0).amount == 70.0


def test_every_kind_has_its_keys() -> None:
    for kind in FaultKind:
        assert ("value" in KEYS[kind]) == (kind in VALUES)
        assert ("rate" in KEYS[kind]) == (kind in BYTE_KINDS)
    assert all(low <= usual <= high for usual, low, high in VALUES.values())


def test_a_plan_follows_from_its_seed() -> None:
    plans = [random_faults(seed, range(1, 21), 60.0) for seed in range(50)]
    assert plans == [random_faults(seed, range(1, 21), 60.0) for seed in range(50)]
    assert len(set(plans)) == 50
    faults = [fault for plan in plans for fault in plan]
    assert {fault.kind for fault in faults} == set(FaultKind)
    for fault in faults:
        assert 0.0 <= fault.start <= fault.end <= 60.0
        assert fault.end - fault.start <= 12.0
        assert set(fault.ids) <= set(range(1, 21))


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
    assert _all(Fault(FaultKind.DROP, of=Unit.BYTES)) == b""
    assert _bits(_all(Fault(FaultKind.FLIP, of=Unit.BYTES)), PACKET) == len(PACKET)
    assert _all(Fault(FaultKind.DUPLICATE, of=Unit.BYTES)) == bytes(byte for byte in PACKET for _ in range(2))
    late = mangled(PACKET[:3], [Fault(FaultKind.LATE, of=Unit.BYTES, value=0.5)], random.Random(1))
    assert late == [Part(0.5, PACKET[:1]), Part(0.5, PACKET[1:2]), Part(0.5, PACKET[2:3])]
    assert len(_all(Fault(FaultKind.NOISE, of=Unit.BYTES))) > len(PACKET)


@pytest.mark.parametrize("unit", Unit)
@pytest.mark.parametrize("kind", [FaultKind.DROP, FaultKind.FLIP, FaultKind.DUPLICATE])
def test_a_rate_hits_its_share(kind: FaultKind, unit: Unit) -> None:
    chance = random.Random(3)
    fault = Fault(kind, rate=0.1, of=unit)
    packet = PACKET if unit is Unit.PACKETS else PACKET[:1]
    hit = sum(mangled(packet, [fault], chance) != [Part(0.0, packet)] for _ in range(3000))
    assert 230 <= hit <= 370


def test_the_same_seed_does_the_same() -> None:
    fault = Fault(FaultKind.FLIP, rate=0.3, of=Unit.BYTES)
    assert _all(fault, seed=5) == _all(fault, seed=5)
    assert _all(fault, seed=5) != _all(fault, seed=6)


def test_faults_add_up() -> None:
    faults = [Fault(FaultKind.LATE, value=0.5), Fault(FaultKind.DUPLICATE), Fault(FaultKind.LATE, value=0.25)]
    assert mangled(b"ab", faults, random.Random(1)) == [Part(0.75, b"abab")]


def test_two_storms_leave_a_packet_as_wrong_as_one() -> None:
    storm = Fault(FaultKind.CRC_STORM)
    assert mangled(PACKET, [storm, storm], random.Random(0)) == mangled(PACKET, [storm], random.Random(0))
