"""Robot profiles: what OP3's says, how one is found and read, and that no content breaks the reader."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.joint_map import JointMap
from messages import refuses
from retarget.errors import ConfigError, UsageError
from retarget.model.robot import load_profile
from retarget.schema.catalogue import shipped_folder
from retarget.schema.profile import RobotProfile, read_profile
from retarget.schema.strict_yaml import scan

KEYS = [
    *(
        "name",
        "body",
        "root",
        "frames",
        "servos",
        "couplings",
        "buses",
        "observers",
        "ignore_pairs",
        "feet",
        "postures",
    ),
    *("landmarks", "safety", "reconstruct", "retarget", "standing"),
]


@pytest.fixture(scope="module")
def op3(root: Path) -> Path:
    return root / "configs" / "robots" / "op3"


def test_keys_are_those_of_the_design() -> None:
    assert list(RobotProfile.model_fields) == KEYS


def test_op3_by_name_folder_and_file(op3: Path) -> None:
    named = load_profile("op3")
    assert named == load_profile(op3) == load_profile(op3 / "robot.yaml")
    assert named.body_path == op3 / "body.xml"
    assert named.path == op3 / "robot.yaml"


def test_op3_says_what_the_others_need(op3: Path) -> None:
    profile = load_profile(op3)
    assert sorted(servo.id for servo in profile.servos.values()) == list(range(1, 21))
    assert profile.safety.rate_hz == 125
    assert profile.postures.stand["l_knee"] == 0.6
    assert profile.feet["left"].frame == "l_sole"
    hand = profile.landmarks["l_hand"]
    assert (hand.frame, hand.follows, hand.measured_from, hand.anchor) == (
        "l_hand", ("l_wrist",), ("l_shoulder",), ("l_shoulder",),
    )  # fmt: skip
    assert hand.human_length == (("l_shoulder",), ("l_elbow",), ("l_wrist",))
    assert profile.landmarks["head"].human_length == (("l_hip", "r_hip"), ("head",))


def test_servo_specs_make_a_joint_map(op3: Path) -> None:
    profile = load_profile(op3)
    joint_map = JointMap(profile.servo_specs())
    assert joint_map.joints == tuple(profile.servos)


def test_a_profile_cannot_be_changed() -> None:
    profile = read_profile("op3")
    with pytest.raises(ValueError, match="frozen"):
        profile.name = "other"


def test_unknown_robot_names_the_nearest() -> None:
    with refuses(UsageError, "op3", found="'op4'", next_step="op3"):
        load_profile("op4")


def test_reading_alone_makes_no_cross_checks(op3: Path, tmp_path: Path) -> None:
    text = (op3 / "robot.yaml").read_text(encoding="utf-8").replace("{id: 2,", "{id: 1,")
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    assert read_profile(tmp_path).servos["l_sho_pitch"].id == 1


values = st.recursive(
    st.none() | st.booleans() | st.integers(-5, 5) | st.floats(-2, 2) | st.text("abl_ ", max_size=6),
    lambda node: (
        st.lists(node, max_size=3) | st.dictionaries(st.text("abl_", min_size=1, max_size=4), node, max_size=3)
    ),
    max_leaves=6,
)


def _paths(node: object, here: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    items = list(node.items()) if isinstance(node, dict) else list(enumerate(node)) if isinstance(node, list) else []
    return [here, *(path for key, value in items for path in _paths(value, (*here, key)))]


@settings(max_examples=40)
@given(data=st.data())
def test_any_value_in_any_place_is_read_or_refused(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    op3 = shipped_folder() / "robots" / "op3"
    tree = scan((op3 / "robot.yaml").read_text(encoding="utf-8"), op3).data
    path = data.draw(st.sampled_from(_paths(tree)[1:]))
    node: object = tree
    for key in path[:-1]:
        node = node[key]  # type: ignore[index]
    node[path[-1]] = data.draw(values)  # type: ignore[index]
    folder = tmp_path_factory.getbasetemp()
    (folder / "body.xml").write_text((op3 / "body.xml").read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "robot.yaml").write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
    try:
        load_profile(folder / "robot.yaml")
    except ConfigError as error:
        assert str(folder) in str(error)
