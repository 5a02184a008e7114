"""Priority files: every task type, the defaults, and what is refused."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from followers import DT, dimensions, performer, postures
from messages import Facts, refuses, shows
from retarget import rotations
from retarget.cli import main
from retarget.cli.exit import REFUSED
from retarget.errors import ConfigError, UsageError
from retarget.model.robot import load_robot
from retarget.robot.follower import Follower
from retarget.run.options import PhysicsOptions, RunOptions, priority_names
from retarget.schema.catalogue import Kind, find
from retarget.schema.priorities import (
    AxisTask,
    CentreOfMassTask,
    HeadingSettings,
    OrientationTask,
    PositionTask,
    PostureTask,
    PreventiveTask,
    Priorities,
    Task,
    check_for_human,
    load_priorities,
    self_contained,
)


def test_defaults_are_whole() -> None:
    settings = HeadingSettings()
    assert settings.pairs["wrist"] > settings.pairs["ankle"] > 0.0
    assert settings.walking[0] < settings.walking[1]


@pytest.mark.parametrize("walking", [(1.0, 0.5), (0.5, 0.5), (-1.0, 1.0)])
def test_walking_speeds_rise_from_zero(walking: tuple[float, float]) -> None:
    with pytest.raises(ValidationError):
        HeadingSettings(walking=walking)


@pytest.mark.parametrize("forward", [True, False])
def test_feet_that_are_asked_to_point_forward_do(forward: bool) -> None:
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
    for name in ("l_sole", "l_hand"):
        row = posture.landmark_names.index(name)
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
def test_who_runs_them(bus: str, mount: str | None, named: str | None, chosen: str) -> None:
    hook = "neck" if mount == "gantry" else None
    physics = PhysicsOptions(mount=mount, hook=hook)
    options = RunOptions(robot="op3", bus=bus, priorities=named, physics=physics)
    assert priority_names(load_robot("op3", root=physics.root), options)[-1] == chosen


EVERYTHING = """\
name: everything
description: One task of each type.
iterations: 8
activation: ranked
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


def refused(text: str, folder: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load(text, folder)
    return str(caught.value)


def test_every_task_type_is_read(tmp_path: Path) -> None:
    priorities = load(EVERYTHING, tmp_path)
    assert (priorities.iterations, priorities.activation) == (8, "ranked")
    kinds = {task.type for _, _, task in priorities.tasks()}
    assert kinds == {
        *("position", "orientation", "axis", "heading", "look_at", "centre_of_mass", "posture", "reactive"),
        "preventive",
    }


def test_tasks_come_with_their_places(tmp_path: Path) -> None:
    places = [(level, index) for level, index, _ in load(EVERYTHING, tmp_path).tasks()]
    assert places == [(0, 0), (0, 1), (1, 0), (1, 1), (1, 2), (3, 0), (3, 1), (3, 2), (3, 3), (4, 0), (4, 1)]


def test_short_forms_and_defaults(tmp_path: Path) -> None:
    levels = load(EVERYTHING, tmp_path).levels
    hand = levels[3].tasks[0]
    assert isinstance(hand, PositionTask)
    assert (hand.of, hand.weight, hand.gain, hand.max_error, hand.optional) == (
        *(("l_hand",), (3, 3, 3), 0.5, 0.02, True),
    )
    axis = levels[1].tasks[1]
    assert isinstance(axis, AxisTask)
    assert (axis.gain, axis.max_error, axis.optional, axis.weight) == (1.0, None, False, 1.0)
    preventive = levels[1].tasks[2]
    assert isinstance(preventive, PreventiveTask)
    assert preventive.of == ("l_forearm",)
    com = levels[0].tasks[0]
    assert isinstance(com, CentreOfMassTask)
    assert com.weight == (1.0, 1.0, 0.0)
    posture = levels[4].tasks[0]
    assert isinstance(posture, PostureTask)
    assert (posture.towards, posture.stiffness, posture.settle) == ("attractor", {"default": 1.0, "spine": 20.0}, 0.1)


def test_iterations_and_activation_are_the_papers_by_default(tmp_path: Path) -> None:
    text = EVERYTHING.replace("iterations: 8\nactivation: ranked\n", "")
    priorities = load(text, tmp_path)
    assert (priorities.iterations, priorities.activation) == (5, "closest")


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("type: reactive", "type: reactve", ":9: levels[0].tasks[1].type: wrong value; found 'reactve'"),
        ("type: reactive", "type: reactve", "Did you mean reactive?"),
        ("type: reactive, ", "", ":9: levels[0].tasks[1].type: missing key. Add 'type'"),
        ("mode: support", "mode: over_rot", "Did you mean over_root"),
        ("settle: 0.1", "setle: 0.1", "setle: unknown key; found 'setle'; allowed: gain, max_error"),
        ("settle: 0.1", "settle: -1", "levels[4].tasks[0].settle: wrong value; found -1"),
        ("weight: [1, 1, 2]", "weight: [1, x, 2]", "levels[1].tasks[0].weight[1]: wrong value; found 'x'"),
        ("weight: [1, 1, 2]", "weight: [0, 0, 0]", "weight: all three are zero"),
        ("weight: [1, 1, 2]", "weight: -1", "levels[1].tasks[0].weight"),
        ("weight: [1, 1, 2]", "weight: true", "weight: wrong value; found true"),
        ("axis: [0, 0, 1], ", "axis: [0, 0, 0], ", "levels[1].tasks[1].axis: all three are zero"),
        ("gain: 0.05", "gain: 0", "gain: wrong value; found 0; allowed: greater than 0"),
        ("optional: true", "optional: yes", "optional: wrong value; found 'yes'; allowed: true or false"),
        ("iterations: 8", "iterations: 8.5", ":3: iterations: wrong value; found 8.5; allowed: a whole number"),
        ("iterations: 8", "iterations: 0", "iterations: wrong value; found 0"),
        ("name: feet", "name: balance", "levels[1].name: duplicate level name; found 'balance', also of level 1"),
        ("    tasks: []", "    task: []", "levels[2].task: unknown key; found 'task'; allowed: name, tasks"),
        ("spine: 20", "spine: .nan", "stiffness.spine: a number that is not finite"),
    ],
)
def test_refused_with_its_place(tmp_path: Path, old: str, new: str, part: str) -> None:
    assert old in EVERYTHING
    assert part in refused(EVERYTHING.replace(old, new, 1), tmp_path)


