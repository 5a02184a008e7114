"""From a body file to a profile that runs: whole or not at all, and with no line of hand work."""

import json
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from command_line import said_by as run
from hardware.servo import SERVO_MODELS, Layout, ServoMode, ServoSpec
from messages import refuses, shows
from retarget.cli import main
from retarget.errors import ConfigError, InputError, UsageError
from retarget.ik.support_polygon import check_stand
from retarget.model.body_file import compile_body_text
from retarget.model.observers import robot_observers
from retarget.model.robot import load_profile, load_robot
from retarget.run.options import RunOptions
from retarget.run.trial import try_robot
from retarget.safety.joint_ranges import questioned_ranges
from retarget.schema.profile import DRAFT, RobotProfile, marked_lines, read_profile
from retarget.schema.profile_parts import Foot, Landmark, ProfileFrame, Servo
from retarget.setup.body_draft import BodyDraft
from retarget.setup.draft import Draft, profile_text
from retarget.setup.import_robot import import_robot
from retarget.setup.servo_guess import UNKNOWN, ServoDraft, guess_servos, models_in_names
from unknown_robots import (
    ARM,
    SHIPPED,
    darwin_like,
    ground_rooted,
    humanoid,
    imported,
    microban_like,
    proposed_anatomy,
    scrambled,
    shipped_body,
    small_bust,
    table_arm,
    text_tree,
    urdf,
)


def left_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_bust(tmp_path: Path) -> None:
    done = imported(small_bust(), tmp_path)
    assert not done.problems and done.margin is None and done.drafts == 4 + 5
    assert left_in(tmp_path) == {"body.urdf", "new"} and left_in(done.folder) == {"robot.yaml", "body.xml"}
    profile = load_profile(done.folder)
    arms = {f"{side}_{part}" for side in "lr" for part in ("hand", "upper_arm", "forearm")}
    assert (profile.name, profile.root, set(profile.landmarks)) == ("stranger", "fixed", {*arms, "head"})
    assert set(profile.servos) == {"j_p1", "j_p2", "j_q1", "j_q2"} and not profile.feet


def test_the_missing_parts_of_an_arm_are_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "body.urdf"
    path.write_text(table_arm())
    done = import_robot(path, tmp_path / "new", name="op3")
    assert done.draft.notes[0].startswith("a robot op3 is known already")
    assert [text.split(":")[0] for text in done.draft.missing] == ["head", "legs", "l_hand"]
    assert len(done.problems) == 1 and str(tmp_path) not in done.problems[0]
    shows(done.problems[0], "l_hand")
    assert "# Not found: l_hand: no such arm." in (done.folder / "robot.yaml").read_text()
    code, out, _ = run(capsys, "import", path, "--out", tmp_path / "arm")
    assert code == 0
    shows(out, "l_hand")
    code, _, err = run(capsys, "check", tmp_path / "arm")
    assert code == 2
    shows(err, "l_hand")


@pytest.mark.parametrize("kind", ["folder", "file", "link"])
def test_nothing_is_overwritten(kind: str, tmp_path: Path) -> None:
    target = tmp_path / "new"
    if kind == "folder":
        target.mkdir()
        (target / "robot.yaml").write_text("mine")
    elif kind == "file":
        target.write_text("mine")
    else:
        target.symlink_to(tmp_path / "nowhere")
    with refuses(UsageError):
        imported(small_bust(), tmp_path)
    assert left_in(tmp_path) == {"body.urdf", "new"} or not target.exists()
    if kind == "folder":
        assert (target / "robot.yaml").read_text() == "mine" and left_in(target) == {"robot.yaml"}


def test_a_failure_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.setup.import_robot.find_postures", Mock(side_effect=InputError("no")))
    with pytest.raises(InputError):
        imported(small_bust(), tmp_path)
    assert left_in(tmp_path) == {"body.urdf"}


