"""What a human observes with: the paper's lines, or every segment; at any size, posture and setting."""

from functools import cache

import numpy as np
import pytest

from retarget.human import Human, build_human
from retarget.human_dimensions import POINTS, proportional_dimensions
from retarget.human_observers import Worn, human_observers
from retarget.human_posture import PostureReader
from retarget.observer_pairs import placed
from retarget.priorities import ObserverSettings
from retarget.rotations import rotate

LINES = [f"{side}_{joint}" for joint in ("shoulder", "elbow", "hip", "knee") for side in ("l", "r")]
FAR_ENDS = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle"}


@cache
def human(height: float = 1.75) -> Human:
    return build_human(proportional_dimensions(height))


@pytest.mark.parametrize(("worn", "count"), [("lines", 8), ("lines_and_head", 9), ("capsules", 19)])
@pytest.mark.parametrize("height", [1.0, 1.75, 2.1])
def test_as_many_as_the_paper_has_at_any_size(worn: Worn, count: int, height: float) -> None:
    made = human_observers(human(height), ObserverSettings(human=worn))
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
