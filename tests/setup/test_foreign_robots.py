"""What robots from elsewhere have and the shipped ones have not: feet of several links, shoulders wider than arms hang,
meshes in COLLADA; and files that are no bodies."""

import json
from pathlib import Path

import numpy as np
import pytest

from command_line import code_of, said_by
from messages import refuses, shows
from retarget.errors import InputError
from retarget.model.observers import robot_observers
from retarget.model.robot import load_robot
from retarget.safety.clearance import PathClearance
from retarget.setup.import_robot import Imported, import_robot
from retarget.setup.robot_file import collada_triangles
from retarget.setup.servo_guess import NO_TORQUE, UNKNOWN
from unknown_robots import HUMANOID, Part, humanoid, imported, urdf

STUD = (0.0101, 0.0102, 0.0103)
STUDS = [(x, y) for x in (-0.03, 0.03) for y in (-0.045, 0.085)]


def fixed(name: str, parent: str, at: tuple[float, float, float], size: tuple[float, float, float]) -> Part:
    return Part(name, parent, at, (1, 0, 0), (0, 0), size, mass=0.01, kind="fixed")


def on_studs() -> str:
    """Each foot has a plate below it, 0.6 mm apart, and that stands on four balls, 0.3 mm lower: all of them links."""
    parts = list(HUMANOID)
    for side in "pq":
        parts.append(fixed(f"{side}_plate", f"{side}5", (0, 0.02, -0.0436), (0.07, 0.14, 0.006)))
        for n, (x, y) in enumerate(STUDS):
            parts.append(fixed(f"{side}_stud{n}", f"{side}_plate", (x, y - 0.02, 0.0017), STUD))
    return humanoid(parts).replace(f'<box size="{" ".join(map(str, STUD))}"/>', '<sphere radius="0.005"/>')


@pytest.fixture(scope="module")
def studded(tmp_path_factory: pytest.TempPathFactory) -> Imported:
    return imported(on_studs(), tmp_path_factory.mktemp("studs"))


def test_all_that_fixed_joints_hold_to_a_sole_is_the_sole(studded: Imported) -> None:
    assert not studded.problems and (studded.margin or 0.0) > 0.02
    robot = load_robot(studded.folder)
    assert [len(foot) for foot in robot.foot_links] == [6, 6]
    observers = robot_observers(robot)
    standing = {name for name, stands in zip(observers.names, observers.stands.tolist(), strict=True) if stands}
    assert standing == {f"{side}{part}" for side in "pq" for part in ("5", "_plate", *(f"_stud{n}" for n in range(4)))}


def test_a_robot_on_studs_follows_the_sample(studded: Imported, tmp_path: Path) -> None:
    words = ("--source", "sample", "--end", "4", "--report", tmp_path / "report.json")
    assert code_of("run", "--robot", studded.folder, *words) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["frames"] > 100 and report["stop"]["reason"] is None
    assert report["penetrating_frames"] == 0, "soles touch the ground, whatever link they are on"


