"""Perturbations that chance draws: in their bounds, the same for the same seed."""

import numpy as np
import pytest

from sim.physics.perturbation import NOMINAL, Perturbation, PerturbationKind, drawn

WITHIN = (1.0, 8.0)


def test_what_is_drawn_is_as_large_as_stated_and_the_same_for_the_same_seed() -> None:
    def all_of(kind: PerturbationKind) -> list[Perturbation]:
        return [drawn(kind, seed, within=WITHIN, frame="neck") for seed in range(50)]

    for kind in PerturbationKind:
        cases = all_of(kind)
        assert cases == all_of(kind) and NOMINAL not in cases
        assert len({repr(case) for case in cases}) == (1 if kind is PerturbationKind.LATENCY else 50)
    masses = [case.mass_scale for case in all_of(PerturbationKind.MASS)]
    assert 0.9 <= min(masses) < 0.93 and 1.07 < max(masses) <= 1.1
    offsets = [case.com_offset[:2] for case in all_of(PerturbationKind.CENTRE_OF_MASS)]
    assert [float(np.hypot(*offset)) for offset in offsets] == pytest.approx([0.01] * 50)
    assert all(0.5 <= case.friction <= 1.0 for case in all_of(PerturbationKind.FRICTION))
    scales = [case.stiffness_scale for case in all_of(PerturbationKind.STIFFNESS)]
    assert 0.7 <= min(scales) < 0.75 and 1.25 < max(scales) <= 1.3
    assert {case.latency_s for case in all_of(PerturbationKind.LATENCY)} == {0.03}
    pushes = [case.pushes[0] for case in all_of(PerturbationKind.PUSH)]
    assert {push.force for push in pushes} == {(3.0, 0.0, 0.0), (-3.0, 0.0, 0.0), (0.0, 3.0, 0.0)}
    assert all(WITHIN[0] <= push.start <= WITHIN[1] and push.duration == 0.2 for push in pushes)
    assert {push.frame for push in pushes} == {"neck"}


def test_a_number_that_is_given_is_not_drawn() -> None:
    for kind in (PerturbationKind.STIFFNESS, PerturbationKind.FRICTION):
        given = {drawn(kind, seed, within=WITHIN, value=0.6) for seed in range(3)}
        assert len(given) == 1 and 0.6 in vars(given.pop()).values()
