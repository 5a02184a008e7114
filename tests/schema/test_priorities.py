"""Priority files: every task type, the defaults, and what is refused."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from followers import DT, dimensions, performer, postures
from messages import Facts, refuses
from retarget import rotations
from retarget.cli import main
from retarget.cli.exit import REFUSED
from retarget.errors import ConfigError
from retarget.model.robot import load_robot
from retarget.robot.follower import Follower
from retarget.run.options import PhysicsOptions, RunOptions, priority_names
from retarget.schema.catalogue import Kind, find
from retarget.schema.priorities import (
    AxisTask,
    CentreOfMassTask,
    PositionTask,
    PostureTask,
    PreventiveTask,
    Priorities,
    load_priorities,
    self_contained,
)


@pytest.mark.parametrize("forward", [True, False])
def test_feet_that_are_to_point_forward_do(forward: bool) -> None:
    """The axis of a robot's frame points along a direction of its own world, x forward."""
    robot, held = load_robot("op3", root="suspended"), load_priorities("fixed_base")
    dropped = (PostureTask,) if forward else (PostureTask, AxisTask)
    levels = tuple(
        level.model_copy(update={"tasks": tuple(task for task in level.tasks if not isinstance(task, dropped))})
        for level in held.levels
    )
    one = Follower(robot, held.model_copy(update={"levels": levels}), dimensions(performer()))
    human = postures(performer())[0]
    one.start(human)
    turned = robot.posture(robot.profile.postures.stand)
    turned[robot.body.joint_qpos[robot.body.joint_index("l_hip_yaw")]] = 0.5
    one.reseed(turned, np.zeros(robot.body.nv))
    posture = one.step(human, DT)
    for _ in range(400):
        posture = one.step(human, DT)
    x, y, _ = rotations.rotate(robot.orientations(posture.q[None], ("l_sole",))[0, 0], np.array([1.0, 0.0, 0.0]))
    assert (abs(float(np.arctan2(y, x))) < 0.02) is forward
    row = posture.landmark_names.index("l_sole")
    assert np.linalg.norm(posture.landmarks_reached[row] - posture.landmarks_asked[row]) < 1e-3


@pytest.mark.parametrize(
    ("bus", "mount", "named", "chosen"),
    [
        ("physics", "gantry", None, "fixed_base"),
        ("physics", "stand", None, "fixed_base"),
        ("physics", "floor", None, "balanced"),
        ("physics", "gantry", "servo", "servo"),
        ("mock", None, None, "servo"),
    ],
)
def test_priorities_of_a_run_follow_its_mount(bus: str, mount: str | None, named: str | None, chosen: str) -> None:
    physics = PhysicsOptions(mount=mount, hook="neck" if mount == "gantry" else None)
    options = RunOptions(robot="op3", bus=bus, priorities=named, physics=physics)
    assert priority_names(load_robot("op3", root=physics.root), options)[-1] == chosen


EVERYTHING = """\
name: everything
description: One task of each type.
iterations: 8
activation: all
levels:
  - name: balance
    tasks:
      - {type: centre_of_mass, mode: support, margin: 0.01}
      - {type: reactive, speed: 0.2}
  - name: feet
    tasks:
      - {type: position, of: [l_sole, r_sole], weight: [1, 1, 2]}
      - {type: axis, of: [l_sole, r_sole], axis: [0, 0, 1], direction: [0, 0, 1]}
      - {type: preventive, of: [l_forearm]}
  - name: kept free
    tasks: []
  - name: hands
    tasks:
      - {type: position, of: l_hand, weight: 3, gain: 0.5, max_error: 0.02, optional: true}
      - {type: orientation, of: head}
      - {type: look_at, of: head}
      - {type: heading, of: [pelvis, chest], weight: 0.3}
  - name: posture
    tasks:
      - {type: posture, stiffness: {default: 1.0, spine: 20}, settle: 0.1, gain: 0.05}
      - {type: centre_of_mass, mode: over_feet, forward: 0.05, fade_speed: 0.5}
"""


def load(text: str, folder: Path) -> Priorities:
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_priorities(path)


def test_short_forms_and_defaults(tmp_path: Path) -> None:
    balance, feet, _, hands, last = (level.tasks for level in load(EVERYTHING, tmp_path).levels)
    hand, axis, preventive, com, posture = hands[0], feet[1], feet[2], balance[0], last[0]
    assert isinstance(hand, PositionTask)
    assert (hand.of, hand.weight, hand.gain, hand.max_error, hand.optional) == (
        *(("l_hand",), (3, 3, 3), 0.5, 0.02, True),
    )
    assert isinstance(axis, AxisTask)
    assert (axis.gain, axis.max_error, axis.optional, axis.weight) == (1.0, None, False, 1.0)
    assert isinstance(preventive, PreventiveTask) and preventive.of == ("l_forearm",)
    assert isinstance(com, CentreOfMassTask) and com.weight == (1.0, 1.0, 0.0)
    assert isinstance(posture, PostureTask)
    assert (posture.towards, posture.stiffness, posture.settle) == ("attractor", {"default": 1.0, "spine": 20.0}, 0.1)


