"""`retarget fit-observers` as a user meets it: a fragment that loads in a profile, files, exit codes."""

from pathlib import Path

import numpy as np
import pytest

from command_line import said_by
from messages import shows
from retarget.model.observers import robot_observers
from retarget.model.robot import load_profile, load_robot
from retarget.report.clearance import place_body
from retarget.schema.catalogue import shipped_folder
from retarget.setup.fit_observers import Fit, find_subject, fit
from retarget.setup.shape_fit import Zones
from retarget.setup.survey import joint_ranges

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
