"""Every command line that a page shows could be typed: the command and its options are there."""

import re
import shlex
import tomllib
from functools import cache
from pathlib import Path

import pytest

from command_pages import commands

ROOT = Path(__file__).resolve().parent.parent
PAGES = ["README.md", *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md")))]
PROGRAM = {"--help", "--version"}


@cache
def options() -> dict[str, set[str]]:
    """Options by command; a group has none of its own."""
    return {
        words: {name for one in command.params for name in (*one.opts, *one.secondary_opts) if name.startswith("-")}
        for words, command in commands()
    }


def shown(page: str) -> list[str]:
    """Command lines in blocks of code and in backquotes, without remarks."""
    text = (ROOT / page).read_text(encoding="utf-8")
    lines = re.findall(r"^    (retarget .+)$", text, re.MULTILINE)
    lines += re.findall(r"`(retarget [a-z][^`]*)`", text)
    return [re.split(r"\s+#(?:\s|$)|\s[|<>&]\s", line)[0].replace("\\|", "|") for line in lines]


@pytest.mark.parametrize("page", PAGES)
def test_commands_and_options_are_there(page: str) -> None:
    for line in shown(page):
        words = shlex.split(line)[1:]
        known = options()
        if words[0] in PROGRAM or words == ["COMMAND"]:
            continue
        assert words[0] in known, line
        command = " ".join(words[:2]) if " ".join(words[:2]) in known else words[0]
        for word in words:
            if re.match(r"--?[a-z]", word):
                assert word.split("=")[0] in known[command] | PROGRAM, line


def test_extras_are_there_and_named_beside_the_first_commands() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for page in PAGES:
        lists = re.findall(r"pip install 'retarget\[(.+?)\]'", (ROOT / page).read_text(encoding="utf-8"))
        named = {extra for one in lists for extra in one.split(",")}
        assert named <= set(project["optional-dependencies"]), page
        assert page != "README.md" or named == {"record", "view", "c3d"}


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_names_of_the_repository_is_there(page: str) -> None:
    """Targets of make, modules that are run, and paths that begin with a folder of the repository."""
    text = (ROOT / page).read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"(?:^    |`)make ([a-z-]+)", text, re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
    for module in re.findall(r"python -m (benchmarks[\w.]*)", text):
        place = ROOT / module.replace(".", "/")
        assert place.is_dir() or place.with_suffix(".py").is_file(), module
    for path in re.findall(r"`((?:retarget|hardware|sim|configs|examples|benchmarks|tests)/[\w./-]*)`", text):
        assert "NAME" in path or (ROOT / path).exists(), path


def test_enough_is_shown_for_this_to_be_a_check() -> None:
    assert sum(len(shown(page)) for page in PAGES) > 100
    assert "--robot" in options()["run"] and "--dry-run" in options()["servo scan"]
