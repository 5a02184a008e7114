"""Messages in tests: a test asserts the kind of a message and its facts, and the wording is pinned once, in a snapshot.

`refuses` stands for `pytest.raises(..., match=...)`, `shows` for `"..." in text`. A fact is a key, a name, a value, a
number or a path that the message must hold, never a word of its wording. Both also note the whole message under the
test's name, and the noted messages are compared with `tests/snapshots/<area>.txt`, where the area is the test's folder.
After a change of wording run

    pytest --update-messages [tests]

also with `-n`, and read the difference of the snapshots. A test that moves to another folder keeps its messages.
"""

import ast
import difflib
import os
import platform
import re
import sys
import tempfile
from collections.abc import Collection, Generator, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Generic, TypeVar

import pytest
from pydantic import ValidationError

from retarget.errors import Problem, RefusedError

Fact = str | int | float | Path | re.Pattern[str]
Facts = Fact | tuple[Fact, ...]
E = TypeVar("E", bound=BaseException)

TESTS = Path(__file__).resolve().parent.parent
SNAPSHOTS = TESTS / "snapshots"
FLAT = "other"
"""Area of a test that lies in no folder and has no messages yet."""

PORTS_OF_SENDERS = range(39539, 39571)
"""Ports of VMC, which a person configures; others as high are given by the system and differ from run to run."""
GIVEN_PORTS = range(32768, 65536)


def refuses(
    kind: type[E] | tuple[type[E], ...],
    *facts: Facts,
    where: Facts = (),
    found: Facts = (),
    allowed: Facts = (),
    next_step: Facts = (),
    varies: Facts = (),
) -> "Refusal[E]":
    """Expects an error of this kind whose message holds every fact, and pins the message, but for pydantic's own.

    where, found, allowed, next_step: facts that one problem of a structured error (`RefusedError`) must have in its
    field of that name. varies: parts of the message that differ from run to run, and are not pinned.
    """
    fields = {"where": where, "found": found, "allowed": allowed, "next_step": next_step}
    return Refusal(kind, facts, {name: _flat(part) for name, part in fields.items() if _flat(part)}, varies)


class Refusal(Generic[E]):
    """The context of `refuses`."""

    def __init__(
        self,
        kind: type[E] | tuple[type[E], ...],
        facts: tuple[Facts, ...],
        fields: dict[str, list[Fact]],
        varies: Facts,
    ) -> None:
        self._raises = pytest.raises(kind)
        self._facts, self._fields, self._varies = facts, fields, varies

    def __enter__(self) -> pytest.ExceptionInfo[E]:
        self._caught = self._raises.__enter__()
        return self._caught

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if not self._raises.__exit__(kind, error, trace):
            return False
        mentions(error, *self._facts)
        if self._fields:
            assert isinstance(error, RefusedError), f"{type(error).__name__} has no fields; it says: {error}"
            assert any(_fits(problem, self._fields) for problem in error.problems), (
                f"no problem of the error has {self._fields}: {error.problems}"
            )
        if not isinstance(error, ValidationError):
            _book.note(str(error), self._varies)
        return True


def shows(text: object, *facts: Facts, varies: Facts = ()) -> None:
    """Checks that a text (or the lines of a text) holds every fact, and pins it whole, but for decimal numbers.

    What a run measures differs between processors: the numbers that matter are facts.
    """
    whole = _text(text)
    mentions(whole, *facts)
    _book.note(_without_numbers(whole), varies)


def shows_lines(text: object, *facts: Facts, varies: Facts = ()) -> None:
    """Checks that some line holds every fact, and pins those lines only: for a text whose other lines vary."""
    assert _flat(facts), "without a fact, no line is meant"
    found = [line for line in _text(text).splitlines() if all(_holds(line, fact) for fact in _flat(facts))]
    assert found, f"no line has all of {_flat(facts)}:\n{_text(text)}"
    _book.note(_without_numbers("\n".join(found)), varies)


def mentions(text: object, *facts: Facts) -> None:
    """Checks that a text holds every fact; pins nothing."""
    whole = _text(text)
    lacking = [fact for fact in _flat(facts) if not _holds(whole, fact)]
    assert not lacking, f"not in the message: {lacking}; the message:\n{whole}"


def _text(text: object) -> str:
    if isinstance(text, str):
        return text
    if isinstance(text, Iterable):
        return "\n".join(str(line) for line in text)
    return str(text)


def _without_numbers(text: str) -> str:
    """Also without the width of the columns that they stand in."""
    return re.sub(r"(?<=\S) {2,}", "  ", re.sub(r"(?<![\w.])[-+]?\d+\.\d+(?!\w|\.\d)", "<number>", text))


def _flat(facts: Facts | tuple[Facts, ...]) -> list[Fact]:
    if not isinstance(facts, tuple):
        return [facts]
    return [fact for part in facts for fact in _flat(part)]


