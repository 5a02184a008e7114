"""What the site's hooks make of Markdown that is written for Git hosts, and the pages that they make."""

import importlib
from typing import Any

import pytest


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


def test_every_example_is_a_page_and_is_listed(hooks: Any) -> None:
    pages = hooks.made_pages()
    assert "read_into_pandas.py](examples/read_into_pandas.md) | A recording as pandas tables" in pages["examples.md"]
    assert "```python\n" in pages["examples/read_into_pandas.md"]
    assert "](docs/" not in pages["security.md"]
