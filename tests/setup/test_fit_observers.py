"""Observers and ignored pairs as YAML of a profile, and which pairs are ignored."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from pydantic import TypeAdapter

from command_line import said_by
from messages import shows
from retarget.model.body import body_from_file
from retarget.model.body_file import compile_body_text
from retarget.model.observers import robot_observers
from retarget.model.robot import load_profile, load_robot
from retarget.model.scene_shapes import ShapeKind
from retarget.schema.catalogue import shipped_folder
from retarget.schema.profile_parts import IgnorePair, Observer
from retarget.schema.strict_yaml import scan
from retarget.setup.fit_observers import Fit, IgnoredLinks, PlacedShapes, Zones, fit, fragment, ignored_links
from retarget.setup.shape_fit import LinkShape, fitted_shapes

ZONES = Zones(0.03, 0.005)
STILL = np.array([1.0, 0.0, 0.0, 0.0])
TURNED = np.array([0.6, 0.8, 0.0, 0.0])
CAPSULE = LinkShape(1, "arm", ShapeKind.CAPSULE, np.array([0.02345, 0.25, 0.0]), np.array([0.0, 0.1, 1.5]), TURNED)
BALL = LinkShape(1, "arm", ShapeKind.CAPSULE, np.array([0.1, 0.0, 0.0]), np.ones(3), STILL)
BOX = LinkShape(1, "arm", ShapeKind.BOX, np.array([0.1, 0.2, 0.3]), np.zeros(3), STILL)
TILTED = LinkShape(1, "arm", ShapeKind.BOX, np.array([0.1, 0.2, 0.3]), np.zeros(3), TURNED)


def read(text: str) -> tuple[dict[str, Observer], list[IgnorePair]]:
    document = scan(text, Path("fragment.yaml"))
    assert not document.problems
    observers = TypeAdapter(dict[str, Observer]).validate_python(document.data["observers"])
    return observers, TypeAdapter(list[IgnorePair]).validate_python(document.data["ignore_pairs"])


@pytest.mark.parametrize("shape", [CAPSULE, BALL, BOX, TILTED])
def test_shapes_are_read_again_as_they_were(shape: LinkShape) -> None:
    found = read(fragment([], [shape], [], ZONES))[0]["arm"]
    assert (found.influence, found.margin) == (0.03, 0.005)
    if shape.kind is ShapeKind.BOX:
        assert found.shape.box is not None
        assert found.shape.box.size == tuple(shape.size)
        assert found.shape.box.quat == pytest.approx(tuple(shape.quat))
    elif not shape.size[1]:
        assert found.shape.sphere is not None and found.shape.sphere.at == (1.0, 1.0, 1.0)
    else:
        assert found.shape.capsule is not None and found.shape.capsule.radius == shape.size[0]
        ends = [*found.shape.capsule.start, *found.shape.capsule.end]
        assert ends == pytest.approx([*shape.ends[0], *shape.ends[1]], abs=1e-5)


@pytest.mark.parametrize("name", ["no", "012", "1:30", "a,b", "{x}", "ünï", "#", "-", "true", "a:", "'", '"'])
def test_any_name_survives(name: str) -> None:
    pair = IgnoredLinks((name, "other"), 'far: 1, 2 "mm" # or more')
    shape = LinkShape(1, name, BALL.kind, BALL.size, BALL.pos, BALL.quat)
    observers, pairs = read(fragment(["a note\nof two: lines"], [shape], [pair], ZONES))
    assert list(observers) == [name] and observers[name].link == name
    assert pairs[0].pair == (name, "other") and pairs[0].reason == pair.reason


LINK = '<body name="l{0}" pos="0.1 0 0"><joint name="j{0}" axis="0 0 1" range="-1 1"/><geom size="0.02"/>'
ROW = "".join(LINK.format(number) for number in range(4))
ROW = f"""<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom size="0.02"/>{ROW}{"</body>" * 5}
  </worldbody></mujoco>"""


def test_distances_are_those_of_mujoco_and_what_touches_is_ignored() -> None:
    file = compile_body_text(ROW, source="test")
    placed = PlacedShapes(body_from_file(file), fitted_shapes(file.model, source="test"))
    data = mujoco.MjData(file.model)
    for q in np.random.default_rng(1).uniform(-1.0, 1.0, (20, 4)):
        data.qpos[:] = q
        mujoco.mj_kinematics(file.model, data)
        angles = {f"j{number}": float(angle) for number, angle in enumerate(q)}
        pairs = [(a, b) for b in range(5) for a in range(b - 1)]  # links one joint apart are never looked at
        exact = {pair: mujoco.mj_geomDistance(file.model, data, *pair, 1e3, None) for pair in pairs}
        assert sorted(placed.distances(angles)) == pytest.approx(sorted(exact.values()), abs=5e-5)
    curled = dict.fromkeys(("j0", "j1", "j2", "j3"), 1.57)
    assert not ignored_links(placed, {}, {})
    (found,) = ignored_links(placed, {}, {"stand": curled})
    assert set(found.links) == {"base", "l3"} and "stand" in found.reason


# `retarget fit-observers` as a user meets it: a fragment that loads in a profile, files, exit codes.

OP3 = shipped_folder() / "robots" / "op3"
TWO_LINKS = """<mujoco model="two"><worldbody><body name="base"><geom size="0.05"/>
  <body name="arm_link" pos="0.1 0 0"><joint name="j" range="-90 90"/>
  <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02"/>
  </body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def op3() -> Fit:
    return fit("op3", ZONES)


def test_the_fragment_loads_in_a_profile(op3: Fit, tmp_path: Path) -> None:
    text = (OP3 / "robot.yaml").read_text(encoding="utf-8")
    start, end = text.index("\nobservers:"), text.index("\n# Convex outline around")
    (tmp_path / "robot.yaml").write_text(text[:start] + "\n" + op3.text + text[end:], encoding="utf-8")
    (tmp_path / "body.xml").write_bytes((OP3 / "body.xml").read_bytes())
    profile = load_profile(tmp_path)
    assert len(profile.observers) == len(op3.shapes) == 21 and len(profile.ignore_pairs) == len(op3.ignored)
    assert profile.observers["l_ank_roll"].shape.box is not None
    assert all(observer.influence == 0.03 and observer.margin == 0.005 for observer in profile.observers.values())
    assert robot_observers(load_robot(tmp_path)).pairs.size


def test_out_writes_the_file_with_a_summary_and_never_over_its_input(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    body = tmp_path / "two.xml"
    body.write_text(TWO_LINKS, encoding="utf-8")
    printed = said_by(capsys, "fit-observers", body)[1]
    code, out, _ = said_by(capsys, "fit-observers", body, "--out", tmp_path / "new.yaml")
    assert (code, out) == (0, f"{tmp_path / 'new.yaml'}: 2 observers; 0 pairs to ignore\n")
    assert (tmp_path / "new.yaml").read_text(encoding="utf-8") == printed
    code, _, err = said_by(capsys, "fit-observers", body, "--out", body)
    assert code == 2
    shows(err)
    assert body.read_text(encoding="utf-8") == TWO_LINKS
    code, _, err = said_by(capsys, "fit-observers", OP3, "--out", OP3 / "robot.yaml")
    assert code == 2 and load_profile("op3").observers
