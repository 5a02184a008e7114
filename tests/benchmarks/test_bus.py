"""The benchmark of the bus: expected times are the datasheet's, and virtual time reaches them."""

import pytest

from benchmarks.bus import expected_ms, virtual_ms

TABLE = [  # servos, baud, fast sync read [ms], sync read [ms]
    (20, 1_000_000, 5.38, 7.08),
    (20, 2_000_000, 3.20, 4.24),
    (20, 3_000_000, 2.47, 3.29),
    (20, 4_000_000, 2.11, 2.82),
    (30, 1_000_000, 7.38, 9.98),
    (30, 4_000_000, 2.61, 3.70),
]


@pytest.mark.parametrize(("count", "baud", "fast", "plain"), TABLE)
def test_cycles_take_what_the_wire_takes(count: int, baud: int, fast: float, plain: float) -> None:
    assert expected_ms(count, baud, plain=False) == pytest.approx(fast, abs=0.006)
    assert expected_ms(count, baud, plain=True) == pytest.approx(plain, abs=0.006)
    assert virtual_ms(count, baud, plain=False, cycles=8) == pytest.approx(fast, rel=0.02)
    assert virtual_ms(count, baud, plain=True, cycles=8) == pytest.approx(plain, rel=0.02)
