"""Every command line of the README and of the first evening works, typed as it stands and in its order."""

import os
import re
import shlex
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from retarget.cli import main
from retarget.cli.exit import DONE, STOPPED
from unknown_robots import small_bust

pytest.importorskip("websockets", reason="the extra 'view' is not installed (make test installs it)")
from retarget.web.serving import serve_files

ROOT = Path(__file__).resolve().parent.parent.parent
PAGES = ("README.md", "docs/first-evening.md")
NEEDS = {
    "--source vmc://": "a live sender",
    "--source json://": "a live sender",
    "--bus profile": "servos",
    "my_robot/robot.yaml --source": "a robot that stands",
    "servo scan --robot my_robot": "servos",
    "servo monitor --robot my_robot": "servos",
    "servo setup": "an answer",
    "servo home": "an answer",
    "retarget batch": "motion files",
    "retarget demo": "half a minute, as tests of the demo have",
}
"""What is not typed here, and what it needs that a test has not."""
SHORTER = {
    "--source sample": ["--end", "0.2"],
    "run first_run": ["--end", "0.5"],
    "retarget view": ["--port", "0"],
}
"""What is added to a line, so that it takes seconds; and a port that no other process has."""
ENDS = {"retarget doctor": {DONE, STOPPED}}
"""Exit codes where it is not only DONE: a machine may have something to fix."""


def lines(page: str) -> list[str]:
    """Command lines of the blocks of code, without remarks."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return [re.split(r"\s+#\s", line)[0].strip() for line in re.findall(r"^    (retarget .+)$", text, re.MULTILINE)]


def typed(page: str) -> list[str]:
    return [line for line in lines(page) if not any(part in line for part in NEEDS)]


def words(line: str) -> list[str]:
    """What is typed after `retarget`, cut short."""
    return [*shlex.split(line)[1:], *(word for part, more in SHORTER.items() if part in line for word in more)]


def impatient(files: Mapping[str, bytes], port: int, *, opened: Callable[[str], object], **kept: Any) -> None:
    """Serves a page, and presses Ctrl-C as soon as it is open."""

    def opened_and_left(address: str) -> None:
        opened(address)
        os.kill(os.getpid(), signal.SIGINT)

    serve_files(files, port, opened=opened_and_left, **kept)


@pytest.mark.long
@pytest.mark.parametrize("page", [PAGES[0], *(pytest.param(page, marks=pytest.mark.long) for page in PAGES[1:])])
def test_every_line_works_in_its_order(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mcap", reason="the extra 'record' is not installed (make test installs it)")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("retarget.web.serving.serve_files", impatient)
    Path("my_robot.urdf").write_text(small_bust().replace('"stranger"', '"my_robot"'), encoding="utf-8")
    for line in typed(page):
        with pytest.raises(SystemExit) as leaving:
            main(words(line))
        allowed = next((codes for part, codes in ENDS.items() if part in line), {DONE})
        assert int(leaving.value.code or 0) in allowed, f"{line}\n{capsys.readouterr().err}"
    made = {"run.npz", "run.mcap", "my_robot"} | ({"report"} if page == "README.md" else set())
    assert made <= {path.name for path in tmp_path.iterdir()}


def test_what_is_not_typed_is_there_and_little() -> None:
    shown = [line for page in PAGES for line in lines(page)]
    here = [line for page in PAGES for line in typed(page)]
    assert len(here) >= 20 and len(shown) - len(here) <= 15
    for part in (*NEEDS, *SHORTER, *ENDS):
        assert any(part in line for line in shown), f"{part} is in no line any more"


def test_files_of_the_readme_come_with_the_program_or_from_a_line_before() -> None:
    sources = [
        found[1] or found[2]
        for line in lines("README.md")
        if (found := re.search(r"--source (\S+)|inspect (\S+)", line))
    ]
    assert {source for source in sources if "://" not in source} == {"sample"}