def test_levels_are_needed(tmp_path: Path) -> None:
    head = "name: a\ndescription: b\n"
    shows(refused(head, tmp_path))
    shows(refused(head + "levels: []\n", tmp_path), 1)
    shows(refused(head + "levels:\n  - {name: a, tasks: []}\n", tmp_path))


def test_wrong_tasks_do_not_make_their_list_wrong_too(tmp_path: Path) -> None:
    text = refused(EVERYTHING.replace("type: look_at", "type: loo_at"), tmp_path)
    assert "problems" not in text


def test_unknown_name_is_refused() -> None:
    with refuses(UsageError):
        load_priorities("no_such_priorities")


@pytest.mark.parametrize(
    ("settings", "part"),
    [
        ({"settle": 0.0}, "settle"),
        ({"settle": 2.0}, "settle"),
        ({"speed_margin": -0.1}, "speed_margin"),
        ({"share": 1}, "share"),
    ],
)
def test_bad_deflection_compensation_is_refused(settings: dict[str, float], part: Facts) -> None:
    levels = [{"name": "b", "tasks": [{"type": "posture", "towards": "stand"}]}]
    valid = {"name": "t", "description": "t", "levels": levels}
    assert Priorities.model_validate(valid).deflection_compensation is None
    usual = Priorities.model_validate({**valid, "deflection_compensation": {}}).deflection_compensation
    assert usual is not None and usual.settle > 0.0 and usual.speed_margin > 0.0
    with refuses(ValueError, part):
        Priorities.model_validate({**valid, "deflection_compensation": settings})


def test_only_balanced_compensates_deflection_and_it_puts_soles_and_balance_before_limbs() -> None:
    for name in ("servo", "paper", "human"):
        assert load_priorities(name).deflection_compensation is None
    balanced = load_priorities("balanced")
    assert balanced.deflection_compensation is not None
    assert [level.name for level in balanced.levels][:3] == ["soles", "balance", "self collision"]


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


def test_without_levels_an_overlay_has_those_of_its_base(tmp_path: Path) -> None:
    mine = overlay(tmp_path, OVERLAY.split("levels")[0])
    assert mine.levels == load_priorities(tmp_path / "base.yaml").levels


def test_overlays_of_the_user_extend_shipped_ones_and_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    folder = tmp_path / "retarget" / "priorities"
    folder.mkdir(parents=True)
    head = "name: mine\ndescription: One of the user's.\n"
    (folder / "slower.yaml").write_text(head + "extends: balanced_sustained\niterations: 3\n", encoding="utf-8")
    (folder / "slowest.yaml").write_text(head + "extends: slower\nlead_time: 0.1\n", encoding="utf-8")
    shipped, own = load_priorities("balanced_sustained"), load_priorities("slowest")
    own_keys = {"name": "mine", "description": "One of the user's.", "iterations": 3, "lead_time": 0.1}
    assert own == shipped.model_copy(update=own_keys)


