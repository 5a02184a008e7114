"""Every measured table of the pages is made by a command, and says what is stored or computed."""

import re
from pathlib import Path

import pytest
import yaml

from benchmarks.docs_tables import BLOCK, COMPUTED, PAGES, with_tables
from benchmarks.table import ROOT, STORED, StoredTable, show_table
from result_pages import CAPTIONS, measurements_page

FIGURES = re.compile(r"^\|.*---:", re.MULTILINE)
"""The line of a table below its heads, where a column holds numbers."""
TABLES = {match[2]: path for path in PAGES for match in BLOCK.finditer(path.read_text(encoding="utf-8"))}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_tables_of_a_page_are_those_of_their_source(page: Path) -> None:
    """After a change of profiles, or of what is stored: make docs-tables."""
    text = page.read_text(encoding="utf-8")
    assert with_tables(text) == text
    assert not FIGURES.search(BLOCK.sub("", text)), "a table of numbers without `<!-- table: NAME -->`"


def test_what_is_stored_is_shown_and_says_how_it_was_measured() -> None:
    stored = {path.stem for path in STORED.glob("*.yaml")}
    assert set(COMPUTED) <= set(TABLES) <= stored | set(COMPUTED) and stored == set(CAPTIONS)
    assert all(caption in measurements_page() for caption in CAPTIONS.values())
    for path in STORED.glob("*.yaml"):
        table = StoredTable(**yaml.safe_load(path.read_text(encoding="utf-8")))
        module = re.match(r"python -m (benchmarks[\w.]*)", table.command)
        assert module, path.name
        place = ROOT / module[1].replace(".", "/")
        assert place.is_dir() or place.with_suffix(".py").is_file(), path.name
        assert re.fullmatch(r"\d{4}-\d\d-\d\d, [0-9a-f]{7,}", table.measured), path.name
        assert {len(row) for row in table.rows} == {len(table.heads)}, path.name


def test_a_benchmark_stores_what_it_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("benchmarks.table.STORED", tmp_path)
    show_table("found", ["motion", "mm"], [["walk", "1.20"]])
    assert not list(tmp_path.iterdir())
    show_table("found", ["motion", "mm"], [["walk", "1.20"]], docs=True)
    printed = capsys.readouterr().out
    page = "<!-- table: found -->\n\nold\n\n<!-- end -->"
    assert with_tables(page).split("\n\n")[1] in printed
