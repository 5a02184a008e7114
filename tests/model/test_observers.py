"""Observers of humans and robots: what they look at, the floor, margins, and the bounds of distances."""

from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import followers
from followers import ROBOTS, op3, shipped, stance
from gated_robot import GatedRobot
from messages import refuses, shows
from observed import act, aim, ball, binding, chain, rig, robot, scene_of, without_observers
from observed import human as observers_idle_human
from people import thinned
from physics_rig import PhysicsRig, ticks
from retarget import _solver
from retarget.errors import ConfigError, UsageError
from retarget.human.calibration import calibrate
from retarget.human.reconstruction import Reconstructor
from retarget.ik.support_polygon import plant
from retarget.model.body import load_body_text
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
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_shapes import ShapeKind
from retarget.model.scene_state import SceneState
from retarget.report.clearance import place_body
from retarget.robot.follower import Follower
from retarget.rotations import rotate
from retarget.safety.clearance import refuse_floor
from retarget.schema.performer import load_performer
from retarget.schema.priorities import ObserverSettings, Priorities, load_priorities
from retarget.schema.profile_parts import Observer
from retarget.schema.scene import on_floor
from retarget.types import FloatArray
from sim.performer import synthetic_performer


@cache
def human(height: float = 1.75) -> Human:
    return build_human(proportional_dimensions(height))


@pytest.mark.parametrize(("chosen", "count"), [("lines", 8), ("lines_and_head", 9), ("capsules", 19)])
@pytest.mark.parametrize("height", [1.0, 1.75, 2.1])
def test_as_many_as_the_paper_has_at_any_size(chosen: ObserverSet, count: int, height: float) -> None:
    made = human_observers(human(height), ObserverSettings(human=chosen))
    assert made is not None and len(made.names) == count
    assert len(made.pairs) > 20


@pytest.mark.parametrize("posture", ["stand", "attractor", "crouch"])
def test_lines_go_from_joint_to_joint(posture: str) -> None:
    made, q = human_observers(human(), ObserverSettings(human="lines_and_head")), human().posture(posture)
    assert made is not None
    position, quat = placed(human().body, made, q)
    joints, ends = PostureReader(human()).joints(q[None])[0], ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    lines = [(side, joint) for joint in ("shoulder", "elbow", "hip", "knee") for side in ("l", "r")]
    for k, (side, joint) in enumerate(lines):
        both = (joint, ends[ends.index(joint) + 1])
        places = [joints[POINTS.index(f"{side}_{part}")] for part in both]
        radius, half, _ = made.sizes[k]
        axis = rotate(quat[k], np.array([0.0, 0.0, half]))
        assert radius == 0.0
        assert [position[k] - axis, position[k] + axis] == [pytest.approx(end, abs=1e-9) for end in places]
    assert made.names[8] == "head" and made.sizes[8, 0] > 0.05 and made.sizes[8, 1] == 0.0


ARM = """<mujoco><worldbody><body name="base"><geom size="0.01"/>
  <body name="plate" pos="0 0 0.1"><geom size="0.01"/></body>
  <body name="a" pos="0.2 0 0"><joint name="ja" axis="0 0 1"/><geom size="0.01"/>
    <body name="b" pos="0.2 0 0"><joint name="jb" axis="0 0 1"/><geom size="0.01"/>
      <body name="c" pos="0.2 0 0"><joint name="jc" axis="0 0 1"/><geom size="0.01"/>
        <body name="d" pos="0.2 0 0"><joint name="jd" axis="0 0 1"/><geom size="0.01"/></body></body></body></body>
</body></worldbody></mujoco>"""
TRIANGLE = (0.0, 2.0 * np.pi / 3, 2.0 * np.pi / 3, 0.0)
LINKS = ("base", "plate", "a", "b", "c", "d")


def pairs_of(observers: Observers) -> set[frozenset[str]]:
    """The pairs whose distance is observed."""
    return {frozenset(observers.names[k] for k in pair) for pair in observers.pairs.tolist()}


