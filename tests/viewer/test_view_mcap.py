"""A recorded run, looked at: every tick as it was, with what observers and servos did."""

from pathlib import Path

import numpy as np
import pytest

from followers import op3
from recordings import recorded
from retarget.run.run_result import RunResult
from retarget.types import FloatArray
from retarget.viewer.joint_plot import curves
from retarget.viewer.recorded import open_recorded
from viewed import shown


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("run") / "run.mcap"


@pytest.fixture(scope="module")
def run(path: Path) -> RunResult:
    return recorded(path, robot="op3", stop=400)


@pytest.mark.long
def test_every_tick_is_as_it_was(path: Path, run: RunResult) -> None:
    seen, sent = open_recorded(path), run.record.robot
    assert sent is not None and run.robot is not None
    assert len(seen.times) == len(run.record.time)
    np.testing.assert_allclose(seen.times, run.record.time, atol=1e-9)
    columns = run.robot.servo_columns
    order = [seen.cast.joints.index(joint) for joint in run.robot.joint_map.joints]
    for row in range(0, len(seen.times), 7):
        snapshot = shown(seen, row)
        np.testing.assert_allclose(snapshot.q, sent.q[row], atol=1e-6)
        np.testing.assert_allclose(snapshot.robot[columns], sent.present[row], atol=1e-9)
        np.testing.assert_array_equal(snapshot.temperature[order], sent.temperature[row])
        assert snapshot.current.min() > 0.01
        assert snapshot.observer_modes.shape == sent.observer_modes[row].shape
        assert seen.cast.sensors == run.sensors
        of = np.abs(run.record.human_q[: row + 1] - snapshot.human_q).max(axis=1)
        made_of = run.record.sensors[: row + 1][of < 1e-6]
        assert any(np.array_equal(snapshot.sensors, one) for one in made_of), (
            "those that the human who is shown is made of"
        )
        assert np.abs(snapshot.human_q - run.record.human_q[max(row - 10, 0) : row + 1]).min(axis=0).max() < 1e-4
    _, goal, present = curves(seen, seen.cast, order[4], "angle")
    np.testing.assert_allclose(goal, np.degrees(sent.q[:, columns[4]]), atol=1e-4)
    np.testing.assert_allclose(present, np.degrees(sent.present[:, 4]), atol=1e-6)
    np.testing.assert_array_equal(curves(seen, seen.cast, order[4], "temperature")[2], sent.temperature[:, 4])


@pytest.mark.long
def test_a_simulated_body_is_where_it_really_was(tmp_path: Path) -> None:
    """Fallen, say, with bent knees; until that is known, it is where its servos have it."""
    path, ticks, robot = tmp_path / "run.mcap", 0, op3()
    truth = np.concatenate([[0.5, 0.25, 0.125, 0.0, 1.0, 0.0, 0.0], np.linspace(-0.5, 0.5, 20), [0.0625, -0.25]])

    def late_truth() -> FloatArray | None:
        nonlocal ticks
        ticks += 1
        return truth if ticks > 100 else None

    run = recorded(path, robot="op3", truth=late_truth)
    seen = open_recorded(path)
    assert run.record.robot is not None
    before, after = shown(seen, 50), shown(seen, len(seen.times) - 1)
    assert np.isnan(before.pressure).all()
    np.testing.assert_allclose(before.robot[robot.servo_columns], run.record.robot.present[50], atol=1e-9)
    np.testing.assert_array_equal(after.robot[:7], truth[:7])
    np.testing.assert_allclose(after.robot[7:], truth[7:-2], atol=1e-6)
    assert after.pressure.tolist() == [0.0625, -0.25]
