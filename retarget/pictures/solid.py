"""Bodies as solids in pictures, still and moving, with the light of the pages (`bodies.js`)."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

from retarget import rotations
from retarget.errors import ConfigError, UsageError, install_step
from retarget.model.human_dimensions import PARENTS, POINTS
from retarget.model.meshes import OBSTACLE, Mesh, SolidBody, rgb
from retarget.model.scene_state import obstacle_meshes, obstacle_poses
from retarget.report import motion_metrics
from retarget.report.tracking import performer_facing, turned
from retarget.run.run_result import RunResult
from retarget.schema.files import write_atomic
from retarget.types import FloatArray, IntArray, ShowProgress, no_progress

# Viewer and light, as in `bodies.js`.

AZIMUTH, ELEVATION = np.deg2rad(35.0), np.deg2rad(12.0)
"""Direction of the viewer, rad: about the vertical from the heading of the body, and above the horizon."""
TO_VIEWER = np.array([np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
LIGHT = np.array([0.47, -0.1, 0.877])
FLOOR_LIGHT, SKY_LIGHT, SUN = np.array([0.66, 0.64, 0.63]), np.array([0.80, 0.81, 0.83]), 0.27
"""Light from below (RGB), from above (RGB), and of surfaces that face LIGHT."""


def project(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Parallel projection of points (..., 3): right and up in the picture, and nearness to the viewer, (...) each."""
    across = -np.sin(AZIMUTH) * points[..., 0] + np.cos(AZIMUTH) * points[..., 1]
    before = np.cos(AZIMUTH) * points[..., 0] + np.sin(AZIMUTH) * points[..., 1]
    up = points[..., 2] * np.cos(ELEVATION) - before * np.sin(ELEVATION)
    return across, up, before * np.cos(ELEVATION) + points[..., 2] * np.sin(ELEVATION)


def lit(outward: FloatArray, colour: FloatArray) -> FloatArray:
    """Return lit colours (v, 3) of points with normals outward (v, 3) and own colours (v, 3)."""
    facing = np.abs(outward @ TO_VIEWER)[:, None]
    light = FLOOR_LIGHT + (SKY_LIGHT - FLOOR_LIGHT) * (0.5 + 0.5 * outward[:, 2:])
    light = light + SUN * np.maximum(outward @ LIGHT, 0.0)[:, None]
    return np.asarray(np.minimum(colour * light * (0.80 + 0.24 * facing) + 0.10 * facing**24, 1.0))


# A body in some postures, in the picture.

Bone = tuple[str, str]
"""Two points that a line joins."""
HUMAN_BONES: tuple[Bone, ...] = tuple(
    (POINTS[parent], name) for name, parent in zip(POINTS, PARENTS, strict=True) if parent >= 0
)
"""Bones of the human: each joint with its parent."""
# Lengths are in heights of the body, if no unit is given.
THIN, MARGIN = 0.010, 0.03
"""Thickness of a recorded bone, and room beside a body."""
NEAR = 1.5
"""Obstacles beyond this distance get no room in a picture."""
BLUR, SHADOW_PX, DARK = 0.036, 160, 52
"""Blur of a shadow, its resolution in pixels, and its darkness of 255."""
FADED, FARTHEST = 3.0, 4.0
"""Distance at which a shadow has faded, in units of BLUR, and half the side of the floor with shadows."""
PITCH, MARKS, MARK, GOES = 0.25, 2, 0.012, 0.3
"""Pitch, number to each side and radius of marks on the floor, if a body travels farther than GOES."""
COARSE = 4
"""Pixels of a picture per pixel of a shadow, which is blurred anyway."""