POSTURE = "      - {type: posture, stiffness"
FLAT = "type: axis, of: l_ankle, axis: [0, 0, 1], direction: [0, 0, 1]"
LOWERED = "type: axis, of: pelvis, axis: [0, 0, 1], direction: [0, 0, 1], lowered"


def more(task: str) -> tuple[str, str]:
    """Another task beside the posture of the last level, as a replacement."""
    return POSTURE, f"      - {{{task}}}\n{POSTURE}"


@pytest.mark.parametrize(
    ("old", "new", "facts"),
    [
        ("type: reactive", "type: reactve", ()),
        ("type: reactive, ", "", ()),
        ("mode: support", "mode: over_rot", ()),
        ("settle: 0.1", "setle: 0.1", ()),
        ("settle: 0.1", "settle: -1", ()),
        ("weight: [1, 1, 2]", "weight: [1, x, 2]", ()),
        ("weight: [1, 1, 2]", "weight: [0, 0, 0]", ()),
        ("weight: [1, 1, 2]", "weight: -1", ()),
        ("weight: [1, 1, 2]", "weight: true", ()),
        ("axis: [0, 0, 1], ", "axis: [0, 0, 0], ", ()),
        ("gain: 0.05", "gain: 0", ()),
        ("optional: true", "optional: yes", ()),
        ("iterations: 8", "iterations: 8.5", ()),
        ("iterations: 8", "iterations: 0", ()),
        ("name: feet", "name: balance", ()),
        ("    tasks: []", "    task: []", ()),
        ("spine: 20", "spine: .nan", ()),
        ("activation: all", "deflection_compensation: {settle: 0, speed_margin: -0.1, share: 1}", ()),
        ("activation: all", "heading: {walking: [1.0, 0.5]}", ()),
        ("mode: support", "mode: over_feet, when: double", ("strict level", "last level")),
        (*more("type: carried, settle: 0.1, by: {head: 0.6, l_ankel: 0.2}"), "Did you mean l_ankle"),
        (*more("type: carried, settle: 0.1, by: {head: 0.6, spine: 0.2}"), "unknown sensor"),
        (*more("type: carried, settle: 0.1, by: {l_ankle: 0.5, r_ankle: 0.5}"), "the head has no share"),
        (*more("type: carried, settle: 0.1, by: {}"), "the head has no share"),
        (*more(f"{LOWERED}: [0, 0, -2]"), ("lowered", "opposite")),
        (*more(f"{FLAT}, when: fligt"), ("when", "fligt", "flight")),
        (*more(f"{FLAT}, when: both"), ("when", "both", "double")),
        (*more(f"{FLAT}, when: []"), "when"),
        (*more("type: centre_of_mass, mode: support, when: double"), ("when", "support", "inequality")),
        (*more("type: posture, when: double"), "when"),
    ],
)
def test_refused_with_its_place(tmp_path: Path, old: str, new: str, facts: Facts) -> None:
    assert old in EVERYTHING
    with refuses(ConfigError, "mine.yaml:", facts):
        load(EVERYTHING.replace(old, new, 1), tmp_path)


def test_a_task_may_act_in_some_phases_of_support_be_carried_or_lowered(tmp_path: Path) -> None:
    for text, phases in (("flight", ("flight",)), ("[double, left]", ("double", "left"))):
        axis = load(EVERYTHING.replace(*more(f"{FLAT}, when: {text}")), tmp_path).levels[-1].tasks[0]
        assert isinstance(axis, AxisTask) and axis.when == phases
    for task in ("type: carried, settle: 0.1, by: {l_ankle: 0.2, head: 0.6}", f"{LOWERED}: [0, 0, 2]"):
        assert load(EVERYTHING.replace(*more(task)), tmp_path)


WRITTEN_OUT = json.loads(Path(__file__).with_name("priorities_written_out.json").read_text(encoding="utf-8"))
"""The shipped priority files of robots, each whole."""


@pytest.mark.parametrize("name", sorted(WRITTEN_OUT))
def test_shipped_overlays_are_what_they_say_written_out(name: str) -> None:
    assert load_priorities(name) == Priorities.model_validate(WRITTEN_OUT[name])


BASE = EVERYTHING.replace("name: everything", "name: base").replace("  - name: kept free\n    tasks: []\n", "")
OVERLAY = """\
name: mine
description: Hands before feet.
extends: base.yaml
activation: all
levels:
  - balance
  - hands
  - name: feet
    tasks:
      - {type: position, of: [l_sole, r_sole]}
  - name: eyes
    tasks:
      - {type: look_at, of: head}
  - posture
"""


