"""Every shipped robot: masses, servos, where it stands, mirror images; and which servos lie between its frames.

To ship one more, add `configs/robots/NAME/` (body and profile from published numbers, with sources named, without
meshes and `# DRAFT`), a row of PUBLISHED, one of ROBOTS in `benchmarks/docs_tables.py`, and a line in the changelog.
`retarget demo --robot NAME` must break no limit and touch nothing, also with `--bus physics`.
"""

from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from followers import op3, shipped, stance
from observed import PosedBody
from retarget.ik.support_polygon import plant, support_distance
from retarget.model.observers import contacts, robot_observers
from retarget.model.robot import joints_between, load_profile
from retarget.report.clearance import place_body
from retarget.schema.catalogue import Kind, entries

POSTURES = ("neutral", "stand", "rest", "attractor")
SEED = 20
GATE_M = 0.001
"""What the gate keeps between observers."""


@dataclass(frozen=True)
class Published:
    """What the sources of a robot say of it as a whole. mass: kg, of all links; joints: with a servo.

    bare: links inside others, which have no observer.
    """

    mass: float
    joints: int
    bare: int = 0


PUBLISHED = {
    "op3": Published(3.14747, 20),
    "poppy": Published(2.86791, 25),
    "toddlerbot": Published(3.45363, 30, bare=3),
    "wolfgang": Published(7.11661, 20),
}


@pytest.fixture(scope="module", params=sorted(PUBLISHED))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def body(name: str) -> PosedBody:
    return PosedBody(load_profile(name))


def twin(joint: str) -> str | None:
    """The right joint for a left one; None for others."""
    for left, right in (("l_", "r_"), ("left_", "right_")):
        if joint.startswith(left):
            return right + joint.removeprefix(left)
    return "R" + joint[1:] if joint[0] == "L" and joint[1].isupper() else None


def test_masses_and_joints_are_those_of_the_sources(body: PosedBody, name: str) -> None:
    assert {entry.name for entry in entries(Kind.ROBOT) if entry.shipped} == set(PUBLISHED)
    assert body.model.body_mass.sum() == pytest.approx(PUBLISHED[name].mass, abs=2e-5)
    assert len(body.profile.servos) == body.model.nu == body.model.nv - 6 == PUBLISHED[name].joints
    # The body file has an actuator per servo, in their order.
    assert list(body.profile.servos) == [body.model.actuator(index).name for index in range(body.model.nu)]


def test_every_link_with_mass_has_a_shape_and_a_sound_inertia(body: PosedBody) -> None:
    for index in range(1, body.model.nbody):
        small, middle, large = sorted(body.model.body_inertia[index])
        link = body.model.body(index).name
        assert body.model.body_geomnum[index] > 0, link
        assert 0.0 < small <= large <= small + middle, link
        # As if all of it were between 1 mm and 15 cm from its centre.
        assert 1e-6 < large / body.model.body_mass[index] < 0.15**2, link


def test_servos_serve_the_range_of_their_joints(body: PosedBody) -> None:
    for spec in body.profile.servo_specs():
        assert spec.problems() == ()
        np.testing.assert_allclose(body.model.joint(spec.joint).range, (spec.lower, spec.upper), atol=1e-6)
        ends = [spec.zero_tick + spec.ticks_per_rad * limit for limit in (spec.lower, spec.upper)]
        assert spec.lowest_tick - 0.5 <= min(ends) < max(ends) <= spec.highest_tick + 0.5
        assert spec.max_velocity < spec.model.no_load_speed


@pytest.mark.parametrize("posture", [posture for posture in POSTURES if posture != "rest"])
def test_postures_stand_flat_and_balanced(body: PosedBody, posture: str) -> None:
    body.pose(getattr(body.profile.postures, posture))
    for foot in body.profile.feet.values():
        np.testing.assert_allclose(body.frame(foot.frame)[1], np.eye(3), atol=2e-3)
    assert np.ptp(body.sole_corners()[:, 2]) < 5e-4
    assert body.support_margin() > 0.045
    assert abs(body.com_in_stand_frame()[0]) < 0.01


