"""Clearance is exact near by, and found far away too."""

from pathlib import Path

import numpy as np
import pytest

from retarget.metrics.clearance import Clearance, self_clearance

TWO_BALLS = """
<mujoco><worldbody>
  <body name="base"><geom type="sphere" size="0.01" mass="1"/>
    <body name="arm"><joint name="s" type="slide" axis="1 0 0"/><geom type="sphere" size="0.001" mass="1"/>
      <body name="hand"><geom type="sphere" size="0.01" pos="0.02 0 0" mass="1"/></body>
    </body>
  </body>
</worldbody></mujoco>"""


def clearance(folder: Path, gaps: list[float]) -> Clearance:
    """Of two balls with these gaps (m) between them, one posture each."""
    path = folder / "balls.xml"
    path.write_text(TWO_BALLS)
    postures = np.array([[gap] for gap in gaps])
    return self_clearance(path, postures, root="fixed", neutral=np.array([1.0]))


@pytest.mark.parametrize("nearest", [-0.004, 0.003, 0.03, 0.4])
def test_the_smallest_gap_is_found_however_far(tmp_path: Path, nearest: float) -> None:
    found = clearance(tmp_path, [nearest, *np.linspace(0.5, 0.6, 30)])
    assert found.smallest == pytest.approx(nearest, abs=1e-9)
    assert found.penetrating == (1 if nearest < 0.0 else 0)
    assert found.pair is not None and set(found.pair) == {"base", "hand"}


def test_one_posture_among_many_is_seen_where_it_matters(tmp_path: Path) -> None:
    gaps = [0.5] * 40
    gaps[33] = 0.04
    assert clearance(tmp_path, gaps).smallest == pytest.approx(0.04, abs=1e-9)


def test_what_never_comes_near_has_no_clearance(tmp_path: Path) -> None:
    assert clearance(tmp_path, [3.0, 4.0]) == Clearance(None, 0, None)