def overlay(folder: Path, text: str = OVERLAY, *, base: str = BASE) -> Priorities:
    (folder / "base.yaml").write_text(base, encoding="utf-8")
    return load(text, folder)


def test_an_overlay_takes_from_its_base_what_it_does_not_say(tmp_path: Path) -> None:
    mine, base = overlay(tmp_path), load_priorities(tmp_path / "base.yaml")
    assert (mine.name, mine.description, mine.extends) == ("mine", "Hands before feet.", None)
    assert (mine.iterations, mine.activation) == (8, "all")
    theirs = {level.name: level for level in base.levels}
    assert [level.name for level in mine.levels] == ["balance", "hands", "feet", "eyes", "posture"]
    for name in ("balance", "hands", "posture"):
        assert theirs[name] in mine.levels
    assert len(mine.levels[2].tasks) == 1 and len(theirs["feet"].tasks) == 3


def test_overlays_of_the_user_extend_shipped_ones_and_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A shipped overlay extends the shipped base, whatever the user has."""
    shipped, balanced = load_priorities("balanced_sustained"), load_priorities("balanced")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    folder = tmp_path / "retarget" / "priorities"
    folder.mkdir(parents=True)
    head = "name: mine\ndescription: One of the user's.\n"
    (folder / "slower.yaml").write_text(head + "extends: balanced_sustained\niterations: 3\n", encoding="utf-8")
    (folder / "slowest.yaml").write_text(head + "extends: slower\nlag_compensation: 0.1\n", encoding="utf-8")
    own_keys = {"name": "mine", "description": "One of the user's.", "iterations": 3, "lag_compensation": 0.1}
    assert load_priorities("slowest") == shipped.model_copy(update=own_keys)
    (folder / "servo.yaml").write_text(EVERYTHING, encoding="utf-8")
    assert load_priorities("servo").name == "everything"
    assert load_priorities("balanced") == balanced


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("base.yaml", "servvo"),
        ("base.yaml", "lasting"),
        ("base.yaml", "gone.yaml"),
        ("base.yaml", "[base.yaml]"),
        ("base.yaml", "mine.yaml"),
        ("- hands", "- hans"),
        ("- hands", "- {name: hands}"),
        ("- hands", "- balance"),
        ("activation: all", "activaton: all"),
        ("name: mine\n", ""),
        ("look_at", "look_it"),
        ("levels:\n", "levels: none\nlayers:\n"),
        ("levels:\n  - balance\n  - hands\n", "levels: []\nx:\n"),
    ],
)
def test_a_bad_overlay_is_refused_with_its_place(tmp_path: Path, old: str, new: str) -> None:
    assert old in OVERLAY
    with refuses(ConfigError, "mine.yaml"):
        overlay(tmp_path, OVERLAY.replace(old, new, 1))


def test_overlays_that_lead_back_or_too_far_are_refused(tmp_path: Path) -> None:
    head = "name: a\ndescription: b\nextends: {}.yaml\n"
    for number in range(10):
        (tmp_path / f"{number}.yaml").write_text(head.format(number + 1), encoding="utf-8")
    (tmp_path / "10.yaml").write_text(BASE, encoding="utf-8")
    assert load_priorities(tmp_path / "2.yaml").levels
    with refuses(ConfigError, "9.yaml:3: extends", "1 -> 2", "9 -> 10"):
        load_priorities(tmp_path / "1.yaml")
    (tmp_path / "10.yaml").write_text(head.format(9), encoding="utf-8")
    with refuses(ConfigError, "10.yaml:3: extends", "9 -> 10 -> 9"):
        load_priorities(tmp_path / "9.yaml")


@pytest.mark.parametrize("name", ["human", "balanced_sustained"])
def test_a_file_that_holds_all_that_it_takes_loads_as_the_file_itself(name: str, tmp_path: Path) -> None:
    path = tmp_path / "whole.yaml"
    path.write_bytes(self_contained(find(Kind.PRIORITIES, name)))
    assert "extends" not in path.read_text(encoding="utf-8")
    assert load_priorities(path) == load_priorities(name)


@pytest.mark.parametrize(
    ("robot", "priorities", "message"),
    [
        ("human", "servo", r"servo\.yaml.*neck.*human_clear"),
        ("op3", "human", r"human\.yaml: .*l_wrist, r_wrist.*leave its priorities out"),
    ],
)
def test_the_wrong_file_is_refused(
    robot: str, priorities: str, message: str, shared: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = str(shared / "mocap" / "cmu_asfamc" / "02_06.amc")
    with pytest.raises(SystemExit) as leaving:
        main(["run", "--robot", robot, "--source", source, "--end", "0.1", "--priorities", priorities])
    error = capsys.readouterr().err
    assert leaving.value.code == REFUSED
    assert re.search(message, error, re.DOTALL), error
