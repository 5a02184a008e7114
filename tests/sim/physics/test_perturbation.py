"""Perturbations that chance draws: in their bounds, the same for the same seed."""

import numpy as np
import pytest

from sim.physics.perturbation import NOMINAL, Perturbation, PerturbationKind, drawn

WITHIN = (1.0, 8.0)


@pytest.mark.parametrize("trouble", list(PerturbationKind))
def test_the_same_seed_draws_the_same_and_nothing_else_is_changed(trouble: PerturbationKind) -> None:
    cases = [drawn(trouble, seed, within=WITHIN) for seed in range(50)]
    assert cases == [drawn(trouble, seed, within=WITHIN) for seed in range(50)]
    assert NOMINAL not in cases
    if trouble is not PerturbationKind.LATENCY:
        assert len({repr(case) for case in cases}) == 50


def test_they_are_as_large_as_stated() -> None:
    def all_of(trouble: PerturbationKind) -> list[Perturbation]:
        return [drawn(trouble, seed, within=WITHIN, frame="neck") for seed in range(50)]

    masses = [case.mass_scale for case in all_of(PerturbationKind.MASS)]
    assert 0.9 <= min(masses) < 0.93 and 1.07 < max(masses) <= 1.1
    assert {round(float(np.hypot(*case.com_offset[:2])), 9) for case in all_of(PerturbationKind.CENTRE_OF_MASS)} == {
        0.01
    }
    assert all(0.5 <= case.friction <= 1.0 for case in all_of(PerturbationKind.FRICTION))
    assert {case.latency_s for case in all_of(PerturbationKind.LATENCY)} == {0.03}
    pushes = [case.pushes[0] for case in all_of(PerturbationKind.PUSH)]
    assert {push.force for push in pushes} == {(3.0, 0.0, 0.0), (-3.0, 0.0, 0.0), (0.0, 3.0, 0.0)}
    assert all(WITHIN[0] <= push.start <= WITHIN[1] and push.duration == 0.2 for push in pushes)
    assert {push.frame for push in pushes} == {"neck"}
