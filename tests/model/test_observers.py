"""What a human observes with: the paper's lines, or every segment; at any size, posture and setting."""

from dataclasses import replace
from functools import cache
from itertools import combinations
from typing import Any

import numpy as np
import pytest

import followers
from followers import op3
from messages import refuses, shows
from observed import Rig, aim, ball, chain, rig, rod
from observed_robot import act, robot, scene_of
from observed_robot import human as observers_idle_human
from observers_idle_helpers import without_observers
from reconstructions import thinned
from retarget import _solver
from retarget.errors import ConfigError
from retarget.human.calibration import calibrate
from retarget.human.reconstruction import Reconstructor
from retarget.model.body import BodyModel, load_body_text
from retarget.model.human import Human, PostureReader, build_human
from retarget.model.human_dimensions import POINTS, proportional_dimensions
from retarget.model.observers import (
    Observers,
    ObserverSet,
    PairRules,
    Part,
    assemble,
    human_observers,
    placed,
    robot_observers,
)
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import ShapeKind
from retarget.model.scene_state import SceneState
from retarget.rotations import rotate
from retarget.schema.performer import load_performer
from retarget.schema.priorities import ObserverSettings, Priorities, load_priorities
from retarget.types import FloatArray
from sim.performer import synthetic_performer

LINES = [f"{side}_{joint}" for joint in ("shoulder", "elbow", "hip", "knee") for side in ("l", "r")]
FAR_ENDS = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle"}


@cache
def human(height: float = 1.75) -> Human:
    return build_human(proportional_dimensions(height))


@pytest.mark.parametrize(("chosen", "count"), [("lines", 8), ("lines_and_head", 9), ("capsules", 19)])
@pytest.mark.parametrize("height", [1.0, 1.75, 2.1])
def test_as_many_as_the_paper_has_at_any_size(chosen: ObserverSet, count: int, height: float) -> None:
    made = human_observers(human(height), ObserverSettings(human=chosen))
    assert made is not None and len(made.names) == count
    assert len(made.pairs) > 20


def test_none_are_worn_where_none_are_wanted() -> None:
    assert human_observers(human(), ObserverSettings(human="none")) is None
    assert human_observers(human(), ObserverSettings(human="capsules"), "none") is None
    made = human_observers(human(), ObserverSettings(human="none"), "lines")
    assert made is not None and list(made.names) == LINES


@pytest.mark.parametrize("posture", ["stand", "attractor", "crouch"])
def test_lines_go_from_joint_to_joint(posture: str) -> None:
    made, q = human_observers(human(), ObserverSettings(human="lines_and_head")), human().posture(posture)
    assert made is not None
    position, quat = placed(human().body, made, q)
    joints = PostureReader(human()).joints(q[None])[0]
    for k, name in enumerate(LINES):
        side, joint = name.split("_")
        ends = [joints[POINTS.index(f"{side}_{part}")] for part in (joint, FAR_ENDS[joint])]
        radius, half, _ = made.sizes[k]
        axis = rotate(quat[k], np.array([0.0, 0.0, half]))
        assert radius == 0.0
        assert [position[k] - axis, position[k] + axis] == [pytest.approx(end, abs=1e-9) for end in ends]
    assert made.names[8] == "head" and made.sizes[8, 0] > 0.05 and made.sizes[8, 1] == 0.0


def test_zones_are_those_of_the_settings() -> None:
    given = human_observers(human(), ObserverSettings(human="lines", influence=0.2, margin=0.03))
    usual = human_observers(human(), ObserverSettings(human="lines"))
    assert given is not None and usual is not None
    assert (given.influence == 0.2).all() and (given.margin == 0.03).all()
    assert (usual.influence == 0.08).all() and (usual.margin == 0.01).all()


def test_limbs_look_at_each_other_and_at_the_trunk() -> None:
    made = human_observers(human(), ObserverSettings(human="capsules"))
    assert made is not None
    pairs = {frozenset(made.names[k] for k in pair) for pair in made.pairs.tolist()}
    for pair in (("l_wrist", "r_wrist"), ("r_elbow", "pelvis"), ("l_knee", "r_knee"), ("l_wrist", "head")):
        assert frozenset(pair) in pairs
    assert {entry.reason.split(" by ")[0] for entry in made.dropped} == {"neighbours along the body", "touch"}


ARM = """<mujoco><worldbody><body name="base"><geom size="0.01"/>
  <body name="plate" pos="0 0 0.1"><geom size="0.01"/></body>
  <body name="a" pos="0.2 0 0"><joint name="ja" axis="0 0 1"/><geom size="0.01"/>
    <body name="b" pos="0.2 0 0"><joint name="jb" axis="0 0 1"/><geom size="0.01"/>
      <body name="c" pos="0.2 0 0"><joint name="jc" axis="0 0 1"/><geom size="0.01"/>
        <body name="d" pos="0.2 0 0"><joint name="jd" axis="0 0 1"/><geom size="0.01"/></body></body></body></body>
</body></worldbody></mujoco>"""
TRIANGLE = (0.0, 2.0 * np.pi / 3, 2.0 * np.pi / 3, 0.0)
LINKS = ("base", "plate", "a", "b", "c", "d")


def arm() -> BodyModel:
    return load_body_text(ARM, source="arm")


