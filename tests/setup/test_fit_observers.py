"""How near pairs of links come over all postures, which pairs are ignored for it, and both as YAML of a profile."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from pydantic import TypeAdapter

from command_line import said_by
from messages import shows
from retarget.model.body import load_body_text
from retarget.model.body_file import compile_body_text
from retarget.model.observers import robot_observers
from retarget.model.robot import load_profile, load_robot
from retarget.report.clearance import place_body
from retarget.schema.catalogue import shipped_folder
from retarget.schema.profile_parts import IgnorePair, Observer
from retarget.schema.strict_yaml import scan
from retarget.setup.fit_observers import MAX_PAIRS, WIDTH, Fit, Verdict, find_subject, fit, fragment, verdicts
from retarget.setup.shape_fit import Capsule, Proposal, Solid, Zones, link_geometries, propose
from retarget.setup.survey import PairRecord, PlacedShapes, joint_ranges, survey

BODY = load_body_text(
    """<mujoco><compiler angle="radian"/><worldbody><body name="base"><freejoint/><geom size="1"/>
    <body name="a"><joint name="a" range="-1 2"/><geom size="1"/>
    <body name="b"><joint name="b"/><geom size="1"/>
    <body name="c"><joint name="c" type="ball"/><geom size="1"/>
    <body name="d"><joint name="d" type="slide" range="0.1 0.2"/><geom size="1"/></body></body></body></body>
    </body></worldbody></mujoco>""",
    source="test",
)


def test_samples_stay_inside_and_reach_the_corners() -> None:
    ranges = joint_ranges(BODY, {})
    q = ranges.sample(np.random.default_rng(0), 400)
    scalar = q[:, ranges.address]
    assert (scalar >= ranges.lower).all() and (scalar <= ranges.upper).all()
    corner = np.isin(scalar, [*ranges.lower, *ranges.upper]).all(axis=1)
    assert corner.sum() >= 100
    assert len(np.unique(scalar[:, 0])) > 200
    assert np.allclose(np.linalg.norm(q[:, 9:13], axis=1), 1.0)
    assert (q[:, :7] == BODY.qpos0[:7]).all()


NEAR = 0.045
BALLS = """<mujoco><worldbody><body name="base"><geom size="0.01"/>
  <body name="arm"><joint name="s" type="slide" axis="1 0 0" range="{low} {high}"/><geom size="0.001" pos="0 0 5"/>
    <body name="hand"><joint name="r" axis="1 0 0" range="-90 90"/><geom size="0.01" pos="0.02 0 0"/></body>
  </body></body></worldbody></mujoco>"""
# Six joints in a row; the tip meets the ball only if nearly all of them bend as far as they can.
INERTIA = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
LINK = '<body name="l{0}" pos="0.1 0 0"><joint name="j{0}" axis="0 0 1" range="-1 1"/>' + INERTIA
CURL = "".join(LINK.format(number) for number in range(6))
CURL = f"""<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom size="0.02" pos="0.02 0.09 0"/>{CURL}
  <geom size="0.02" pos="0.1 0 0"/>{"</body>" * 6}</body></worldbody></mujoco>"""


def look(text: str, *, samples: int, seed: int = 0) -> dict[tuple[str, str], PairRecord]:
    body, model = load_body_text(text, source="test"), compile_body_text(text, source="test").model
    geometries, ranges = link_geometries(model)[0], joint_ranges(body, {})
    shapes = propose(geometries, Zones(0.03, 0.005))
    neutral = ranges.clipped(body.qpos0)
    looks = {"near": NEAR, "samples": samples, "seed": seed}
    records = survey(body, shapes, ranges, neutral=neutral, model=model, geometries=geometries, **looks)  # type: ignore[arg-type]
    return {(shapes[r.pair[0]].link_name, shapes[r.pair[1]].link_name): r for r in records}


def test_the_smallest_distance_is_the_exact_one() -> None:
    found = look(BALLS.format(low=0.1, high=0.5), samples=3)
    assert list(found) == [("base", "hand")]  # links one joint apart are never looked at
    record = found["base", "hand"]
    assert record.smallest == pytest.approx(0.1, abs=2e-5)
    assert record.at_neutral == pytest.approx(0.1, abs=2e-5)
    assert record.largest is None and record.searches == 20


def test_overlap_at_every_posture_is_reported_with_its_depth() -> None:
    record = look(BALLS.format(low=-0.015, high=-0.005), samples=40)["base", "hand"]
    assert record.largest == pytest.approx(-0.005, abs=4e-5)
    assert record.smallest == pytest.approx(-0.015, abs=4e-5)
    assert record.own == pytest.approx((-0.015, -0.005), abs=4e-5) and not record.hides_collision


def test_a_pair_that_parts_in_one_corner_is_not_called_overlapping() -> None:
    record = look(BALLS.format(low=-0.019, high=0.00002), samples=1)["base", "hand"]
    assert record.largest is None


@pytest.mark.parametrize("seed", range(2))
def test_a_meeting_that_hardly_any_posture_shows_is_found(seed: int) -> None:
    body = load_body_text(CURL, source="test")
    ranges = joint_ranges(body, {})
    shapes = propose(link_geometries(compile_body_text(CURL, source="test").model)[0], Zones(0.03, 0.005))
    sampled = PlacedShapes(body, shapes).distances(ranges.sample(np.random.default_rng(seed), 20), np.array([[0, 1]]))
    assert sampled.min() > NEAR  # so that the sample alone would be wrong
    assert look(CURL, samples=20, seed=seed)["base", "l5"].smallest <= NEAR


def test_distances_are_those_of_mujoco() -> None:
    file = compile_body_text(CURL, source="test")
    body, data = load_body_text(CURL, source="test"), mujoco.MjData(file.model)
    shapes = PlacedShapes(body, propose(link_geometries(file.model)[0], Zones(0.03, 0.005)))
    postures, pair = joint_ranges(body, {}).sample(np.random.default_rng(1), 50), np.array([[0, 1]])
    found = shapes.distances(postures, pair)[:, 0]
    for q, distance in zip(postures, found, strict=True):
        data.qpos[:] = q
        mujoco.mj_kinematics(file.model, data)
        assert mujoco.mj_geomDistance(file.model, data, 0, 1, 1e3, None) == pytest.approx(distance, abs=5e-5)


ZONES = Zones(0.03, 0.005)
CAPSULE = Capsule(np.array([0.0, -0.00001, 1.5]), np.array([0.1, 0.0, 2.0]), 0.02345)
BALL = Capsule(np.ones(3), np.ones(3), 0.1)
BOX = Solid("box", np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.1, 0.2, 0.3]))
TURNED = Solid("box", np.zeros(3), np.array([0.6, 0.8, 0.0, 0.0]), np.array([0.1, 0.2, 0.3]))


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


def test_comments_stay_comments() -> None:
    warned = Verdict("always", ("a", "b"), "deep", "b is\nhidden " + 40 * "very " + "well")
    text = fragment(["a note\nof two: lines"], [observer(BALL)], [warned], ZONES, tail=["the end"])
    assert len(read(text)[0]) == 1
    comments = [line for line in text.splitlines() if line.lstrip().startswith("#")]
    assert comments[0] == "# a note of two: lines" and comments[-1] == "# the end"
    assert max(map(len, comments)) <= WIDTH + 4
    shows(text)


# b has no geometry: a and c are neighbours with nothing between.
TEXT = """<mujoco><worldbody><body name="a"><geom size="0.1"/>
  <body name="b"><joint name="b" axis="1 0 0" range="-90 90"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <body name="c"><joint name="c" range="-90 90"/><geom size="0.05" pos="0.12 0 0"/>
      <body name="d" pos="1 0 0"><joint name="d" range="-90 90"/><geom size="0.1"/></body></body></body>
