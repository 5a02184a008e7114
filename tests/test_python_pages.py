"""The pages of the Python reference name modules that exist, each once."""

from collections import Counter
from pathlib import Path

import pytest

import retarget
from python_pages import PAGES, PUBLIC, python_page

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("place", PAGES)
def test_every_module_is_there(place: str) -> None:
    page = python_page(place)
    for module in PAGES[place].modules:
        base = ROOT / module.replace(".", "/")
        assert any(file.is_file() for file in (base.with_suffix(".py"), base.with_suffix(".pyi"), base / "__init__.py"))
        assert f"\n::: {module}\n" in page


def test_no_module_is_documented_twice() -> None:
    count = Counter(module for page in PAGES.values() for module in page.modules)
    assert count.most_common(1)[0][1] == 1


def test_every_public_name_is_listed_with_what_it_is_and_its_page() -> None:
    page, documented = python_page(PUBLIC), {module for one in PAGES.values() for module in one.modules}
    for name, home in retarget._HOMES.items():
        assert f"| [`{name}`][{home}.{name}] | " in page and f"| [`{name}`][{home}.{name}] |  |" not in page
        assert home in documented