@pytest.mark.parametrize("name", ["a b/c", *(pytest.param(name, marks=pytest.mark.long) for name in ("..", "  "))])
def test_names_are_made_fit(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "body.urdf"
    path.write_text(small_bust())
    done = import_robot(path, name=name)
    assert done.folder.parent == Path() and done.folder.is_dir() and "/" not in done.draft.name


@pytest.mark.long
@pytest.mark.parametrize("robot", [*SHIPPED, "unknown", *(f"unnamed {name}" for name in SHIPPED)])
def test_no_hand_work_before_the_demo(robot: str, tmp_path: Path) -> None:
    name = robot.removeprefix("unnamed ")
    text = humanoid()
    if robot != "unknown":
        text = shipped_body(name).read_text() if robot == name else scrambled(name)
    done = imported(text, tmp_path)
    assert not done.problems and not done.draft.missing
    assert (check_stand(load_robot(done.folder)) or 0.0) > 0.02
    with pytest.raises(SystemExit) as leaving:
        main(["demo", str(tmp_path / "demo"), "--robot", str(done.folder), "--bus", "mock"])
    assert not leaving.value.code
    report = json.loads((tmp_path / "demo" / "report.json").read_text())
    assert report["stop"]["reason"] is None
    assert report["limit_violations"] == {"position": 0, "velocity": 0, "acceleration": 0}
    assert report["pelvis_height_mm"]["p95"] < 30.0 and report["likeness_deg"]["upper_arms"]["mean"] < 25.0
    # The thighs of the unknown robot meet its hips before it leans as far as the performer.
    assert report["hand_path_ratio"] > (0.85 if robot == "unknown" else 0.9)


LIKE = {
    "darwin": (darwin_like, "MX-28"),
    "ground": (ground_rooted, "XH540-W150"),
    "microban": (microban_like, "XL330-M288"),
}


@pytest.mark.parametrize("like", LIKE)
def test_robots_as_newcomers_bring_them_can_run(like: str, tmp_path: Path) -> None:
    """Shells that are wide above, a base on the ground with visual shapes only, servos that only meshes name."""
    make, model = LIKE[like]
    done = import_robot(make(tmp_path), tmp_path / "new")
    assert not done.problems and (done.margin or 0.0) > 0.02 and "legs" not in " ".join(done.draft.missing)
    assert {servo.entry.model for servo in done.draft.servos} == {model}
    robot = load_robot(done.folder)
    low, high = robot.profile.safety.voltage
    assert low <= SERVO_MODELS[model].voltage <= high
    # Nothing is drawn but what is there: no rod begins or ends at an origin that is far from all shapes.
    vertices, body = robot.solid.meshes[0].vertices, robot.body
    shapes = [geom for geom in body.geoms if geom.body == robot.solid.links[0]]
    reach = max(float(np.linalg.norm(geom.size)) for geom in shapes)
    children = body.body_pos[body.parent == robot.solid.links[0]]
    near = [*(geom.position for geom in shapes), *children]
    assert all(min(np.linalg.norm(vertex - place) for place in near) < reach + 0.02 for vertex in vertices)
    wide = list(questioned_ranges(robot, robot_observers(robot)))
    assert bool(wide) == bool(done.wide) == (like == "darwin")


def test_a_supply_that_is_not_one_of_the_servos_is_refused(tmp_path: Path) -> None:
    folder = imported(small_bust(), tmp_path).folder
    text = (folder / "robot.yaml").read_text(encoding="utf-8")
    (folder / "robot.yaml").write_text(text.replace("model: MX-28", "model: XL330-M288"), encoding="utf-8")
    with refuses(ConfigError, "XL330-M288", "voltage"):
        load_profile(folder)


@given(feet=st.sampled_from(["sphere", "edge"]))
@settings(max_examples=2)
def test_legs_without_soles_hang_and_run(feet: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    shape = '<sphere radius="0.03"/>' if feet == "sphere" else '<box size="0.0005 0.14 0.02"/>'
    done = imported(humanoid().replace('<box size="0.07 0.14 0.02"/>', shape), tmp_path_factory.mktemp("hang"))
    assert done.draft.root == "suspended" and not done.problems
    for bus in ("mock", "profile"):
        try_robot(load_robot(done.folder), RunOptions(robot=str(done.folder), bus=bus))


# `retarget import` as a user meets it.


@pytest.fixture
def bust(tmp_path: Path) -> Path:
    path = tmp_path / "bust.urdf"
    path.write_text(small_bust())
    return path


def test_import_then_check(bust: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    code, out, err = run(capsys, "import", bust, "--out", folder, "--name", "bust")
    assert code == 0 and not err
    shows(out, folder, "bust", "bust.urdf", 4, "MX-28", "--robot", folder / "robot.yaml", "--bus")
    code, out, _ = run(capsys, "check", folder)
    assert code == 0
    shows(out, 9, "DRAFT")
    text = (folder / "robot.yaml").read_text()
    (folder / "robot.yaml").write_text(text.replace("# DRAFT", "#"))
    code, out, _ = run(capsys, "check", folder)
    assert code == 0 and "DRAFT" not in out


def test_what_to_do_next_can_be_pasted_into_a_shell(
    bust: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, "import", bust, "--out", tmp_path / "my bust; it's mine")
    words = shlex.split(out.split("next: ")[1].splitlines()[0])
    assert code == 0 and words[:4] == ["retarget", "demo", "--robot", f"{tmp_path}/my bust; it's mine/robot.yaml"]


@pytest.mark.parametrize("answers", [[""], ["?", "l_knee=no thing", "l_elbow=p1", "l_elbow=", ""]])
def test_a_terminal_is_asked(
    answers: list[str], bust: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """ENTER takes the links; what cannot be is said, and asked again."""
    monkeypatch.setattr("retarget.cli.robots.is_interactive", lambda: True)
    said = iter(answers)
    monkeypatch.setattr("builtins.input", lambda _: next(said))
    code, out, _ = run(capsys, "import", bust, "--out", tmp_path / "new")
    assert code == 0 and next(said, None) is None
    shows(out, "l_hand", "p2")
    frames = load_profile(tmp_path / "new").frames
    assert ("l_elbow" in frames) == ("r_elbow" in frames) == (len(answers) == 1)


def test_a_question_without_an_answer(
    bust: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("retarget.cli.robots.is_interactive", lambda: True)
    monkeypatch.setattr("builtins.input", Mock(side_effect=EOFError))
    code, _, err = run(capsys, "import", bust, "--out", tmp_path / "new")
    assert code == 2
    shows(err, "--yes", "--links")


JOINTS = {"none": ("0 0 0",), "three": ("0 0 0.1", "0 0 0.1", "0 0 0"), "one point": ("0 0 0.1", "0 0 0", "0 0 0")}


@pytest.mark.parametrize("places", JOINTS.values(), ids=JOINTS)
def test_small_arms_are_imported_without_landmarks_that_have_no_length(places: tuple[str, ...], tmp_path: Path) -> None:
    opened = "".join(
        f'<body name="b{n}" pos="{place}"><joint name="j{n}" axis="0 {n % 2} {1 - n % 2}"/><geom size=".03"/>'
        for n, place in enumerate(places)
    )
    end = "</body>" * len(places) + "</worldbody></mujoco>"
    done = imported(f'<mujoco><worldbody><body name="x"><geom size=".05"/>{opened}</body>{end}', tmp_path)
    assert done.problems and all(landmark.robot_length >= 1e-3 for landmark in done.draft.landmarks.values())
    assert ("landmark r_hand" in " ".join(done.draft.missing)) == (len(places) > 1)
    with refuses(InputError, "b0", "base"):
        (tmp_path / "new").rename(tmp_path / "old")
        imported(f"<mujoco><worldbody>{opened}{end}", tmp_path)


# A drafted profile as YAML, and servos guessed from what a body file says of torque and speed.

FRAME = ProfileFrame(link="Yes", pos=(0.1, -0.0, 1e-7))
MOTION = {"limits": (-1.5, 1.25), "max_velocity": 5.2, "max_acceleration": 30.0, "gains": {"p": 850}}
SERVO = Servo.model_validate({"id": 1, "model": "MX-28", "bus": "main", "direction": 1, "zero_tick": 2048, **MOTION})
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
    missing=("l_hand: no such arm",),
    notes=("# a note: of [many] " + "words " * 40,),
)


def read(text: str, folder: Path) -> RobotProfile:
    path = folder / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    return read_profile(path)


def test_everything_comes_back_and_drafts_are_marked(tmp_path: Path) -> None:
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
    lines = text.splitlines()
    marked = [lines[number - 1] for number in marked_lines(text)]
    assert sum("direction, zero_tick" in line for line in marked) == 2 and len(marked) == 2 + 5
    assert not any(line.startswith("#") for line in marked) and text.splitlines()[1].count(DRAFT) <= 1


def guessed(text: str, speeds: dict[str, float] | None = None, **more: str) -> tuple[ServoDraft, ...]:
    tree, model = text_tree(text), compile_body_text(text, source="test").model
    body = BodyDraft(None, model, b"", speeds=speeds or {})
    return guess_servos(body, tree, proposed_anatomy(tree), **more)


def arm(effort: float, *, limits: str = "") -> str:
    return urdf(ARM, base="base", size=(0.1, 0.1, 0.06), effort=effort).replace('lower="-2.5" upper="2.5"', limits)


@pytest.mark.parametrize("robot", SHIPPED)
def test_every_draft_can_be_driven(robot: str) -> None:
    drafts = guessed(shipped_body(robot).read_text(encoding="utf-8"))
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


@pytest.mark.parametrize(
    ("names", "ids"),
    [
        ("J09 J03 arm_J250", [9, 3, 250]),
        ("1_pan 17_lift2 4_roll2", [1, 17, 4]),
        ("l_j1 r_j1 j2", [1, 2, 3]),
        ("j1 j2 wrist", [1, 2, 3]),
        ("j1 j0 j2", [1, 2, 3]),
        ("j1 j253 j2", [1, 2, 3]),
    ],
)
def test_different_numbers_in_all_names_are_ids(names: str, ids: list[int]) -> None:
    text = arm(2.5)
    for one in guessed(text):
        text = text.replace(f'"{one.joint}"', f'"@{one.joint}"')
    old = [one.joint for one in guessed(text)]
    new = [*names.split(), *(f"more{number}" for number in range(100, 97 + len(old)))]
    for joint, name in zip(old, new, strict=True):
        text = text.replace(f'"{joint}"', f'"{name}"')
    drafts = guessed(text)
    assert [one.entry.id for one in drafts][:3] == ids
    assert all(one.numbered is (ids != [1, 2, 3]) for one in drafts)
    text = profile_text(replace(DRAFTED, servos=drafts))
    assert text.count("name), direction") == len(drafts) * drafts[0].numbered


@pytest.mark.parametrize(
    ("model", "volts"),
    [("XM430-W350", (9.5, 14.8)), ("XL430-W250", (6.0, 14.0)), ("XL330-M288", (4.0, 6.0)), ("XC430-W240", (6.0, 14.8))],
)
def test_the_supply_is_what_its_servos_bear(model: str, volts: tuple[float, float], tmp_path: Path) -> None:
    servos = tuple(replace(one, entry=one.entry.model_copy(update={"model": model})) for one in DRAFTED.servos)
    assert read(profile_text(replace(DRAFTED, servos=servos)), tmp_path).safety.voltage == volts


def test_models_by_torque() -> None:
    """OP3's and Poppy's bodies state the stall torques of their servos, so the models are the real ones."""
    for robot, exceptions in (("op3", 0), ("poppy", 2)):  # Poppy's two AX-12A speak another protocol
        profile = load_profile(robot)
        drafts = guessed(shipped_body(robot).read_text(encoding="utf-8"))
        wrong = [draft for draft in drafts if draft.entry.model != profile.servos[draft.joint].model]
        assert len(wrong) == exceptions


@pytest.mark.parametrize("name", [name for name, entry in SERVO_MODELS.items() if entry.layout is Layout.X])
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


@given(
    known=st.sampled_from([name for name, entry in SERVO_MODELS.items() if 2 in entry.protocols]),
    write=st.sampled_from(
        [str.lower, str.upper, lambda name: name.replace("-", "_"), lambda name: name.replace("-", "")]
    ),
    series=st.booleans(),
)
def test_names_tell_a_model_in_any_writing(known: str, write: Callable[[str], str], *, series: bool) -> None:
    """As part of the name of a link or a mesh; a series alone gives its first model."""
    stated = known.split("-")[0] if series else known
    found = models_in_names(["base", f"meshes/{write(stated)}_horn.stl"])
    if stated in ("MX", "XL"):
        assert not found
    else:
        assert [one.name.startswith(stated) for one in found] == [True]
    assert not models_in_names(["left_arm", "xmas", "body_430"])


def test_limits_that_no_servo_reaches_are_refused_and_a_model_that_is_given_fills_the_column() -> None:
    drafts = guessed(arm(2.5, limits='lower="2.5" upper="5.0"'))
    assert max(draft.entry.limits[1] for draft in drafts) < np.pi
    with refuses(InputError, "j_turn"):
        guessed(arm(2.5, limits='lower="3.5" upper="5.0"'))
    assert {one.entry.model for one in guessed(arm(2.5), model="XL330-M288")} == {"XL330-M288"}
    text = arm(2.5).replace('"bend"', '"bend_xl430_w250_case"')
    assert {one.entry.model for one in guessed(text)} == {"XL430-W250"}
