"""Bodies in pictures: the nearest is seen, and an animation shows performer and robot of a run as they move."""

import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from messages import refuses
from retarget.errors import ConfigError, UsageError
from retarget.model.body import load_body_text
from retarget.model.meshes import LEFT, MIDDLE, RIGHT, Mesh, rgb, shape_mesh, solid_body
from retarget.model.scene_shapes import ShapeKind
from retarget.model.scene_state import SceneState
from retarget.pictures import solid
from retarget.pictures.outputs import Outputs, WrittenFiles
from retarget.pictures.solid import (
    FPS,
    DrawnPostures,
    animation_path,
    gif,
    moving,
    mp4,
    pictures,
    robot_postures,
    webp,
    write_animation,
)
from retarget.report.measure import measure
from retarget.run.run_result import RunResult
from retarget.schema.scene import load_scene
from rig import scripted_run

TWO = """<mujoco><worldbody><body name="base"><freejoint/><geom type="box" size="0.1 0.2 0.3"/>
<body name="l_ball" pos="0.2 0 0"><joint/><geom type="sphere" size="0.1"/></body></body></worldbody></mujoco>"""
"""A grey box, and an orange ball before it."""


BODY = solid_body(load_body_text(TWO, source="test"), {"base": 1, "l_ball": 2})


def drawn(quat: tuple[float, ...]) -> tuple[int, int]:
    """Pixels that are orange, and those that are grey, of both in one picture. quat: how they are turned, wxyz."""
    poses = BODY.poses(np.array([[0.0, 0.0, 0.5, *quat, 0.0]]))
    picture = Image.new("RGB", (200, 200), "white")
    DrawnPostures(BODY, poses, 1.0).draw(picture, 0, place=(100.0, 180.0), scale=150.0)
    red, green, blue = np.moveaxis(np.asarray(picture).astype(int), -1, 0)
    above = np.arange(200)[:, None] < 140  # the floor has a shadow
    return int((red > 2 * blue).sum()), int(((abs(red - blue) < 12) & (green < 200) & above).sum())


def test_the_nearest_is_seen() -> None:
    orange, grey = drawn((1.0, 0.0, 0.0, 0.0))
    assert orange > 0.9 * np.pi * 15.0**2 and grey > 2000, "the ball is a circle of 15 pixels"
    hidden, more = drawn((0.0, 0.0, 0.0, 1.0))
    assert hidden < 0.35 * orange and more > grey, "turned by half, the box stands before the ball"


def test_an_open_surface_is_seen_from_both_sides_and_its_shadow_has_room() -> None:
    """A box without its near side: its far one is seen from within, and what it casts ends inside the picture."""
    box = shape_mesh(ShapeKind.BOX, (0.1, 0.2, 0.3))
    near = (box.vertices[box.faces][..., 0] > 0.0).all(axis=1)
    cut = Mesh(box.vertices, box.faces[~near])
    assert near.sum() == 2 and box.is_closed and not cut.is_closed
    pixels = []
    for mesh in (box, cut):
        alone = replace(BODY, meshes=(mesh,), owners=BODY.owners[:1], colours=BODY.colours[:1])
        postures = DrawnPostures(alone, BODY.poses(np.array([[0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0, 0.0]])), 1.0)
        picture = Image.new("RGB", (300, 200), "white")
        postures.draw(picture, 0, place=(100.0, 150.0), scale=150.0)
        pixels.append(np.asarray(picture).min(axis=2))
        right = 100 + round(150.0 * postures.shadow_end(0))
        dark = np.flatnonzero((pixels[-1] < 252).any(axis=0))
        assert right - 25 < dark.max() <= right < 300
    seen = pixels[0][:130] < 200
    assert seen.sum() > 2000 and (pixels[1][:130][seen] < 200).mean() > 0.97, "it is not seen through"


def test_bones_are_drawn_where_both_ends_are_known() -> None:
    poses = BODY.poses(np.array([[0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0]]))
    recorded = np.array([[[0.0, 0.6, 0.3], [0.0, 0.6, 0.6], [np.nan] * 3]])
    picture = Image.new("RGB", (200, 200), "white")
    bones = ((0, 1), (1, 2))
    DrawnPostures(BODY, poses, 1.0, recorded=recorded, bones=bones).draw(picture, 0, place=(100.0, 180.0), scale=150.0)
    black = np.asarray(picture).max(axis=2) < 20
    assert 40 < black.sum() < 120 and not black[:, :100].any(), "a single line of 44 pixels"


def test_sides_that_turn_to_the_light_are_brighter() -> None:
    front, side, top = solid.lit(np.eye(3), np.tile(rgb(MIDDLE), (3, 1))).mean(axis=1)
    assert top > front > side > 0.3


@pytest.fixture(scope="module")
def run() -> RunResult:
    return scripted_run()


@pytest.fixture(scope="module")
def frames(run: RunResult) -> list[Image.Image]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solid, "HEIGHT", 200)
        return list(pictures(moving(run, seconds=0.3)))


