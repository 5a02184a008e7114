"""A centre of mass on its way from over both soles to over one, pushed by a zero-moment point that stays inside."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import DT, op3
from retarget.stance import plant
from retarget.standing_balance import GRAVITY
from retarget.step_balance import StepBalance
from retarget.weight_shift import WeightShift

HEIGHT = 0.25
STANCE = plant(op3(), op3().profile.postures.stand)
BALANCE = StepBalance(STANCE, 0.25)
STILL = np.zeros(3)


def shift() -> WeightShift:
    return WeightShift(room=BALANCE.room, height=HEIGHT)


@settings(max_examples=20)
@given(share_x=st.floats(-0.99, 0.99), share_y=st.floats(-0.99, 0.99), foot=st.sampled_from([1, 2]))
def test_from_wherever_it_stands_it_arrives_and_is_never_pushed_from_outside(
    share_x: float, share_y: float, foot: int
) -> None:
    way = shift()
    way.restart(np.array([0.0158 * share_x, 0.0216 * share_y, HEIGHT]), STILL, DT)
    rows = [np.array(way.at)] * 2
    rows += [way.step(BALANCE.middles[foot], BALANCE.on_the_way, DT).copy() for _ in range(500)]
    path = np.array(rows)
    pushed = path[1:-1] - HEIGHT / GRAVITY * np.diff(path, n=2, axis=0) / DT**2
    worst = min(BALANCE.depth(BALANCE.on_the_way, np.array([*point, 0.0]), STILL, STILL) for point in pushed)
    assert worst > -1e-9
    assert np.abs(path[-1] - BALANCE.middles[foot]).max() < 1e-6


def test_who_stands_at_the_edge_still_goes_along_it() -> None:
    """No room to be pushed away from the edge, but along it."""
    edge = max(offset for nx, _, offset in BALANCE.on_the_way if nx == 1.0)
    way = shift()
    way.restart(np.array([edge, 0.0, HEIGHT]), STILL, DT)
    for _ in range(50):
        way.step(BALANCE.middles[1], BALANCE.on_the_way, DT)
    assert way.at[1] > 0.01 and way.at[0] <= edge + 1e-12
