"""Every verdict carries the numbers that it rests on, and tells what it costs."""

from retarget.body import load_body_text
from retarget.body_file import compile_body_text
from retarget.fitting.fragment import MAX_PAIRS
from retarget.fitting.geometry import link_geometries
from retarget.fitting.own_geoms import OwnDistances, own_distances
from retarget.fitting.proposals import Zones, propose
from retarget.fitting.ranges import joint_ranges
from retarget.fitting.survey import PairRecord
from retarget.fitting.verdicts import Verdict, verdicts
from support.messages import shows

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
    pair: tuple[int, int], *, smallest: float, largest: float | None = None, at_neutral: float = 1.0
) -> PairRecord:
    return PairRecord(pair, smallest, largest, at_neutral, 100, 20)


def one(
    found: PairRecord, own: tuple[OwnDistances, ...] = (), excluded: tuple[int, int] = (0, 0)
) -> tuple[Verdict, ...]:
    return verdicts([found], SHAPES, BODY, near=0.045, own=own, excluded={excluded})


def test_never_near() -> None:
    (verdict,) = one(record((0, 2), smallest=0.0731))
    assert (verdict.kind, verdict.links) == ("never", ("a", "d"))
    assert verdict.reason == "never near, at least 73.1 mm apart (100 postures, 20 searches)"


def test_sometimes_near_is_left_to_check() -> None:
    assert one(record((0, 2), smallest=0.0449)) == ()
    assert one(record((0, 2), smallest=-0.1)) == ()


def test_always_overlapping_says_what_the_geoms_do() -> None:
    found = record((0, 2), smallest=-0.02, largest=-0.001)
    (nested,) = one(found, (OwnDistances(-0.01, -0.005),))
    assert nested.kind == "always" and nested.reason.endswith("and so do the links' own geoms")
    shows(nested.reason, "1.0", "20.0")
    (apart,) = one(found, (OwnDistances(0.004, 0.02),))
    assert not apart.warning and apart.reason.endswith("their own geoms stay 4.0 mm apart")
    (hidden,) = one(found, (OwnDistances(-0.004, 0.02),))
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
    (found,) = own_distances(MODEL, joint_ranges(BODY, {}), [(1, 3)], seed=0)
    assert abs(found.smallest + 0.03) < 1e-6 and abs(found.largest + 0.03) < 1e-6
    assert not found.may_collide and OwnDistances(-1.0, 1.0).may_collide


def test_what_a_profile_cannot_do_without_comes_first() -> None:
    records = [record((0, 2), smallest=0.1)] * (MAX_PAIRS + 1) + [record((0, 2), smallest=-0.02, largest=-0.01)]
    found = verdicts(records, SHAPES, BODY, near=0.045, own=[OwnDistances(-1.0, -1.0)], excluded=set())
    assert found[0].kind == "always"
