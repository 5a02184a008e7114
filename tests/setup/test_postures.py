"""Postures in which a drafted robot does not touch itself."""

from pathlib import Path

import numpy as np
import pytest

from retarget.model.observers import NEAR_LINKS, robot_observers
from retarget.model.robot import load_profile, load_robot
from retarget.setup import postures
from retarget.setup.import_robot import import_robot
from retarget.setup.robot_file import Relaxed
from unknown_robots import small_bust


def imported(text: str, folder: Path) -> Path:
    path = folder / "body.urdf"
    path.write_text(text, encoding="utf-8")
    return import_robot(path, folder / "new", relaxed=Relaxed(), samples=20).folder


@pytest.mark.long
def test_nothing_is_ignored_where_nothing_touches(tmp_path: Path) -> None:
    folder = imported(small_bust(), tmp_path)
    text = (folder / "robot.yaml").read_text()
    assert "touch in the drafted postures" not in text
    assert not [pair for pair in robot_observers(load_robot(folder)).dropped if "neutral posture" in pair.reason]


def test_what_touches_in_every_posture_is_ignored_and_marked(tmp_path: Path) -> None:
    """Forearms so wide that both meet in front of the chest, whatever shoulders and elbows do: a run may begin."""
    text = small_bust().replace('<box size="0.03 0.1 0.03"/>', '<box size="0.3 0.1 0.03"/>')
    folder = imported(text, tmp_path)
    (ignored,) = [entry for entry in load_profile(folder).ignore_pairs if set(entry.pair) == {"p2", "q2"}]
    has_reason = "overlap at every posture" in ignored.reason or "touch in the drafted postures" in ignored.reason
    assert has_reason and robot_observers(load_robot(folder)).names


@pytest.mark.parametrize(
    ("steps", "neutral", "stand", "listed"),
    [
        (2, 0.001, -0.0005, True),  # neighbours that a run would be refused for
        (2, 0.001, 0.001, False),
        (2, -0.001, -0.002, False),  # never looked at
        (3, 0.001, 0.01, True),
        (3, 0.01, 0.0015, True),
        (3, 0.01, 0.01, False),
    ],
)
def test_a_pair_is_listed_where_a_run_would_be_refused_for_it(
    steps: int, neutral: float, stand: float, listed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = object.__new__(postures._Bench)
    bench._near, bench._links = np.array([steps <= NEAR_LINKS]), [("a", "b")]
    distance = {"neutral": neutral, "stand": stand, "attractor": 1.0}
    monkeypatch.setattr(bench, "_distances", lambda angles: np.array([distance[angles["name"]]]), raising=False)
    found = bench.touching({name: {"name": name} for name in distance})  # type: ignore[dict-item]
    assert found == ((("a", "b"),) if listed else ())


@pytest.mark.long
@pytest.mark.parametrize("width", ["0.12", "0.24"])
def test_a_wide_chest_pushes_nothing_into_the_arms(width: str, tmp_path: Path) -> None:
    text = small_bust().replace('<box size="0.12 0.08 0.2"/>', f'<box size="{width} 0.08 0.2"/>')
    robot = load_robot(imported(text, tmp_path))
    robot_observers(robot)  # raises where parts that are far apart touch in the neutral posture
