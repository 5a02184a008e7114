"""A recorded run, looked at: every tick as it was, with what observers and servos did."""

from pathlib import Path

import numpy as np
import pytest

from faulty_bus import FaultKind, MockFault
from followers import op3
from recordings import record, recorded
from retarget.run.run_result import RunResult
from retarget.types import FloatArray
from retarget.web.recorded import open_recorded
from retarget.web.shown import joint_tracks, moved, observers_at, present


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
    assert len(seen) == len(run.record.time)
    np.testing.assert_allclose(seen.time, run.record.time, atol=1e-9)
    columns = run.robot.servo_columns
    order = [seen.cast.joints.index(joint) for joint in run.robot.joint_map.joints]
    np.testing.assert_allclose(seen.q, sent.q, atol=1e-6)
    np.testing.assert_allclose(present(seen.cast, seen, seen.q)[:, columns], sent.present, atol=1e-9)
    np.testing.assert_array_equal(seen.temperature[:, order], sent.temperature)
    assert seen.current.min() > 0.01 and seen.cast.sensors == run.sensors
    acts = np.isfinite(observers_at(seen.cast, seen)[0]).all(axis=2)
    np.testing.assert_array_equal(acts, sent.observer_modes > 0)
    for row in range(0, len(seen), 7):
        of = np.abs(run.record.human_q[: row + 1] - seen.human_q[row]).max(axis=1)
        made_of = run.record.sensors[: row + 1][of < 1e-6]
        assert any(np.array_equal(seen.sensors[row], one) for one in made_of), (
            "those that the human who is shown is made of"
        )
        assert np.abs(seen.human_q[row] - run.record.human_q[max(row - 10, 0) : row + 1]).min(axis=0).max() < 1e-4
    tracks = joint_tracks(seen.cast, seen)
    np.testing.assert_allclose(tracks["goal"][:, order], np.degrees(sent.q[:, columns]), atol=1e-4)
    np.testing.assert_allclose(tracks["servo"][:, order], np.degrees(sent.present), atol=1e-6)
    np.testing.assert_array_equal(tracks["temperature"][:, order], sent.temperature)


@pytest.mark.long
def test_what_no_servo_measured_is_not_shown(tmp_path: Path, path: Path, run: RunResult) -> None:
    """Mock servos measure nothing."""
    unknown = tuple(MockFault(FaultKind.HOT, 0, 10**6, servo=servo, value=float("nan")) for servo in range(20))
    record(tmp_path / "run.mcap", faults=unknown)
    assert run.robot is not None and open_recorded(path).cast.servos_measure, "these measure it"
    assert not open_recorded(tmp_path / "run.mcap").cast.servos_measure


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
    q = moved(seen.cast, seen)
    there = present(seen.cast, seen, q)
    np.testing.assert_allclose(there[50, robot.servo_columns], run.record.robot.present[50], atol=1e-9)
    np.testing.assert_allclose(q[50], seen.q[50], atol=1e-9)
    np.testing.assert_array_equal(there[-1, :7], truth[:7])
    np.testing.assert_allclose(there[-1, 7:], truth[7:-2], atol=1e-6)
