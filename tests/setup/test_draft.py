"""A drafted profile as YAML, and servos guessed from what a body file says of torque and speed."""

from pathlib import Path

import pytest

from hardware.servo import SERVO_MODELS, ServoMode, ServoSpec
from retarget.model.body_file import compile_body, compile_body_text
from retarget.model.robot import load_profile
from retarget.schema.profile import DRAFT, RobotProfile, marked_lines, read_profile
from retarget.schema.profile_parts import Foot, Frame, Gains, Landmark, Servo
from retarget.setup.draft import Draft, profile_text
from retarget.setup.limbs import find_anatomy
from retarget.setup.servo_guess import UNKNOWN, ServoDraft, guess_servos
from unknown_robots import ARM, SHIPPED, shipped_anatomy, shipped_body, shipped_tree, text_tree, urdf

FRAME = Frame(link="Yes", pos=(0.1, -0.0, 1e-7))
SERVO = Servo(
    id=1,
    model="MX-28",
    bus="main",
    direction=1,
    zero_tick=2048,
    limits=(-1.5, 1.25),
    max_velocity=5.2,
    max_acceleration=30.0,
    gains=Gains(p=850),
)
DRAFTED_SERVO = ServoDraft("no", SERVO, "by its 2.5 N m", "drawn in")
HAND = Landmark.model_validate(
    {
        "frame": "l_hand",
        "follows": "l_wrist",
        "from": "l_shoulder",
        "anchor": "head",
        "robot_length": 0.25,
        "human_length": ["l_shoulder", ["l_elbow", "l_wrist"]],
        "offset": (0.0, 0.1, -0.2),
    }
)
TURNED = FRAME.model_copy(update={"quat": (0.707107, 0.0, 0.0, 0.707107)})
DRAFTED = Draft(
    name="on",
    source="a body: with a # in it.urdf",
    body="body.xml",
    root="free",
    frames={"head": (FRAME, "centre: of it"), "neck": (TURNED, "")},
    servos=(
        DRAFTED_SERVO,
        ServoDraft('a"b:c#', SERVO.model_copy(update={"id": 2}), "by its 2.5 N m"),
    ),
    feet={"left": Foot(frame="head", polygon=((0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1)))},
    postures={name: {"no": 0.5, 'a"b:c#': -0.25} for name in ("neutral", "stand", "rest", "attractor")},
    landmarks={"l_hand": HAND},
    facing="assumed",
    missing=("l_hand: no such arm",),
    notes=("# a note: of [many] " + "words " * 40,),
)


def read(text: str, folder: Path) -> RobotProfile:
    path = folder / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    return read_profile(path)


def test_everything_comes_back(tmp_path: Path) -> None:
    text = profile_text(DRAFTED)
    profile = read(text, tmp_path)
    head, neck = profile.frames["head"], profile.frames["neck"]
    assert (profile.name, head.link, list(head.pos)) == ("on", "Yes", [0.1, 0.0, 1e-7])
    assert list(neck.quat) == [0.707107, 0.0, 0.0, 0.707107]
    assert list(profile.servos) == ["no", 'a"b:c#'] and profile.servos["no"].limits == (-1.5, 1.25)
    assert profile.postures.rest == {"no": 0.5, 'a"b:c#': -0.25} and profile.feet["left"].polygon[0] == (0.1, 0.1)
    assert profile.landmarks["l_hand"].human_length == (("l_shoulder",), ("l_elbow", "l_wrist"))
    assert profile.landmarks["l_hand"].offset == (0.0, 0.1, -0.2)
    assert max(len(line.split("  #")[0]) for line in text.splitlines()) <= 120


def test_what_is_only_a_draft_is_marked() -> None:
    text = profile_text(DRAFTED)
    lines = text.splitlines()
    marked = [lines[number - 1] for number in marked_lines(text)]
    assert sum("direction, zero_tick" in line for line in marked) == 2 and len(marked) == 2 + 5
    assert not any(line.startswith("#") for line in marked) and text.splitlines()[1].count(DRAFT) <= 1


def guessed(text: str, speeds: dict[str, float] | None = None) -> tuple[ServoDraft, ...]:
    tree = text_tree(text)
    return guess_servos(compile_body_text(text, source="test").model, tree, find_anatomy(tree), speeds or {})


def arm(effort: float, *, limits: str = "") -> str:
    return urdf(ARM, base="base", size=(0.1, 0.1, 0.06), effort=effort).replace('lower="-2.5" upper="2.5"', limits)


@pytest.mark.parametrize("robot", SHIPPED)
def test_every_draft_can_be_driven(robot: str) -> None:
    model = compile_body(shipped_body(robot)).model
    drafts = guess_servos(model, shipped_tree(robot), shipped_anatomy(robot), {})
    assert [draft.entry.id for draft in drafts] == list(range(1, len(drafts) + 1))
    for draft in drafts:
        model = SERVO_MODELS[draft.entry.model]
        spec = ServoSpec(
            joint=draft.joint,
            id=draft.entry.id,
            model=model,
            bus="main",
            direction=1,
            zero_tick=draft.entry.zero_tick,
            lower=draft.entry.limits[0],
            upper=draft.entry.limits[1],
            max_velocity=draft.entry.max_velocity,
            max_acceleration=draft.entry.max_acceleration,
            mode=ServoMode.POSITION,
        )
        assert spec.problems() == () and draft.entry.max_velocity < model.no_load_speed


def test_models_by_torque() -> None:
    """OP3's and Poppy's bodies state the stall torques of their servos, so the models are the real ones."""
    for robot, exceptions in (("op3", 0), ("poppy", 2)):  # Poppy's two AX-12A speak another protocol
        profile = load_profile(robot)
        model = compile_body(shipped_body(robot)).model
        drafts = guess_servos(model, shipped_tree(robot), shipped_anatomy(robot), {})
        wrong = [draft for draft in drafts if draft.entry.model != profile.servos[draft.joint].model]
        assert len(wrong) == exceptions


@pytest.mark.parametrize("name", [name for name, entry in SERVO_MODELS.items() if 2 in entry.protocols])
def test_torque_and_speed_identify_a_model(name: str) -> None:
    entry = SERVO_MODELS[name]
    drafts = guessed(arm(entry.stall_torque), {f"j_{part.name}": entry.no_load_speed for part in ARM})
    found = {SERVO_MODELS[draft.entry.model] for draft in drafts}
    assert all(one.stall_torque == entry.stall_torque and one.voltage == entry.voltage for one in found)


def test_no_torque_and_a_torque_that_no_servo_has() -> None:
    nothing = guessed(arm(0.0))
    assert {draft.entry.model for draft in nothing} == {UNKNOWN} and nothing[0].why == "the body states no torque"
    strong = guessed(arm(200.0))
    assert strong[0].entry.model == "XH540-W270" and strong[0].why.startswith("no known model has 200 N m")
