"""Which observers look at each other: what is dropped at start is told, with its reason, and nothing else is."""

from itertools import combinations

import numpy as np
import pytest

from followers import op3
from observed import CAPSULE
from retarget.body import BodyModel, load_body_text
from retarget.errors import ConfigError
from retarget.observer_pairs import PairRules, placed
from retarget.observers import Observers, assemble, robot_observers
from retarget.scene_shapes import ShapeKind
from support.messages import refuses, shows

ARM = """<mujoco><worldbody><body name="base"><geom size="0.01"/>
  <body name="plate" pos="0 0 0.1"><geom size="0.01"/></body>
  <body name="a" pos="0.2 0 0"><joint name="ja" axis="0 0 1"/><geom size="0.01"/>
    <body name="b" pos="0.2 0 0"><joint name="jb" axis="0 0 1"/><geom size="0.01"/>
      <body name="c" pos="0.2 0 0"><joint name="jc" axis="0 0 1"/><geom size="0.01"/>
        <body name="d" pos="0.2 0 0"><joint name="jd" axis="0 0 1"/><geom size="0.01"/></body></body></body></body>
</body></worldbody></mujoco>"""
TRIANGLE = (0.0, 2.0 * np.pi / 3, 2.0 * np.pi / 3, 0.0)
LINKS = ("base", "plate", "a", "b", "c", "d")


def arm() -> BodyModel:
    return load_body_text(ARM, source="arm")


def balls(
    radius: float, angles: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0), ignored: tuple[tuple[str, str], ...] = ()
) -> Observers:
    """A ball on every link."""
    body = arm()
    rules = PairRules(
        neutral=np.array(angles),
        ignored=tuple((body.body_index(a), body.body_index(b), "because") for a, b in ignored),
        where="arm",
    )
    row = (ShapeKind.CAPSULE, (radius, 0.0, 0.0), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    links = {name: body.body_index(name) for name in LINKS}
    return assemble(body, links, dict.fromkeys(LINKS, row), dict.fromkeys(LINKS, (0.05, 0.0)), rules)


def looked_at(observers: Observers) -> set[frozenset[str]]:
    return {frozenset(observers.names[k] for k in pair) for pair in observers.pairs.tolist()}


def told(observers: Observers) -> dict[frozenset[str], str]:
    return {frozenset((pair.first, pair.second)): pair.reason for pair in observers.dropped}


def test_neighbours_are_not_looked_at_and_fixed_links_are_one() -> None:
    found = balls(0.01)
    near = "neighbours along the body"
    assert told(found) == {
        **{frozenset(pair): near for pair in (("base", "a"), ("plate", "a"), ("a", "b"), ("b", "c"), ("c", "d"))},
    }
    one = {frozenset(("base", "plate"))}
    every = {frozenset(pair) for pair in combinations(LINKS, 2)}
    assert looked_at(found) == every - set(told(found)) - one


def test_ignored_pairs_keep_their_reason() -> None:
    found = balls(0.01, ignored=(("a", "c"), ("d", "base")))
    assert told(found)[frozenset(("a", "c"))] == told(found)[frozenset(("base", "d"))] == "because"
    assert not looked_at(found) & {frozenset(("a", "c")), frozenset(("base", "d"))}


def test_what_touches_at_rest_is_dropped_and_told_how_deep() -> None:
    """Balls of 21 cm two joints apart overlap by 2 cm."""
    found = balls(0.21)
    assert {pair: reason for pair, reason in told(found).items() if "touch" in reason} == {
        frozenset(pair): "touch by 20.0 mm in the neutral posture" for pair in (("a", "c"), ("b", "d"), ("base", "b"))
    } | {frozenset(("plate", "b")): f"touch by {1e3 * (0.42 - np.hypot(0.4, 0.1)):.1f} mm in the neutral posture"}


def test_what_is_far_apart_along_the_body_and_touches_is_refused() -> None:
    """Folded so that the last link lies on the first."""
    with refuses(ConfigError) as refused:
        balls(0.03, angles=TRIANGLE)
    text = str(refused.value)
    shows(text, 3)
    calm = balls(0.03, angles=TRIANGLE, ignored=(("a", "d"),))
    assert told(calm)[frozenset(("a", "d"))] == "because"


def test_every_pair_of_op3_is_looked_at_or_told() -> None:
    found = robot_observers(op3())
    assert len(found.names) == 23 and len(found.pairs) == 223 and len(found.dropped) == 28
    assert len({tuple(sorted(pair)) for pair in found.pairs.tolist()}) == 223
    links = dict(zip(found.names, found.links.tolist(), strict=True))
    every = {frozenset(pair) for pair in combinations(found.names, 2) if links[pair[0]] != links[pair[1]]}
    assert looked_at(found) | set(told(found)) == every and not looked_at(found) & set(told(found))
    reasons = set(told(found).values())
    assert reasons == {"neighbours along the body", op3().profile.ignore_pairs[0].reason}


def test_observers_are_placed_with_their_links() -> None:
    body, found = arm(), balls(0.01)
    q = np.array([0.3, -0.2, 0.5, 0.1])
    position, quat = placed(body, found, q)
    where, turned = body.solver_body().forward(q)
    assert position == pytest.approx(where[found.links], abs=1e-12)
    assert np.abs((quat * turned[found.links]).sum(axis=1)) == pytest.approx(1.0)
    assert (found.kinds == CAPSULE).all()