@dataclass(frozen=True, eq=False)
class DrawnPostures:
    """A body in p postures that face x, with the feet at the origin, in heights of the body.

    poses (p, k, 7): of links. size: height, m. soles: outlines (p, c, 3). recorded (p, e, 3): points of the recorded
    body, joined by `bones`. around: the body with its translucent obstacles. marks (p, m, 3): on the floor.
    """

    solid: SolidBody
    poses: FloatArray
    size: float
    soles: tuple[FloatArray, ...] = ()
    recorded: FloatArray | None = None
    bones: tuple[tuple[int, int], ...] = ()
    around: "DrawnPostures | None" = None
    marks: FloatArray | None = None

    @cached_property
    def _surface(self) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
        """Vertices (v, 3) in link frames, normals (v, 3), owners (v,) and faces (f, 3). Open meshes have two sides."""
        known = [(number, mesh) for number, mesh in enumerate(self.solid.meshes)]
        known += [(number, Mesh(mesh.vertices, mesh.faces[:, ::-1])) for number, mesh in known if not mesh.is_closed]
        numbers, meshes = zip(*known, strict=True)
        vertices = np.concatenate([mesh.vertices for mesh in meshes]) / self.size
        owner = np.repeat(numbers, [len(mesh.vertices) for mesh in meshes])
        first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        faces = np.concatenate([mesh.faces + begin for mesh, begin in zip(meshes, first[:-1], strict=True)])
        across = np.cross(*(vertices[faces[:, corner]] - vertices[faces[:, 0]] for corner in (1, 2)))
        outward = np.zeros_like(vertices)
        for corner in range(3):
            np.add.at(outward, faces[:, corner], across)
        return vertices, outward / np.maximum(np.linalg.norm(outward, axis=1)[:, None], 1e-12), owner, faces

    def points(self, pose: int) -> FloatArray:
        """Vertices of the surface (v, 3) in one posture."""
        vertices, _, owner, _ = self._surface
        poses = self.poses[pose, self.solid.owners[owner]]
        return np.asarray(poses[:, :3] + rotations.rotate(poses[:, 3:], vertices))

    def extent(self, pose: int) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of one posture in the picture, without its shadow."""
        shown = [self.points(pose), *(sole[pose] for sole in self.soles)]
        if self.recorded is not None:
            shown.append(self.recorded[pose])
        if self.around is not None:
            points = self.around.points(pose)
            shown.append(points[np.abs(points).max(axis=1) < NEAR])
        across, up, _ = project(np.concatenate(shown))
        low, high = np.nanmin([across, up], axis=1) - MARGIN, np.nanmax([across, up], axis=1) + MARGIN
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])

    def shadow_end(self, pose: int) -> float:
        """Right end of the shadow of one posture in the picture."""
        across, _, _ = project(np.pad(_fallen(self.points(pose)), ((0, 0), (0, 1))))
        return float(across.max()) + FADED * BLUR

    def draw_floor(self, picture: Image.Image, pose: int, *, place: tuple[float, float], scale: float) -> None:
        """Draw the marks on the floor of one posture. place, scale: see `draw`."""
        if self.marks is not None:
            across, up, _ = project(self.marks[pose])
            pen, radius = ImageDraw.Draw(picture), MARK * scale
            for x, y in zip((place[0] + scale * across).tolist(), (place[1] - scale * up).tolist(), strict=True):
                pen.ellipse((x - radius, y - 0.5 * radius, x + radius, y + 0.5 * radius), "#c0c0c0")

    def draw(self, picture: Image.Image, pose: int, *, place: tuple[float, float], scale: float) -> None:
        """Draw one posture with its origin at `place`, pixels across and down. scale: pixels per height."""
        _, outward, owner, faces = self._surface
        points, pen = self.points(pose), ImageDraw.Draw(picture)
        whole = None if self.around is None else picture.copy()
        if self.around is not None and whole is not None:
            self.around.draw(whole, pose, place=place, scale=scale)

        def pixels(points: FloatArray) -> tuple[FloatArray, FloatArray]:
            across, up, near = project(points)
            return np.stack([place[0] + scale * across, place[1] - scale * up], axis=-1), near

        _cast(picture, points[faces], place, scale)
        for sole in self.soles:
            pen.polygon(pixels(sole[pose])[0].ravel().tolist(), outline="#a0a0a0", width=max(1, round(0.004 * scale)))
        turns = self.poses[pose, self.solid.owners[owner], 3:]
        shades = lit(rotations.rotate(turns, outward), self.solid.colours[owner])
        _fill(picture, *pixels(points), shades, faces)
        if self.recorded is not None:
            ends, _ = pixels(self.recorded[pose])
            for bone in self.bones:
                if np.isfinite(ends[[*bone]]).all():  # a file that knows only some of the joints
                    pen.line(ends[[*bone]].ravel().tolist(), "black", max(1, round(THIN * scale)))
        if whole is not None:
            picture.paste(Image.blend(picture, whole, 0.5))


def _fallen(points: FloatArray) -> FloatArray:
    """Shadows (..., 2) of points (..., 3) on the floor."""
    return np.asarray(points[..., :2] - points[..., 2:] * LIGHT[:2] / LIGHT[2])


def _cast(picture: Image.Image, corners: FloatArray, place: tuple[float, float], scale: float) -> None:
    """Darken the floor by the blurred shadow of faces (f, 3, 3)."""
    fallen = _fallen(corners)
    fallen = fallen[_areas(fallen) > 0.0]  # faces that face the light cast the whole shadow
    floor = min(float(np.abs(fallen).max(initial=0.0)) + FADED * BLUR, FARTHEST)  # half its side
    to_px = 0.5 * SHADOW_PX / floor
    dark = np.zeros(SHADOW_PX * SHADOW_PX, dtype=np.uint8)
    spans = _spans(to_px * (floor + fallen), (SHADOW_PX, SHADOW_PX))
    dark[_pixels(spans.line * SHADOW_PX + spans.begin, spans.count)] = DARK
    mask = Image.fromarray(dark.reshape(SHADOW_PX, SHADOW_PX)).filter(ImageFilter.GaussianBlur(BLUR * to_px))
    # The affine map from every COARSE-th pixel of the picture to the floor.
    across, up, _ = project(np.eye(2, 3))
    half = COARSE * np.ceil(scale * floor * np.abs([across, up]).sum(axis=1) / COARSE).astype(int)
    low = np.round(place).astype(int) - half
    back = np.linalg.inv(scale * np.array([across, -up])) * to_px
    begin = back @ (low - np.array(place)) + 0.5 * SHADOW_PX
    lies = [value for row, first in zip(back, begin, strict=True) for value in (*(COARSE * row), float(first))]
    size = (2 * int(half[0]), 2 * int(half[1]))
    coarse = (size[0] // COARSE, size[1] // COARSE)
    seen = mask.transform(coarse, Image.Transform.AFFINE, lies, Image.Resampling.BILINEAR)
    picture.paste("black", (int(low[0]), int(low[1])), seen.resize(size, Image.Resampling.BILINEAR))


@dataclass(frozen=True, eq=False)
class _Spans:
    """Horizontal spans of pixels, (n,) each. face: index of the face; line: of the picture; begin, count: pixels."""

    face: IntArray
    line: IntArray
    begin: IntArray
    count: IntArray


def _spans(corners: FloatArray, size: tuple[int, int]) -> _Spans:
    """Spans of the pixels of a picture (across, down) whose middle is inside of faces, corners (f, 3, 2) in pixels."""
    order = np.argsort(corners[..., 1], axis=1)
    x, y = (np.take_along_axis(corners[..., axis], order, axis=1) for axis in (0, 1))
    first, after = (np.clip(np.ceil(y[:, end]), 0, size[1]).astype(np.int64) for end in (0, 2))
    count = after - first
    face = np.repeat(np.arange(len(count)), count)
    line = _pixels(first, count)
    # Each line crosses the side from the highest to the lowest corner, and one of the other two sides.
    starts, ends = (0, 0, 1), (2, 1, 2)
    down = y[:, ends] - y[:, starts]
    slope = (x[:, ends] - x[:, starts]) / np.where(down > 0.0, down, 1.0)
    zero = x[:, starts] - y[:, starts] * slope
    other = 3 * face + np.where(line < y[face, 1], 1, 2)
    one = zero[face, 0] + line * slope[face, 0]
    two = zero.ravel()[other] + line * slope.ravel()[other]
    begin, end = (np.clip(np.ceil(edge(one, two)), 0, size[0]).astype(np.int64) for edge in (np.minimum, np.maximum))
    known = end > begin
    return _Spans(face[known], line[known], begin[known], (end - begin)[known])


def _pixels(begin: IntArray, count: IntArray) -> IntArray:
    """Concatenate the ranges of `count` numbers from each `begin` (n,) on."""
    return np.asarray(np.arange(count.sum()) + np.repeat(begin - (np.cumsum(count) - count), count))


def _fill(picture: Image.Image, corners: FloatArray, near: FloatArray, shades: FloatArray, faces: IntArray) -> None:
    """Paint the faces (f, 3) of a surface with a depth buffer. corners (v, 2): pixels. near (v,) and shades (v, 3), 0
    to 1, are interpolated linearly over a face."""
    areas = _areas(corners[faces])
    faces, areas = faces[areas < 0.0], areas[areas < 0.0]  # faces towards the viewer: pixels count downwards
    box = np.concatenate([np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0)) + 1.0])
    box = np.clip(box, 0, 2 * picture.size).astype(int)
    corners, (wide, high) = corners - box[:2], (box[2:] - box[:2]).tolist()
    spans = _spans(corners[faces], (wide, high))
    # Nearness and shade of a face: values at its first corner, and changes per pixel across and down.
    at, values = corners[faces[:, 0]], np.column_stack([near, 255.0 * shades])
    (ax, ay), (bx, by) = (corners[faces[:, 1]] - at).T, (corners[faces[:, 2]] - at).T
    first, one, two = (values[faces[:, corner]] for corner in range(3))
    one, two = (one - first) / areas[:, None], (two - first) / areas[:, None]
    across, down = by[:, None] * one - ay[:, None] * two, ax[:, None] * two - bx[:, None] * one
    across, down = across.astype(np.float32), down.astype(np.float32)
    begin = spans.begin[:, None] - at[spans.face, :1], spans.line[:, None] - at[spans.face, 1:]
    step = across.take(spans.face, axis=0)
    value = (first[spans.face] + begin[0] * step + begin[1] * down.take(spans.face, axis=0)).astype(np.float32)
    # The nearest face in each pixel.
    before = np.cumsum(spans.count) - spans.count
    count = np.arange(spans.count.sum(), dtype=np.int32)
    further = count - np.repeat(before.astype(np.int32), spans.count)
    pixel = further + np.repeat((spans.line * wide + spans.begin).astype(np.int32), spans.count)
    depth = np.repeat(step[:, 0], spans.count)
    depth *= further
    depth += np.repeat(value[:, 0], spans.count)
    nearest = np.full(wide * high, -np.inf, dtype=np.float32)
    np.maximum.at(nearest, pixel, depth)
    seen = np.flatnonzero(depth == nearest[pixel])
    span = np.repeat(np.arange(len(before), dtype=np.int32), spans.count)[seen]
    shade = step[:, 1:].take(span, axis=0)
    shade *= further[seen, None].astype(np.float32)
    shade += value[:, 1:].take(span, axis=0)
    painted = np.array(picture.crop(tuple(box.tolist()))).reshape(-1, 3)
    painted[pixel[seen]] = np.clip(shade, 0.0, 255.0, out=shade)
    picture.paste(Image.fromarray(painted.reshape(high, wide, 3)), tuple(box[:2].tolist()))


def _areas(corners: FloatArray) -> FloatArray:
    """Twice the signed areas (f,) of faces (f, 3, 2), positive if the corners turn from the first axis to the
    second."""
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    return np.asarray(ax * by - bx * ay)


def performer_postures(run: RunResult, ticks: Sequence[int]) -> DrawnPostures:
    """The reconstructed human, rotated to face x, in ticks of a run; with the recorded body for a human alone."""
    record, truth = run.record, run.human_truth
    facing = performer_facing(run)[np.array(ticks) - run.record.following.start]
    points = turned(record.human_joints[ticks], facing)
    feet, size = feet_of(points, record.human_joint_names), _size(points, record.human_joint_names)
    poses = facing_x(run.human.solid.poses(record.human_q[ticks]), facing)
    recorded: FloatArray | None = None
    bones: tuple[tuple[int, int], ...] = ()
    if truth is not None and run.robot is None:
        recorded = (turned(truth[ticks], facing) - feet) / size
        bones = tuple((record.human_joint_names.index(a), record.human_joint_names.index(b)) for a, b in HUMAN_BONES)
    marks = _marks(feet / size, facing)
    drawn = DrawnPostures(
        run.human.solid, _standing(poses, feet, size), size, recorded=recorded, bones=bones, marks=marks
    )
    return drawn if run.robot is not None else _among(drawn, run, ticks, feet, facing)


def robot_postures(run: RunResult, ticks: Sequence[int]) -> DrawnPostures:
    """The robot as it moved, with its soles: the simulated body, or the sent posture without physics."""
    robot, moved = run.robot, run.seen_q
    assert robot is not None and moved is not None
    names = tuple(robot.profile.frames)
    q = np.ascontiguousarray(moved[ticks])
    points = robot.points(q, names)
    feet, size = feet_of(points, names), _size(points, names)
    soles = tuple((sole - feet) / size for sole in motion_metrics.standing_of(robot, q).soles)
    facing = np.array([[1.0, 0.0]])
    marks = _marks(feet / size, facing)
    drawn = DrawnPostures(robot.solid, _standing(robot.solid.poses(q), feet, size), size, soles, marks=marks)
    return _among(drawn, run, ticks, feet, facing)


def obstacles(run: RunResult, rows: Sequence[int] | IntArray) -> tuple[list[Mesh], FloatArray] | None:
    """Return meshes of the obstacles, and their poses (T, o, 7), m and wxyz, at ticks `rows`, (1, o, 7) if none moves;
    None without obstacles."""
    scene = run.scene
    if scene is None or not (meshes := obstacle_meshes(scene.shapes)):
        return None
    times = np.maximum(run.record.time[rows], 0.0).tolist()
    poses = np.array([obstacle_poses(scene.shapes, scene.at_rest(time)) for time in times])
    return meshes, poses if np.ptp(poses, axis=0).max() > 0.0 else poses[:1]


def _among(
    drawn: DrawnPostures, run: RunResult, ticks: Sequence[int], feet: FloatArray, facing: FloatArray
) -> DrawnPostures:
    """Add the obstacles of a run to a body. facing (p or 1, 2): heading of the body in their world."""
    seen = obstacles(run, ticks)
    if seen is None:
        return drawn
    meshes, poses = seen[0], np.broadcast_to(seen[1], (len(ticks), *seen[1].shape[1:]))
    solid, colours = drawn.solid, np.tile(rgb(OBSTACLE), (len(meshes), 1))
    owners = np.append(solid.owners, drawn.poses.shape[1] + np.arange(len(meshes)))
    colours = np.vstack([solid.colours, colours])
    both = replace(solid, meshes=(*solid.meshes, *meshes), owners=owners, colours=colours)
    poses = np.concatenate([drawn.poses, _standing(facing_x(poses, facing), feet, drawn.size)], axis=1)
    return replace(drawn, around=DrawnPostures(both, poses, drawn.size))


def facing_x(poses: FloatArray, heading: FloatArray) -> FloatArray:
    """Rotate poses (T, m, 7) about the vertical so that a body with `heading` (T or 1, 2) faces x."""
    half = -0.5 * np.arctan2(heading[:, 1], heading[:, 0])
    turn = np.column_stack([np.cos(half), np.zeros((len(half), 2)), np.sin(half)])[:, None]
    return np.concatenate([turned(poses[..., :3], heading), rotations.multiply(turn, poses[..., 3:])], axis=-1)


def _standing(poses: FloatArray, feet: FloatArray, size: float) -> FloatArray:
    """Poses (p, m, 7) with the feet (p, 1, 3) at the origin, in heights."""
    return np.concatenate([(poses[..., :3] - feet) / size, poses[..., 3:]], axis=-1)


def feet_of(points: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """Place (p, 1, 3) of each posture: on the ground between the feet."""
    feet = [names.index(name) for name in ("l_ankle", "r_ankle") if name in names] or [0]
    centre = points[:, feet].mean(axis=1, keepdims=True)
    centre[..., 2] = 0.0
    return np.asarray(centre)


def _marks(feet: FloatArray, facing: FloatArray) -> FloatArray | None:
    """Marks (p, m, 3) of the floor, relative to feet (p, 1, 3), for a heading (p or 1, 2); None if the body stays."""
    if np.ptp(feet, axis=0).max() < GOES:
        return None
    ahead = np.arange(-MARKS, MARKS + 1.0)
    grid = np.stack([*np.meshgrid(ahead, ahead), np.zeros((len(ahead), len(ahead)))], axis=-1).reshape(-1, 3)
    back = facing * np.array([1.0, -1.0])
    marks = PITCH * (np.round(turned(feet, back) / PITCH) + grid)
    return np.asarray(turned(marks, facing) - feet)


def _size(points: FloatArray, names: tuple[str, ...]) -> float:
    """Greatest height of the head, m, or of any point of a body without head."""
    heights = points[:, names.index("head"), 2] if "head" in names else points[..., 2]
    return max(float(np.nanmax(heights)), 1e-3)


# Bodies side by side, moving.

FPS = 20
"""Frame rate of an animation, 1/s."""
LONGEST_S = 60.0
"""Longest animation, s, since larger files are hard to share."""
HEIGHT = 540
"""Height of an animation, about, pixels."""
GAP, TITLE = 0.05, 0.12
"""Room between bodies, and above them, in heights."""
SHARPER = 2
"""Pixels drawn per pixel shown."""
QUALITY = 80
"""Quality of WebP, percent."""


def moving(run: RunResult, *, seconds: float = LONGEST_S) -> dict[str, DrawnPostures]:
    """Return performer and robot, by title, at FPS while the run followed, for at most `seconds`."""
    following = run.record.following
    time = run.record.time[following]
    instants = np.arange(time[0], min(time[-1], time[0] + seconds), 1.0 / FPS)
    ticks = (following.start + np.searchsorted(time, instants - 1e-9)).tolist()
    shown = {"performer": performer_postures(run, ticks)}
    return shown if run.robot is None else shown | {run.robot.profile.name: robot_postures(run, ticks)}


def pictures(shown: Mapping[str, DrawnPostures], *, width: int | None = None) -> Iterator[Image.Image]:
    """Draw one picture per instant, with all bodies side by side on one floor. width: pixels, None for HEIGHT."""
    count = min(len(body.poses) for body in shown.values())
    extents = np.array([[body.extent(pose) for pose in range(count)] for body in shown.values()])
    left, right = extents[..., 0].min(axis=1), extents[..., 1].max(axis=1)
    ends = np.cumsum(right - left + GAP)
    places = ends - right
    floor, top = float(extents[..., 2].min()), float(extents[..., 3].max()) + TITLE
    shadows = [max(body.shadow_end(pose) for pose in range(count)) for body in shown.values()]
    end = max(float(ends[-1]), *(places + shadows).tolist())
    across = width or HEIGHT * end / (top - floor)
    scale = across / end  # pixels per height
    size = [2 * round(0.5 * pixels) for pixels in (across, scale * (top - floor))]  # H.264 needs even sizes
    for pose in range(count):
        picture = Image.new("RGB", (SHARPER * size[0], SHARPER * size[1]), "white")
        pen = ImageDraw.Draw(picture)
        at = [(place, SHARPER * scale * top) for place in (SHARPER * scale * places).tolist()]
        for body, place in zip(shown.values(), at, strict=True):
            body.draw_floor(picture, pose, place=place, scale=SHARPER * scale)
        for (title, body), place in zip(shown.items(), at, strict=True):
            pen.text((place[0], 0.0), title, "#555555", anchor="ma", font_size=0.55 * TITLE * SHARPER * scale)
            body.draw(picture, pose, place=place, scale=SHARPER * scale)
        yield picture.reduce(SHARPER)


def webp(frames: Iterable[Image.Image], count: int, *, quality: int = QUALITY) -> bytes:
    """Encode `count` pictures as an endless animated WebP."""
    return _film("webp", frames, count, quality=quality, method=4)


def gif(frames: Iterable[Image.Image], count: int) -> bytes:
    """Encode `count` pictures as an endless GIF with the palette of the first."""
    rest = iter(frames)
    first = next(rest).quantize(255, dither=Image.Dither.NONE)
    palette, ground = first.getpalette() or [], int(np.asarray(first)[0, 0])
    palette[3 * ground : 3 * ground + 3] = (255, 255, 255)  # nearly, with the shadows in its group of colours
    first.putpalette(palette)
    rest = (one.quantize(palette=first, dither=Image.Dither.NONE) for one in rest)
    return _film("gif", chain([first], rest), count)


class _Reel(Image.Image):
    """An image of several frames for Pillow's encoder. Each is made when it is sought, since all take gigabytes."""

    def __init__(self, frames: Iterable[Image.Image], count: int) -> None:
        super().__init__()
        self.n_frames, self._at, self._frames = count, -1, iter(frames)
        self.seek(0)

    def tell(self) -> int:
        return self._at

    def seek(self, frame: int) -> None:
        """Advance to a picture. Earlier ones are gone. Raises EOFError after the last."""
        if frame >= self.n_frames:
            raise EOFError
        while self._at < frame:
            one = next(self._frames)
            self._at, self.im, self._mode, self._size = self._at + 1, one.im, one.mode, one.size
            self.palette = one.palette