def test_a_run_that_cannot_begin_is_reported_before_it(
    studded: Imported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The gate lets nothing pass."""
    monkeypatch.setattr(PathClearance, "__call__", lambda *_, walk=None: False)
    done = imported(on_studs(), tmp_path)
    assert len(done.problems) == 1
    shows(done.problems[0], "`rest`", "the gate refuses the approach")
    code, _, err = said_by(capsys, "check", studded.folder)
    assert code == 2
    shows(err, "`rest`", "the gate refuses the approach")


def test_arms_hang_beside_shoulders_that_reach_over_them(tmp_path: Path) -> None:
    """The yoke of the chest goes over the upper arms, three joints away, whose axes meet."""
    yoke = fixed("yoke", "chest", (0, 0, 0.1), (0.25, 0.05, 0.1))
    done = imported(humanoid([*HUMANOID, yoke]), tmp_path)
    assert not done.problems
    ignored = {frozenset(pair.links): pair.reason for pair in done.draft.ignored}
    assert {frozenset(("yoke", "p8")), frozenset(("yoke", "q8"))} <= ignored.keys()
    for posture in ("neutral", "stand"):
        assert abs(done.draft.postures[posture].get("j_p7", 0.0)) < 0.6, "the arm hangs"
    assert any("p9, q9" in note for note in done.draft.notes), "forearm and hand are one link"


def test_torques_that_no_servo_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "body.urdf"
    path.write_text(urdf(HUMANOID, base="chest", size=(0.12, 0.08, 0.16), effort=200.0))
    shows(said_by(capsys, "import", path, "--out", tmp_path / "strong", "--yes")[1], "no known one is strong enough")
    path.write_text(urdf(HUMANOID, base="chest", size=(0.12, 0.08, 0.16), effort=5e4))
    code, out, _ = said_by(capsys, "import", path, "--out", tmp_path / "placeholders", "--yes")
    assert code == 0
    shows(out, UNKNOWN, "--servo")
    assert {servo.why for servo in import_robot(path, tmp_path / "again").draft.servos} == {NO_TORQUE}


def test_files_that_are_mixed_up(studded: Imported, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = studded.folder
    motion = tmp_path / "walk.bvh"
    motion.write_text("HIERARCHY")
    for words, next_step in (
        (("run", "--source", "sample", "--robot", folder / "body.xml"), folder / "robot.yaml"),
        (("run", "--source", "sample", "--robot", folder.parent / "body.urdf"), "retarget import"),
        (("import", folder / "robot.yaml"), "retarget check"),
        (("import", folder), "retarget check"),
        (("import", motion), "retarget run"),
    ):
        code, _, err = said_by(capsys, *words)
        assert code == 2 and err.count("\n") == 1
        shows(err, next_step)


TETRAHEDRON = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>
    <unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
  <library_geometries><geometry id="g"><mesh>
    <source id="p"><float_array id="a" count="12">0 0 0 10 0 0 0 20 0 0 0 30</float_array><technique_common>
      <accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
      <param name="Z" type="float"/></accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 1 2 3 0 3 2</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s"><node><translate>0 0 5</translate><instance_geometry url="#g"/></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""
WITHOUT_PYCOLLADA = "pycollada is not installed (extra `collada`)"


def test_collada_in_its_unit_as_its_nodes_place_it() -> None:
    pytest.importorskip("collada", reason=WITHOUT_PYCOLLADA)
    corners = collada_triangles(TETRAHEDRON.encode(), source="a.dae").reshape(-1, 3)
    assert len(corners) == 12
    np.testing.assert_allclose(corners.min(axis=0), [0.0, 0.0, 0.05], atol=1e-9)
    np.testing.assert_allclose(corners.max(axis=0), [0.1, 0.2, 0.35], atol=1e-9)


@pytest.mark.parametrize("content", ["", TETRAHEDRON[:900], f"<!DOCTYPE a>{TETRAHEDRON}"])
def test_collada_that_cannot_be_read(content: str) -> None:
    pytest.importorskip("collada", reason=WITHOUT_PYCOLLADA)
    with refuses(InputError, "a.dae"):
        collada_triangles(content.encode(), source="a.dae")


def with_shell(folder: Path) -> Path:
    """The humanoid, whose head is a mesh in COLLADA."""
    (folder / "head.dae").write_text(TETRAHEDRON)
    path = folder / "body.urdf"
    path.write_text(humanoid().replace('<box size="0.08 0.08 0.08"/>', '<mesh filename="package://a/head.dae"/>'))
    return path


def test_a_body_with_collada_is_imported(tmp_path: Path) -> None:
    pytest.importorskip("collada", reason=WITHOUT_PYCOLLADA)
    done = import_robot(with_shell(tmp_path), tmp_path / "new")
    assert [shape.link_name for shape in done.draft.shapes if shape.around_mesh] == ["face"]


def test_without_pycollada_one_line_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "collada", None)
    path = with_shell(tmp_path)
    with refuses(InputError, "pip install", "pycollada", "--no-meshes"):
        import_robot(path, tmp_path / "new")
