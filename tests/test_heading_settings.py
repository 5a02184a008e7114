"""The heading section of a priority file."""

import pytest
from pydantic import ValidationError

from retarget.heading_settings import HeadingSettings


def test_defaults_are_whole() -> None:
    settings = HeadingSettings()
    assert settings.pairs["wrist"] > settings.pairs["ankle"] > 0.0
    assert settings.walking[0] < settings.walking[1]


@pytest.mark.parametrize("walking", [(1.0, 0.5), (0.5, 0.5), (-1.0, 1.0)])
def test_walking_speeds_rise_from_zero(walking: tuple[float, float]) -> None:
    with pytest.raises(ValidationError):
        HeadingSettings(walking=walking)
