"""Angles between the limbs of a robot and of its performer."""

import numpy as np
import pytest

from followers import DT, follower, op3, performance, performer, postures
from retarget.ik.support_polygon import plant
from retarget.report.likeness import LEAN, LIMB_ENDS, arm_clearance, best_angles, best_postures, legs_away, limb_angles
from retarget.report.tracking import EVERY, ReferenceMotion, hands_from_shoulders
from retarget.robot.arm_branches import arm_postures
from retarget.types import FloatArray


def followed(priorities: str, *, held: int = 0) -> tuple[ReferenceMotion, FloatArray, FloatArray]:
    """What was asked, the postures (T, nq) and the landmarks reached (T, k, 3) m of OP3. held: ticks for which the
    performer then holds still."""
    human, robot = postures(performer())[:250], follower(priorities=priorities)
    human += [human[-1]] * held
    robot.start(human[0])
    done = [robot.step(posture, DT) for posture in human]
    asked = performance(human, done[0].landmark_names, np.array([one.landmarks_asked for one in done]))
    return asked, np.array([one.q for one in done]), np.array([one.landmarks_reached for one in done])


def test_a_limb_that_is_turned_is_off_by_its_angle() -> None:
    asked, q, _ = followed("servo")
    found = limb_angles(op3(), q, asked)
    assert set(found) == {*LIMB_ENDS, LEAN} and all(len(angles) == len(q) for angles in found.values())
    elbow = op3().body.joint_qpos[op3().body.joint_index("l_el")]
    points = op3().points(q, ("l_elbow", "l_hand"))
    q[:, elbow] += 0.4
    turned = op3().points(q, ("l_elbow", "l_hand"))
    before, after = points[:, 1] - points[:, 0], turned[:, 1] - turned[:, 0]
    moved = np.arccos(np.sum(before * after, axis=1) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1))
    again = limb_angles(op3(), q, asked)
    assert (np.abs(again["forearms"][:, 0] - found["forearms"][:, 0]) <= moved + 1e-9).all()
    for name in ("upper_arms", "thighs", "shanks", LEAN):
        np.testing.assert_allclose(again[name], found[name], atol=1e-9)
    np.testing.assert_allclose(again["forearms"][:, 1], found["forearms"][:, 1], atol=1e-9)


def test_a_recorded_body_takes_the_place_of_the_reconstructed_one() -> None:
    """In the heading of the reconstruction, and not known where a joint is not."""
    asked, q, _ = followed("servo")
    same = limb_angles(op3(), q, asked, recorded=asked.joints)
    for name, angles in limb_angles(op3(), q, asked).items():
        np.testing.assert_array_equal(same[name], angles)
    knee, ankle = (asked.joint_names.index(name) for name in ("l_knee", "l_ankle"))
    lifted = asked.joints.copy()
    lifted[:100, ankle] = lifted[:100, knee] + [0.4, 0.0, 0.0]  # a level shank
    lifted[200:, asked.joint_names.index("r_elbow")] = np.nan
    found = limb_angles(op3(), q, asked, recorded=lifted)
    assert np.isnan(found["forearms"][200:, 1]).all() and np.isfinite(found["forearms"][:, 0]).all()
    away = legs_away(found, DT)
    assert away["l_shank"] == pytest.approx(100 * DT) and set(away) == {"l_thigh", "r_thigh", "l_shank", "r_shank"}
    assert away["r_shank"] == away["r_thigh"] == 0.0


def test_a_trunk_that_leans_as_the_performers_does_is_no_error() -> None:
    asked, q, _ = followed("servo")
    lean = limb_angles(op3(), q, asked)[LEAN]
    assert np.degrees(lean[100:].mean()) < 6.5
    stood = np.tile(q[0], (len(q), 1))
    assert np.degrees(limb_angles(op3(), stood, asked)[LEAN].max()) > 15.0  # it is seen to stand still