def _holds(text: str, fact: Fact) -> bool:
    """A number is looked for as a whole number: 3 is not in 30, nor in 1.3 or j3."""
    if isinstance(fact, re.Pattern):
        return fact.search(text) is not None
    if isinstance(fact, int | float):
        numbers = "|".join(re.escape(number) for number in (repr(fact), f"{fact:g}"))
        return re.search(rf"(?<![\w.])({numbers})(?!\w|\.\d)", text) is not None
    return str(fact) in text


def _fits(problem: Problem, asked: Mapping[str, list[Fact]]) -> bool:
    return all(_holds(getattr(problem, name), fact) for name, facts in asked.items() for fact in facts)


# The snapshots.

OF_THE_MACHINE = [
    (re.compile(pattern), name)
    for pattern, name in {
        rf"\bprocess {os.getpid()}\b( \(.*?\)+(?=[ .,;]|$))?": "process <this>",
        r"process \d+ \((\S*/)?python[^)]*\)": "process <another>",
        rf"{re.escape(tempfile.gettempdir())}/tmp\w{{8}}\b": "<tmp>",
        r"(\w)\1{40,}": "<long name>",
        r"\d+(\.\d+){3} \(\w+\)(, \d+(\.\d+){3} \(\w+\))*": "<interfaces>",
        rf"\b{re.escape(platform.machine())}\b": "<machine>",
        rf"\b{re.escape(platform.python_version())}\b": "<version>",
        r"/dev/pts/\d+": "/dev/pts/<number>",
        r"(?<=\.py\", line )\d+": "<number>",
        r"(?<=allowed: )(/dev/tty\w+(, /dev/tty\w+)*\b(?! \(bus)|none, no serial port exists here)": "<ports>",
        r"owner \w+, group \w+, mode \S+": "<owner>",
        r"0x[0-9a-f]{8,}": "<address>",
        r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:\d\d)?)?": "<time>",
    }.items()
]


@dataclass
class Book:
    """The pinned messages of every test, and what the running test has noted.

    pinned: area -> test -> its messages in order. noted: messages of the tests that passed in this run.
    """

    update: bool = False
    replaced: list[tuple[re.Pattern[str], str]] = field(default_factory=list)
    pinned: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    noted: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    running: list[str] | None = None
    _homes: dict[str, str] = field(default_factory=dict)

    def note(self, text: str, varies: Facts = ()) -> None:
        """Notes a message of the running test; outside of one, and in a randomised test, nothing is noted."""
        if self.running is not None:
            self.running.append(self.plain(text, varies))

    def plain(self, text: str, varies: Facts = ()) -> str:
        """The text without what differs from run to run: folders, ports, addresses, times."""
        for pattern, name in self.replaced:
            text = pattern.sub(name, text)
        for fact in _flat(varies):
            text = fact.sub("<varies>", text) if isinstance(fact, re.Pattern) else text.replace(str(fact), "<varies>")
        text = re.sub(r"(?<=:)\d{5}\b|(?<=port )\d{5}\b|(?<=found )\d{5}(?=: taken)", _port, text)
        for pattern, name in OF_THE_MACHINE:
            text = pattern.sub(name, text)
        return "\n".join(line.rstrip() for line in text.splitlines())

    def pinned_for(self, area: str, test: str) -> list[str]:
        """The messages of a test: of its area, else of the area that it came from."""
        if test in self.pinned.get(area, {}):
            return self.pinned[area][test]
        return next((tests[test] for tests in self.pinned.values() if test in tests), [])

    def area_of(self, path: Path) -> str:
        """The folder of a test file; a file that lies in no folder stays where its messages are."""
        folder = path.resolve().relative_to(TESTS).parent
        if folder != Path():
            return "-".join(folder.parts)
        if not self._homes:
            self._homes = {_module(test): area for area, tests in self.pinned.items() for test in tests}
        return self._homes.get(path.stem, FLAT)


def _port(match: re.Match[str]) -> str:
    port = int(match[0])
    return "<port>" if port in GIVEN_PORTS and port not in PORTS_OF_SENDERS else match[0]


def _module(test: str) -> str:
    return test.partition("::")[0]


def function_of(test: str) -> str:
    """`test_bvh::test_cut_short[3]` -> `test_bvh::test_cut_short`."""
    return test.partition("[")[0]


def read_snapshot(text: str) -> dict[str, list[str]]:
    """Test -> messages. A test stands at the start of a line, its messages below it, indented, with `  --` between."""
    tests: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line.startswith("test_"):
            messages = tests.setdefault(line, [])
            lines: list[str] = []
            messages.append("")
        elif line == "  --":
            lines = []
            messages.append("")
        else:
            lines.append(line[4:])
            messages[-1] = "\n".join(lines)
    return tests


def write_snapshot(tests: Mapping[str, list[str]]) -> str:
    """What `read_snapshot` reads, sorted by test."""
    lines: list[str] = []
    for test, messages in sorted(tests.items()):
        lines.append(test)
        for index, message in enumerate(messages):
            lines += ["  --"] if index else []
            lines += [f"    {line}".rstrip() for line in message.split("\n")]
    return "\n".join(lines) + "\n"


