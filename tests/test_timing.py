"""How long a condition has held, and the first-order low pass."""

from math import exp, inf

import numpy as np
import pytest

from retarget.timing import Dwell, low_pass

SEEDS = range(20)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_dwell_is_the_time_since_the_condition_failed_last(seed: int) -> None:
    random = np.random.default_rng(seed)
    steps, holds = random.uniform(1e-3, 0.02, 200), random.random(200) < 0.9
    dwell = Dwell()
    for tick in range(200):
        held = dwell.step(float(steps[tick]), holds=bool(holds[tick]))
        began = next((before + 1 for before in range(tick, -1, -1) if not holds[before]), 0)
        assert held == dwell.held == pytest.approx(float(steps[began : tick + 1].sum()), abs=1e-12)


def test_a_dwell_begins_anew_from_what_it_is_set_to() -> None:
    dwell = Dwell()
    dwell.step(1.0, holds=True)
    dwell.held = 0.0
    assert dwell.step(0.5, holds=True) == 0.5
    dwell.held = -inf  # never, until it has failed once
    assert dwell.step(1e9, holds=True) == -inf
    assert [dwell.step(0.5, holds=holds) for holds in (False, True)] == [0.0, 0.5]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_low_pass_is_the_solution_of_its_equation_in_steps_of_any_length(seed: int) -> None:
    random = np.random.default_rng(seed)
    start, to, settle = random.normal(), random.normal(), random.uniform(0.01, 2.0)
    value, time = float(start), 0.0
    for dt in random.uniform(0.0, 0.1, 100):
        value, time = low_pass(value, float(to), dt / settle), time + dt
        assert value == pytest.approx(to + (start - to) * exp(-time / settle), abs=1e-12)
        assert min(start, to) - 1e-12 <= value <= max(start, to) + 1e-12, "it overshoots"


def test_a_low_pass_stays_in_no_time_and_is_there_after_any_time() -> None:
    assert low_pass(1.5, -2.25, 0.0) == 1.5
    assert low_pass(1.5, -2.25, inf) == -2.25


def test_a_low_pass_of_a_vector_is_that_of_each_part() -> None:
    start, to = np.array([0.3, -1.7, 2.0]), np.array([1.1, 0.4, 2.0])
    parts = [low_pass(a, b, 0.4) for a, b in zip(start.tolist(), to.tolist(), strict=True)]
    assert low_pass(start, to, 0.4).tolist() == parts
    assert low_pass(complex(*start[:2]), complex(*to[:2]), 0.4) == complex(*parts[:2])