def test_performer_and_robot_stand_side_by_side_and_move(run: RunResult, frames: list[Image.Image]) -> None:
    assert [*moving(run)] == ["performer", "op3"]
    assert len(frames) == 6 and all(frame.width % 2 == frame.height % 2 == 0 for frame in frames)
    for half in np.split(
        np.array([np.asarray(frame) for frame in frames], dtype=float), [frames[0].width // 2], axis=2
    ):
        for side in (LEFT, RIGHT):
            seen = half[0] / half[0].sum(axis=2, keepdims=True)
            assert (np.abs(seen - np.array(rgb(side)) / sum(rgb(side))).max(axis=2) < 0.1).sum() > 100, side
        assert (half[0] != half[-1]).any()


def test_obstacles_are_seen_and_seen_through(run: RunResult) -> None:
    tick = run.record.following.start
    among = robot_postures(replace(run, scene=SceneState(load_scene("table"))), [tick])
    alone = robot_postures(run, [tick])
    pictures = []
    for body in (alone, among):
        picture = Image.new("RGB", (400, 300), "white")
        body.draw(picture, 0, place=(250.0, 250.0), scale=150.0)
        pictures.append(np.asarray(picture).astype(int))
    red, green, blue = np.moveaxis(pictures[1], -1, 0)
    table = (red > green + 5) & (green > blue + 5) & (red < 2 * blue)
    assert table.sum() > 5000 and table[:, :150].any(), "it is brown, and reaches beyond the robot"
    before = (pictures[0] != 255).any(axis=2) & (pictures[1] != pictures[0]).any(axis=2)
    assert before.any() and among.extent(0)[0] < alone.extent(0)[0] - 0.3


@pytest.mark.parametrize(("make", "kind"), [(webp, "WEBP"), (gif, "GIF")])
def test_an_animation_has_every_picture(
    make: Callable[[list[Image.Image], int], bytes], kind: str, frames: list[Image.Image]
) -> None:
    with Image.open(BytesIO(make(frames, len(frames)))) as image:
        assert image.format == kind and getattr(image, "n_frames", 1) == len(frames) and image.size == frames[0].size
        image.seek(len(frames) - 1)
        off = np.abs(np.asarray(image.convert("RGB")).astype(int) - np.asarray(frames[-1]))
        assert off.mean() < 3.0 and image.info["duration"] == 1000 / FPS


def test_a_webp_is_encoded_while_it_is_drawn(frames: list[Image.Image]) -> None:
    """No picture but the one that is drawn is kept, and progress is that of the file."""
    drawn = list[weakref.ref[Image.Image]]()

    def draw() -> Iterator[Image.Image]:
        for frame in frames:
            assert sum(one() is not None for one in drawn) <= 1
            picture = frame.copy()
            drawn.append(weakref.ref(picture))
            yield picture

    assert webp(draw(), len(frames)) == webp(frames, len(frames)) and len(drawn) == len(frames)


def test_a_film_has_every_picture(frames: list[Image.Image]) -> None:
    av = pytest.importorskip("av", reason="PyAV is not installed: pip install av")
    with av.open(BytesIO(mp4(frames, len(frames)))) as film:
        shown = [picture.to_image() for picture in film.decode(video=0)]
        assert len(shown) == len(frames) and shown[0].size == frames[0].size
        assert film.streams.video[0].codec_context.name == "h264" and film.streams.video[0].average_rate == FPS
    assert np.abs(np.asarray(shown[-1]).astype(int) - np.asarray(frames[-1])).mean() < 3.0


def test_what_cannot_be_written_is_refused_before_anything_runs(
    run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with refuses(UsageError, "--animate"):
        animation_path(Path("run.avi"))
    monkeypatch.setattr(solid, "find_spec", lambda name: None)
    with refuses(ConfigError, "PyAV", "pip install"):
        animation_path(Path("run.mp4"))
    assert animation_path(Path("run.WEBP")) == Path("run.WEBP")
    with refuses(UsageError, "followed"):
        write_animation(replace(run, record=run.record[:1]), tmp_path / "run.webp")
    assert not [*tmp_path.iterdir()]


def test_an_animation_reports_its_progress_and_can_be_ended(
    run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other files are there all the same, and nothing of it is."""
    monkeypatch.setattr(solid, "HEIGHT", 60)
    done = list[int]()

    @contextmanager
    def watch(what: str, total: int) -> Iterator[Callable[[int], None]]:
        def report(count: int) -> None:
            done.append(count)
            if count == ends_at:
                raise KeyboardInterrupt

        assert (what, total) == (f"writing {outputs.animate}", len(moving(run)["performer"].poses))
        yield report

    outputs = Outputs(animate=tmp_path / "run.webp", report=tmp_path / "report.json")
    ends_at = 3
    written = outputs.write(run, measure(run), progress=watch)
    assert written.problems == ("animation not written: interrupted",) and done == [1, 2, 3]
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]
    ends_at = 0
    done.clear()
    assert outputs.write(run, measure(run), progress=watch).problems == ()
    assert done == [*range(1, len(moving(run)["performer"].poses))], "with the last one the file is written"


def test_files_in_one_folder_are_one_word(tmp_path: Path) -> None:
    files = [("report", tmp_path / "report.json"), ("page", tmp_path / "report.html"), ("run", Path("run.npz"))]
    written = WrittenFiles(tuple(files), ())
    assert written.listed(every=False) == f"2 files in {tmp_path}, run.npz"
    assert written.listed(every=True) == ", ".join(str(path) for _, path in files)
