"""Names of version 0.1.0 are refused with the new ones: options, priority files, keys of YAML, words of the socket."""

from pathlib import Path

import pytest

from check_helpers import copy_of_op3
from messages import shows
from retarget.cli import main
from retarget.cli.controls import WORDS, refused_word
from retarget.cli.exit import REFUSED
from retarget.errors import RENAMED
from retarget.schema.catalogue import shipped_folder

RUN = ("run", "--robot", "op3", "--source", "sample", "--bus", "none")


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """What is on stderr when the command line is refused."""
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    out, err = capsys.readouterr()
    assert (left.value.code, out) == (REFUSED, "") and "Traceback" not in err
    return err


@pytest.mark.parametrize(
    ("words", "old"),
    [
        ((*RUN, "--trouble", "mass"), "--trouble"),
        ((*RUN, "--trouble=mass"), "--trouble"),
        (("stop", "--cut"), "--cut"),
    ],
)
def test_an_option(words: tuple[str, ...], old: str, capsys: pytest.CaptureFixture[str]) -> None:
    shows(refused(capsys, *words), old, RENAMED[old])


@pytest.mark.parametrize("old", ["steady", "lasting", "held"])
def test_a_priority_file(old: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert (shipped_folder() / "priorities" / f"{RENAMED[old]}.yaml").is_file()
    shows(refused(capsys, *RUN, "--priorities", old), old, f"called {RENAMED[old]} now")


def test_a_priority_file_that_a_profile_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    profile = copy_of_op3(tmp_path, ("retarget: servo", "retarget: steady"))
    shows(refused(capsys, "check", profile), "'steady'", "called balanced now")


@pytest.mark.parametrize(
    ("file", "old"),
    [
        *(("balanced", old) for old in ("uphold", "reserve", "off_stops", "late")),
        ("fixed_base", "ahead"),
    ],
)
def test_a_key_of_a_priority_file(file: str, old: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (shipped_folder() / "priorities" / f"{file}.yaml").read_text(encoding="utf-8")
    assert f"{RENAMED[old]}:" in text
    path = tmp_path / "mine.yaml"
    path.write_text(text.replace(f"{RENAMED[old]}:", f"{old}:"), encoding="utf-8")
    shows(refused(capsys, "check", path), path, old, f"called {RENAMED[old]} now")


def test_a_key_of_a_profile(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = "following_error_lasting"
    profile = copy_of_op3(tmp_path, (RENAMED[old], old))
    shows(refused(capsys, "check", profile), profile, old, f"called {RENAMED[old]} now")


def test_a_word_of_the_control_socket() -> None:
    assert "torque_off" in WORDS and "cut" not in WORDS
    shows(refused_word("cut"), "'cut'", "called torque_off now")
