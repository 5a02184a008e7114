"""A root that is told by the lower sole."""

import numpy as np
import pytest

from followers import op3
from retarget.carried_load import CARRIES_BELOW_M, CarriedLoad
from retarget.either_sole import EitherSole
from retarget.planted_root import plant_root
from retarget.rotations import FloatArray
from retarget.stance import plant

STANCE = plant(op3(), op3().profile.postures.stand)


def bent(side: str, knee: float) -> FloatArray:
    """The standing posture with one leg drawn up, its root somewhere else."""
    sign = 1.0 if side == "l" else -1.0
    angles = dict(op3().profile.postures.stand)
    angles[f"{side}_knee"] += sign * knee
    angles[f"{side}_hip_pitch"] -= sign * 0.5 * knee
    angles[f"{side}_ank_pitch"] += sign * 0.5 * knee
    q = op3().posture(angles)
    q[:3] += [0.3, -0.2, 0.1]
    return q


@pytest.mark.parametrize(("side", "other"), [("l", "r_sole"), ("r", "l_sole")])
def test_the_sole_of_the_straighter_leg_is_where_it_was_planted(side: str, other: str) -> None:
    q = bent(side, 0.3)
    heights = EitherSole(op3(), STANCE).plant(q)
    place = next(sole.position for sole in STANCE.soles if sole.frame.name == other)
    assert np.abs(op3().points(q[None], (other,))[0, 0] - place).max() < 1e-9
    assert sorted(heights)[0] == pytest.approx(0.0, abs=1e-12) and sorted(heights)[1] > 0.005


def test_on_both_it_is_as_with_planted_soles() -> None:
    q, same = bent("l", 0.0), bent("l", 0.0)
    EitherSole(op3(), STANCE).plant(q)
    plant_root(op3(), STANCE.q, same)
    assert np.abs(q - same).max() < 1e-6


def test_a_sole_in_the_air_carries_nothing_and_none_leaps() -> None:
    load, still = CarriedLoad(op3(), STANCE), np.zeros(3)
    both = load.torques(STANCE.q, still)
    assert (load.torques(STANCE.q, still, heights=np.zeros(2)) == both).all()
    alone = load.torques(STANCE.q, still, heights=np.array([0.0, 1.0]))
    right = [op3().body.dof_index(joint) for joint in ("r_knee", "r_ank_pitch")]
    # It still carries its shank.
    assert np.abs(alone[right]).max() < 0.5 * np.abs(both[right]).max()
    way = [load.torques(STANCE.q, still, heights=np.array([0.0, h])) for h in np.linspace(0.0, CARRIES_BELOW_M, 50)]
    assert np.abs(np.diff(way, axis=0)).max() < 0.05
