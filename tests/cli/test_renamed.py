"""Names of version 0.1.0 are refused with the new ones: options, priority files, keys of YAML, words of the socket."""

from pathlib import Path

import pytest

from command_line import Typed, copy_of_op3
from command_pages import commands
from messages import shows
from retarget.cli.controls import WORDS, refused_word
from retarget.errors import RENAMED
from retarget.schema.catalogue import shipped_folder

RUN = ("run", "--robot", "op3", "--source", "sample", "--bus", "none")
OF_PROFILE = "following_error_lasting"
PRIORITIES = shipped_folder() / "priorities"


def text_of(file: str) -> str:
    return (PRIORITIES / f"{file}.yaml").read_text(encoding="utf-8")


FILES = [old for old, new in RENAMED.items() if (PRIORITIES / f"{new}.yaml").is_file()]
KEYS = [
    (file, old) for file in ("balanced", "fixed_base") for old, new in RENAMED.items() if f"{new}:" in text_of(file)
]


@pytest.mark.parametrize(
    ("words", "old", "option"),
    [
        ((*RUN, "--trouble", "mass"), "--trouble", "--perturb"),
        ((*RUN, "--trouble=mass"), "--trouble", "--perturb"),
        (("stop", "--cut"), "--cut", "--torque-off"),
        (("stop", "--socket", "here"), "--socket", "path"),
        (("servo", "setup", "--id", "13", "--drive-mode", "4"), "--drive-mode", "--register"),
    ],
)
def test_an_option(words: tuple[str, ...], old: str, option: str, refused: Typed) -> None:
    new = RENAMED[f"{words[0]} {old}"]
    shows(refused(*words), old, new)
    called = [command for name, command in commands() if name in (words[0], " ".join(words[:2]))]
    assert option in new.lower()
    assert option in {name for command in called for one in command.params for name in one.opts}


@pytest.mark.parametrize("old", FILES)
def test_a_priority_file(old: str, refused: Typed) -> None:
    shows(refused(*RUN, "--priorities", old), old, f"called {RENAMED[old]} now")


def test_a_priority_file_that_a_profile_names(tmp_path: Path, refused: Typed) -> None:
    profile = copy_of_op3(tmp_path, ("retarget: servo", "retarget: steady"))
    for words in (("check", profile), ("run", "--robot", profile, *RUN[3:])):
        shows(refused(*words), "'steady'", "called balanced now")


@pytest.mark.parametrize(("file", "old"), KEYS)
def test_a_key_of_a_priority_file(file: str, old: str, tmp_path: Path, refused: Typed) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text_of(file).replace(f"{RENAMED[old]}:", f"{old}:"), encoding="utf-8")
    shows(refused("check", path), path, old, f"called {RENAMED[old]} now")


def test_a_key_of_a_profile(tmp_path: Path, refused: Typed) -> None:
    new = RENAMED[OF_PROFILE]
    profile = copy_of_op3(tmp_path, (new, OF_PROFILE))
    shows(refused("check", profile), profile, OF_PROFILE, f"called {new} now")


def test_every_old_name_is_tried() -> None:
    assert {"steady", "held"} < set(FILES) and {"uphold", "late"} < {old for _, old in KEYS}
    options = {"run --trouble", "stop --cut", "stop --socket", "servo --drive-mode"}
    assert {*FILES, *(old for _, old in KEYS), *options, OF_PROFILE, "cut"} == set(RENAMED)


def test_a_word_of_the_control_socket() -> None:
    assert "torque_off" in WORDS and "cut" not in WORDS
    shows(refused_word("cut"), "'cut'", "called torque_off now")
