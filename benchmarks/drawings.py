"""Drawings of the documentation: what a command prints, axes, an imported body, and observers at work."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import wrap

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from benchmarks.table import ROOT
from hardware.clock import VirtualClock
from retarget import _solver
from retarget.model.body import BodyModel
from retarget.model.human import PostureReader, build_human
from retarget.model.human_dimensions import POINTS, proportional_dimensions
from retarget.model.meshes import LEFT, MIDDLE, OBSTACLE, RIGHT, Mesh, SolidBody, rgb, solid_body
from retarget.model.observers import placed, robot_observers
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_state import SceneState, obstacle_meshes, obstacle_poses
from retarget.report.solid import HUMAN_BONES, DrawnPostures, feet_of, pictures, project, robot_postures
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult
from retarget.schema.scene import FLOOR, load_scene
from retarget.setup.import_robot import import_robot
from retarget.types import MM, FloatArray
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer

INK, SOFT, GRID, PAPER, SENSOR, GOOD, BAD = "#1a2430", "#5a6674", "#e4e8ec", "#ffffff", "#c98500", "#0a7a4f", "#b3261e"
"""As on the pages."""
WIDTH = 760
"""Of an SVG, in its units: about the pixels of a page's column."""


def svg(width: float, height: float, label: str, parts: Sequence[str], *, ground: str = PAPER) -> bytes:
    """A drawing on a plain ground."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{label}">'
    style = "<style>text{font-family:system-ui,-apple-system,'Segoe UI','DejaVu Sans',sans-serif}</style>"
    rect = f'<rect width="{width:g}" height="{height:g}" rx="10" fill="{ground}"/>'
    return "\n".join([head, style, rect, *parts, "</svg>\n"]).encode()


# A terminal.

COLUMNS, LETTER, LINE = 88, (8.1, 13.5), 22
"""Of the window; across and up of a letter, and from line to line."""


def terminal(commands: Mapping[str, str]) -> bytes:
    """Commands and what each prints, as a terminal shows it."""
    lines: list[tuple[str, str]] = []
    for command, printed in commands.items():
        lines += [(f"$ retarget {command}", "#7fd1a5")]
        lines += [(part, "#e8edf3") for line in printed.splitlines() for part in wrap(line, COLUMNS) or [""]]
    parts = [f'<circle cx="{22 + 18 * i}" cy="20" r="6" fill="{c}"/>' for i, c in enumerate((BAD, "#f0b429", GOOD))]
    for row, (line, colour) in enumerate(lines):
        parts.append(
            f'<text x="18" y="{58 + LINE * row}" font-size="{LETTER[1]}" fill="{colour}" xml:space="preserve" '
            f'textLength="{LETTER[0] * len(line):.1f}" style="font-family:ui-monospace,\'DejaVu Sans Mono\','
            f'Menlo,Consolas,monospace">{escape(line)}</text>'
        )
    return svg(WIDTH, 58 + LINE * len(lines), "What a run prints", parts, ground=INK)


# Axes of the world and of a sample.

SCALE, FEET = 196.0, (205.0, 392.0)
"""Pixels to a metre, and where the origin is."""
STROKES = {"hip": 44, "knee": 30, "ankle": 24, "toe": 20, "shoulder": 34, "elbow": 22, "wrist": 18, "hand": 16}
"""Thickness of a bone by the joint at its end."""
WORN = {"head": (30, -22), "l_wrist": (16, 5), "r_wrist": (-16, 5), "l_ankle": (22, 0), "r_ankle": (-22, 0)}
"""Sensors, and where their names stand beside them."""
SAMPLE = (
    ("A sample of a sensor", INK, 19),
    ("position: x, y, z in metres, in the world", SOFT, 15),
    ("orientation: a quaternion w, x, y, z", SOFT, 15),
    ("retarget.SensorSample.of({", INK, 14),
    ('  "l_wrist": (0.04, 0.27, 0.86),', INK, 14),
    ("  ...})", INK, 14),
    ("The orientation is (1, 0, 0, 0) where a person", SOFT, 15),
    ("stands upright, faces x, and lets the arms hang,", SOFT, 15),
    ("thumbs forward.", SOFT, 15),
)


def _seen(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) of points (n, 3) m, and how near they are."""
    across, up, near = project(points)
    return np.stack([FEET[0] + SCALE * across, FEET[1] - SCALE * up], axis=-1), near


def _line(ends: FloatArray, colour: str, width: float, more: str = "") -> str:
    (xa, ya), (xb, yb) = ends.round(1).tolist()
    place = f'x1="{xa}" y1="{ya}" x2="{xb}" y2="{yb}"'
    return f'<line {place} stroke="{colour}" stroke-width="{width:g}" stroke-linecap="round" {more}/>'


