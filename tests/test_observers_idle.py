"""Observers that have nothing to do: out of influence nothing changes, and pairs that sleep are not missed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import followers
from observed import Rig, aim, ball, chain, rig, rod
from observed_robot import act, around, human, robot
from reconstructions import thinned
from retarget import _solver
from retarget.calibration import calibrate
from retarget.human import build_human
from retarget.observer_pairs import placed
from retarget.observers import Observers, robot_observers
from retarget.performer import load_performer
from retarget.priorities import ObserverSettings, Priorities, load_priorities
from retarget.reconstruct import Reconstructor
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.scene_motion import SceneState
from sim.performer import synthetic_performer

FAR: dict[str, Any] = {
    "ball": {"shape": {"sphere": {"radius": 0.1}}, "at": {"pos": (0.0, 5.0, 1.0)}, "velocity": (0.0, 0.1, 0.0)},
    "wall": {"shape": {"half_space": {"point": (4.0, 0.0, 0.0), "normal": (-1.0, 0.0, 0.0)}}},
    "box": {"shape": {"box": {"size": (0.1, 0.2, 0.3)}}, "at": {"pos": (-3.0, 0.0, 1.0)}},
}


def without_observers(priorities: Priorities) -> Priorities:
    """The same levels, empty where observers were."""
    levels = tuple(
        level.model_copy(update={"tasks": tuple(t for t in level.tasks if t.type not in ("reactive", "preventive"))})
        for level in priorities.levels
    )
    return priorities.model_copy(update={"levels": levels})


def reconstructed(priorities: Priorities, scene: SceneState | None) -> tuple[FloatArray, FloatArray]:
    """Postures (T, nq), and modes of observers (T, n)."""
    frames = thinned(synthetic_performer().cut(0.0, 1.5), 2)
    made = Reconstructor(build_human(calibrate(frames)), priorities, load_performer("five"), scene=scene)
    done = [made.start(frames.sample(0.0))]
    done += [made.step(frames.sample(time), 1.0 / 60.0) for time in frames.time[1:]]
    return np.array([posture.q for posture in done]), np.array([posture.observer_modes for posture in done])


@pytest.mark.parametrize("name", ["human", "paper"])
@pytest.mark.parametrize("scene", [False, True], ids=["alone", "far obstacles"])
def test_out_of_influence_the_human_moves_as_without_observers(name: str, scene: bool) -> None:
    priorities = load_priorities(name)
    bare, _ = reconstructed(without_observers(priorities), None)
    small = ObserverSettings(human=priorities.observers.human, influence=2e-3, margin=1e-3)
    q, modes = reconstructed(priorities.model_copy(update={"observers": small}), around(**FAR) if scene else None)
    assert modes.shape[1] > 7 and not modes.any()
    assert q == pytest.approx(bare, abs=1e-9)


@pytest.mark.parametrize("scene", [False, True], ids=["alone", "far obstacles"])
def test_out_of_influence_the_robot_moves_as_without_observers(monkeypatch: pytest.MonkeyPatch, scene: bool) -> None:
    def small(of: RobotBody) -> Observers:
        made = robot_observers(of)
        n = len(made.names)
        return replace(made, influence=np.full(n, 2e-3), margin=np.full(n, 1e-3))

    motion = human()[:50]  # before it folds onto its thighs
    bare = act(robot(None, without_observers(load_priorities("servo"))), None, motion)
    monkeypatch.setattr("retarget.follow.robot_observers", small)
    done = act(robot(around(**FAR) if scene else None), None, motion)
    assert not any(posture.observer_modes.any() for posture in done.postures)
    assert done.q == pytest.approx(bare.q, abs=1e-9)


def test_no_pair_of_the_robot_is_ever_overlooked() -> None:
    """Every pair in every frame of a motion that brings arms near the body: never below what the law permits."""
    done = act(robot(None), None, human()[:900])
    own, body = robot_observers(followers.op3()), followers.op3().body
    first, second = own.pairs.T
    margin = np.maximum(own.margin[first], own.margin[second])
    room = np.maximum(own.influence[first], own.influence[second]) - margin
    before, least = None, np.inf
    for q in done.q:
        position, quat = placed(body, own, q)
        now = _solver.shape_distances(
            *(own.kinds[first], own.sizes[first], position[first], quat[first]),
            *(own.kinds[second], own.sizes[second], position[second], quat[second]),
        )[0]
        if before is not None:
            floor = margin + np.minimum(before - margin, room) * np.exp(-0.5 * followers.DT / room)
            least = min(least, float((now - floor).min()))
        before = now
    assert least > -1e-4
    assert sum(posture.observer_modes.any() for posture in done.postures) > 100


def reaching(made: Rig) -> _solver.Solver:
    levels = [[_solver.Task.reactive()], [_solver.Task.preventive()], [_solver.Task.position(7, (0.2, 0.0, 0.0))]]
    return made.solver(levels, activation="all", n_ik=1, speed=2.0, acceleration=20.0)


def test_pairs_that_sleep_change_nothing() -> None:
    """Against a solver that is told posture and velocity anew in every frame, so that it knows no distance."""
    obstacles = [ball(at=(0.5, 0.45, 0.0)), ball(at=(-0.6, 0.3, 0.0)), ball(at=(0.9, -0.4, 0.0))]
    made = rig(chain(7), [rod(k + 1) for k in range(7)], obstacles, [(a, b) for a in range(7) for b in range(a + 2, 7)])
    remembers, forgets = reaching(made), reaching(made)
    made.show(forgets)
    near = 0
    for t in range(600):
        goal = 0.9 * np.array([np.cos(0.01 * t), np.sin(0.023 * t), 0.0])
        forgets.reset(remembers.q, remembers.velocity)
        one = remembers.frame(aim(remembers, l2_0=goal), 0.01)
        other = forgets.frame(aim(forgets, l2_0=goal), 0.01)
        assert one == pytest.approx(other, abs=1e-9), t
        near += int(remembers.observer_modes.any())
    assert near > 100
