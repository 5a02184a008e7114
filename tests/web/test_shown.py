"""What a page draws of a row: figures in one colour code, and tracks that are NaN where nothing is known."""

from typing import Any

import numpy as np
import pytest

from followers import dimensions, op3, performer
from retarget import _solver
from retarget.model.human import Human, build_human
from retarget.model.meshes import LEFT, RIGHT, rgb, shape_mesh
from retarget.model.observers import placed, robot_observers
from retarget.run.table import RunTable
from retarget.web.shown import Cast, live_tracks

AWAY = np.array([[0.0, 2.0, 0.3, 1.0, 0.0, 0.0, 0.0]])


@pytest.fixture(scope="module")
def human() -> Human:
    return build_human(dimensions(performer()))


@pytest.fixture(scope="module")
def cast(human: Human) -> Cast:
    robot = op3()
    return Cast(
        human=human.solid,
        robot=robot.solid,
        profile=robot,
        joints=robot.joint_map.joints,
        landmarks=("l_hand",),
        sensors=("l_wrist", "head"),
        obstacles=[shape_mesh(0, (0.05, 0.0, 0.0))],
    )


def row(human: Human, **changed: Any) -> RunTable:
    """OP3 as its file has it, at its goals."""
    known = {"time": np.array(0.0), "q": op3().body.qpos0, "human_q": human.body.qpos0, "present": np.zeros(20)}
    return RunTable(**known | changed)


def test_left_is_orange_and_right_is_blue_of_performer_and_robot(cast: Cast) -> None:
    scene = cast.as_json()
    sides = {tuple(round(value, 3) for value in rgb(side)) for side in (LEFT, RIGHT)}
    for body in (scene["human"]["body"], scene["robot"]["body"]):
        assert sides < {tuple(mesh["colour"]) for mesh in body["meshes"]}
    assert scene["robot"]["layers"] == ["desired", "goal", "pass", "scene", "observers"]
    assert scene["human"]["layers"] == ["servos"] and scene["joints"] == cast.joints


def test_every_track_has_the_numbers_of_its_figure(cast: Cast, human: Human) -> None:
    def drawn_links(body: dict[str, Any]) -> set[int]:
        return {mesh["link"] for mesh in body["meshes"]}  # one mesh for each colour

    scene = cast.as_json()
    desired, sensors = np.full((1, 3), 0.1), np.array([[0.0, 0.0, 1.0], [np.nan] * 3])
    tracks = live_tracks(cast, row(human, landmarks_asked=desired, sensors=sensors, obstacles=AWAY))
    parts = {"poses": "body", "goal": "body", "scene": "scene", "observers": "observers"}
    for track, part in parts.items():
        assert tracks[f"robot.{track}"].size == 7 * len(drawn_links(scene["robot"][part])), part
    assert tracks["human.poses"].size == 7 * len(drawn_links(scene["human"]["body"]))
    assert tracks["robot.corners"].size == 3 * sum(scene["robot"]["sizes"]) and tracks["robot.com"].size == 3
    np.testing.assert_array_equal(tracks["robot.marks"][0], desired)
    assert np.isnan(tracks["human.marks"][0, 1]).all(), "the head's is not valid"
    assert tracks["joints.servo"].size == 20 and np.isnan(tracks["joints.current"]).all()


def test_the_robot_is_where_its_servos_are_and_the_goal_is_pale_beside_it(cast: Cast, human: Human) -> None:
    servos = np.where(np.arange(20) == 3, np.nan, 0.1)
    tracks, q = live_tracks(cast, row(human, present=servos)), op3().body.qpos0.copy()
    np.testing.assert_allclose(tracks["robot.goal"], op3().solid.poses(q[None]))
    q[cast.columns] = np.where(np.isfinite(servos), servos, q[cast.columns])
    np.testing.assert_allclose(tracks["robot.poses"], op3().solid.poses(q[None]))
    np.testing.assert_allclose(tracks["joints.servo"][0, 0], np.degrees(0.1))


def test_a_simulated_body_is_where_its_physics_has_it(cast: Cast, human: Human) -> None:
    truth = np.concatenate([[0.5, 0.25, 0.125, 0.0, 1.0, 0.0, 0.0], np.linspace(-0.5, 0.5, 20), [0.0, 0.0]])
    tracks = live_tracks(cast, row(human, truth=truth))
    np.testing.assert_allclose(tracks["robot.poses"], op3().solid.poses(truth[None, :-2]), atol=1e-12)


def test_only_observers_that_act_are_shown_where_they_are(cast: Cast, human: Human) -> None:
    known = robot_observers(op3())
    modes = np.zeros(len(known.names), dtype=np.uint8)
    modes[2] = 1
    shown = live_tracks(cast, row(human, observer_modes=modes))["robot.observers"][0]
    assert np.flatnonzero(np.isfinite(shown).all(axis=1)).tolist() == [2]
    places = op3().points(op3().body.qpos0[None], op3().landmark_frames(("l_hand",)))
    assert np.abs(shown[2, :3] - places).max() < 1.0
    assert np.isnan(live_tracks(cast, row(human))["robot.observers"]).all()


def test_the_nearest_two_are_shown_where_one_of_them_acts(cast: Cast, human: Human) -> None:
    """The line between them is as long as the observers are apart; nothing is near where the rest is far away."""
    known = robot_observers(op3())
    places, turns = placed(op3().body, known, op3().body.qpos0)
    sides = []
    for column in map(np.ascontiguousarray, known.pairs.T):
        sides += [known.kinds[column], known.sizes[column], places[column], turns[column]]
    distances = _solver.shape_distances(*sides)[0]
    modes = np.zeros(len(known.names), dtype=np.uint8)
    modes[known.pairs[int(np.argmin(distances)), 0]] = 1
    begin, end = live_tracks(cast, row(human, observer_modes=modes))["robot.near"][0]
    assert np.linalg.norm(end - begin) == pytest.approx(abs(distances.min()), abs=1e-6)
    alone = int(np.argmax([distances[(known.pairs == one).any(axis=1)].min() for one in range(len(modes))]))
    assert distances[(known.pairs == alone).any(axis=1)].min() > known.influence.max()
    modes[:] = np.arange(len(modes)) == alone
    assert np.isnan(live_tracks(cast, row(human, observer_modes=modes))["robot.near"]).all()


def test_a_human_alone_has_the_obstacles(human: Human) -> None:
    alone = Cast(human=human.solid, sensors=("head",), obstacles=[shape_mesh(0, (0.05, 0.0, 0.0))])
    scene = alone.as_json()
    assert scene["robot"] is None and scene["human"]["layers"] == ["servos", "scene"]
    tracks = live_tracks(alone, RunTable(time=np.array(0.0), human_q=human.body.qpos0, obstacles=AWAY))
    assert set(tracks) == {"human.poses", "human.view", "human.scene"}
