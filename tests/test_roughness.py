"""How rough a bus is: what counts as a rough cycle, how many are looked back at, and what real damage comes to."""

import pytest

from bus_rig import BusRig, specs
from hardware.dynamixel.roughness import FEWEST, RETRIES, WINDOW_S, Roughness
from sim.emulator.faults import Fault, FaultKind


def test_silence_is_not_rough_and_one_retry_neither() -> None:
    rough = Roughness()
    for cycle in range(20):
        rough.note(0.01 * cycle, retries=RETRIES, spoiled=0)
        rough.note(0.01 * cycle, retries=RETRIES - 1, spoiled=1)
    assert rough.share == 0.0


def test_the_share_is_of_the_last_cycles_only() -> None:
    rough = Roughness()
    for cycle in range(FEWEST):
        rough.note(0.01 * cycle, retries=RETRIES, spoiled=1)
        assert rough.share == (cycle + 1) / FEWEST
    for cycle in range(100):
        rough.note(1.0 + 0.01 * cycle, retries=0, spoiled=0)
    assert rough.share == 0.0
    rough.note(2.0, retries=RETRIES, spoiled=1)
    assert 0.0 < rough.share <= 1.0 / (WINDOW_S / 0.01 - 1.0)


@pytest.mark.parametrize(
    ("rate", "most", "least"), [(0.0, 0.0, 0.0), (0.01, 0.1, 0.0), (0.05, 0.75, 0.0), (0.3, 1.0, 0.6)]
)
def test_a_line_that_damages_packets(rate: float, most: float, least: float) -> None:
    rig = BusRig(specs(20)).ready()
    if rate:
        rig.fault(Fault(FaultKind.FLIP, rate=rate))
    seen = [rig.tick().states.rough for _ in range(60)][10:]
    assert max(seen) <= most
    assert sum(seen) / len(seen) >= least
