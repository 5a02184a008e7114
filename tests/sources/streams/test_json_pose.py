"""JSON poses: what the specification promises, and that nothing else gets in."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from retarget import rotations
from retarget.frames import SENSORS
from retarget.sources.skeletons import TABLES
from retarget.sources.streams.json_pose import JsonPoseDecoder
from retarget.sources.streams.stream_frame import (
    CONVENTIONS,
    MAX_COORDINATE,
    MAX_DATAGRAM,
    MAX_POSES,
    StreamFrame,
    unusable,
)

Message = dict[str, Any]


def good(**changes: object) -> Message:
    """A message that is used, with keys changed; None takes one out."""
    message: Message = {
        "axes": "unity",
        "quaternion": "xyzw",
        "time": 12.5,
        "frame": 741,
        "poses": {
            "l_wrist": {"p": [1.0, 2.0, 3.0], "q": [0.0, 0.6, 0.0, 0.8], "tracked": True},
            "head": {"p": [0, 1, 0]},
            "chest": {"q": [0, 0, 0, -1], "tracked": False},
        },
    }
    return {key: value for key, value in (message | changes).items() if value is not None}


def pose(value: object) -> Message:
    return good(poses={"a": value})


def decoded(message: object) -> StreamFrame:
    decoder = JsonPoseDecoder()
    (frame,) = decoder.decode(json.dumps(message).encode())
    return frame


def reason(datagram: bytes | object) -> str:
    """Why a datagram is not used at all."""
    decoder = JsonPoseDecoder()
    assert decoder.decode(datagram if isinstance(datagram, bytes) else json.dumps(datagram).encode()) == []
    ((text, count),) = decoder.dropped.reasons.items()
    assert count == 1
    return text


@pytest.mark.parametrize("name", CONVENTIONS)
@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_every_convention_and_order(name: str, order: str) -> None:
    turn = rotations.normalise([0.9, 0.1, -0.2, 0.3])
    sent = turn if order == "wxyz" else np.roll(turn, -1)
    frame = decoded(pose({"p": [1.0, 2.0, 3.0], "q": sent.tolist()}) | {"axes": name, "quaternion": order})
    np.testing.assert_allclose(frame.position[0], CONVENTIONS[name].positions([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(frame.orientation[0], CONVENTIONS[name].orientations(turn), atol=1e-12)


@pytest.mark.parametrize(
    "bad",
    [
        {"q": [0, 0, 0, 0]},
        {"q": [0, 0, 0, 1.03]},
        {"q": [0, 0, 0, 1e300]},
        {"q": [0, 0, 0, 10**400]},
        {"q": [0.5, 0.5, 0.5, 10**400]},
        {"p": [0, 0, 1.01 * MAX_COORDINATE]},
        {"p": [0, -(10**400), 0], "q": [0, 0, 0, 1]},
    ],
)
def test_numbers_that_are_no_pose_cost_only_that_pose(bad: Message) -> None:
    decoder = JsonPoseDecoder()
    (frame,) = decoder.decode(json.dumps(good(poses={"a": bad, "b": {"p": [0, 0, 1]}})).encode())
    assert frame.tracked.tolist() == [False, True]
    assert np.isnan(frame.position[0]).all() and np.isnan(frame.orientation[0]).all()
    assert decoder.dropped.reasons == {"pose that is no number or no rotation": 1}
    decoder.decode(json.dumps(pose(bad | {"tracked": False})).encode())
    assert decoder.dropped.count == 1  # the sender said itself that it is none


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (b"", "not JSON"),
        (b"\xff{}", "not JSON"),
        (b"{} {}", "not JSON"),
        (b"[" * 60_000, "not JSON"),
        (b'{"time": ' + b"9" * 60_000 + b"}", "not JSON"),
        (b" " * (MAX_DATAGRAM + 1), "too long"),
        ([1], "not a JSON object"),
        ("text", "not a JSON object"),
        (good(extra=1), "a key other than"),
        (b'{"axes": "unity", "axes": "unity", "poses": {}}', "a key twice"),
        (b'{"axes": "unity", "poses": {"a": {"p": [0,0,0]}, "a": {"p": [1,0,0]}}}', "a key twice"),
        (b'{"axes": "unity", "poses": {"a": {"p": [0,0,NaN]}}}', "NaN or Infinity"),
        (b'{"axes": "unity", "time": -Infinity, "poses": {}}', "NaN or Infinity"),
        (good(axes=None), '"axes"'),
        (good(axes="Unity"), '"axes"'),
        (good(axes=["unity"]), '"axes"'),
        (good(quaternion=None), '"quaternion"'),
        (good(quaternion="wzyx"), '"quaternion"'),
        (good(quaternion=["xyzw"]), '"quaternion"'),
        (good(time="12"), '"time"'),
        (b'{"axes": "unity", "time": 1e999, "poses": {}}', "no finite number"),
        (good(time=1.7e12), "milliseconds"),
        (good(time=True), '"time"'),
        (good(time=10**400), '"time"'),
        (good(frame=1.0), '"frame"'),
        (good(frame=-1), '"frame"'),
        (good(frame=2**63), '"frame"'),
        (good(frame=False), '"frame"'),
        (good(poses=None), '"poses"'),
        (good(poses={}), '"poses"'),
        (good(poses=[]), '"poses"'),
        (good(poses={str(n): {"p": [0, 0, 0]} for n in range(MAX_POSES + 1)}), '"poses"'),
        (good(poses={"": {"p": [0, 0, 0]}}), "name"),
        (good(poses={"x" * 65: {"p": [0, 0, 0]}}), "name"),
        (good(poses={"a\x1b[2J": {"p": [0, 0, 0]}}), "name"),
        (b'{"axes": "unity", "poses": {"\\ud800": {"p": [0,0,0]}}}', "name"),
        (pose([0, 0, 0]), "a pose is"),
        (pose({}), "a pose is"),
        (pose({"tracked": True}), "a pose is"),
        (pose({"p": [0, 0, 0], "rot": 1}), "a pose is"),
        (pose({"p": [0, 0, 0], "tracked": 1}), '"tracked"'),
        (pose({"p": [0, 0]}), '"p" is not 3 numbers'),
        (pose({"p": [0, 0, "0"]}), '"p" is not 3 numbers'),
        (pose({"p": [0, 0, True]}), '"p" is not 3 numbers'),
        (pose({"p": None}), '"p" is not 3 numbers'),
        (pose({"q": [0, 0, 1]}), '"p" is not 3 numbers'),
        (pose({"q": {"x": 0, "y": 0, "z": 0, "w": 1}}), '"p" is not 3 numbers'),
        (good(layout="smpl"), "smpl24"),
        (good(layout=["smpl24"]), "smpl24"),
        (good(layout="smpl24"), "24"),
        (good(layout="webxr83", poses=[None] * 24), "83"),
        (good(poses=[None] * 24), '"layout"'),
        (good(layout="smpl24", poses=[[0, 0]] * 24), "a pose"),
        (good(layout="smpl24", poses=[[0, 0, "x"]] * 24), '"p"'),
        (good(layout="smpl24", poses=[]), '"poses"'),
    ],
)
def test_an_error_of_the_sender_is_counted_with_its_reason(message: object, words: str) -> None:
    assert words in reason(message)


def test_the_page_shows_a_message_that_is_used_and_every_convention(root: Path) -> None:
    page = (root / "docs/live.md").read_text(encoding="utf-8")
    shown = page.split("```json\n")[1].split("```")[0]
    assert decoded(json.loads(shown)).tracked.all()
    for row in CONVENTIONS.values():
        unit = {1.0: "m", 0.001: "mm"}[row.metres]
        assert f"| `{row.name}` | {row.x} | {row.y} | {row.z} | {unit} |" in page
    table = page.split("## Axes")[1].split("## Names")[0]
    assert table.count("\n| `") == len(CONVENTIONS)


SCALAR = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5))
TREE = st.recursive(
    SCALAR, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner), max_leaves=8
)


@given(st.sampled_from(["axes", "quaternion", "time", "frame", "poses", "a", "p", "q", "tracked"]), TREE)
@example("poses", {"a": {"p": [1, 2, 3], "q": None}})
def test_any_value_at_any_key(key: str, value: object) -> None:
    message = good(poses={"a": {"p": [0, 0, 0], "q": [0, 0, 0, 1], "tracked": True}})
    if key in message:
        message[key] = value
    elif key == "a":
        message["poses"][key] = value
    else:
        message["poses"]["a"][key] = value
    for frame in JsonPoseDecoder().decode(json.dumps(message).encode()):
        assert 0 < len(frame.names) == len(set(frame.names)) <= MAX_POSES
        assert not np.isinf(frame.position).any() and not np.isinf(frame.orientation).any()


# Poses that no room and no rotation holds are found, and only those.

GOOD_PLACE, GOOD_TURN = [0.5, -1.0, 1.7], [0.6, 0.0, 0.8, 0.0]


@pytest.mark.parametrize(
    ("place", "turn", "bad"),
    [
        (GOOD_PLACE, GOOD_TURN, False),
        (GOOD_PLACE, [-1.0, 0.0, 0.0, 0.0], False),
        (GOOD_PLACE, [1.019, 0.0, 0.0, 0.0], False),
        (GOOD_PLACE, [1.021, 0.0, 0.0, 0.0], True),
        (GOOD_PLACE, [0.979, 0.0, 0.0, 0.0], True),
        (GOOD_PLACE, [0.0, 0.0, 0.0, 0.0], True),
        (GOOD_PLACE, [np.nan, 0.0, 0.0, 1.0], True),
        (GOOD_PLACE, [np.inf, 0.0, 0.0, 1.0], True),
        (GOOD_PLACE, [3.4e38, 0.0, 0.0, 1.0], True),
        ([0.0, np.nan, 0.0], GOOD_TURN, True),
        ([0.0, 0.0, -np.inf], GOOD_TURN, True),
        ([0.0, MAX_COORDINATE, 0.0], GOOD_TURN, False),
        ([0.0, 1.01 * MAX_COORDINATE, 0.0], GOOD_TURN, True),
    ],
)
def test_each_pose_by_itself(place: list[float], turn: list[float], bad: bool) -> None:
    among = unusable(np.array([GOOD_PLACE, place, GOOD_PLACE]), np.array([GOOD_TURN, turn, GOOD_TURN]))
    assert among.tolist() == [False, bad, False]


def test_the_formulas_of_the_vendors() -> None:
    generator = np.random.default_rng(5)
    points, turns = generator.normal(size=(50, 3)), rotations.normalise(generator.normal(size=(50, 4)))
    (px, py, pz), (w, x, y, z) = points.T, turns.T
    np.testing.assert_allclose(CONVENTIONS["unity"].positions(points), np.stack([pz, -px, py], axis=1))
    np.testing.assert_allclose(CONVENTIONS["unity"].orientations(turns), np.stack([w, -z, x, -y], axis=1))
    np.testing.assert_allclose(CONVENTIONS["openxr"].positions(points), np.stack([-pz, -px, py], axis=1))
    np.testing.assert_allclose(CONVENTIONS["openxr"].orientations(turns), np.stack([w, -z, -x, y], axis=1))
    np.testing.assert_allclose(CONVENTIONS["vicon_mm"].positions(points), points / 1000.0)
    np.testing.assert_allclose(CONVENTIONS["xsens_y_up"].orientations(turns), np.stack([w, z, x, y], axis=1))


# Layouts: poses as an array.


SMPL = tuple(TABLES["layouts"]["smpl"])


def standing_smpl(yaw: float = 0.0) -> Message:
    """A person with the left arm hanging and the right one out to the side, who faces forward, turned by yaw."""
    half = np.sqrt(0.5)
    turn = rotations.from_axis_angle([0.0, 1.0, 0.0], yaw)  # about up, in axes left, up, forward
    rows: list[object] = []
    for at, name in enumerate(SMPL):
        hanging = name.startswith("left_") and name[5:] in ("shoulder", "elbow", "wrist", "hand")
        own = np.array([half, 0.0, 0.0, -half]) if hanging else rotations.IDENTITY  # left arm down: about forward
        q = rotations.multiply(turn, own)
        rows.append([0.01 * at, 1.0, 0.0, *np.roll(q, -1).tolist()])
    return good(axes="motive_y_up", layout="smpl24", poses=rows)


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_smpl_s_order_gives_our_sensors_unturned_where_arms_hang(yaw: float) -> None:
    frame = decoded(standing_smpl(yaw))
    assert set(frame.names) == set(SENSORS)
    at = dict(zip(frame.names, frame.position, strict=True))
    for sensor, joint in (("l_wrist", "left_wrist"), ("head", "head"), ("r_toe", "right_foot"), ("chest", "spine3")):
        np.testing.assert_allclose(at[sensor], [0.0, 0.01 * SMPL.index(joint), 1.0], atol=1e-12)
    upright = rotations.from_axis_angle([0.0, 0.0, 1.0], yaw)
    aside = rotations.multiply(upright, rotations.shortest_arc([0.0, 0.0, -1.0], [0.0, -1.0, 0.0]))
    for name, turn in zip(frame.names, frame.orientation, strict=True):
        right = aside if name in ("r_shoulder", "r_elbow", "r_wrist") else upright
        assert rotations.angle_between(turn, right) < 1e-6, name


def test_a_toe_turns_with_the_foot_and_null_is_not_tracked() -> None:
    message = standing_smpl()
    message["poses"][SMPL.index("left_foot")] = [0.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.8]
    message["poses"][SMPL.index("head")] = None
    message["poses"][SMPL.index("left_knee")] = [0.1, 0.2, 0.3]
    message["poses"][SMPL.index("right_knee")] = {"p": [0.1, 0.2, 0.3], "tracked": False}
    frame = decoded(message)
    row = frame.names.index
    np.testing.assert_array_equal(frame.orientation[row("l_toe")], frame.orientation[row("l_ankle")])
    assert np.isnan(frame.position[row("head")]).all() and not frame.tracked[row("head")]
    assert np.isnan(frame.orientation[row("l_knee")]).all() and frame.tracked[row("l_knee")]
    assert not frame.tracked[row("r_knee")]


def test_webxr_s_body_gives_places_alone() -> None:
    rows = [[0.01 * at, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0] for at in range(83)]
    frame = decoded(good(axes="webxr", layout="webxr83", poses=rows))
    assert set(frame.names) == set(SENSORS) and np.isnan(frame.orientation).all() and frame.tracked.all()
    places = dict(zip(frame.names, np.rint(-100.0 * frame.position[:, 1]).astype(int).tolist(), strict=True))
    # By the enumeration: hips, ..., 7 of the torso, 5 of each arm, 26 of each hand, 7 of each leg.
    assert (places["pelvis"], places["head"], places["l_wrist"], places["r_wrist"]) == (0, 6, 18, 44)
    assert (places["l_shoulder"], places["r_shoulder"], places["l_hip"], places["r_toe"]) == (9, 14, 69, 82)
