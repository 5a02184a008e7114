"""Rendered performers through the real body tracker in a headless browser, and through the decoder."""

import json
from collections.abc import Iterator
from typing import Any

import pytest

from camera_clips import CLIPS, EVERY, seen_clip
from camera_figures import check, check_wave
from landmarks import tracker
from retarget.web.runtime import runtime_folder

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def page() -> Iterator[Any]:
    folder = runtime_folder()
    if folder is None:
        pytest.skip("the body tracker is not installed: retarget web install")
    with tracker(folder) as opened:
        yield opened


@pytest.mark.parametrize("name", ["still", "wave", "front", "crouch", "step", "bare"])
def test_a_performer_on_film_comes_out_as_near_as_promised(page: Any, name: str) -> None:
    frames = [json.dumps(frame).encode() for frame in seen_clip(page, CLIPS[name])]
    check(name, frames, CLIPS[name].motion(), every=EVERY)
    if name == "wave":
        check_wave(frames, 0.5, every=EVERY)
