"""A part of the slow tests, another one each day of the year, so that each of them runs four times a year.

`pytest -m long --part DAY` keeps every test whose number in the list of all slow tests leaves the same rest by PARTS as
the day. After `--minutes M` the tests that are left are skipped, with the reason.
"""

import time

import pytest

PARTS = 90
"""Parts into which the slow tests are dealt: all take some ten hours of one core, a part seven minutes."""

_begun = time.monotonic()


def pytest_addoption(parser: pytest.Parser) -> None:
    """`pytest --part DAY --minutes M`."""
    parser.addoption("--part", type=int, metavar="DAY", help=f"of the chosen tests each {PARTS}th, from this one on")
    parser.addoption("--minutes", type=float, metavar="M", help="begin no test later than this")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keeps the part, after `-m` and `-k` have chosen."""
    part = config.getoption("--part")
    if part is not None:
        kept = items[part % PARTS :: PARTS]
        first = part // PARTS * len(kept) // (366 // PARTS + 1)  # another one each time: what time is short for changes
        kept = kept[first:] + kept[:first]
        config.hook.pytest_deselected(items=[item for item in items if item not in kept])
        items[:] = kept


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Begins no test after the time is over."""
    minutes = item.config.getoption("--minutes")
    if minutes is not None and time.monotonic() - _begun > 60.0 * minutes:
        pytest.skip(f"the {minutes:g} minutes of this part are over")