def difference(pinned: list[str], noted: list[str]) -> str:
    """What differs, or "" where nothing does."""
    lines = []
    for number in range(max(len(pinned), len(noted))):
        old, new = (side[number].split("\n") if number < len(side) else [] for side in (pinned, noted))
        if old != new:
            lines += [f"message {number + 1}:", *(line for line in difflib.ndiff(old, new) if line[0] in "+-?")]
    return "\n".join(line.rstrip() for line in lines)


def test_functions(folder: Path = TESTS) -> set[str]:
    """`test_bvh::test_cut_short` of every test in the files of a folder."""
    return {
        f"{path.stem}::{node.name}"
        for path in folder.rglob("test_*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


def stale(tests: Iterable[str], functions: Collection[str], cases: Collection[str] = ()) -> list[str]:
    """Those of the tests that exist no more. cases: every case of the test functions that were collected whole."""
    known = {function_of(case) for case in cases}
    return sorted(
        test
        for test in tests
        if function_of(test) not in functions or (function_of(test) in known and test not in cases)
    )


# Hooks of pytest, imported by tests/conftest.py.

_book = Book()
_cases: set[str] = set()


def pytest_addoption(parser: pytest.Parser) -> None:
    """`pytest --update-messages`."""
    parser.addoption("--update-messages", action="store_true", help="pin the messages as the tests that run meet them")


def pytest_configure(config: pytest.Config) -> None:
    """Reads the snapshots."""
    _book.update = bool(config.getoption("--update-messages"))
    _book.pinned = read_all()


def read_all() -> dict[str, dict[str, list[str]]]:
    """Every area's snapshot."""
    return {path.stem: read_snapshot(path.read_text(encoding="utf-8")) for path in sorted(SNAPSHOTS.glob("*.txt"))}


def pytest_sessionstart(session: pytest.Session) -> None:
    """Learns the names of this machine's folders."""
    made = session.config._tmp_path_factory.getbasetemp()  # type: ignore[attr-defined]  # no public way before a test runs
    folders = {
        rf"{re.escape(str(made))}(/[\w.-]+)?": "<tmp>",
        rf"{re.escape(str(TESTS.parent))}(?![\w.-])": "<repository>",
        re.escape(os.environ.get("RETARGET_SHARED", str(TESTS.parent.parent / "shared"))): "<shared>",
        re.escape(sys.executable): "<python>",
    }
    _book.replaced = [(re.compile(pattern), name) for pattern, name in folders.items()]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Notes every case before `-m` and `-k` choose; cases that were asked for one by one say nothing of the others."""
    if not any("::" in word for word in config.args):
        _cases.update(_name(item) for item in items)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """After a test that passed, its messages are compared, or kept for the update."""
    randomised = getattr(getattr(item, "obj", None), "is_hypothesis_test", False)
    _book.running = None if randomised else []
    try:
        yield
        noted = _book.running or []
    finally:
        _book.running = None
    area, test = _book.area_of(item.path), _name(item)
    if _book.update:
        _book.noted.setdefault(area, {})[test] = noted
    elif changed := difference(_book.pinned_for(area, test), noted):
        pytest.fail(
            f"messages differ from tests/snapshots/{area}.txt; if meant so: pytest --update-messages\n{changed}",
            pytrace=False,
        )


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: object) -> None:
    """With xdist: takes over what a worker has noted."""
    output: dict[str, dict[str, dict[str, list[str]]]] = getattr(node, "workeroutput", {})
    for area, tests in output.get("messages", {}).items():
        _book.noted.setdefault(area, {}).update(tests)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A worker hands its part on; otherwise the snapshots are written."""
    worker: dict[str, object] | None = getattr(session.config, "workeroutput", None)
    if not _book.update:
        return
    if worker is not None:
        worker["messages"] = _book.noted
    else:
        _book.pinned = read_all()  # another run may have written since
        write_all(_book.pinned, _book.noted, gone=stale_entries())


def write_all(
    pinned: Mapping[str, Mapping[str, list[str]]],
    noted: Mapping[str, Mapping[str, list[str]]],
    *,
    gone: Collection[str] = (),
    folder: Path = SNAPSHOTS,
) -> None:
    """The pinned messages with the noted ones in place of the same tests' old ones, without the tests that are gone."""
    ran = {test for tests in noted.values() for test in tests}
    folder.mkdir(exist_ok=True)
    for area in sorted({*pinned, *noted}):
        tests = {test: old for test, old in pinned.get(area, {}).items() if test not in ran and test not in gone}
        tests |= {test: new for test, new in noted.get(area, {}).items() if new}
        path = folder / f"{area}.txt"
        if tests and tests != pinned.get(area):
            path.write_text(write_snapshot(tests), encoding="utf-8")
        elif not tests:
            path.unlink(missing_ok=True)


def stale_entries() -> list[str]:
    """Pinned tests that exist no more."""
    return stale((test for tests in _book.pinned.values() for test in tests), test_functions(), _cases)


def _name(item: pytest.Item) -> str:
    return f"{item.path.stem}::{item.nodeid.partition('::')[2]}"
