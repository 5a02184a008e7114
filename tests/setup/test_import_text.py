"""A drafted profile as YAML: it loads, awkward names too, and its marks can be counted."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from messages import shows
from retarget.schema.profile import DRAFT, RobotProfile, marked_lines, read_profile
from retarget.schema.profile_parts import Foot, Frame, Gains, Landmark, Servo
from retarget.setup.draft import FAST_HZ, SLOW_HZ, Draft, observer_text, profile_text
from retarget.setup.fit_observers import Fit, Verdict
from retarget.setup.servo_guess import ServoDraft
from retarget.setup.shape_fit import Capsule, Proposal, Zones

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


@pytest.mark.parametrize(("count", "rate"), [(2, FAST_HZ), (40, SLOW_HZ)])
def test_many_servos_are_asked_less_often(count: int, rate: int, tmp_path: Path) -> None:
    servos = tuple(
        ServoDraft(f"j{number}", SERVO.model_copy(update={"id": number}), "") for number in range(1, count + 1)
    )
    profile = read(profile_text(replace(DRAFTED, servos=servos)), tmp_path)
    assert profile.safety.rate_hz == rate and profile.buses["main"].ids == tuple(range(1, count + 1))


def test_servos_of_five_volts(tmp_path: Path) -> None:
    small = ServoDraft("no", SERVO.model_copy(update={"model": "XL330-M288"}), "")
    assert read(profile_text(replace(DRAFTED, servos=(small,))), tmp_path).safety.voltage == (4.0, 6.0)


@pytest.mark.parametrize("pairs", [(), (Verdict("never", ("a", "b"), "near"),)])
def test_pairs_that_touch_are_ignored_too(pairs: tuple[Verdict, ...], tmp_path: Path) -> None:
    ball = Proposal(1, "a", "b", Capsule(np.zeros(3), np.zeros(3), 0.1), 1.0, 0.0, "")
    fitted = Fit((ball,), Zones(0.04, 0.005), pairs, (), ("Proposed: put it elsewhere.",), ())
    profile = read(profile_text(replace(DRAFTED, observers=observer_text(fitted, [("x", "y")]))), tmp_path)
    assert profile.ignore_pairs[0].pair == ("x", "y")
    shows(profile.ignore_pairs[0].reason)
    assert len(profile.ignore_pairs) == 1 + len(pairs)
    shows(observer_text(fitted, ()))