</body></worldbody></mujoco>"""
FOUR_LINKS = load_body_text(TEXT, source="test")
MODEL = compile_body_text(TEXT, source="test").model
SHAPES = propose(link_geometries(MODEL)[0], Zones(0.03, 0.005))


JOINED, FAR = (0, 1), (0, 2)
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
        (record(JOINED, -0.05, at_neutral=-0.03), (0, 0), "neighbours", "no volume between them"),
        (record(JOINED, -0.05, at_neutral=0.01), (0, 0), "", ""),
        (record(FAR, -0.05, at_neutral=-0.03), (0, 0), "", ""),
        (record(FAR, -0.02, own=(-0.01, -0.005), **DEEP), (0, 0), "always", "and so do the links' own geoms"),
        (record(FAR, -0.02, own=(0.004, 0.02), **DEEP), (0, 0), "always", "their own geoms stay 4.0 mm apart"),
        (record(FAR, -0.02, own=(-0.004, 0.02), **DEEP), (0, 0), "always", "4.0 mm into each other"),
    ],
)
def test_a_pair_is_ignored_for_a_reason(found: PairRecord, excluded: tuple[int, int], kind: str, reason: str) -> None:
    done = verdicts([found], SHAPES, FOUR_LINKS, near=0.045, excluded={excluded})
    assert [verdict.kind for verdict in done] == ([kind] if kind else [])
    for verdict in done:
        assert reason in verdict.reason and bool(verdict.warning) == found.hides_collision


def test_what_a_profile_cannot_do_without_comes_first() -> None:
    records = [record(FAR, 0.1)] * (MAX_PAIRS + 1)
    records += [record(FAR, -0.02, largest=-0.01, own=(-1.0, -1.0))]
    found = verdicts(records, SHAPES, FOUR_LINKS, near=0.045, excluded=set())
    assert found[0].kind == "always"


# `retarget fit-observers` as a user meets it: a fragment that loads in a profile, files, exit codes.

OP3 = shipped_folder() / "robots" / "op3"
TWO_LINKS = """<mujoco model="two"><worldbody><body name="base"><geom size="0.05"/>
  <body name="arm_link" pos="0.1 0 0"><joint name="j" range="-90 90"/>
  <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02"/>
  </body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def op3() -> Fit:
    return fit(find_subject("op3"), Zones(0.03, 0.005), samples=500)


