"""Options that may stand alone."""

import pytest

from retarget.cli.optional_values import with_values


@pytest.mark.parametrize(
    ("words", "whole"),
    [
        ("run --realtime --core 1", "run --realtime 40 --core 1"),
        ("run --realtime", "run --realtime 40"),
        ("run --realtime 50 --core 1", "run --realtime 50 --core 1"),
        ("run --control-socket --realtime", "run --control-socket usual --realtime 40"),
        ("run --control-socket here.sock", "run --control-socket here.sock"),
        ("run --realtime=7", "run --realtime=7"),
        ("", ""),
    ],
)
def test_the_usual_value_is_put_in(words: str, whole: str) -> None:
    assert with_values(words.split()) == whole.split()
