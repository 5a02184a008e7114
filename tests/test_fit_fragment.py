"""The fragment is YAML of the profile's own format, with comments, whatever the names."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from retarget.fitting.box import Box
from retarget.fitting.capsule import Capsule
from retarget.fitting.fragment import MAX_PAIRS, WIDTH, fragment
from retarget.fitting.geometry import Lone
from retarget.fitting.proposals import Proposal, Zones
from retarget.fitting.verdicts import Verdict
from retarget.profile_parts import IgnorePair, Observer
from retarget.strict_yaml import scan
from support.messages import shows, shows_lines

ZONES = Zones(0.03, 0.005)
CAPSULE = Capsule(np.array([0.0, -0.00001, 1.5]), np.array([0.1, 0.0, 2.0]), 0.02345)
BALL = Capsule(np.ones(3), np.ones(3), 0.1)
BOX = Box(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.1, 0.2, 0.3]))
TURNED = Box(np.zeros(3), np.array([0.6, 0.8, 0.0, 0.0]), np.array([0.1, 0.2, 0.3]))
LONE = Lone("box", "geom:[x]", (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (1.0,) * 3)


def observer(shape: Capsule | Box | Lone, *, name: str = "arm") -> Proposal:
    return Proposal(1, name, name, shape, 2.0, 0.01, "")


def read(text: str) -> tuple[dict[str, Observer], list[IgnorePair]]:
    document = scan(text, Path("fragment.yaml"))
    assert not document.problems
    observers = TypeAdapter(dict[str, Observer]).validate_python(document.data["observers"])
    return observers, TypeAdapter(list[IgnorePair]).validate_python(document.data["ignore_pairs"])


@pytest.mark.parametrize("shape", [CAPSULE, BALL, BOX, TURNED])
def test_shapes_are_read_again_as_they_were(shape: Capsule | Box) -> None:
    found = read(fragment([], [observer(shape)], [], ZONES))[0]["arm"]
    assert (found.influence, found.margin) == (0.03, 0.005)
    if isinstance(shape, Box):
        assert found.shape.box is not None
        assert found.shape.box.size == tuple(shape.size)
        assert found.shape.box.quat == pytest.approx(tuple(shape.quat))
    elif shape.is_ball:
        assert found.shape.sphere is not None and found.shape.sphere.at == (1.0, 1.0, 1.0)
    else:
        assert found.shape.capsule is not None
        assert (found.shape.capsule.start, found.shape.capsule.end) == (tuple(shape.start), tuple(shape.end))
        assert found.shape.capsule.radius == shape.radius


@pytest.mark.parametrize("name", ["no", "012", "1:30", "a,b", "{x}", "ünï", "#", "-", "true", "a:", "'", '"'])
def test_any_name_survives(name: str) -> None:
    pair = Verdict("never", (name, "other"), 'far: 1, 2 "mm" # or more')
    observers, pairs = read(fragment([], [observer(BALL, name=name)], [pair], ZONES))
    assert list(observers) == [name] and observers[name].link == name
    assert pairs[0].pair == (name, "other") and pairs[0].reason == pair.reason


def test_a_geom_is_taken_over_by_name() -> None:
    assert read(fragment([], [observer(LONE)], [], ZONES))[0]["arm"].shape.geom == "geom:[x]"


def test_no_pairs_is_an_empty_list() -> None:
    assert read(fragment([], [observer(BALL)], [], ZONES))[1] == []


def test_comments_stay_comments() -> None:
    warned = Verdict("always", ("a", "b"), "deep", "b is\nhidden " + 40 * "very " + "well")
    text = fragment(["a note\nof two: lines"], [observer(BALL)], [warned], ZONES, tail=["the end"])
    assert len(read(text)[0]) == 1
    comments = [line for line in text.splitlines() if line.lstrip().startswith("#")]
    assert comments[0] == "# a note of two: lines" and comments[-1] == "# the end"
    assert max(map(len, comments)) <= WIDTH + 4
    shows(text)


def test_no_more_pairs_than_a_profile_holds() -> None:
    pairs = [Verdict("never", (f"a{number}", "b"), "far") for number in range(MAX_PAIRS + 7)]
    text = fragment([], [observer(BALL)], pairs, ZONES)
    assert len(read(text)[1]) == MAX_PAIRS
    shows_lines(text, 7)