@pytest.fixture
def body(tmp_path: Path) -> Path:
    path = tmp_path / "two.xml"
    path.write_text(TWO_LINKS, encoding="utf-8")
    return path


def profile_with(fragment: str, folder: Path) -> Path:
    """A copy of OP3's profile with its observers and ignored pairs replaced."""
    text = (OP3 / "robot.yaml").read_text(encoding="utf-8")
    start, end = text.index("\nobservers:"), text.index("\n# Convex outline around")
    (folder / "robot.yaml").write_text(text[:start] + "\n" + fragment + text[end:], encoding="utf-8")
    (folder / "body.xml").write_bytes((OP3 / "body.xml").read_bytes())
    return folder / "robot.yaml"


@pytest.mark.long
def test_the_fragment_loads_in_a_profile(op3: Fit, tmp_path: Path) -> None:
    profile = load_profile(profile_with(op3.text, tmp_path))
    assert len(profile.observers) == len(op3.observers) == 21
    assert len(profile.ignore_pairs) == len(op3.ignored)
    assert profile.observers["l_ank_roll"].shape.box is not None
    assert profile.observers["body"].shape.geom == "body_shell"
    assert all(observer.influence == 0.03 and observer.margin == 0.005 for observer in profile.observers.values())


def test_a_run_looks_at_the_pairs_that_are_left_to_check(op3: Fit, tmp_path: Path) -> None:
    observers = robot_observers(load_robot(profile_with(op3.text, tmp_path)))
    assert len(observers.pairs) == len(op3.records) - len(op3.ignored)
    assert f"# {len(observers.pairs)} pairs are left to check." in op3.text


def test_far_parts_that_touch_in_the_neutral_posture_are_reported(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    link = '<body name="l{0}" pos="0.2 0 0"><joint name="j{0}" range="-90 90"/><geom size="0.05"/>'
    ring = "".join(link.format(number) for number in range(3)) + '<geom size="0.05" pos="-0.58 0 0"/>'
    text = f'<mujoco><worldbody><body name="base"><geom size="0.05"/>{ring}{"</body>" * 4}</worldbody></mujoco>'
    (tmp_path / "ring.xml").write_text(text, encoding="utf-8")
    code, out, _ = said_by(capsys, "fit-observers", tmp_path / "ring.xml", "--samples", 10)
    assert code == 0
    shows(out, 2, "l2")


def test_ignoring_hides_no_collision_of_the_robots_own_geoms(op3: Fit) -> None:
    """Without the pairs that are nested by construction, ignored pairs never collide: none is missed by ignoring it."""
    robot = load_robot("op3")
    assert not any(verdict.warning for verdict in op3.ignored)
    ignored = {frozenset(verdict.links) for verdict in op3.ignored}
    nested = [ignored_pair.pair for ignored_pair in robot.profile.ignore_pairs]
    links = robot.body.body_names[1:]
    others = [(a, b) for a in links for b in links if a < b and frozenset((a, b)) not in ignored]
    ranges = joint_ranges(robot.body, {joint: servo.limits for joint, servo in robot.profile.servos.items()})
    postures = ranges.sample(np.random.default_rng(99), 1000)
    neutral = robot.posture(robot.profile.postures.neutral)
    found = place_body(robot.profile.body_path, postures, root="free").to_itself(
        neutral=neutral, ignored=[*others, *nested]
    )
    assert found.penetrating == 0


def test_out_writes_the_file_and_says_what_is_in_it(
    capsys: pytest.CaptureFixture[str], body: Path, tmp_path: Path
) -> None:
    printed = said_by(capsys, "fit-observers", body)[1]
    code, out, _ = said_by(capsys, "fit-observers", body, "--out", tmp_path / "new.yaml")
    assert (code, out) == (0, f"{tmp_path / 'new.yaml'}: 2 observers; 0 of 0 pairs to ignore (none)\n")
    assert (tmp_path / "new.yaml").read_text(encoding="utf-8") == printed


def test_what_it_was_made_from_is_never_overwritten(capsys: pytest.CaptureFixture[str], body: Path) -> None:
    code, _, err = said_by(capsys, "fit-observers", body, "--out", body)
    assert code == 2
    shows(err)
    assert body.read_text(encoding="utf-8") == TWO_LINKS
    code, _, err = said_by(capsys, "fit-observers", OP3, "--out", OP3 / "robot.yaml")
    assert code == 2 and load_profile("op3").observers
