"""The page of a report: one file, nothing from elsewhere, every text escaped, and data that is the run's."""

import base64
import hashlib
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from hardware.clock import VirtualClock
from hardware.guard_state import Stop, StopCause
from retarget.model.meshes import THINNEST
from retarget.model.scene_shapes import ShapeKind
from retarget.model.scene_state import SceneState, obstacle_meshes, obstacle_poses
from retarget.pictures.animation import animation_of
from retarget.pictures.outputs import page_path, report_path
from retarget.pictures.page import FOLDER, page_html, write_page
from retarget.pictures.plots import PICTURES, figures_of
from retarget.report.findings import moments
from retarget.report.measure import measure
from retarget.report.report import Report
from retarget.rotations import conjugate, rotate
from retarget.run.loop import Operator, run_human
from retarget.run.run_result import RunResult
from retarget.schema.scene import FLOOR, load_scene
from retarget.types import FloatArray
from rig import StubReconstructor, person, result, scripted_run, short_clip

EVIL = "<script>alert(1)</script><img src=x onerror=alert(2)>\"' & $\\frac$ </title>\x1b[31m"


@pytest.fixture(scope="module", autouse=True)
def few_pictures() -> Iterator[None]:
    """Big drawings take seconds; all of them are drawn by the test of the demo."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("retarget.pictures.plots.PICTURES", {name: PICTURES[name] for name in ("balance", "poses")})
        yield


@pytest.fixture(scope="module")
def run() -> RunResult:
    return scripted_run()


@pytest.fixture(scope="module")
def report(run: RunResult) -> Report:
    return measure(run)


@pytest.fixture(scope="module")
def html(run: RunResult, report: Report) -> str:
    return page_html(run, report, figures=figures_of(run))


class Page(HTMLParser):
    """What a browser would make of it: elements with attributes, texts outside of scripts, contents of scripts."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._open.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] == "script":
            self.scripts[-1] += data
        elif not (self._open and self._open[-1] == "style"):
            self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(self.texts)


def data_of(page: Page) -> Any:
    return json.loads(page.scripts[0])


