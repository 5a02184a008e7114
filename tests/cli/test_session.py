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