def test_at_rest_it_squats_flat_and_balanced_and_leans_little(name: str) -> None:
    robot, rest = shipped(name), plant(shipped(name), shipped(name).profile.postures.rest)
    lean = np.degrees(2.0 * np.arccos(min(abs(float(rest.q[3])), 1.0)))
    assert lean < (13.0 if name == "poppy" else 5.0)  # whose hips are nearly at their stops
    feet = tuple(foot.frame for foot in robot.profile.feet.values())
    assert np.abs(robot.orientations(rest.q[None], feet)[0, :, 1:3]).max() < 1e-3  # no sole tilts
    assert np.abs(robot.points(rest.q[None], feet)[0, :, 2]).max() < 5e-4
    com = robot.kinematics.centre_of_mass(rest.q[None])[0]
    assert support_distance(com[:2], rest.edges(0.0)) > 0.03


def test_the_stance_is_on_the_floor_with_bent_knees(name: str) -> None:
    robot, stands = shipped(name), stance(name)
    for sole in stands.soles:
        assert abs(robot.points(stands.q[None], (sole.frame.name,))[0, 0, 2]) < 1e-4
    for side in "lr":
        hip, knee, ankle = (stands.points[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle"))
        straight = np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee)
        assert 0.9 * straight < np.linalg.norm(hip - ankle) < 0.99 * straight
        assert knee[0] > 0.5 * (hip[0] + ankle[0]) + 0.01  # forward of the line from hip to ankle


@pytest.mark.parametrize("posture", POSTURES)
def test_postures_touch_nothing_and_are_mirror_images(body: PosedBody, posture: str) -> None:
    assert body.pose(getattr(body.profile.postures, posture)).touching() == set()
    for frame in [frame for frame in body.profile.frames if frame.startswith("l_")]:
        np.testing.assert_allclose(body.at(frame) * (1, -1, 1), body.at("r" + frame[1:]), atol=2e-4)


@pytest.mark.long
def test_where_observers_are_clear_the_bodys_own_shapes_are(name: str) -> None:
    """The gate looks at observers, the report at the body's own shapes: a hand was in a bracket that had none."""
    robot, chance = shipped(name), np.random.default_rng(SEED)
    profile, servos, observers = robot.profile, robot.joint_map.servos, robot_observers(robot)
    low, high = (np.array([getattr(servo, end) for servo in servos]) for end in ("lower", "upper"))
    # Some joints are turned from `stand`, by a share of the way to any place in their range.
    count, stand = 8000, robot.posture(profile.postures.stand)
    turned = chance.random((count, len(servos))) < chance.uniform(0.15, 1.0, (count, 1))
    way = chance.uniform(low, high, turned.shape) - stand[robot.servo_columns]
    q = np.tile(stand, (count, 1))
    q[:, robot.servo_columns] += turned * chance.uniform(0.1, 1.0, (count, 1)) * way
    q = q[[not contacts(robot.body, observers, None, row, deeper_than=-GATE_M) for row in q]]
    assert len(q) > 0.2 * count
    placed = place_body(profile.body_path, q, root=profile.root)
    found = placed.to_itself(
        neutral=robot.posture(profile.postures.neutral), ignored=[entry.pair for entry in profile.ignore_pairs]
    )
    assert not found.penetrating, found.pair


def test_no_pair_of_observers_is_in_contact_where_it_stands(name: str) -> None:
    robot, observers = shipped(name), robot_observers(shipped(name))
    seen = {robot.body.body_names[link] for link in observers.links}
    assert len(set(robot.body.body_names) - {"world"} - seen) == PUBLISHED[name].bare
    # Most that a pair keeps is a share of its distance in `neutral` and `stand`: above 0, it is in contact in neither.
    assert (observers.pair_margin > 1e-4).all()
    if name == "wolfgang":  # with 5 mm about torso and thighs it could lean or squat, not both
        postures = robot.profile.postures
        margin = max(observers.margin[observers.names.index(part)] for part in ("torso", "l_thigh", "r_thigh"))
        for bend in np.linspace(0.0, postures.rest["LHipPitch"], 100):
            q = robot.posture({**postures.stand, "LHipPitch": bend, "RHipPitch": -bend})
            assert not contacts(robot.body, observers, None, q, deeper_than=-margin)


def test_its_left_is_the_mirror_image_of_its_right(body: PosedBody) -> None:
    """In random postures whose left mirrors the right; joints without a twin turn if their axis lies across."""
    body.pose({})
    pairs = {joint: twin(joint) for joint in body.profile.servos if twin(joint)}
    limits = {joint: servo.limits for joint, servo in body.profile.servos.items()}
    assert 2 * len(pairs) >= len(limits) - 7
    signs, middle = {}, []
    for left, right in pairs.items():
        # An axis is a pseudovector: its mirror image keeps y and turns x and z round.
        signs[left] = float(np.sign(body.anchor(left)[1] @ (body.anchor(str(right))[1] * (-1.0, 1.0, -1.0))))
        ends = sorted(signs[left] * limit for limit in limits[str(right)])
        np.testing.assert_allclose(limits[left], ends, atol=1e-6)
    for joint in set(limits) - set(pairs) - set(pairs.values()):
        if abs(body.anchor(joint)[1][1]) > 0.99:
            middle.append(joint)
    random = np.random.default_rng(SEED)
    frames = [frame for frame in body.profile.frames if frame.startswith("l_")]
    assert len(frames) >= 8
    for _ in range(20):
        q = {joint: random.uniform(*limits[joint]) for joint in [*pairs, *middle]}
        q |= {str(pairs[left]): signs[left] * q[left] for left in pairs}
        body.pose(q)
        centre = body.data.qpos[:3] * (0.0, 1.0, 0.0)
        for frame in frames:
            left, right = body.at(frame) - centre, body.at("r" + frame[1:]) - centre
            np.testing.assert_allclose(left * (1, -1, 1), right, atol=2e-4, err_msg=f"{frame}, seed {SEED}")


def test_frames_look_where_a_person_would(body: PosedBody) -> None:
    """In `stand`: left is left, toes and face look ahead, elbows are behind the hands, the head is on top."""
    body.pose(body.profile.postures.stand)
    for part in ("shoulder", "elbow", "hand", "hip", "knee", "ankle", "sole", "toe"):
        assert body.at(f"l_{part}")[1] > 0.02 > -0.02 > body.at(f"r_{part}")[1], part
    for side in "lr":
        assert body.at(f"{side}_toe")[0] > body.at(f"{side}_sole")[0] + 0.02
        assert body.at(f"{side}_hand")[0] > body.at(f"{side}_elbow")[0]
        heights = [body.at(f"{side}_{part}")[2] for part in ("shoulder", "elbow", "hip", "knee", "ankle", "sole")]
        assert sorted(heights, reverse=True)[0] == heights[0]
        assert heights[2:] == sorted(heights[2:], reverse=True)
    assert body.at("head")[2] > body.at("neck")[2] > body.at("pelvis")[2]
    np.testing.assert_allclose(body.frame("head")[1][:, 0], (1, 0, 0), atol=2e-3)


def test_landmarks_ask_for_less_than_the_stretched_limb(body: PosedBody) -> None:
    """Lengths of the segments; and that from the ankle a sole is where the landmark's offset says."""
    body.pose(body.profile.postures.stand)
    landmarks = body.profile.landmarks

    def length(*frames: str) -> float:
        return float(sum(np.linalg.norm(body.at(a) - body.at(b)) for a, b in pairwise(frames)))

    arm, leg = length("l_shoulder", "l_elbow", "l_hand"), length("l_hip", "l_knee", "l_ankle")
    assert 0.9 * arm < landmarks["l_hand"].robot_length < arm
    assert 0.95 * leg < landmarks["l_sole"].robot_length < leg
    assert landmarks["pelvis"].robot_length == landmarks["l_sole"].robot_length
    assert landmarks["head"].robot_length == pytest.approx(length("pelvis", "head"), abs=2e-3)
    np.testing.assert_allclose(body.at("l_sole") - body.at("l_ankle"), landmarks["l_sole"].offset, atol=5e-4)


def test_acceleration_limits_are_within_the_torque(body: PosedBody) -> None:
    """Base held: inertia about each joint times max_acceleration, plus gravity, stays below stall torque at 12 V.

    But for coupled joints, which have the torque of both servos and their gear.
    """
    random = np.random.default_rng(SEED)
    specs = {spec.joint: spec for spec in body.profile.servo_specs() if spec.coupling is None}
    lower, upper = body.model.jnt_range[1:].T
    inertia = np.zeros((body.model.nv, body.model.nv))
    for _ in range(200):
        body.data.qpos[7:] = random.uniform(lower, upper)
        mujoco.mj_forward(body.model, body.data)
        mujoco.mj_fullM(body.model, body.data, inertia)
        for joint, spec in specs.items():
            dof = body.model.joint(joint).dofadr[0]
            torque = inertia[dof, dof] * spec.max_acceleration + abs(body.data.qfrc_bias[dof])
            stall = spec.model.stall_torque * min(1.0, 12.0 / spec.model.voltage)
            assert torque < 0.82 * stall, f"{joint}, seed {SEED}"


def test_the_stance_stands_by_the_actuators_of_the_body_file(name: str) -> None:
    """Mechanics of 2 s on a floor, every servo with its angle as goal: upright, not sunk in, soles where they were."""
    robot, stands = shipped(name), stance(name)
    spec = mujoco.MjSpec.from_file(str(robot.profile.body_path))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2.0, 2.0, 0.1])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = stands.q
    data.ctrl[:] = [robot.profile.postures.stand.get(model.actuator(index).name, 0.0) for index in range(model.nu)]
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    assert data.qpos[2] > 0.97 * stands.q[2]
    assert np.degrees(np.arccos(data.xmat[1, 8])) < 4.0
    soles = tuple(sole.frame.name for sole in stands.soles)
    before, after = robot.points(np.array([stands.q, data.qpos]), soles)
    np.testing.assert_allclose(after, before, atol=5e-3)


