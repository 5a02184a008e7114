"""The virtual human: sizes, degrees of freedom, mass, symmetry, frames, postures, and what it evades."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from messages import refuses
from observed import nearest, scene_of
from people import place, trial
from retarget import rotations
from retarget._solver import Solver, Task
from retarget.errors import ConfigError, InputError
from retarget.frames import JOINTS, SensorFrames, SensorSample
from retarget.human.calibration import calibrate
from retarget.human.reconstruction import Reconstructor
from retarget.model.human import POSTURES, Human, PostureReader, build_human, human_limits, human_mjcf
from retarget.model.human_dimensions import (
    FRACTIONS,
    PARENTS,
    POINTS,
    SEGMENTS,
    TRUNK_LEVELS,
    check_plausible,
    mirrored_dimensions,
    proportional_dimensions,
)
from retarget.model.observers import Observers
from retarget.model.scene_state import SceneState
from retarget.schema.performer import load_performer
from retarget.schema.priorities import ReactiveTask, load_priorities
from retarget.types import ORIENTED, FloatArray
from sim.performer import synthetic_performer


@pytest.fixture(scope="module")
def human() -> Human:
    return build_human(proportional_dimensions(1.75))


def test_the_rest_posture_has_the_dimensions_and_the_mass(human: Human) -> None:
    points = place(human, human.body.qpos0, POINTS)
    assert_allclose(points - points[0], human.dimensions.standing(), atol=1e-9)
    soles = place(human, human.body.qpos0, ["l_sole", "r_sole"])
    assert_allclose(soles[:, 2], 0.0, atol=1e-9)
    assert human.body.total_mass == pytest.approx(human.dimensions.mass, abs=1e-5)
    com = human.body.solver_body().centre_of_mass(human.body.qpos0[None])[0]
    assert com[1] == pytest.approx(0.0, abs=1e-9)
    # Standing people have it near 0.55 to 0.58 of stature.
    assert 0.55 < com[2] / 1.75 < 0.585


def test_the_body_is_symmetric(human: Human) -> None:
    rng, body = np.random.default_rng(5), human.body
    left, right = body.qpos0.copy(), body.qpos0.copy()
    for name in body.dof_names[6:]:
        if name.startswith("l_"):
            pair = [body.dof_index(name), body.dof_index("r_" + name[2:])]
            left[pair[0] + 1] = right[pair[1] + 1] = rng.uniform(-0.3, 0.3)
            assert body.lower[pair[0]] == body.lower[pair[1]] and body.upper[pair[0]] == body.upper[pair[1]]
    one, other = place(human, left, POINTS), place(human, right, POINTS)
    swap = [POINTS.index({"l_": "r_", "r_": "l_"}.get(n[:2], n[:2]) + n[2:]) for n in POINTS]
    assert_allclose(one, other[swap] * [1, -1, 1], atol=1e-9)


def test_postures_are_named_in_errors(human: Human) -> None:
    with refuses(ConfigError):
        human.posture("atractor")
    with refuses(ConfigError, "l_knee_flexion"):
        human.posture_from([("l_knee_flexin", 3.0)])
    with refuses(ConfigError, 0, 155):
        human.posture_from([("knee_flexion", -5.0)])


def test_each_segment_has_its_share_of_the_mass_its_gyration_and_a_shape() -> None:
    person = replace(proportional_dimensions(1.75), mass=70.0)
    model = mujoco.MjModel.from_xml_string(human_mjcf(person))
    for segment in SEGMENTS:
        sides = ("",) if segment.body in ("pelvis", "spine", "chest", "neck") else ("l_", "r_")
        for side in sides:
            assert model.body(side + segment.body).mass[0] == pytest.approx(70.0 * segment.mass)
    assert model.body("l_collar").mass[0] < 1e-5
    thigh = model.body("l_hip")
    assert_allclose(thigh.ipos, 0.433 * person.of("l_knee"), atol=1e-9)
    rod = thigh.mass[0] * (0.323 * person.length("l_knee")) ** 2
    assert rod < max(thigh.inertia) < 1.2 * rod
    assert set(model.geom_bodyid) == set(range(1, model.nbody))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    feet = [model.geom("l_ankle").id, model.geom("r_ankle").id]
    assert_allclose([data.geom_xpos[i, 2] - model.geom_size[i, 0] for i in feet], 0.0, atol=1e-9)


def test_reads_what_the_body_has(human: Human) -> None:
    reader = PostureReader(human)
    q = human.posture("natural")
    q[:3] = 1.0, 2.0, 3.0
    q[3:7] = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(0.7))
    rows = np.stack([q, human.posture("stand")])
    assert reader.joints(rows).shape == (2, len(POINTS), 3)
    assert reader.joints(rows)[0] == pytest.approx(place(human, q, POINTS))
    assert reader.orientations(rows)[0, ORIENTED.index("pelvis")] == pytest.approx(q[3:7])
    assert reader.orientations(rows)[1] == pytest.approx(np.tile(rotations.IDENTITY, (3, 1)))
    assert reader.read(q)[2][:2] == pytest.approx([1.0, 2.0], abs=0.1)


def test_every_posture_is_inside_the_limits(human: Human) -> None:
    """Every degree of freedom has a speed limit, and none of acceleration."""
    single, address = human.body.scalar_joints()
    for name in POSTURES:
        q = human.posture(name)
        angles = q[address[single]]
        assert (angles >= human.body.lower[single]).all() and (angles <= human.body.upper[single]).all(), name
        assert (q[7:][human.locked[6:]] == 0.0).all(), name
    limits = human_limits(human.body)
    assert ((limits.max_velocity >= 10.0) & (limits.max_velocity <= 30.0)).all()
    assert np.isinf(limits.max_acceleration).all()
    assert (limits.lower == human.body.lower).all() and (limits.upper == human.body.upper).all()


def test_the_attractor_is_the_papers(human: Human) -> None:
    q = human.posture("attractor")
    stand = place(human, human.posture("stand"), ["l_wrist", "r_wrist"])
    arms = place(human, q, ["l_wrist", "r_wrist"])
    assert arms[0, 1] - stand[0, 1] > 0.25 and stand[1, 1] - arms[1, 1] > 0.25, "arms away from the torso"
    by_name = dict(zip(human.body.dof_names[6:], q[7:], strict=True))
    assert by_name["l_knee_flexion"] > 0.4 and by_name["spine_flexion"] == 0.0 and abs(by_name["l_hip_flexion"]) < 0.2


UNSENSED = [
    i for i, name in enumerate(POINTS) if name.split("_")[-1] in ("pelvis", "knee", "elbow", "shoulder", "neck")
]


def errors_mm(frames: SensorFrames, *, step: int) -> FloatArray:
    """Distance (T, 23) of every point from the recording, after a fit of all points inside the limits."""
    human = build_human(calibrate(frames))
    body, solver_body = human.body, human.body.solver_body()
    at = [body.frame(name) for name in POINTS]
    points = [Task.position(frame.body, tuple(frame.position), max_error=0.3) for frame in at]
    rest = Task.posture(np.where(np.arange(body.nv) < 6, 0.0, 1.0), gain=0.1)
    solver = Solver(
        solver_body,
        [points, [rest]],
        lower=body.lower,
        upper=body.upper,
        max_velocity=np.full(body.nv, 1e6),
        max_acceleration=np.full(body.nv, 1e9),
        locked=human.locked,
        n_ik=30,
        max_step=0.5,
        damping=0.05,
        early_stop=False,
    )
    assert frames.joints is not None
    truth = np.stack([frames.joints.of(name)[::step] for name in POINTS], axis=1)
    target = np.ones((len(truth), solver.target_size))
    for i in range(len(POINTS)):
        start, stop = solver.target_slice(0, i)
        target[:, start + 1 : stop] = truth[:, i]
    start, stop = solver.target_slice(1, 0)
    target[:, start + 1 : stop] = human.posture("natural")
    solver.reset(_standing_at(human.posture("natural"), truth[0]))
    for _ in range(5):
        solver.frame(target[0], 0.05)
    postures = np.array([solver.frame(row, 0.05) for row in target])
    reached = solver_body.points(postures, [frame.body for frame in at], np.array([f.position for f in at]))
    return np.asarray(1000.0 * np.linalg.norm(reached - truth, axis=2))


def _standing_at(q: FloatArray, points: FloatArray) -> FloatArray:
    """The posture moved to the pelvis of points (23, 3) and turned to face as they do."""
    left = points[POINTS.index("l_hip")] - points[POINTS.index("r_hip")]
    heading = np.arctan2(-left[0], left[1])
    q[:3] = points[0]
    q[3:7] = [np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)]
    return q


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "floor", "step"),
    [
        ("02_01", 4.0, 60),
        *(("02_05", 4.0, 6), ("02_06", 5.0, 6), ("01_01", 4.0, 6), ("49_18", 4.0, 6), ("05_13", 8.0, 6)),
    ],
)
def test_the_human_can_take_recorded_postures(shared: Path, name: str, floor: float, step: int) -> None:
    assert errors_mm(trial(shared, name), step=step)[:, UNSENSED].mean() < floor


DT = 1.0 / 60.0
R_WRIST = POINTS.index("r_wrist")


@cache
def person() -> Human:
    return build_human(calibrate(synthetic_performer()))


@cache
def moving() -> tuple[SensorSample, ...]:
    """A crouch and a reach of the right hand, which is then held for a second."""
    frames = synthetic_performer().resample(np.arange(0.0, 2.5, DT))
    samples = [frames.sample(time) for time in frames.time]
    return (*samples, *[samples[-1]] * 60)


def reconstructor(state: SceneState) -> tuple[Reconstructor, Observers]:
    made = Reconstructor(person(), load_priorities("human"), load_performer("five"), scene=state)
    assert made.observers is not None
    return made, made.observers


def sphere(y: float, radius: float = 0.06) -> dict[str, Any]:
    shape = {"sphere": {"radius": radius}}
    return {"shape": shape, "at": {"pos": (0.0, y, 0.0)}, "influence": 0.08, "margin": 0.005}


def test_an_obstacle_that_appears_inside_the_arm_is_left_at_a_bounded_speed() -> None:
    made, own = reconstructor(state := scene_of(ball=sphere(5.0)))
    sample = moving()[0]
    posture, near = made.start(sample), []
    for tick in range(120):
        if tick == 5:
            at = posture.joints[R_WRIST] + np.array([0.05, 0.0, 0.03])
            state.live("ball").update(at, (1.0, 0.0, 0.0, 0.0), time=tick * DT)
            near.append(float(nearest(person().body, own, posture.q, state, tick * DT)[0]))
        posture = made.step(sample, DT)
        if tick >= 5:
            near.append(float(nearest(person().body, own, posture.q, state, tick * DT)[0]))
    inside = np.array([distance for distance in near if distance < 0.0])
    speed = next(task.speed for _, _, task in load_priorities("human").tasks() if isinstance(task, ReactiveTask))
    assert inside[0] < -0.02
    assert (np.diff(inside) > 0.0).all() and np.diff(inside).max() < speed * DT * 1.1
    assert near[-1] > 0.004


def test_among_random_obstacles_nothing_breaks() -> None:
    """16 scenes of four spheres, still or moving, some already inside; seed 0."""
    rng, time = np.random.default_rng(0), 0.0
    state = scene_of(**{f"o{k}": sphere(9.0, radius=0.04 + 0.04 * k) for k in range(4)})
    made, own = reconstructor(state)
    limits, (single, address) = human_limits(person().body), person().body.scalar_joints()
    for scene in range(16):
        made.start(moving()[0])
        speed = rng.normal(0.0, 0.5, (4, 3)) * (scene % 2)
        at = rng.uniform([-0.4, -0.6, 0.0], [0.6, 0.6, 1.9], (4, 3))
        goal = moving()[int(rng.integers(len(moving())))]
        q, near = [], []
        for tick in range(6):
            time += DT
            for k in range(4):
                there = at[k] + tick * DT * speed[k]
                state.live(f"o{k}").update(there, (1.0, 0.0, 0.0, 0.0), time=time, velocity=speed[k])
            q.append(made.step(goal, DT).q)
            near.append(float(nearest(person().body, own, q[-1], state, time).min()))
        angles = np.array(q)[:, address[single]]
        assert np.isfinite(q).all()
        assert (angles >= limits.lower[single] - 1e-9).all() and (angles <= limits.upper[single] + 1e-9).all()
        if not scene % 2:
            assert min(near) > min(near[0], 0.0) - 2e-3, f"scene {scene}"


def test_the_parts_of_the_trunk_have_the_trunks_own_mass_and_centre() -> None:
    level = TRUNK_LEVELS
    parts = [s for s in SEGMENTS if s.body in ("pelvis", "spine", "chest")]
    masses = np.array([s.mass for s in parts])
    centres = np.array([level[s.start] + s.com * (level[s.end] - level[s.start]) for s in parts])
    assert masses.sum() == pytest.approx(0.497)  # Winter (2009), Table 4.1, trunk
    assert masses @ centres / masses.sum() == pytest.approx(0.50, abs=1e-3)


def test_heights_of_the_standing_body_agree_with_drillis_and_contini() -> None:
    body, f = proportional_dimensions(1.0), FRACTIONS
    hip = f.ankle_height + body.length("l_ankle") + body.length("l_knee")
    assert hip == pytest.approx(0.530)
    neck = hip - body.of("l_hip")[2] + sum(body.length(name) for name in ("spine", "chest", "neck"))
    assert neck + body.of("l_shoulder")[2] == pytest.approx(0.818)
    assert neck + body.length("head") == pytest.approx(f.head_height, abs=0.003)
    assert f.heel_back + body.of("l_toe")[0] + f.toe_tip == pytest.approx(0.152)
    # The points are the canonical joints, parents first.
    assert set(POINTS) == set(JOINTS) and len(POINTS) == 23
    assert all(parent < i for i, parent in enumerate(PARENTS))


def test_mirrored_left_is_right_and_twice_is_nothing() -> None:
    usual = proportional_dimensions(1.7)
    offset = usual.offset.copy()
    offset[POINTS.index("l_knee")] *= 1.1
    offset[POINTS.index("spine"), 1] = 0.01
    person = replace(usual, offset=offset)
    mirrored = mirrored_dimensions(person)
    assert mirrored.length("r_knee") == person.length("l_knee") > mirrored.length("l_knee")
    assert mirrored.of("spine")[1] == -0.01 and mirrored.of("l_hip")[1] > 0.0
    assert_allclose(mirrored_dimensions(mirrored).offset, person.offset)


def test_what_is_no_human_is_refused() -> None:
    check_plausible(proportional_dimensions(1.7), source="file")
    with refuses(InputError, 170):
        check_plausible(proportional_dimensions(170.0), source="file")
    stretched = proportional_dimensions(1.7)
    offset = np.array(stretched.offset)
    offset[[POINTS.index("l_knee"), POINTS.index("r_wrist")]] *= [[5.0], [0.1]]
    with refuses(InputError, "l_hip", "l_knee", "r_elbow", "r_wrist"):
        check_plausible(replace(stretched, offset=offset), source="file")


FORWARD, LEFT, UP = np.eye(3)
OUTWARD = LEFT  # of the left side
MOTIONS: dict[str, tuple[str, FloatArray]] = {
    "spine_flexion": ("head", FORWARD),
    "spine_lateral": ("head", LEFT),
    "chest_flexion": ("head", FORWARD),
    "chest_lateral": ("head", LEFT),
    "neck_flexion": ("head", FORWARD),
    "neck_lateral": ("head", LEFT),
    "spine_rotation": ("r_shoulder", FORWARD),
    "chest_rotation": ("r_shoulder", FORWARD),
    "l_collar_protraction": ("l_shoulder", FORWARD),
    "l_collar_elevation": ("l_shoulder", UP),
    "l_shoulder_elevation": ("l_wrist", FORWARD + OUTWARD),
    "l_shoulder_swing": ("l_wrist", FORWARD - OUTWARD),
    "l_elbow_flexion": ("l_wrist", FORWARD),
    "l_wrist_flexion": ("l_hand", -OUTWARD),
    "l_wrist_deviation": ("l_hand", FORWARD),
    "l_hip_flexion": ("l_ankle", FORWARD),
    "l_hip_abduction": ("l_ankle", OUTWARD),
    "l_hip_rotation": ("l_toe", -OUTWARD),
    "l_knee_flexion": ("l_ankle", -FORWARD),
    "l_ankle_dorsiflexion": ("l_toe", UP),
    "l_ankle_rotation": ("l_toe", -OUTWARD),
}
"""A point that a positive angle moves, and where to."""


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_positive_angle_moves_the_body_as_the_name_says(human: Human, motion: str) -> None:
    point, direction = MOTIONS[motion]
    for side, mirror in (("l_", np.ones(3)), ("r_", np.array([1.0, -1.0, 1.0]))):
        if side == "r_" and not motion.startswith("l_"):
            continue
        name, target = (text.replace("l_", side, 1) for text in (motion, point))
        q = human.posture("stand")
        before = place(human, q, [target])[0]
        q[human.body.scalar_joints()[1][human.body.dof_index(name)]] = 1e-3
        moved = place(human, q, [target])[0] - before
        along = moved @ (direction * mirror) / np.linalg.norm(direction)
        assert along > 0.9 * np.linalg.norm(moved) > 0.0, name


@pytest.mark.parametrize(
    ("elevation", "swing", "way"),
    [(0.0, 0.0, -UP), (180.0, 0.0, UP), (90.0, 45.0, FORWARD), (90.0, -45.0, OUTWARD), (-50.8, -37.8, None)],
)
def test_common_arm_postures_are_far_from_the_shoulders_lock(
    human: Human, elevation: float, swing: float, way: np.ndarray[tuple[int], np.dtype[np.float64]] | None
) -> None:
    q = human.posture_from([("shoulder_elevation", elevation), ("shoulder_swing", swing)])
    shoulder, elbow = place(human, q, ["l_shoulder", "l_elbow"])
    arm = (elbow - shoulder) / np.linalg.norm(elbow - shoulder)
    if way is None:  # 60 degrees of extension, straight back
        way = np.array([-np.sin(np.pi / 3), 0.0, -np.cos(np.pi / 3)])
    assert_allclose(arm, way, atol=2e-3)
    body = human.body.solver_body()
    columns = [human.body.dof_index(f"l_shoulder_{m}") for m in ("elevation", "swing", "rotation")]
    link = human.body.body_index("l_shoulder")
    axes = np.array(body.frame_jacobian(q, link, (0.0, 0.0, 0.0)))[3:, columns]
    assert np.linalg.svd(axes, compute_uv=False)[-1] > 0.5  # 0 is gimbal lock, 1 is three axes at right angles
