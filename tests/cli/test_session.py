"""A session file: the options of `run` from YAML, those of the command line first, and what is refused."""

from pathlib import Path
from typing import Any

import pytest

from command_line import code_of
from messages import shows
from retarget.cli import run as run_module
from retarget.cli.exit import DONE, REFUSED
from retarget.schema.catalogue import Kind, entries

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
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What a live run is asked for."""
    found: dict[str, Any] = {}

    def follow(source: str, options: object, outputs: object, live: object) -> int:
        found.update(source=source, options=options, outputs=outputs, live=live)
        return DONE

    monkeypatch.setattr(run_module, "follow_live", follow)
    return found


def test_each_key_is_an_option_and_the_command_line_wins(
    tmp_path: Path, asked: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
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


def test_a_shipped_one_is_good_and_chosen_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    for entry in entries(Kind.SESSION):
        assert code_of("check", entry.name) == DONE
        assert f"session {entry.name}: good" in capsys.readouterr().out
    assert code_of("run", "first_run", "--end", "0.1", "--report", "/nowhere/r.json") == REFUSED
    assert "/nowhere" in capsys.readouterr().err


def test_a_switch_that_is_on_is_undone_on_the_command_line(tmp_path: Path, asked: dict[str, Any]) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("robot: op3\nsource: json://:14150\nmirror: true\nno-gate: true\noverwrite: true\n")
    assert code_of("run", path) == DONE
    assert (asked["options"].playback.mirror, asked["options"].gate, asked["outputs"].overwrite) == (True, False, True)
    assert code_of("run", path, "--no-mirror", "--gate", "--no-overwrite") == DONE
    assert (asked["options"].playback.mirror, asked["options"].gate, asked["outputs"].overwrite) == (False, True, False)


def test_paths_of_what_is_read_count_from_the_session_file(
    tmp_path: Path, asked: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "mine"
    (folder / "data").mkdir(parents=True)
    for name in ("walk.raw", "faults.yaml", "five.yaml"):
        (folder / "data" / name).write_text("")
    monkeypatch.chdir(tmp_path)
    text = "robot: op3\nbus: emulator\nsource: replay://data/walk.raw?speed=2\nfaults: data/faults.yaml\n"
    (folder / "run.yaml").write_text(f"{text}performer: data/five.yaml\nscene: table\nsave: run.npz\n")
    assert code_of("run", "mine/run.yaml") == DONE
    options = asked["options"]
    assert asked["source"] == f"replay://{folder}/data/walk.raw?speed=2" and options.scene == "table"
    assert options.faults == folder / "data" / "faults.yaml" and options.performer == f"{folder}/data/five.yaml"
    assert asked["outputs"].save == Path("run.npz")


@pytest.mark.parametrize("source", ["walk.bvh", "mine/walk.bvh"])
def test_a_file_that_is_missing_is_named_in_both_places(
    source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "run.yaml").write_text(f"robot: op3\nsource: {source}\n")
    if "/" in source:
        (tmp_path / source).touch()
    monkeypatch.chdir(tmp_path)
    for command in ("run", "check"):
        assert code_of(command, "mine/run.yaml") == REFUSED
        shows(capsys.readouterr().err, tmp_path / "mine" / source, tmp_path / source)
    assert code_of("run", "mine/run.yaml", "--source", "sample", "--unit", "no") == REFUSED
    assert "mine" not in capsys.readouterr().err, "what is typed takes its place"


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
    typed = [
        word for key in ("robot: op3", "source: sample") if key[:5] not in text for word in ("--" + key).split(": ")
    ]
    assert code_of("run", path, *typed) == REFUSED
    refused = capsys.readouterr().err.removeprefix("error: ")
    assert code_of("check", path) == REFUSED
    assert capsys.readouterr().err == f"error: {path}: {refused}"


def test_a_session_is_checked_without_its_servos_and_its_sender(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("robot: op3\nsource: vmc://:39539\nbus: /dev/no-such-port\n")
    assert code_of("check", path) == DONE


@pytest.mark.parametrize("command", ["run", "check"])
def test_everything_wrong_is_said_at_once_with_its_line(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("robot: op3\nsource: sample\nspede: 0.5\nloop: 3\nn-ik: many\nperturb: [mass, 4]\nhelp: true\n")
    assert code_of(command, path) == REFUSED
    said = capsys.readouterr().err
    for place in ("3: spede: unknown key", "4: loop: ", "5: n-ik: ", "6: perturb[1]: ", "7: help: unknown key"):
        assert f"mine.yaml:{place}" in said, said
    shows(said)


def test_an_unknown_session_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert code_of("run", "first_rnu") == REFUSED
    shows(capsys.readouterr().err, "first_rnu", "first_run")