def _film(kind: str, frames: Iterable[Image.Image], count: int, **how: Any) -> bytes:
    made = BytesIO()
    _Reel(frames, count).save(made, kind, save_all=True, duration=1000 // FPS, loop=0, **how)
    return made.getvalue()


def mp4(frames: Iterable[Image.Image], count: int) -> bytes:
    """Encode `count` pictures as H.264, which every browser and phone plays."""
    import av

    rest, made = iter(frames), BytesIO()
    first = next(rest)
    with av.open(made, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=FPS, options={"crf": "20"})
        stream.pix_fmt, (stream.width, stream.height) = "yuv420p", first.size
        for frame in chain([first], rest):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.asarray(frame), format="rgb24")))
        container.mux(stream.encode())
    return made.getvalue()


KINDS: dict[str, Callable[[Iterable[Image.Image], int], bytes]] = {".webp": webp, ".gif": gif, ".mp4": mp4}
"""Suffix of a file -> encoder of pictures."""


def animation_path(path: Path) -> Path:
    """The path if its kind can be written. Raises UsageError for an unknown kind, and ConfigError without its
    encoder."""
    if path.suffix.lower() not in KINDS:
        raise UsageError("unknown kind of animation", where="--animate", found=str(path), allowed=", ".join(KINDS))
    if path.suffix.lower() == ".mp4" and find_spec("av") is None:
        step = f"{install_step('av')}; or write a .webp"
        raise ConfigError("an MP4 needs PyAV", where="--animate", found=str(path), next_step=step)
    return path


def write_animation(run: RunResult, path: Path, *, progress: ShowProgress = no_progress) -> None:
    """Write an animation of performer and robot, of at most LONGEST_S. progress: shows it. Raises UsageError if the
    file cannot be written, or if nothing was followed."""
    if run.ticks_followed < 2:
        raise UsageError("no tick followed, and an animation shows what followed", where="--animate")
    shown = moving(run)
    count = len(shown["performer"].poses)
    with progress(f"writing {path}", count) as made:

        def counted() -> Iterator[Image.Image]:
            for number, frame in enumerate(pictures(shown), 1):
                yield frame
                made(number)

        content = KINDS[path.suffix.lower()](counted(), count)
    write_atomic(path, content, option="--animate")