def test_a_shipped_overlay_extends_the_shipped_base_whatever_the_user_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    balanced = load_priorities("balanced")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    folder = tmp_path / "retarget" / "priorities"
    folder.mkdir(parents=True)
    (folder / "servo.yaml").write_text(EVERYTHING, encoding="utf-8")
    assert load_priorities("servo").name == "everything"
    assert load_priorities("balanced") == balanced


@pytest.mark.parametrize(
    ("old", "new", "facts"),
    [
        ("base.yaml", "servvo", (":3: extends", "'servvo'", "servo", "Did you mean servo?")),
        ("base.yaml", "lasting", (":3: extends", "'lasting'", "balanced_sustained")),
        ("base.yaml", "gone.yaml", (":3: extends", "gone.yaml")),
        ("base.yaml", "[base.yaml]", (":3: extends", "base.yaml")),
        ("base.yaml", "mine.yaml", (":3: extends", "mine -> mine")),
        ("- hands", "- hans", (":7: levels[1]", "level of base", "'hans'", "Did you mean hands?")),
        ("- hands", "- {name: hands}", (":7: levels[1].tasks", "missing key")),
        ("- hands", "- balance", (":7: levels[1].name", "duplicate level name", "also of level 1")),
        ("activation: all", "activaton: all", (":4: activaton", "Did you mean activation?")),
        ("name: mine\n", "", ("name: missing key",)),
        ("look_at", "look_it", (":13: levels[3].tasks[0].type", "'look_it'", "Did you mean look_at?")),
        ("levels:\n", "levels: none\nlayers:\n", (":5: levels", "'none'", ":6: layers")),
    ],
)
def test_a_bad_overlay_is_refused_with_its_place(tmp_path: Path, old: str, new: str, facts: tuple[str, ...]) -> None:
    assert old in OVERLAY
    with refuses(ConfigError, *facts, "mine.yaml"):
        overlay(tmp_path, OVERLAY.replace(old, new, 1))


def test_a_bad_base_is_refused_in_its_own_file(tmp_path: Path) -> None:
    with refuses(ConfigError, "base.yaml:3: iterations", "found 0"):
        overlay(tmp_path, base=BASE.replace("iterations: 8", "iterations: 0"))


def test_a_name_alone_is_no_level_without_a_base(tmp_path: Path) -> None:
    with refuses(ConfigError, "mine.yaml:5: levels[0]", "'balance'"):
        load(OVERLAY.replace("extends: base.yaml\n", ""), tmp_path)


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


@pytest.mark.parametrize("name", ["human", "paper"])
def test_the_human_has_files_of_its_own(name: str) -> None:
    check_for_human(load_priorities(name), name)


def test_a_robots_file_moves_no_human() -> None:
    with refuses(ConfigError, "servo.yaml", "l_hand", "r_hand") as caught:
        check_for_human(load_priorities("servo"), "servo")
    assert len(caught.value.problems) > 1


@pytest.mark.parametrize(
    ("robot", "priorities", "message"),
    [
        ("human", "servo", r"servo\.yaml.*names no sensor of a performer"),
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


TASK: TypeAdapter[Task] = TypeAdapter(Task)


def read(**keys: Any) -> Task:
    return TASK.validate_python(keys)


@pytest.mark.parametrize("kind", ["position", "orientation"])
def test_one_number_weighs_all_rows_and_one_name_is_a_list(kind: str) -> None:
    task = read(type=kind, of="head", weight=2.0)
    assert isinstance(task, PositionTask | OrientationTask)
    assert task.weight == (2.0, 2.0, 2.0) and task.of == ("head",)
    assert read(type=kind, of=["head"], weight=[2.0, 2.0, 2.0]) == task


@pytest.mark.parametrize(
    "keys",
    [
        {"type": "position", "of": "head", "weight": 0.0},
        {"type": "position", "of": "head", "weight": True},
        {"type": "position", "of": []},
        {"type": "axis", "of": "head", "axis": [0, 0, 0], "direction": [0, 0, 1]},
        {"type": "axis", "of": "head", "axis": [0, 0, 1]},
        {"type": "reactive", "speed": 0.0},
        {"type": "reactive", "gain": 0.5},
        {"type": "centre_of_mass", "mode": "support", "moving": 1.5},
        {"type": "dance", "of": "head"},
    ],
)
def test_what_cannot_be_meant_is_refused(keys: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        read(**keys)


def test_what_is_left_out_has_its_usual_value() -> None:
    axis = read(type="axis", of="chest", axis=[0, 0, 1], direction=[0, 0, 1])
    assert isinstance(axis, AxisTask) and (axis.gain, axis.max_error, axis.optional) == (1.0, None, False)
    first, second = read(type="posture"), read(type="posture")
    assert isinstance(first, PostureTask) and isinstance(second, PostureTask)
    assert first.stiffness == {"default": 1.0} and first.stiffness is not second.stiffness