def balls(radius: float, angles: tuple[float, ...] = (0.0,) * 4, ignored: tuple[str, ...] = ()) -> Observers:
    """A ball on every link; ignored: two links."""
    body = load_body_text(ARM, source="arm")
    skipped = ((*map(body.body_index, ignored), "because"),) if ignored else ()
    rules = PairRules(neutral=np.array(angles), ignored=skipped, where="arm")  # type: ignore[arg-type]
    row = (ShapeKind.CAPSULE, (radius, 0.0, 0.0), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return assemble(body, {name: Part(body.body_index(name), *row, 0.05, 0.0) for name in LINKS}, rules)


def dropped(observers: Observers) -> dict[frozenset[str], str]:
    return {frozenset((pair.first, pair.second)): pair.reason for pair in observers.dropped}


def test_neighbours_and_what_touches_at_rest_are_dropped_with_a_reason_and_fixed_links_are_one() -> None:
    """Balls of 21 cm two joints apart overlap by 2 cm."""
    near = [frozenset(pair) for pair in (("base", "a"), ("plate", "a"), ("a", "b"), ("b", "c"), ("c", "d"))]
    small, large = balls(0.01), balls(0.21)
    assert dropped(small) == dict.fromkeys(near, "neighbours along the body")
    every = {frozenset(pair) for pair in combinations(LINKS, 2)}
    assert pairs_of(small) == every - set(near) - {frozenset(("base", "plate"))}
    touch = {pair: reason for pair, reason in dropped(large).items() if "touch" in reason}
    depths = {
        ("a", "c"): 20.0,
        ("b", "d"): 20.0,
        ("base", "b"): 20.0,
        ("plate", "b"): 1e3 * (0.42 - np.hypot(0.4, 0.1)),
    }
    assert touch == {
        frozenset(pair): f"touch by {depth:.1f} mm in the neutral posture" for pair, depth in depths.items()
    }


def test_what_is_far_along_the_body_and_touches_is_refused() -> None:
    """Folded so that the last link lies on the first."""
    with refuses(ConfigError) as refused:
        balls(0.03, angles=TRIANGLE)
    shows(str(refused.value), 3)
    calm = balls(0.03, angles=TRIANGLE, ignored=("a", "d"))
    assert dropped(calm)[frozenset(("a", "d"))] == "because"


def test_a_person_whose_legs_touch_is_no_mistake() -> None:
    """Hip joints in one place, as some files have them: what touches is not looked at, and all else is."""
    usual = proportional_dimensions(1.7)
    offset = usual.offset.copy()
    offset[[POINTS.index("l_hip"), POINTS.index("r_hip")], 1] = 0.0
    made = human_observers(build_human(replace(usual, offset=offset)), ObserverSettings(human="capsules"))
    assert made is not None and frozenset(("l_knee", "r_knee")) in dropped(made)
    assert frozenset(("l_elbow", "r_knee")) in pairs_of(made)


def test_every_pair_of_op3_is_observed_or_dropped_with_a_reason() -> None:
    found = robot_observers(op3())
    assert len(found.names) == 23 and len(found.pairs) == 223 and len(found.dropped) == 28
    assert len({tuple(sorted(pair)) for pair in found.pairs.tolist()}) == 223
    links = dict(zip(found.names, found.links.tolist(), strict=True))
    every = {frozenset(pair) for pair in combinations(found.names, 2) if links[pair[0]] != links[pair[1]]}
    assert pairs_of(found) | set(dropped(found)) == every and not pairs_of(found) & set(dropped(found))
    assert set(dropped(found).values()) == {"neighbours along the body", op3().profile.ignore_pairs[0].reason}


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
def test_out_of_influence_the_human_moves_as_without_observers(name: str) -> None:
    """Alone, and among far obstacles."""
    priorities = load_priorities(name)
    bare, _ = reconstructed(without_observers(priorities), None)
    small = ObserverSettings(human=priorities.observers.human, influence=2e-3, margin=1e-3)
    for scene in (None, scene_of(**FAR)):
        q, modes = reconstructed(priorities.model_copy(update={"observers": small}), scene)
        assert modes.shape[1] > 7 and not modes.any()
        assert q == pytest.approx(bare, abs=1e-9)


def test_out_of_influence_the_robot_moves_as_without_observers(monkeypatch: pytest.MonkeyPatch) -> None:
    def small(of: RobotBody) -> Observers:
        made = robot_observers(of)
        n = len(made.names)
        return replace(made, influence=np.full(n, 2e-3), margin=np.full(n, 1e-3))

    motion = observers_idle_human()[:50]  # before it folds onto its thighs
    bare = act(robot(None, without_observers(load_priorities("servo"))), None, motion)
    monkeypatch.setattr("retarget.robot.follower.robot_observers", small)
    for scene in (None, scene_of(**FAR)):
        done = act(robot(scene), None, motion)
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


def test_pairs_that_sleep_change_nothing() -> None:
    """Against a solver that gets posture and velocity anew in every frame, so that it knows no distance."""
    obstacles = [ball(0, 0.003, at=at) for at in ((0.5, 0.45, 0.0), (-0.6, 0.3, 0.0), (0.9, -0.4, 0.0))]
    beads = [ball(k + 1, 0.003, at=(0.15, 0.0, 0.0)) for k in range(7)]  # their nearest points do not leap
    made = rig(chain(7), beads, obstacles, [(a, b) for a in range(7) for b in range(a + 2, 7)])
    levels = [[_solver.Task.reactive()], [_solver.Task.preventive()], [_solver.Task.position(7, (0.2, 0.0, 0.0))]]
    remembers, forgets = (made.solver(levels, activation="all", n_ik=1, speed=2.0, acceleration=20.0) for _ in range(2))
    near = 0
    for t in range(600):
        goal = 0.9 * np.array([np.cos(0.01 * t), np.sin(0.023 * t), 0.0])
        forgets.reset(remembers.q, remembers.velocity)
        one, other = (solver.frame(aim(solver, l2_0=goal), 0.01) for solver in (remembers, forgets))
        assert one == pytest.approx(other, abs=1e-9), t
        near += int(remembers.observer_modes.any())
    assert near > 100


ON_ONE_LINK = """<mujoco><worldbody><body name="arm"><joint name="h" type="hinge" axis="0 0 1"/>
<joint name="s" type="slide" axis="1 0 0"/><geom size="0.01" mass="1"/></body></worldbody></mujoco>"""
TWO_SLIDES = """<mujoco><worldbody><body name="h"><joint name="x" type="slide" axis="1 0 0"/><geom size="0.01"
mass="1"/>
</body><body name="o" pos="0 5 0"><joint name="y" type="slide" axis="0 1 0"/><geom size="0.01" mass="1"/></body>
</worldbody></mujoco>"""


def test_an_observer_that_slides_behind_its_own_hinge_is_observed_in_time() -> None:
    """It is 1 m out on a slide, on a link whose joints are hinge and slide: no length of the body says how far it
    swings."""
    made = rig(ON_ONE_LINK, [ball(1, 0.01, influence=0.05)], [ball(at=(0.0, 1.0, 0.0), radius=0.01, influence=0.05)])
    levels = [[_solver.Task.preventive(speed=0.5)], [_solver.Task.position(1)]]
    solver = made.solver(levels, activation="all", n_ik=5, speed=3.0)
    solver.reset(np.array([0.0, 1.0]))
    least, acted = np.inf, False
    for turn in np.minimum(0.02 * np.arange(200), 3.0):
        solver.frame(aim(solver, l1_0=np.array([np.cos(turn), np.sin(turn), 0.0])), 0.01)
        angle, out = solver.q
        acted |= bool(solver.observer_modes[0])
        least = min(least, np.hypot(np.cos(angle) * out, np.sin(angle) * out - 1.0) - 0.02)
    assert least > 0.0 and acted


@pytest.mark.parametrize("rows", [1, 2, 4])
@pytest.mark.parametrize("share", [0.55, 0.7, 0.85])
def test_an_obstacle_that_recedes_while_the_robot_has_arrived_long_ago_is_met(rows: int, share: float) -> None:
    """The robot goes 0.2 m in a few rows and rests; the obstacle goes as far in forty, from less than 0.2 m away. The
    gate's check is of a ball of 1 cm and as large an obstacle."""
    body, count, distance = load_body_text(TWO_SLIDES, source="test").solver_body(), 40, 0.2
    watched = binding(body, [ball(1, 0.01, influence=0.02)], (), [ball(radius=0.01, influence=0.02)])
    points = np.zeros((0, 3))
    made = _solver.PathChecker(body, watched, columns=np.array([0, 1]), sole_links=[], sole_points=points)
    path = np.zeros((count + 1, 2))
    path[:, 0] = distance * np.minimum(np.arange(count + 1) / rows, 1.0)
    path[:, 1] = np.linspace(0.0, 0.01, count + 1)
    speed = distance / (count * 0.01)
    begins, velocity = np.array([[share * distance + 0.02, 0.0, 0.0]]), np.array([[speed, 0.0, 0.0]])
    made.set_obstacles(begins, np.array([[1.0, 0.0, 0.0, 0.0]]), velocity, np.zeros((1, 3)))
    row = np.linspace(0.0, count, 4001)
    gap = share * distance + speed * 0.01 * row - np.interp(row, np.arange(count + 1), path[:, 0])
    assert gap.min() < 0.0
    assert not made.is_clear(np.zeros(2), path, dt=0.01, share=0.0)


def test_no_pair_has_a_larger_margin_than_distance_at_home(tmp_path: Path) -> None:
    """With margins of 2 cm the hips of an OP3 would never be satisfied, and nothing else would move."""
    robot = load_robot("op3")
    text = robot.profile.path.read_text(encoding="utf-8").replace("margin: 0.004", "margin: 0.02")
    (tmp_path / "body.xml").write_text(robot.profile.body_path.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    wide, narrow = robot_observers(load_robot(tmp_path / "robot.yaml")), robot_observers(robot)
    assert (wide.margin == 0.02).all() and 0.0 < wide.pair_margin.min() < 0.01
    np.testing.assert_array_equal(wide.pair_margin, narrow.pair_margin)


def test_a_floor_under_the_soles_is_refused() -> None:
    def check(height: float) -> None:
        floor = {"shape": {"half_space": {"normal": [0, 0, 1]}}, "at": {"pos": [0, 0, height]}}
        refuse_floor(op3(), robot_observers(op3()), scene_of(ground=floor), stance().q)

    check(-0.03)
    with refuses(UsageError, "ground"):
        check(0.0)


def heights(robot: RobotBody, q: FloatArray) -> float:
    """Least height (m) of the robot's own geoms, soles' links aside, over the floor, by MuJoCo."""
    placed = place_body(robot.profile.body_path, q, root=robot.profile.root)
    soles = [robot.body.body_names[sole.body] for sole in robot.soles]
    found = placed.to_ground(SceneState(on_floor(None)), np.zeros(len(q)), feet=soles)
    assert found.smallest is not None
    return found.smallest


@pytest.mark.parametrize("name", ROBOTS)
def test_all_but_soles_look_at_the_floor_and_keep_less_than_they_have_at_home(name: str) -> None:
    robot, observers = shipped(name), robot_observers(shipped(name))
    feet = {sole.body for sole in robot.soles}
    on_soles = {n for n, link in zip(observers.names, observers.links.tolist(), strict=True) if link in feet}
    pairs, _ = observers.obstacle_pairs(SceneState(on_floor(None)).shapes)
    assert on_soles and {observers.names[row] for row in pairs[:, 0]} == set(observers.names) - on_soles
    kept = observers.ground_margin[~observers.stands]
    lowest = heights(robot, np.array([plant(robot, robot.profile.postures.rest).q]))
    assert 0.0 < kept.min() <= lowest


def test_a_part_below_the_soles_is_refused() -> None:
    """A stick that hangs from the torso in front of the feet, 0.1 m too long."""
    shapes = {"stick": {"capsule": {"from": [0.3, 0, 0], "to": [0.3, 0, -0.37], "radius": 0.005}}}
    more = {f"ball{n}": {"sphere": {"at": [0.3, 0, -0.36], "radius": 0.005}} for n in range(9)}
    for parts, facts in ((shapes, ("stick", "103.0")), (shapes | more, ("stick", "103.0", "9 more"))):
        added = {
            name: Observer.model_validate({"link": "body_link", "shape": one, "influence": 0.05, "margin": 0.004})
            for name, one in parts.items()
        }
        profile = op3().profile.model_copy(update={"observers": op3().profile.observers | added})
        with refuses(ConfigError, *facts) as error:
            robot_observers(replace(op3(), profile=profile))
        assert len(error.value.problems) == 1, "one cause, one line"


@pytest.mark.long
@pytest.mark.parametrize("name", ROBOTS)
def test_hands_with_targets_below_the_floor_stay_above(name: str) -> None:
    """A performer who crouches and digs: both wrists go 0.3 m below their feet."""
    robot, performer = shipped(name), followers.performer()
    follower = Follower(
        robot, load_priorities("servo"), followers.dimensions(performer), scene=SceneState(on_floor(None))
    )
    motion = followers.postures(performer)[:200]
    follower.start(motion[0])
    sent = []
    for human in motion:
        joints = human.joints.copy()
        for wrist in ("l_wrist", "r_wrist"):
            joints[human.joint_names.index(wrist), 2] = -0.3
        sent.append(follower.step(replace(human, joints=joints), followers.DT).q)
    q = np.array(sent)
    hands = robot.points(q, ("l_hand", "r_hand"))[..., 2]
    assert hands.min() < 0.75 * hands[0].min()  # they did go down
    assert heights(robot, q) > 0.0


def test_the_gate_refuses_a_hand_in_the_floor() -> None:
    """A deep squat with an arm that hangs straight down."""
    robot, bare = GatedRobot(SceneState(on_floor(None))), GatedRobot()
    arm = {"l_sho_pitch": 0.0, "l_sho_roll": 1.4, "l_el": 0.0}
    low = robot.robot.profile.postures.rest | arm | {"l_hip_pitch": -1.5, "r_hip_pitch": 1.5}
    down = robot.robot.posture(low)[robot.robot.servo_columns] - robot.sent
    path = robot.sent + np.linspace(0.0, 1.0, 40)[:, None] * down
    assert heights(robot.robot, robot.standing(path)) < 0.0
    stay = path[:1].repeat(len(path), axis=0)
    assert bare.clearance(np.ascontiguousarray(path), stay, bare.q)
    assert not robot.clearance(np.ascontiguousarray(path), stay, robot.q)


def test_a_simulated_hand_on_the_floor_is_no_fall_and_is_counted() -> None:
    """A squat whose left hand is 3 mm in the floor at first, held for 0.3 s."""
    arm = {"l_sho_pitch": 0.0, "l_sho_roll": 1.45, "l_el": 0.0}
    low = ticks(followers.op3().profile.postures.rest | arm | {"l_hip_pitch": -1.55, "r_hip_pitch": 1.55})
    rig = PhysicsRig(start=low)
    rig.arm()
    rig.run(0.3, low)
    witness = rig.bus.witness
    assert witness.state.fixture_contacts == 1 and not witness.state.touching and witness.fall is None