def balls(
    radius: float, angles: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0), ignored: tuple[tuple[str, str], ...] = ()
) -> Observers:
    """A ball on every link."""
    body = arm()
    rules = PairRules(
        neutral=np.array(angles),
        ignored=tuple((body.body_index(a), body.body_index(b), "because") for a, b in ignored),
        where="arm",
    )
    row = (ShapeKind.CAPSULE, (radius, 0.0, 0.0), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return assemble(body, {name: Part(body.body_index(name), *row, 0.05, 0.0) for name in LINKS}, rules)


def looked_at(observers: Observers) -> set[frozenset[str]]:
    return {frozenset(observers.names[k] for k in pair) for pair in observers.pairs.tolist()}


def dropped(observers: Observers) -> dict[frozenset[str], str]:
    return {frozenset((pair.first, pair.second)): pair.reason for pair in observers.dropped}


def test_neighbours_are_not_looked_at_and_fixed_links_are_one() -> None:
    found = balls(0.01)
    near = "neighbours along the body"
    assert dropped(found) == {
        **{frozenset(pair): near for pair in (("base", "a"), ("plate", "a"), ("a", "b"), ("b", "c"), ("c", "d"))},
    }
    one = {frozenset(("base", "plate"))}
    every = {frozenset(pair) for pair in combinations(LINKS, 2)}
    assert looked_at(found) == every - set(dropped(found)) - one


def test_ignored_pairs_keep_their_reason() -> None:
    found = balls(0.01, ignored=(("a", "c"), ("d", "base")))
    assert dropped(found)[frozenset(("a", "c"))] == dropped(found)[frozenset(("base", "d"))] == "because"
    assert not looked_at(found) & {frozenset(("a", "c")), frozenset(("base", "d"))}


def test_what_touches_at_rest_is_dropped_and_the_reason_shows_how_deep() -> None:
    """Balls of 21 cm two joints apart overlap by 2 cm."""
    found = balls(0.21)
    assert {pair: reason for pair, reason in dropped(found).items() if "touch" in reason} == {
        frozenset(pair): "touch by 20.0 mm in the neutral posture" for pair in (("a", "c"), ("b", "d"), ("base", "b"))
    } | {frozenset(("plate", "b")): f"touch by {1e3 * (0.42 - np.hypot(0.4, 0.1)):.1f} mm in the neutral posture"}


def test_what_is_far_apart_along_the_body_and_touches_is_refused() -> None:
    """Folded so that the last link lies on the first."""
    with refuses(ConfigError) as refused:
        balls(0.03, angles=TRIANGLE)
    text = str(refused.value)
    shows(text, 3)
    calm = balls(0.03, angles=TRIANGLE, ignored=(("a", "d"),))
    assert dropped(calm)[frozenset(("a", "d"))] == "because"


def test_every_pair_of_op3_is_looked_at_or_dropped_with_a_reason() -> None:
    found = robot_observers(op3())
    assert len(found.names) == 23 and len(found.pairs) == 223 and len(found.dropped) == 28
    assert len({tuple(sorted(pair)) for pair in found.pairs.tolist()}) == 223
    links = dict(zip(found.names, found.links.tolist(), strict=True))
    every = {frozenset(pair) for pair in combinations(found.names, 2) if links[pair[0]] != links[pair[1]]}
    assert looked_at(found) | set(dropped(found)) == every and not looked_at(found) & set(dropped(found))
    reasons = set(dropped(found).values())
    assert reasons == {"neighbours along the body", op3().profile.ignore_pairs[0].reason}


FAR: dict[str, Any] = {
    "ball": {"shape": {"sphere": {"radius": 0.1}}, "at": {"pos": (0.0, 5.0, 1.0)}, "velocity": (0.0, 0.1, 0.0)},
    "wall": {"shape": {"half_space": {"point": (4.0, 0.0, 0.0), "normal": (-1.0, 0.0, 0.0)}}},
    "box": {"shape": {"box": {"size": (0.1, 0.2, 0.3)}}, "at": {"pos": (-3.0, 0.0, 1.0)}},
}


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
    q, modes = reconstructed(priorities.model_copy(update={"observers": small}), scene_of(**FAR) if scene else None)
    assert modes.shape[1] > 7 and not modes.any()
    assert q == pytest.approx(bare, abs=1e-9)


@pytest.mark.parametrize("scene", [False, True], ids=["alone", "far obstacles"])
def test_out_of_influence_the_robot_moves_as_without_observers(monkeypatch: pytest.MonkeyPatch, scene: bool) -> None:
    def small(of: RobotBody) -> Observers:
        made = robot_observers(of)
        n = len(made.names)
        return replace(made, influence=np.full(n, 2e-3), margin=np.full(n, 1e-3))

    motion = observers_idle_human()[:50]  # before it folds onto its thighs
    bare = act(robot(None, without_observers(load_priorities("servo"))), None, motion)
    monkeypatch.setattr("retarget.robot.follower.robot_observers", small)
    done = act(robot(scene_of(**FAR) if scene else None), None, motion)
    assert not any(posture.observer_modes.any() for posture in done.postures)
    assert done.q == pytest.approx(bare.q, abs=1e-9)


def test_no_pair_of_the_robot_is_ever_overlooked() -> None:
    """Every pair in every frame of a motion that brings arms near the body: never below what the law permits."""
    done = act(robot(None), None, observers_idle_human()[:900])
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
    """Against a solver that gets posture and velocity anew in every frame, so that it knows no distance."""
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
