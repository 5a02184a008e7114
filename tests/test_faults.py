"""Faults as data: windows, usual values, plans from a seed."""

import math

from sim.emulator.faults import BYTE_KINDS, KEYS, VALUES, Fault, FaultKind, random_faults


def test_windows_of_time_and_cycles_begin_inside_and_end_outside() -> None:
    fault = Fault(FaultKind.SHORT, start=1.0, end=2.0, from_cycle=3, to_cycle=5)
    assert [fault.lasts(time, 3) for time in (0.9, 1.0, 1.9, 2.0)] == [False, True, True, False]
    assert [fault.lasts(1.5, cycle) for cycle in (2, 3, 4, 5)] == [False, True, True, False]
    assert Fault(FaultKind.SHORT).lasts(math.nextafter(math.inf, 0.0), 10**9)


def test_a_value_is_the_usual_one_unless_given() -> None:
    assert Fault(FaultKind.OVER_TEMPERATURE).amount == VALUES[FaultKind.OVER_TEMPERATURE][0]
    assert Fault(FaultKind.OVER_TEMPERATURE, value=70.0).amount == 70.0


def test_every_kind_says_what_it_can_be_told() -> None:
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
