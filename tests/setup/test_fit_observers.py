"""The fragment is YAML of the profile's own format, with comments, whatever the names."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from messages import shows, shows_lines
from retarget.model.body import load_body_text
from retarget.model.body_file import compile_body_text
from retarget.schema.profile_parts import IgnorePair, Observer
from retarget.schema.strict_yaml import scan
from retarget.setup.enclosing_shapes import Capsule, Solid, link_geometries
from retarget.setup.fit_observers import MAX_PAIRS, WIDTH, Verdict, fragment, verdicts
from retarget.setup.observer_proposals import Proposal, Zones, propose
from retarget.setup.survey import OwnDistances, PairRecord, joint_ranges, with_own_distances

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


def record(
    pair: tuple[int, int],
    *,
    smallest: float,
    largest: float | None = None,
    at_neutral: float = 1.0,
    own: tuple[float, float] | None = None,
) -> PairRecord:
    return PairRecord(pair, smallest, largest, at_neutral, 100, 20, None if own is None else OwnDistances(*own))


def one(found: PairRecord, excluded: tuple[int, int] = (0, 0)) -> tuple[Verdict, ...]:
    return verdicts([found], SHAPES, BODY, near=0.045, excluded={excluded})


def test_never_near() -> None:
    (verdict,) = one(record((0, 2), smallest=0.0731))
    assert (verdict.kind, verdict.links) == ("never", ("a", "d"))
    assert verdict.reason == "never near, at least 73.1 mm apart (100 postures, 20 searches)"


def test_sometimes_near_is_left_to_check() -> None:
    assert one(record((0, 2), smallest=0.0449)) == ()
    assert one(record((0, 2), smallest=-0.1)) == ()


def test_always_overlapping_says_what_the_geoms_do() -> None:
    def found(*own: float) -> PairRecord:
        return record((0, 2), smallest=-0.02, largest=-0.001, own=(own[0], own[1]))

    (nested,) = one(found(-0.01, -0.005))
    assert nested.kind == "always" and nested.reason.endswith("and so do the links' own geoms")
    shows(nested.reason, "1.0", "20.0")
    (apart,) = one(found(0.004, 0.02))
    assert not apart.warning and apart.reason.endswith("their own geoms stay 4.0 mm apart")
    (hidden,) = one(found(-0.004, 0.02))
    shows(hidden.warning)


def test_pairs_that_the_body_file_excludes() -> None:
    (verdict,) = one(record((0, 2), smallest=-0.1), excluded=(1, 4))
    assert verdict.kind == "excluded"
    shows(verdict.reason, "100.0")


def test_neighbours_with_nothing_between_them_are_ignored_if_they_touch() -> None:
    (verdict,) = one(record((0, 1), smallest=-0.05, at_neutral=-0.03))
    assert verdict.kind == "neighbours"
    assert one(record((0, 1), smallest=-0.05, at_neutral=0.01)) == ()
    assert one(record((0, 2), smallest=-0.05, at_neutral=-0.03)) == ()  # c lies between a and d


def test_own_geoms_are_looked_at_in_many_postures() -> None:
    pairs = (record((0, 1), smallest=-0.02, largest=-0.01), record((0, 2), smallest=-0.02))
    one, other = with_own_distances(pairs, MODEL, link_geometries(MODEL)[0], joint_ranges(BODY, {}), seed=0)
    found = one.own
    assert found is not None and other.own is None
    assert abs(found.smallest + 0.03) < 1e-6 and abs(found.largest + 0.03) < 1e-6
    assert not found.may_collide and OwnDistances(-1.0, 1.0).may_collide


def test_what_a_profile_cannot_do_without_comes_first() -> None:
    records = [record((0, 2), smallest=0.1)] * (MAX_PAIRS + 1)
    records += [record((0, 2), smallest=-0.02, largest=-0.01, own=(-1.0, -1.0))]
    found = verdicts(records, SHAPES, BODY, near=0.045, excluded=set())
    assert found[0].kind == "always"