def test_nothing_comes_from_elsewhere_and_only_our_own_script_may_run(html: str) -> None:
    page = Page(html)
    for tag, attributes in page.elements:
        assert tag not in ("link", "iframe", "object", "embed", "base", "img"), tag
        for name, value in attributes.items():
            assert not name.startswith("on"), (tag, name)
            if name in ("src", "href", "xlink:href", "action", "data"):
                assert value is not None and value.startswith("#"), (tag, name, value)
    style = re.findall(r"<style>(.*?)</style>", html, re.DOTALL)
    assert style and not any("url(" in text.replace("url(#", "") or "@import" in text for text in style[:1])
    assert "fetch(" not in html and "XMLHttpRequest" not in html
    policy = next(
        attributes["content"]
        for tag, attributes in page.elements
        if tag == "meta" and attributes.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy is not None and policy.startswith("default-src 'none'")
    kinds = [attributes.get("type") for tag, attributes in page.elements if tag == "script"]
    assert kinds == ["application/json", "module"]
    digest = base64.b64encode(hashlib.sha256(page.scripts[1].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy


def test_a_hostile_name_does_nothing(run: RunResult, report: Report, html: str) -> None:
    assert run.robot is not None
    profile = run.robot.profile.model_copy(update={"name": EVIL})
    hostile = replace(run, robot=replace(run.robot, profile=profile), reason=EVIL, stop=Stop(StopCause.SOURCE, EVIL))
    tracking = {EVIL: next(iter(report.tracking_mm.values()))}
    named = replace(measure(hostile), source=EVIL, performer=EVIL, priorities=(EVIL,))
    worse = replace(named, notes=(EVIL,), tracking_mm=tracking)
    page, plain = Page(page_html(hostile, worse, figures={})), Page(html)
    assert len(page.scripts) == len(plain.scripts) == 2 and page.scripts[1] == plain.scripts[1]
    assert data_of(page)["robot"]["label"] == EVIL
    tags, usual = ([tag for tag, _ in one.elements] for one in (page, plain))
    assert set(tags) - set(usual) <= {"ul", "li"} and "img" not in tags  # notes are a list that was not there
    assert not any(name.startswith("on") for _, attributes in page.elements for name in attributes)
    assert page.text.count("<script>alert(1)</script>") >= 5
    assert r"\x1b[31m" in page.text and "\x1b" not in page.text


def test_drawings_are_well_formed_with_ids_of_their_own_and_numbers_are_the_reports(html: str, report: Report) -> None:
    drawings = re.findall(r'<svg viewBox="[^"]*" role="img".*?</svg>', html, re.DOTALL)
    assert len(drawings) == 1  # postures are drawn by the player
    for drawing in drawings:
        ElementTree.fromstring(drawing.replace("<svg ", '<svg xmlns:xlink="x" ', 1))
        used = set(re.findall(r'(?:xlink:href="#|url\(#)([^")]+)', drawing))
        assert used <= set(re.findall(r'\bid="([^"]+)"', drawing))
    ids = re.findall(r'\bid="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    page = Page(html)
    shown = next(text for text in page.texts if '"tracking_mm"' in text)
    assert json.loads(shown) == json.loads(report.as_json())
    assert f"{report.tracking_mm['l_hand'].max:.1f}" in page.texts


def unpacked(track: str, *shape: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.frombuffer(base64.b64decode(track), dtype="<f4").astype(float).reshape(shape)


def test_the_player_shows_what_was_sent(html: str, run: RunResult) -> None:
    data, robot, sent = data_of(Page(html)), run.robot, run.record.robot
    assert robot is not None and sent is not None
    rows = np.arange(0, len(run.record), data["every"])
    figure, poses = data["robot"], robot.solid.poses(sent.q[rows])
    assert {mesh["link"] for mesh in figure["body"]["meshes"]} == set(range(poses.shape[1]))
    numbers = np.frombuffer(base64.b64decode(figure["poses"]["numbers"]), dtype="<i2").reshape(poses.shape)
    place = numbers[..., :3] * figure["poses"]["step"]
    place[..., :2] += unpacked(figure["centre"], len(rows), 1, 2)
    np.testing.assert_allclose(place, poses[..., :3], atol=1e-3)
    turn = numbers[..., 3:] / np.linalg.norm(numbers[..., 3:], axis=-1, keepdims=True)
    off = 2.0 * np.arccos(np.minimum(np.abs(np.sum(turn * poses[..., 3:], axis=-1)), 1.0))
    assert np.rad2deg(off).max() < 0.2
    marks = unpacked(figure["marks"], len(rows), -1, 3)
    np.testing.assert_allclose(marks, sent.landmarks_asked[rows], atol=1e-4)
    np.testing.assert_allclose(np.array(data["time"]) / 1e3, run.record.time[rows], atol=1e-3)
    assert len(data["phase"]) == len(data["gated"]) == len(rows) and set(data["phase"]) <= {"a", "f", "b"}
    com = unpacked(data["ground"]["com"], len(rows), 3)
    np.testing.assert_allclose(com, robot.body.solver_body().centre_of_mass(sent.q[rows]), atol=1e-4)
    corners = unpacked(data["ground"]["corners"], len(rows), sum(data["ground"]["sizes"]), 3)
    assert np.abs(corners[..., 2]).max() < 0.01
    tracks = len(json.dumps(data)) - sum(len(json.dumps(data[name]["body"])) for name in ("performer", "robot"))
    assert tracks < 1700 * len(rows)  # bytes: a page of the most rows stays below 6 MB


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not there")
def test_the_script_is_a_valid_module(html: str) -> None:
    command = ["node", "--check", "--input-type=module", "-"]
    checked = subprocess.run(command, input=Page(html).scripts[1], text=True, capture_output=True, check=False)
    assert checked.returncode == 0, checked.stderr


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not there")
def test_a_camera_sees_left_on_the_right_of_who_faces_it_and_a_headset_sees_x_ahead() -> None:
    script = (
        (FOLDER / "bodies.js").read_text(encoding="utf-8")
        + """
        const [view, projection] = orbit(0, 0.2, 3, [1, 2, 0.5], 1.5);
        const seen = (m, p) => [0, 1, 2, 3].map((i) => m[i] * p[0] + m[4 + i] * p[1] + m[8 + i] * p[2] + m[12 + i]);
        const shown = [[1, 2, 0.5], [1, 2.1, 0.5], [1, 2, 0.6]].map((p) => seen(multiply(projection, view), p));
        const axes = [[1, 0, 0], [0, 1, 0]].map((axis) => seen(TO_WEBXR, axis));
        console.log(JSON.stringify([...shown, ...axes, grid(1, 2, 0.4, 0).length]));
    """
    )
    done = subprocess.run(
        ["node", "--input-type=module", "-"], input=script, text=True, capture_output=True, check=True
    )
    middle, left, above, ahead, sideways, numbers = json.loads(done.stdout)
    assert middle[:2] == pytest.approx([0.0, 0.0], abs=1e-6) and middle[3] == pytest.approx(3.0, abs=1e-6)
    assert left[0] > 0.0 and abs(left[1]) < 1e-6 and above[1] > 0.0 and abs(above[0]) < 1e-6
    assert ahead[:3] == [0, 0, -1] and sideways[:3] == [-1, 0, 0]
    assert numbers == 6 * 2 * 5


CHROMIUM = shutil.which("chromium")


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not there")
def test_a_browser_draws_the_bodies_or_says_why_not(html: str, tmp_path: Path) -> None:
    page, picture = tmp_path / "report.html", tmp_path / "seen.png"
    page.write_text(html, encoding="utf-8")

    def browse(*options: str) -> str:
        command = [str(CHROMIUM), "--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1160,2600"]
        command += [f"--user-data-dir={tmp_path / 'browser'}", "--virtual-time-budget=4000", *options, page.as_uri()]
        return subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=True).stdout

    assert "WebGL 2" in Page(browse("--disable-3d-apis", "--dump-dom")).text
    text = Page(browse("--dump-dom")).text
    assert "grid 20 cm" in text and "inside" in text and "WebGL 2" not in text
    browse(f"--screenshot={picture}")
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    red, green, blue = np.moveaxis(pixels, -1, 0)
    assert ((red > 1.5 * green) & (green > 2 * blue) & (red > 120)).sum() > 2000  # left, orange
    assert ((blue > 1.3 * green) & (green > 5 * red) & (blue > 90)).sum() > 2000  # right


def test_what_stopped_it_and_when(run: RunResult, report: Report) -> None:
    stop = Stop(StopCause.VOLTAGE, "9.1 V", powered=True, then=StopCause.BUS)
    stopped = replace(run, reason="the supply is low", stop=stop)
    (moment,) = moments(stopped)
    braking = run.record.time[run.record.following.stop]
    assert moment.time == braking and moment.text == "the supply is low"
    page = Page(page_html(stopped, replace(report, stop=replace(report.stop, reason="the supply is low")), figures={}))
    assert f"Stopped at {braking:.2f} s" in page.texts and "bus" in page.text and "torque is off" in page.text
    assert any(attributes.get("data-time") == f"{1e3 * braking:.0f}" for _, attributes in page.elements)
    assert "✗ fail" in page.texts and any(text.endswith(": the supply is low") for text in page.texts)
    assert data_of(page)["moments"] == [round(1e3 * braking)]


def test_a_human_alone(tmp_path: Path) -> None:
    human, clip = person(), short_clip(rate_hz=None)
    alone = result(run_human(clip, StubReconstructor(human), Operator(), VirtualClock()), clip, human, None)
    write_page(alone, measure(alone), tmp_path / "report.html", figures={})
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    data = data_of(page)
    assert data["robot"] is None and data["ground"] is None
    assert "view-performer" in {attributes.get("id") for _, attributes in page.elements}
    assert [entry.name for entry in tmp_path.iterdir()] == ["report.html"]


def test_a_run_that_followed_nothing_has_a_page_without_motion(run: RunResult, report: Report) -> None:
    ticks = int(run.record.following.start)
    early = replace(run, record=run.record[:ticks], reason="a servo is silent")
    assert animation_of(early) is None
    page = Page(page_html(early, measure(early), figures={}))
    assert not page.scripts and "a servo is silent" in page.text


def test_where_a_page_goes(tmp_path: Path) -> None:
    assert page_path(tmp_path / "r.json") is None
    for name in ("new", "run.2026", "a/b", "walk.bvh", "v1.2"):
        assert page_path(tmp_path / name) == tmp_path / name / "report.html"
        assert report_path(tmp_path / name) == tmp_path / name / "report.json"
    assert list(tmp_path.iterdir()) == []


# Obstacles on the page: their meshes are on their shapes, where the scene has them at that time.


@pytest.mark.parametrize("name", ["table", "wall", "gantry", "door_frame", "crossing_ball"])
def test_every_corner_is_on_the_surface_of_an_obstacle(name: str) -> None:
    state = SceneState(load_scene(name))
    meshes = obstacle_meshes(state.shapes)
    assert len(meshes) == sum(one != FLOOR for one in state.shapes.names)
    for time in (0.0, 0.7, 1.4):
        at = state.at_rest(time)
        for mesh, pose in zip(meshes, obstacle_poses(state.shapes, at), strict=True):
            corners = mesh.placed(pose[:3], pose[3:]).vertices[::7]
            for corner in corners:
                off = [_off(state, at.position, at.quat, one, corner) for one in range(len(at.position))]
                assert min(off) < 1e-3


def _off(state: SceneState, position: FloatArray, quat: FloatArray, at: int, point: FloatArray) -> float:
    """Distance, m, of a point from the surface of an obstacle, written out for each shape."""
    local, size = rotate(conjugate(quat[at]), point - position[at]), state.shapes.sizes[at]
    kind = state.shapes.kinds[at]
    if kind == ShapeKind.BOX:
        return float(np.abs(np.abs(local) - size).max())  # a corner
    if kind == ShapeKind.CAPSULE:
        beyond = max(abs(float(local[2])) - float(size[1]), 0.0)
        return abs(float(np.hypot(np.hypot(local[0], local[1]), beyond)) - float(size[0]))
    if kind == ShapeKind.CYLINDER:
        return abs(abs(float(local[2])) - float(size[1]))  # the rims, and the middles of both ends
    return abs(float(local[2])) - THINNEST  # a half-space: a piece of its surface


def test_what_moves_has_a_row_for_each_time_and_what_does_not_has_one(run: RunResult) -> None:
    later = replace(run, record=replace(run.record, time=run.record.time + 2.0))  # the ball has begun to move
    for name, rows in (("crossing_ball", None), ("table", 1)):
        data = animation_of(replace(later, scene=SceneState(load_scene(name))))
        assert data is not None and data["robot"]["scene"]["rows"] == (rows or len(data["time"]))
        assert "scene" in data["robot"]["layers"] and "scene" not in data["performer"]