ARM = {"l_sho_pitch", "l_sho_roll", "l_el"}
LEG = {"hip_yaw", "hip_roll", "hip_pitch", "knee", "ank_pitch", "ank_roll"}


OTHERS: list[tuple[str, list[str], set[str]]] = [
    ("l_hand", ["l_shoulder"], ARM),
    ("l_shoulder", ["l_hand"], ARM),
    ("l_elbow", ["l_hand"], set(op3().joint_map.joints)),  # on one link
    ("pelvis", ["l_sole"], {f"l_{joint}" for joint in LEG}),
    ("pelvis", ["l_sole", "r_sole"], {f"{side}_{joint}" for joint in LEG for side in "lr"}),
    ("l_sole", ["r_sole"], {f"{side}_{joint}" for joint in LEG for side in "lr"}),
    ("head", ["neck"], {"head_pan", "head_tilt"}),
    ("head", ["l_hand"], ARM | {"head_pan", "head_tilt"}),
    ("head", [], set(op3().joint_map.joints)),
]


def test_joints_between_frames_of_the_op3() -> None:
    for frame, others, joints in OTHERS:
        between = joints_between(op3(), frame, others)
        found = {joint for joint, lies in zip(op3().joint_map.joints, between, strict=True) if lies}
        assert found == joints, (frame, others)
