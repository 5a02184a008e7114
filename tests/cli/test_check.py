"""`retarget check` and `retarget robots` as a user meets them: output, messages, exit codes."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from command_line import Typed, code_of, copy_of_op3, said_by
from messages import mentions, shows, shows_lines
from retarget.cli import run as run_module
from retarget.cli.exit import DONE, REFUSED
from retarget.model.robot import load_robot
from retarget.schema.catalogue import Kind, entries, shipped_folder
from sim.buses import topples_at_rest


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's configuration folder, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "xdg"))
    return tmp_path / "xdg" / "retarget"


ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")


@pytest.mark.parametrize("robot", ROBOTS)
def test_shipped_robots_are_good_and_it_says_which_stay_at_rest(robot: str, done: Typed) -> None:
    out = done("check", robot)
    assert out.count(": good (") == 1
    if robot == "op3":
        shows(out, "op3", 61)
        assert "20 x XM430-W350" in out and re.search(r"physics: +ready\n", out)
    (at_rest,) = re.findall(r"at rest: .*", out)
    shows(at_rest)
    robot_body = load_robot(robot)
    hanging = robot_body.profile.model_copy(update={"root": "suspended"})
    assert topples_at_rest(replace(robot_body, profile=hanging)) is None, "only who stands can go down"


@pytest.mark.long
def test_it_says_whether_physics_takes_the_robot(tmp_path: Path, done: Typed) -> None:
    soft = copy_of_op3(tmp_path / "soft", (", gains: {p: 800, i: 0, d: 0}", ""))
    hung = copy_of_op3(tmp_path / "hung", ("root: free", "root: suspended"))
    light = copy_of_op3(tmp_path / "light")
    body = light.with_name("body.xml")
    body.write_text(re.sub(r"<inertial .*?/>", "", body.read_text(encoding="utf-8")), encoding="utf-8")
    for profile, why in ((soft, "1 servo without a P gain"), (hung, "no hook point"), (light, "only guessed")):
        assert re.search(rf"physics: +not possible: .*{why}", done("check", profile))


def test_every_other_shipped_file_is_good(done: Typed) -> None:
    robots = {entry.path for entry in entries(Kind.ROBOT)}
    assert {path.parent.name for path in robots} == {*ROBOTS}
    files = sorted({*shipped_folder().rglob("*.yaml")} - robots)
    assert done("check", *files).count(": good (") == len(files)


def test_one_bad_file_does_not_hide_the_others(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bad = copy_of_op3(tmp_path / "bad", ("{id: 2,", "{id: 1,"), ("root: free", "root: fre"))
    code, out, err = said_by(capsys, "check", bad, "five")
    assert code == REFUSED
    shows(out, "five")
    shows(err, bad, f"{bad}:5", "'fre'")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("file.yaml", "a: 1\n"),
        ("file.yaml", ""),
        ("file.yaml", "levels: []\nname: x\n"),
        ("file.yaml", "sensors: {hed: {joint: head}}\n"),
        ("file.yaml", "obstacles: {b: {shape: {bal: {radius: 1}}}}\n"),
        ("file.yaml", "source: sample\nrobto: op3\n"),
        ("file.yaml", "a: [\n"),
        ("body.xml", ""),
        ("02_06.amc", ""),
    ],
)
def test_any_other_file_is_refused(refused: Typed, tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    shows(refused("check", path), path, {"body.xml": "robot.yaml", "02_06.amc": "retarget inspect"}.get(name, ()))


def test_robots_lists_shipped_and_own(done: Typed, own: Path) -> None:
    copy_of_op3(own / "robots" / "mine")
    copy_of_op3(own / "robots" / "broken", ("root: free", "root: fre"))
    out = done("robots")
    rows = {line.split()[0]: line for line in out.splitlines() if line[:1].strip()}  # what is folded is indented
    assert "shipped" in rows["op3"]
    assert "20 x XM430-W350" in rows["mine"]
    shows(rows["broken"].split("/")[0].rstrip(), "broken")
    shows_lines(out, "--robot")


def test_a_robot_that_would_fall_over_is_refused(tmp_path: Path, refused: Typed) -> None:
    soles = copy_of_op3(tmp_path / "op3")
    text = soles.read_text(encoding="utf-8")
    soles.write_text(re.sub(r"(_sole: \{link: \w+, pos: \[)([^,]+),", r"\g<1>0.2,", text), encoding="utf-8")
    mentions(refused("check", soles), "would fall over in posture stand", "centre of mass at (", "outside the soles")


# A session file: the options of `run` from YAML, those of the command line first, and what is refused.

SESSION = """\
robot: op3
source: json://:14150
speed: 0.5
n-ik: 3
parts: upper
view: true
realtime: true
check-sides: false
perturb: [mass, push]
bus: physics
report: out/r.json
overwrite: true
"""


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, Any]:
    """What a live run is asked for, from the folder of the test."""
    found: dict[str, Any] = {}

    def follow(source: str, options: object, outputs: object, live: object, *, stature: float | None = None) -> int:
        found.update(source=source, options=options, outputs=outputs, live=live, stature=stature)
        return DONE

    monkeypatch.setattr(run_module, "follow_live", follow)
    monkeypatch.chdir(tmp_path)
    return found


def test_each_key_is_an_option_and_the_command_line_wins(asked: dict[str, Any]) -> None:
    Path("out").mkdir()
    Path("mine.yaml").write_text(SESSION)
    words = ("--robot", "poppy", "--bus", "mock", "--perturb", "friction", "--speed", "0.8")
    assert code_of("run", "mine.yaml") == DONE
    options, outputs, live = asked["options"], asked["outputs"], asked["live"]
    assert (options.robot, options.iterations, options.parts, options.bus) == ("op3", 3, "upper", "physics")
    assert (options.playback.speed, options.physics.perturbations) == (0.5, ("mass", "push"))
    assert (outputs.view, outputs.report, outputs.overwrite) == (8080, Path("out/r.json"), True)
    assert (live.oversight.realtime, live.check_sides, asked["source"]) == (40, False, "json://:14150")
    assert code_of("run", *words[:2], "mine.yaml", "--bus", "physics+wire", *words[4:], "--check-sides") == DONE
    options = asked["options"]
    assert (options.robot, options.playback.speed, options.physics.perturbations) == ("poppy", 0.8, ("friction",))
    assert (options.iterations, options.bus, asked["live"].check_sides) == (3, "physics+wire", True)


def test_a_shipped_one_is_good_and_chosen_by_name(done: Typed, refused: Typed) -> None:
    for entry in entries(Kind.SESSION):
        assert f"session {entry.name}: good" in done("check", entry.name)
    assert "/nowhere" in refused("run", "first_run", "--end", "0.1", "--report", "/nowhere/r.json")
    shows(refused("run", "first_rnu"), "first_rnu", "first_run")


def test_a_switch_that_is_on_is_undone_on_the_command_line(asked: dict[str, Any]) -> None:
    Path("mine.yaml").write_text("robot: op3\nsource: json://:14150\nmirror: true\nno-gate: true\noverwrite: true\n")
    for words, on in (((), True), (("--no-mirror", "--gate", "--no-overwrite"), False)):
        assert code_of("run", "mine.yaml", *words) == DONE
        options = asked["options"]
        assert (options.playback.mirror, options.gate, asked["outputs"].overwrite) == (on, not on, on)


@pytest.mark.parametrize(
    ("typed", "performer"),
    [("web://", "web"), ("web:// --performer five", "five"), ("json://:14150", "five")],
)
def test_the_performer_is_the_usual_one_of_the_source_or_as_typed(
    typed: str, performer: str, asked: dict[str, Any]
) -> None:
    assert code_of("run", "--robot", "op3", "--source", *typed.split()) == DONE
    assert asked["options"].performer == performer


def test_paths_of_what_is_read_count_from_the_session_file(tmp_path: Path, asked: dict[str, Any]) -> None:
    folder = tmp_path / "mine"
    (folder / "data").mkdir(parents=True)
    for name in ("walk.raw", "faults.yaml", "five.yaml"):
        (folder / "data" / name).write_text("")
    text = "robot: op3\nbus: emulator\nsource: replay://data/walk.raw?speed=2\nfaults: data/faults.yaml\n"
    (folder / "run.yaml").write_text(f"{text}performer: data/five.yaml\nscene: table\nsave: run.npz\n")
    assert code_of("run", "mine/run.yaml") == DONE
    options = asked["options"]
    assert asked["source"] == f"replay://{folder}/data/walk.raw?speed=2" and options.scene == "table"
    assert options.faults == folder / "data" / "faults.yaml" and options.performer == f"{folder}/data/five.yaml"
    assert asked["outputs"].save == Path("run.npz")


@pytest.mark.parametrize("source", ["walk.bvh", "mine/walk.bvh"])
def test_a_file_that_is_missing_is_named_in_both_places(
    source: str, tmp_path: Path, refused: Typed, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    Path("mine/run.yaml").write_text(f"robot: op3\nsource: {source}\n")
    if "/" in source:
        Path(source).touch()
    for command in ("run", "check"):
        shows(refused(command, "mine/run.yaml"), tmp_path / "mine" / source, tmp_path / source)
    typed = refused("run", "mine/run.yaml", "--source", "sample", "--unit", "no")
    assert "mine" not in typed, "what is typed takes its place"


@pytest.mark.parametrize(
    "text",
    [
        "robot: op3\nsource: sample\nspeed: 0\n",
        "robot: op4\nsource: sample\n",
        "source: sample\nunit: furlong\n",
        "robot: op3\nscene: tabel\n",
        "robot: op3\nsource: vmc://:39539\nbus: profile\nspeed: 0.5\n",
        "robot: op3\nsource: sample\nperson: me\n",
        "robot: op3\nsource: sample\nview: 99999\n",
        "robot: op3\nsource: sample\nstart: 60\n",
    ],
)
def test_check_refuses_what_run_refuses(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    usual = {"robot": "op3", "source": "sample"}
    typed = [word for key, value in usual.items() if f"{key}:" not in text for word in (f"--{key}", value)]
    code, _, said = said_by(capsys, "run", path, *typed)
    checked, out, err = said_by(capsys, "check", path)
    named = said if str(path) in said else f"error: {path}: {said.removeprefix('error: ')}"
    assert (code, checked, out, err) == (REFUSED, REFUSED, "", named)


@pytest.mark.parametrize(
    ("text", "typed", "line", "key"),
    [
        ("robot: op3\nsource: sample\nspeed: 0\n", (), 3, "speed"),
        ("robot: op3\nview: 99999\nsource: sample\n", (), 2, "view"),
        ("robot: op3\nsource: sample\nstart: 5\nend: 3\n", (), 3, "start"),
        ("robot: op3\nsource: sample\nstart: 5\nend: 3\n", ("--start", "6"), 4, "end"),
        ("robot: op3\nsource: sample\nstart: 5\nend: 3\n", ("--start", "6", "--end", "2"), 0, ""),
    ],
)
def test_a_refused_option_has_its_line_unless_it_was_typed(
    text: str, typed: tuple[str, ...], line: int, key: str, tmp_path: Path, refused: Typed
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    said = refused("run", path, *typed)
    assert said.startswith(f"error: {path}:{line}: {key}: " if line else "error: --start, --end: ")


def test_a_session_is_checked_without_its_servos_and_its_sender(tmp_path: Path, done: Typed) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("robot: op3\nsource: vmc://:39539\nbus: /dev/no-such-port\n")
    done("check", path)


@pytest.mark.parametrize("command", ["run", "check"])
def test_everything_wrong_is_said_at_once_with_its_line(command: str, tmp_path: Path, refused: Typed) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("robot: op3\nsource: sample\nspede: 0.5\nloop: 3\nn-ik: many\nperturb: [mass, 4]\nhelp: true\n")
    said = refused(command, path)
    places = ("3: spede: unknown key", "4: loop: ", "5: n-ik: ", "6: perturb[1]: ", "7: help: unknown key")
    shows(said, *(f"mine.yaml:{place}" for place in places))