def _text(x: float, y: float, text: str, colour: str = INK, size: float = 15, more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" fill="{colour}" {more}>{escape(text)}</text>'


def _arrows(at: FloatArray, length: float, names: Mapping[str, tuple[float, float]], width: float) -> list[str]:
    """The three axes at a point, m, and their names, each so far from its end."""
    ends, _ = _seen(np.vstack([at, at + length * np.eye(3)]))
    parts = [_line(ends[[0, axis]], INK, width, 'marker-end="url(#tip)"') for axis in (1, 2, 3)]
    for (name, (x, y)), end in zip(names.items(), ends[1:], strict=True):
        parts.append(_text(end[0] + x, end[1] + y, name, more='text-anchor="middle" font-weight="600"'))
    return parts


def _body(joints: FloatArray) -> list[str]:
    """A person, joints (m, 3) of POINTS: from the farthest bone to the nearest, each with an edge of paper."""
    bones = []
    for a, b in HUMAN_BONES:
        ends, near = _seen(joints[[POINTS.index(a), POINTS.index(b)]])
        kind = b.partition("_")[2]
        colour = MIDDLE if kind in ("hip", "shoulder", "collar", "") else {"l": LEFT, "r": RIGHT}[b[0]]
        width = STROKES.get(kind, 48 if b not in ("head", "neck") else 18)
        bones.append((float(near.min()), _line(ends, PAPER, width + 3) + _line(ends, colour, width)))
    (x, y), _ = _seen(joints[POINTS.index("head")] + (0.0, 0.0, 0.02))
    head = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="25" fill="{MIDDLE}" stroke="{PAPER}"/>'
    return [*(bone for _, bone in sorted(bones)), head]


def axes() -> bytes:
    """The world, the performer in it, and a sample of one sensor."""
    human = build_human(proportional_dimensions(1.75))
    q = human.posture_from([("shoulder_elevation", 8.0), ("shoulder_swing", -10.0), ("hip_abduction", 3.0)])
    joints = PostureReader(human).joints(q[None])[0]
    ankles = joints[[POINTS.index("l_ankle"), POINTS.index("r_ankle")]].mean(axis=0)
    joints += (0.0, 0.0, 0.09) - ankles
    parts = [f'<defs><marker id="tip" viewBox="0 0 10 10" refX="7" refY="5" markerWidth="4.5" markerHeight="4.5" '
             f'orient="auto"><path d="M0 0L10 5L0 10z" fill="{INK}"/></marker></defs>']  # fmt: skip
    for at in np.arange(-0.75, 0.76, 0.25):
        for line in (((at, -0.75, 0), (at, 0.75, 0)), ((-0.75, at, 0), (0.75, at, 0))):
            parts.append(_line(_seen(np.array(line))[0], "#c9d1d9", 1))
    parts += _body(joints)
    names = {"x  forward": (-14, 24), "y  left": (34, 8), "z  up": (0, -10)}
    parts += _arrows(np.array([0.45, -0.55, 0.0]), 0.34, names, 3)
    for name, (x, y) in WORN.items():
        (u, v), _ = _seen(joints[POINTS.index(name)])
        parts.append(f'<path d="M{u - 8:.1f} {v:.1f}h16m-8 -8v16" stroke="{SENSOR}" stroke-width="4"/>')
        anchor = "start" if x > 0 else "end"
        parts.append(_text(u + x, v + y, name, SENSOR, 14, f'text-anchor="{anchor}" font-weight="600"'))
    parts.append(_text(205, 458, "ground: z = 0", SOFT, 14, 'text-anchor="middle"'))
    for row, (line, colour, size) in enumerate(SAMPLE):
        mono = 'xml:space="preserve" style="font-family:ui-monospace,\'DejaVu Sans Mono\',monospace"' if size == 14 else ""
        parts.append(_text(405, 110 + 28 * row, line, colour, size, mono))
    return svg(WIDTH, 476, "Axes of the world and of a sample", parts)


# An imported body.


def _stl(mesh: Mesh) -> bytes:
    """A mesh as binary STL."""
    rows = np.zeros(len(mesh.faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("used", "<u2")])
    rows["corners"] = mesh.vertices[mesh.faces]
    return bytes(80) + len(mesh.faces).to_bytes(4, "little") + rows.tobytes()


def _with_meshes(robot: RobotBody, folder: Path) -> Path:
    """An MJCF of a shipped robot with meshes in place of its shapes, as robots from elsewhere have them."""
    import mujoco

    spec = mujoco.MjSpec.from_file(robot.body.source)
    for geom in list(spec.geoms):
        spec.delete(geom)
    for link, mesh in zip(robot.solid.links.tolist(), robot.solid.meshes, strict=True):
        name = robot.body.body_names[link]
        (folder / f"{name}.stl").write_bytes(_stl(mesh))
        spec.add_mesh(name=name, file=str(folder / f"{name}.stl"))
        spec.body(name).add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    spec.compile()
    (folder / "robot.xml").write_text(spec.to_xml(), encoding="utf-8")
    return folder / "robot.xml"


def imported() -> Image.Image:
    """What `retarget import` makes of a file with meshes: what is seen, what collides, and what looks out."""
    with TemporaryDirectory() as place:
        import_robot(_with_meshes(load_robot("poppy"), Path(place)), Path(place) / "imported")
        robot = load_robot(Path(place) / "imported")
        q = robot.posture(robot.profile.postures.stand)[None]
        seen = robot.solid
        collides = replace(robot.body, geoms=tuple(geom for geom in robot.body.geoms if geom.collides))
        shapes = solid_body(collides, {name: robot.frame(name).body for name in robot.profile.frames})
        shown = {"the meshes of the file": seen, "what collides": shapes}
        return _side_by_side({title: _standing(robot, solid, q) for title, solid in shown.items()})


def _standing(robot: RobotBody, solid: SolidBody, q: FloatArray) -> DrawnPostures:
    """A body as drawn in a posture (1, nq), on the ground that its soles have."""
    names = tuple(robot.profile.frames)
    feet, poses = feet_of(robot.points(q, names), names), solid.poses(q)
    return DrawnPostures(solid, np.concatenate([(poses[..., :3] - feet) / solid.height, poses[..., 3:]], axis=-1), solid.height)


def _side_by_side(shown: Mapping[str, DrawnPostures], width: int = 1280) -> Image.Image:
    return next(pictures(shown, width=width))


# Observers at work.

HANDS = ("l_el", "r_el")


def _followed(scene: str | None) -> RunResult:
    """The robot that follows the synthetic performer, with a scene or without."""
    options = RunOptions(robot="op3", scene=scene)
    with prepare(synthetic_performer, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        return prepared.run()


def _distances(run: RunResult, scene: SceneState) -> FloatArray:
    """How far the nearest observer is from the nearest obstacle at each tick (T,), m; below 0: inside."""
    robot = run.robot
    assert robot is not None
    observers, rows, shapes = robot_observers(robot), run.record.q[run.record.following], scene.shapes
    places, turns = placed(robot.body, observers, rows)
    known = [i for i, name in enumerate(shapes.names) if name != FLOOR]
    least = np.full(len(rows), np.inf)
    for of, pose in zip(known, obstacle_poses(shapes, scene.at_rest(0.0)), strict=True):
        for part in range(len(observers.names)):
            count = len(rows)
            distance = _solver.shape_distances(
                np.full(count, observers.kinds[part]), np.tile(observers.sizes[part], (count, 1)),
                np.ascontiguousarray(places[:, part]), np.ascontiguousarray(turns[:, part]),
                np.full(count, shapes.kinds[of]), np.tile(shapes.sizes[of], (count, 1)),
                np.tile(pose[:3], (count, 1)), np.tile(pose[3:], (count, 1)),
            )[0]  # fmt: skip
            least = np.minimum(least, distance)
    return least


def observer() -> Image.Image:
    """The same motion with and without a table that the robot knows of."""
    scene = SceneState(load_scene("table"))
    runs = {"without observers": _followed(None), "with observers": _followed("table")}
    far = {title: MM * _distances(run, scene) for title, run in runs.items()}
    at = int(np.argmin(far["without observers"]))
    shown = {}
    for title, run in runs.items():
        assert run.robot is not None
        value = float(far[title][at])
        words = f"{title}: {abs(value):.0f} mm {'inside the table' if value < 0 else 'off the table'}"
        shown[words] = _at_table(run, run.record.following.start + at, scene)
    return _stacked(_side_by_side(shown), _curves(far, at / run.setup.rate_hz if False else at))


def _at_table(run: RunResult, tick: int, scene: SceneState) -> DrawnPostures:
    """The robot at a tick, with the obstacles."""
    drawn, robot = robot_postures(run, [tick]), run.robot
    assert robot is not None and run.moved_q is not None
    names = tuple(robot.profile.frames)
    feet = feet_of(robot.points(run.moved_q[[tick]], names), names)[0, 0]
    meshes, poses = obstacle_meshes(scene.shapes), obstacle_poses(scene.shapes, scene.at_rest(0.0))
    poses = np.column_stack([(poses[:, :3] - feet) / drawn.size, poses[:, 3:]])
    solid = replace(drawn.solid, meshes=(*drawn.solid.meshes, *meshes),
                    colours=np.vstack([drawn.solid.colours, np.tile(rgb(OBSTACLE), (len(meshes), 1))]))  # fmt: skip
    return replace(drawn, solid=solid, poses=np.concatenate([drawn.poses, poses[None]], axis=1))
