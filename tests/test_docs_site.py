"""The documentation site: its navigation is whole, no warning builds it, and it loads nothing from elsewhere."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
import yaml

from python_pages import PAGES

ROOT = Path(__file__).resolve().parent.parent
CONFIG: dict[str, Any] = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
MADE = {"reference/robot.md", "reference/performer.md", "reference/priorities.md", "reference/scene.md", *PAGES}
MADE |= {"reference/command-line.md", "security.md", "changelog.md", "examples.md"}
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


def test_what_the_site_is_made_with_is_there() -> None:
    for place in (*CONFIG["extra_css"], *CONFIG["extra"]["polyfills"]):
        assert (ROOT / "docs" / place).is_file()
    for place in CONFIG["hooks"]:
        assert (ROOT / place).is_file()
    assert CONFIG["site_dir"] == "out/site" and CONFIG["strict"] and CONFIG["theme"]["font"] is False


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


@pytest.mark.long
def test_the_search_works_from_disk(site: Path) -> None:
    assert (site / "search/search_index.js").read_text(encoding="utf-8").startswith("var __index = ")
    assert 'src="site/iframe-worker.js"' in (site / "index.html").read_text(encoding="utf-8")
