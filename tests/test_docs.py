"""What the pages say is there: commands with their options, names, messages, models, and links between pages."""

import ast
import importlib
import re
import shlex
import tomllib
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
import yaml

import retarget
from command_pages import commands
from hardware.servo import SERVO_MODELS
from python_pages import PAGES as PYTHON_PAGES
from python_pages import PUBLIC, python_page
from retarget.cli.servo.monitor import TORQUE
from retarget.report.findings import findings
from retarget.report.measure import measure
from retarget.report.report import BusReport, Report, StopReport
from rig import scripted_run

ROOT = Path(__file__).resolve().parent.parent
PAGES = ["README.md", "AGENTS.md", *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md")))]
PROGRAM = {"--help", "--version"}


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


@cache
def options() -> dict[str, set[str]]:
    """Options by command; a group has none of its own."""
    return {
        words: {name for one in command.params for name in (*one.opts, *one.secondary_opts) if name.startswith("-")}
        for words, command in commands()
    }


def shown(page: str) -> list[str]:
    """Command lines in blocks of code and in backquotes, without remarks."""
    lines = re.findall(r"^    (retarget .+)$", text_of(page), re.MULTILINE)
    lines += re.findall(r"`(retarget [a-z][^`]*)`", text_of(page))
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
    project = tomllib.loads(text_of("pyproject.toml"))["project"]
    for page in PAGES:
        lists = re.findall(r"pip install -e '\.\[(.+?)\]'", text_of(page))
        named = {extra for one in lists for extra in one.split(",")}
        assert named <= set(project["optional-dependencies"]), page
        assert page != "README.md" or named == {"record", "view"}


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_names_of_the_repository_is_there(page: str) -> None:
    """Targets of make, modules that are run, and paths that begin with a folder of the repository."""
    text = text_of(page)
    makefile = text_of("Makefile")
    for target in re.findall(r"(?:^    |`)make ([a-z-]+)", text, re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
    for module in re.findall(r"python -m (benchmarks[\w.]*)", text):
        place = ROOT / module.replace(".", "/")
        assert place.is_dir() or place.with_suffix(".py").is_file(), module
    for path in re.findall(r"`((?:retarget|hardware|sim|configs|examples|benchmarks|tests)/[\w./-]*)`", text):
        assert "NAME" in path or (ROOT / path).exists(), path


EVENING = "docs/first-evening.md"


def test_every_command_of_the_group_has_its_step() -> None:
    steps = {line.split()[2] for line in re.findall(r"^    (retarget servo .+)$", text_of(EVENING), re.MULTILINE)}
    assert steps == {"scan", "setup", "home", "monitor"} and "`retarget servo rest`" in text_of(EVENING)


def test_what_is_to_be_read_is_in_the_report() -> None:
    parts: dict[str, type] = {"bus": BusReport, "stop": StopReport}
    keys = re.findall(r"`(bus|stop)\.(\w+)`", text_of(EVENING))
    assert {("bus", "retries"), ("bus", "hottest"), ("bus", "lowest_voltage")} <= set(keys)
    for part, key in keys:
        assert key in {field.name for field in fields(parts[part])}
    assert "`servo_error_deg`" in text_of(EVENING) and "servo_error_deg" in {field.name for field in fields(Report)}


def test_the_lines_of_the_summary_are_those_that_a_run_prints() -> None:
    run = scripted_run()
    printed = {finding.name: finding.measured for finding in findings(run, measure(run))}
    table = text_of(EVENING).partition("| line of the summary |")[2].partition("\n\n")[0]
    named = [re.findall("`([^`]+)`", row.split("|")[1]) for row in table.splitlines()[2:]]
    assert len(named) > 4 and {name for names in named for name in names} <= printed.keys()
    assert f"| `end` | `{printed['end']}` |" in table


def test_every_state_of_torque_is_explained() -> None:
    assert all(f"`{state}`" in text_of(EVENING) for state in TORQUE.values())


def test_the_list_of_targets_says_what_the_demo_runs_on() -> None:
    lines = text_of("Makefile").splitlines()
    line = next(line for line in lines if "echo 'make demo" in line)
    assert "emulated" in line and "mock" not in line


# docs/dynamixel.md


def test_every_model_stands_with_its_protocol() -> None:
    text = " ".join(text_of("docs/dynamixel.md").split())
    start = text.index("Models by name")
    listed = text[start : text.index("Others can be scanned", start)]
    names = "|".join(map(re.escape, sorted(SERVO_MODELS, key=len, reverse=True)))
    parts = re.split(r"with (?:protocol )?(?=[12]\.0)", listed)[1:]
    found = {
        name: tuple(sorted(map(int, re.findall(r"\b([12])\.0", part))))
        for part in parts
        for name in re.findall(names, part)
    }
    assert found == {name: model.protocols for name, model in SERVO_MODELS.items()}


# docs/troubleshooting.md quotes what the tool prints: every message of its first columns is in the sources.

TROUBLE = "docs/troubleshooting.md"
TYPED = re.compile(r"retarget |-|[A-Z_]+$|Ctrl|[\w./]+\.(?:png|py)$")
"""What stands in backquotes and is typed, named or pressed, not said."""
VARIABLE = re.compile(
    r"^(?:fix|note|ok) [\w ]+:|\b[A-Z]{2,}\b|\.\.\.|[;:()\"]|, allowed|\bfound\b|\d[\w.]*|'[^']*'|\w+_\w+|/\S+"
)
"""What differs from message to message: names, numbers, paths, and the heads of a doctor's lines."""
WINDOW = 3
"""Words in a row that must be found together; names and numbers between them differ."""


@cache
def said() -> str:
    """Every text of the sources, with one blank between words; a formatted part is a blank too."""
    texts = []
    for folder in ("retarget", "hardware", "sim"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    texts.append(
                        "".join(str(one.value) if isinstance(one, ast.Constant) else " " for one in node.values)
                    )
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    texts.append(node.value)
    for name in ("setup/doctor.yaml", "live/advice.yaml"):
        table = (ROOT / "retarget" / name).read_text(encoding="utf-8")
        texts += [re.sub(r"\{[^}]*\}", " ", line) for line in re.findall(r'"([^"]+)"', table)]
    return "\n".join(" ".join(re.findall(r"[\w'-]+", text.lower())) for text in texts)


def quoted() -> list[str]:
    """The messages of the first columns, and of the bold lines, without those that are typed."""
    found = []
    for line in text_of(TROUBLE).splitlines():
        cell = line.split(" | ")[0] if line.startswith("| ") else line.split("**")[1] if line.startswith("**") else ""
        found += [text for text in re.findall(r"`([^`]+)`", cell) if not TYPED.match(text)]
    return found


def parts(message: str) -> list[list[str]]:
    """The words of a message, parted where something else may stand."""
    pieces = VARIABLE.split(message)
    return [words for piece in pieces if len(words := re.findall(r"[\w'-]+", piece.lower())) >= WINDOW]


def test_what_is_quoted_is_said() -> None:
    for words in (words for message in quoted() for words in parts(message)):
        windows = [" ".join(words[i : i + WINDOW]) for i in range(len(words) - WINDOW + 1)]
        found = sum(window in said() for window in windows)
        assert 2 * found >= len(windows), " ".join(words)


def test_every_section_is_in_the_table_of_symptoms() -> None:
    table = text_of(TROUBLE).split("\n## ")[0]
    for heading in re.findall(r"^## (.+)$", text_of(TROUBLE), re.MULTILINE):
        anchor = re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")
        assert f"](#{anchor})" in table, heading


# The site: its navigation is whole, no warning builds it, and it loads nothing from elsewhere.

CONFIG: dict[str, Any] = yaml.safe_load(text_of("mkdocs.yml"))
MADE = {"reference/robot.md", "reference/performer.md", "reference/priorities.md", "reference/scene.md", *PYTHON_PAGES}
MADE |= {f"reference/{name}.md" for name in ("command-line", "run-table", "states", "report", "exports")}
MADE |= {"reference/measurements.md", "security.md", "changelog.md", "examples.md"}
"""Pages that are no files of docs/."""
LOADING = {"script": "src", "img": "src", "iframe": "src", "link": "href", "source": "src"}
"""Elements that fetch what they name."""


def named(entry: object) -> Iterator[str]:
    """Every page that a part of the navigation names."""
    if isinstance(entry, str):
        yield entry
    elif isinstance(entry, list):
        for one in entry:
            yield from named(one)
    elif isinstance(entry, dict):
        for one in entry.values():
            yield from named(one)


def test_the_navigation_names_every_page_once_and_none_that_is_not() -> None:
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    names = list(named(CONFIG["nav"]))
    assert sorted(names) == sorted(pages | MADE)


def test_anchors_of_links_between_pages_are_headings_there() -> None:
    for path in sorted((ROOT / "docs").glob("*.md")):
        for target, anchor in re.findall(r"\]\(([\w/.-]*)#([\w-]+)\)", path.read_text(encoding="utf-8")):
            text = ((path.parent / target) if target else path).read_text(encoding="utf-8")
            headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
            slugs = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
            assert anchor in slugs, f"{path.name}: {target}#{anchor}"


def test_links_to_files_beside_docs_are_those_that_the_site_shows() -> None:
    allowed = re.compile(r"\.\./(examples/\w+\.py|README\.md|SECURITY\.md|CHANGELOG\.md)$")
    for path in sorted((ROOT / "docs").glob("*.md")):
        for target in re.findall(r"\]\((\.\./[^)#]+)", path.read_text(encoding="utf-8")):
            assert allowed.match(target), f"{path.name}: {target} is no page of the site"


class Page(HTMLParser):
    """What a page fetches, what it links to, and the anchors that it has."""

    def __init__(self) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.anchors |= {found[key] for key in ("id", "name") if key in found}
        if tag in LOADING and LOADING[tag] in found and found.get("rel") != "canonical":
            self.fetched.append(found[LOADING[tag]])
        if tag == "a" and "href" in found:
            self.links.append(found["href"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for library in ("mkdocs", "material", "mkdocstrings"):
        pytest.importorskip(library, reason="the extra docs is not installed (make docs installs it)")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    place = tmp_path_factory.mktemp("site")
    build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(place)))  # strict: a warning is an error
    return place


@pytest.mark.long
def test_the_site_is_built_and_every_link_leads_somewhere(site: Path) -> None:
    pages: dict[Path, Page] = {}
    for path in sorted(site.rglob("*.html")):
        pages[path] = Page()
        pages[path].feed(path.read_text(encoding="utf-8"))
    assert len(pages) > 40
    for path, page in pages.items():
        if path.name == "404.html":  # for a server: its links begin at the root
            continue
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.is_file(), f"{path.name}: {link}"
            if parts.fragment and target in pages:
                assert unquote(parts.fragment) in pages[target].anchors, f"{path.name}: {link}"


@pytest.mark.long
def test_the_site_fetches_nothing_from_elsewhere(site: Path) -> None:
    for path in sorted(site.rglob("*.html")):
        page = Page()
        page.feed(path.read_text(encoding="utf-8"))
        assert page.fetched
        for place in page.fetched:
            parts = urlsplit(place)
            assert not parts.netloc and parts.scheme in ("", "data"), f"{path.name}: {place}"
            if path.name != "404.html" and not parts.scheme:
                assert (path.parent / unquote(parts.path)).is_file(), f"{path.name}: {place}"
    for path in sorted(site.rglob("*.css")):
        assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", path.read_text(encoding="utf-8"))


# What the site's hooks make of Markdown that is written for Git hosts.


@pytest.fixture(scope="module")
def hooks() -> Any:
    pytest.importorskip("mkdocs", reason="the extra docs is not installed (make docs installs it)")
    return importlib.import_module("hooks")


def test_links_out_of_docs_become_pages(hooks: Any) -> None:
    text = "[a](../examples/own_source.py), [s](../SECURITY.md#who), [r](../README.md), [l](live.md)"
    assert hooks.led_inside(text, "live.md") == (
        "[a](examples/own_source.md), [s](security.md#who), [r](README.md), [l](live.md)"
    )
    assert hooks.led_inside("[s](../SECURITY.md)", "reference/a.md") == "[s](../security.md)"


def test_a_list_is_parted_from_what_stands_before_it(hooks: Any) -> None:
    assert hooks.parted_lists("Two:\n* a\n* b\n  more\n* c") == "Two:\n\n* a\n* b\n  more\n* c"
    assert hooks.parted_lists("One:\n1. a\n2. b") == "One:\n\n1. a\n2. b"
    for whole in ("Two:\n\n* a\n* b", "```\nx\n* a\n```", "x\n    * a", "a\n*b* c"):
        assert hooks.parted_lists(whole) == whole


def test_bars_in_code_are_plain_in_tables_only(hooks: Any) -> None:
    assert hooks.plain_pipes(r"| `a\|b` | c\|d |") == r"| `a|b` | c\|d |"
    assert hooks.plain_pipes(r"`a\|b`") == r"`a\|b`"


def test_the_first_page_begins_and_ends_as_the_readme(hooks: Any) -> None:
    page, readme = hooks.first_page(text_of("docs/README.md")), text_of("README.md")
    assert page.startswith(readme[:200]) and page.endswith(readme[-100:])
    assert "\n## Documentation\n" in page and "](docs/" not in page and "op3_data" not in page


def test_pictures_have_their_text_as_a_caption(hooks: Any) -> None:
    assert hooks.captioned("![A table](images/a.webp)\nb") == "![A table](images/a.webp)\n<br>*A table*\n\nb"
    assert hooks.captioned("see ![a](b.png)") == "see ![a](b.png)"


def test_every_example_is_a_page_and_is_listed(hooks: Any) -> None:
    pages = hooks.made_pages()
    assert "read_into_pandas.py](examples/read_into_pandas.md) | A recording as pandas tables" in pages["examples.md"]
    assert "```python\n" in pages["examples/read_into_pandas.md"]
    assert "](docs/" not in pages["security.md"]


# The pages of the Python reference name modules that exist, each once.


@pytest.mark.parametrize("place", PYTHON_PAGES)
def test_every_module_is_there(place: str) -> None:
    page = python_page(place)
    for module in PYTHON_PAGES[place].modules:
        base = ROOT / module.replace(".", "/")
        assert any(file.is_file() for file in (base.with_suffix(".py"), base.with_suffix(".pyi"), base / "__init__.py"))
        assert f"\n::: {module}\n" in page


def test_every_public_name_is_listed_with_what_it_is_and_its_page() -> None:
    page, documented = python_page(PUBLIC), {module for one in PYTHON_PAGES.values() for module in one.modules}
    for name, home in retarget._HOMES.items():
        assert f"| [`{name}`][{home}.{name}] | " in page and f"| [`{name}`][{home}.{name}] |  |" not in page
        assert home in documented
