"""Every robot that is shipped stands through the demo with mass, goes to rest, and moves."""

import pytest

from benchmarks.physics_runs import play, stood
from retarget.report.measure import measure
from retarget.run.options import RunOptions
from sim.performer import synthetic_performer

pytest.importorskip("mujoco")


@pytest.mark.long
@pytest.mark.parametrize("robot", ["op3", "poppy", "toddlerbot", "wolfgang"])
def test_it_stands_through_the_demo_in_physics(robot: str) -> None:
    run = play(synthetic_performer(), RunOptions(robot=robot, bus="physics"))
    end = stood("none", 0, run)
    assert (end.fallen_at, end.stopped) == (None, "")
    report = measure(run)
    assert report.hand_path_ratio is not None and report.hand_path_ratio > 0.7