@pytest.mark.long
def test_hands_first_puts_hands_where_the_performer_has_them() -> None:
    """In the world, once the performer holds still, also where the pelvis is higher than theirs; arms that reach fold
    no trunk."""
    off, lean = dict[str, float](), dict[str, float]()
    for priorities in ("servo", "hands_first"):
        asked, q, reached = followed(priorities, held=500)
        lean[priorities] = np.degrees(limb_angles(op3(), q, asked)[LEAN][-1]).max()
        seen = hands_from_shoulders(op3(), asked, q, reached)
        hands = [asked.landmark_names.index(name) for name in ("l_hand", "r_hand")]
        off[priorities] = np.linalg.norm(reached - asked.landmarks, axis=2)[-1, hands].max()
        others = [column for column in range(len(asked.landmark_names)) if column not in hands]
        np.testing.assert_array_equal(seen[:, others], reached[:, others])
    assert off["hands_first"] < 0.002 < 0.02 < off["servo"]
    assert lean["hands_first"] < 2.0


WEIGHTS = {"l_hand": 0.15, "l_upper_arm": 0.1, "l_forearm": 0.1}
ARM = {"l_hand": ("l_shoulder", "l_hand"), "l_upper_arm": ("l_shoulder", "l_elbow"), "l_forearm": ("l_elbow", "l_hand")}


def lines(q: FloatArray) -> FloatArray:
    """The lines (T, 3, 3) m of the left arm of OP3, in the order of `ARM`."""
    return np.stack([np.subtract(*np.moveaxis(op3().points(q, ends[::-1]), 1, 0)) for ends in ARM.values()], axis=1)


def cost(q: FloatArray, wanted: FloatArray) -> FloatArray:
    """What the level of likeness weighs of the left arm (T,)."""
    marks = op3().profile.landmarks
    scale = np.array([WEIGHTS[name] / marks[name].robot_length for name in ARM])
    return np.asarray(np.sum((scale[:, None] * (lines(q) - wanted)) ** 2, axis=(1, 2)))


@pytest.mark.long
def test_no_posture_of_an_arm_is_better_than_the_best() -> None:
    """Against 4,000 postures of each arm that meet nothing; lines that the joints allow are found to half a degree."""
    stance, chance = plant(op3(), op3().profile.postures.stand), np.random.default_rng(5)
    some = arm_postures(op3(), stance, "l_hand", 4000)
    clear = arm_clearance(op3(), stance, "l_hand")
    some = some[clear(some)]
    assert 400 < len(some) < 4000  # the arm does meet the trunk
    anywhere = chance.standard_normal((12, 3, 3))
    length = np.linalg.norm(lines(some[:1]), axis=-1)[0]
    anywhere *= (length / np.linalg.norm(anywhere, axis=-1))[..., None]
    anywhere[:, 0] = anywhere[:, 1] + anywhere[:, 2]
    wanted = np.concatenate([lines(some[:12]), anywhere])
    best = best_postures(op3(), stance, "l", wanted, WEIGHTS)
    assert clear(best).all()
    least = np.array([cost(some, one[None]).min() for one in wanted])
    assert (cost(best, wanted) <= least + 1e-6).all()
    assert (cost(best, wanted)[:12] < 0.15**2 * np.radians(0.5) ** 2).all() and cost(best, wanted)[12:].max() > 1e-3


@pytest.mark.long
def test_the_best_is_no_worse_than_what_the_solver_finds() -> None:
    """Of a performer whom the arms can follow, and with its trunk as asked."""
    asked, q, _ = followed("servo")
    best, found = best_angles(op3(), asked, WEIGHTS), limb_angles(op3(), q, asked)
    for limb in ("upper_arms", "forearms"):
        assert best[limb].shape == (-(-len(q) // EVERY), 2)
    both = [angles["upper_arms"].mean() + angles["forearms"].mean() for angles in (best, found)]
    assert both[0] < both[1] + np.radians(0.5)
    assert best[LEAN].max() < np.radians(6.0)
