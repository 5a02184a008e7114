"""The fragment is YAML of the profile's own format, with comments, whatever the names."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from messages import shows, shows_lines
from retarget.model.body import load_body_text
from retarget.model.body_file import compile_body_text
from retarget.schema.profile_parts import IgnorePair, Observer
from retarget.schema.strict_yaml import scan
from retarget.setup.fit_observers import MAX_PAIRS, WIDTH, Verdict, fragment, verdicts
from retarget.setup.shape_fit import Capsule, Proposal, Solid, Zones, link_geometries, propose
from retarget.setup.survey import PairRecord

ZONES = Zones(0.03, 0.005)
CAPSULE = Capsule(np.array([0.0, -0.00001, 1.5]), np.array([0.1, 0.0, 2.0]), 0.02345)
BALL = Capsule(np.ones(3), np.ones(3), 0.1)
BOX = Solid("box", np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.1, 0.2, 0.3]))
TURNED = Solid("box", np.zeros(3), np.array([0.6, 0.8, 0.0, 0.0]), np.array([0.1, 0.2, 0.3]))
LONE = Solid("box", np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.ones(3), "geom:[x]")


def observer(shape: Capsule | Solid, *, name: str = "arm") -> Proposal:
    return Proposal(1, name, name, shape, 2.0, 0.01, "")


def read(text: str) -> tuple[dict[str, Observer], list[IgnorePair]]:
    document = scan(text, Path("fragment.yaml"))
    assert not document.problems
    observers = TypeAdapter(dict[str, Observer]).validate_python(document.data["observers"])
    return observers, TypeAdapter(list[IgnorePair]).validate_python(document.data["ignore_pairs"])


@pytest.mark.parametrize("shape", [CAPSULE, BALL, BOX, TURNED])
def test_shapes_are_read_again_as_they_were(shape: Capsule | Solid) -> None:
    found = read(fragment([], [observer(shape)], [], ZONES))[0]["arm"]
    assert (found.influence, found.margin) == (0.03, 0.005)
    if isinstance(shape, Solid):
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


# b has no geometry: a and c are neighbours with nothing between.
TEXT = """<mujoco><worldbody><body name="a"><geom size="0.1"/>
  <body name="b"><joint name="b" axis="1 0 0" range="-90 90"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <body name="c"><joint name="c" range="-90 90"/><geom size="0.05" pos="0.12 0 0"/>
      <body name="d" pos="1 0 0"><joint name="d" range="-90 90"/><geom size="0.1"/></body></body></body>
</body></worldbody></mujoco>"""
BODY = load_body_text(TEXT, source="test")
MODEL = compile_body_text(TEXT, source="test").model
SHAPES = propose(link_geometries(MODEL)[0], Zones(0.03, 0.005))


NEAR, FAR = (0, 1), (0, 2)
"""c and d, of which c lies between a and d."""


def record(pair: tuple[int, int], smallest: float, **more: Any) -> PairRecord:
    return PairRecord(pair=pair, smallest=smallest, **({"largest": None, "at_neutral": 1.0} | more), **LOOKS)


LOOKS: Any = {"samples": 100, "searches": 20}
NEVER = "never near, at least 73.1 mm apart (100 postures, 20 searches)"
DEEP = {"largest": -0.001}


@pytest.mark.parametrize(
    ("found", "excluded", "kind", "reason"),
    [
        (record(FAR, 0.0731), (0, 0), "never", NEVER),
        (record(FAR, 0.0449), (0, 0), "", ""),
        (record(FAR, -0.1), (0, 0), "", ""),
        (record(FAR, -0.1), (1, 4), "excluded", "at most 100.0 mm deep"),
        (record(NEAR, -0.05, at_neutral=-0.03), (0, 0), "neighbours", "no volume between them"),
        (record(NEAR, -0.05, at_neutral=0.01), (0, 0), "", ""),
        (record(FAR, -0.05, at_neutral=-0.03), (0, 0), "", ""),
        (record(FAR, -0.02, own=(-0.01, -0.005), **DEEP), (0, 0), "always", "and so do the links' own geoms"),
        (record(FAR, -0.02, own=(0.004, 0.02), **DEEP), (0, 0), "always", "their own geoms stay 4.0 mm apart"),
        (record(FAR, -0.02, own=(-0.004, 0.02), **DEEP), (0, 0), "always", "4.0 mm into each other"),
    ],
)
def test_a_pair_is_ignored_for_a_reason(found: PairRecord, excluded: tuple[int, int], kind: str, reason: str) -> None:
    done = verdicts([found], SHAPES, BODY, near=0.045, excluded={excluded})
    assert [verdict.kind for verdict in done] == ([kind] if kind else [])
    for verdict in done:
        assert reason in verdict.reason and bool(verdict.warning) == found.hides_collision


def test_what_a_profile_cannot_do_without_comes_first() -> None:
    records = [record(FAR, 0.1)] * (MAX_PAIRS + 1)
    records += [record(FAR, -0.02, largest=-0.01, own=(-1.0, -1.0))]
    found = verdicts(records, SHAPES, BODY, near=0.045, excluded=set())
    assert found[0].kind == "always"
