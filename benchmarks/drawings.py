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

from hardware.clock import VirtualClock
from retarget import _solver
from retarget.model.human import PostureReader, build_human
from retarget.model.human_dimensions import POINTS, kind_of, proportional_dimensions
from retarget.model.meshes import (
    LEFT,
    MIDDLE,
    RIGHT,
    Mesh,
    SolidBody,
    joined,
    link_meshes,
    rgb,
    shape_mesh,
    side_colours,
    solid_body,
)
from retarget.model.observers import placed, robot_observers
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_state import SceneState, obstacle_poses
from retarget.pictures.solid import HUMAN_BONES, DrawnPostures, feet_of, pictures, project, robot_postures
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
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{label}">'
    )
    style = "<style>text{font-family:system-ui,-apple-system,'Segoe UI','DejaVu Sans',sans-serif}</style>"
    rect = f'<rect width="{width:g}" height="{height:g}" rx="10" fill="{ground}"/>'
    return "\n".join([head, style, rect, *parts, "</svg>\n"]).encode()


MONOSPACE = 'xml:space="preserve" style="font-family:ui-monospace,\'DejaVu Sans Mono\',Menlo,Consolas,monospace"'


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
        long = f'{MONOSPACE} textLength="{LETTER[0] * len(line):.1f}"'
        parts.append(_text(18, 58 + LINE * row, line, colour, LETTER[1], long))
    return svg(WIDTH, 58 + LINE * len(lines), "What a run prints", parts, ground=INK)


# Axes of the world and of a sample.

SCALE, FEET = 190.0, (232.0, 386.0)
"""Pixels to a metre, and where the origin is."""
STROKES = {"hip": 46, "knee": 31, "ankle": 24, "toe": 20, "shoulder": 34, "elbow": 22, "wrist": 18, "hand": 16}
"""Thickness of a bone by the joint at its end; of another: TRUNK."""
TRUNK, NECK, SKULL = 50, 20, 25
TRUNKS = ("hip", "shoulder", "collar")
"""Joints whose bones are of the trunk."""
WORN = {"head": (32, -18), "l_wrist": (17, 5), "r_wrist": (-17, 5), "l_ankle": (24, 4), "r_ankle": (-24, -6)}
"""Sensors, and where their names stand beside them."""
CORNER = (0.35, -0.5, 0.0)
"""Where the axes are drawn, m."""
SAMPLE = """A sample of the sensors
SensorSample.of(
  {"l_wrist": (X), ...},
  {"l_wrist": (1, 0, 0, 0), ...})

position: x, y, z in metres, the ground at z = 0
orientation: w, x, y, z; it is (1, 0, 0, 0) where
a person stands upright, faces x, and lets the
arms hang, thumbs forward"""


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
    """A person, joints (m, 3) of POINTS: the right limbs, which are behind, the trunk, the left limbs."""
    layers: dict[str, list[tuple[float, str]]] = {RIGHT: [], MIDDLE: [], LEFT: []}
    for a, b in HUMAN_BONES:
        ends, near = _seen(joints[[POINTS.index(a), POINTS.index(b)]])
        kind = kind_of(b)
        colour = MIDDLE if kind == b or kind in TRUNKS else LEFT if b.startswith("l_") else RIGHT
        width = STROKES.get(kind, NECK if b in ("head", "neck", "head_top") else TRUNK)
        layers[colour].append((float(near.min()), _line(ends, colour, width)))
        if colour != MIDDLE:
            layers[colour].append((float(near.min()) - 1e-6, _line(ends, PAPER, width + 3)))
    (x, y), _ = _seen(joints[POINTS.index("head")] + (0.0, 0.0, 0.02))
    head = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{SKULL}" fill="{MIDDLE}"/>'
    return [*(bone for layer in layers.values() for _, bone in sorted(layer)), head]


def axes() -> bytes:
    """The world, the performer in it, and a sample of one sensor."""
    human = build_human(proportional_dimensions(1.75))
    q = human.posture_from([("shoulder_elevation", 8.0), ("shoulder_swing", -10.0), ("hip_abduction", 3.0)])
    joints = PostureReader(human).joints(q[None])[0]
    joints += (0.0, 0.0, 0.09) - joints[[POINTS.index("l_ankle"), POINTS.index("r_ankle")]].mean(axis=0)
    parts = [f'<defs><marker id="tip" viewBox="0 0 10 10" refX="7" refY="5" markerWidth="4.5" markerHeight="4.5" '
             f'orient="auto"><path d="M0 0L10 5L0 10z" fill="{INK}"/></marker></defs>']  # fmt: skip
    for at in np.arange(-0.75, 0.76, 0.25):
        for edge in (((at, -0.75, 0), (at, 0.75, 0)), ((-0.75, at, 0), (0.75, at, 0))):
            parts.append(_line(_seen(np.array(edge))[0], "#c9d1d9", 1))
    parts += _body(joints)
    parts += _arrows(np.array(CORNER), 0.36, {"x forward": (-22, 26), "y left": (34, 10), "z up": (0, -12)}, 3)
    for name, (x, y) in WORN.items():
        (u, v), _ = _seen(joints[POINTS.index(name)])
        cross = f'<path d="M{u - 8:.1f} {v:.1f}h16m-8 -8v16" stroke='
        parts += [f'{cross}"{PAPER}" stroke-width="7"/>', f'{cross}"{SENSOR}" stroke-width="4"/>']
        anchor = "start" if x > 0 else "end"
        parts.append(_text(u + x, v + y, name, SENSOR, 15, f'text-anchor="{anchor}" font-weight="600"'))
    wrist = ", ".join(f"{value:.2f}" for value in joints[POINTS.index("l_wrist")])
    heading, *lines = SAMPLE.replace("X", wrist).splitlines()
    parts.append(_text(408, 110, heading, INK, 19, 'font-weight="600"'))
    for row, line in enumerate(lines):
        code = row < lines.index("")
        parts.append(_text(408, 142 + 26 * row, line, *((INK, 13, MONOSPACE) if code else (SOFT, 15))))
    return svg(WIDTH, 460, "Axes of the world and of a sample", parts)


# An imported body.

IMPORTED = "op3"
"""The robot whose shapes become the meshes of a file, those of links without looks with a waist."""
SLENDER, RINGS, AROUND = 1.25, 9, 16
"""Length of a shell in its width at least, its rings, and corners of a ring."""


def _stl(mesh: Mesh) -> bytes:
    """A mesh as binary STL."""
    rows = np.zeros(len(mesh.faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("used", "<u2")])
    rows["corners"] = mesh.vertices[mesh.faces]
    return bytes(80) + len(mesh.faces).to_bytes(4, "little") + rows.tobytes()


def _shell(mesh: Mesh) -> Mesh:
    """A shell with a waist, as long and wide as a mesh; one that is nearly as wide as long stays as it is."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    half = 0.5 * (high - low)
    long = int(np.argmax(half))
    wide = [(long + 1) % 3, (long + 2) % 3]
    if half[long] < SLENDER * half[wide].max():
        return mesh
    along = np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, RINGS))
    waist = np.minimum(0.74 + 0.26 * along**2, 1.6 * np.sqrt(np.maximum(1.0 - along**2, 0.0)) + 0.02)
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    vertices = np.empty((RINGS, AROUND, 3))
    vertices[..., long] = half[long] * along[:, None]
    for axis, turn in zip(wide, (np.cos(angle), np.sin(angle)), strict=True):
        vertices[..., axis] = half[axis] * waist[:, None] * np.sign(turn) * np.sqrt(np.abs(turn))
    number = np.arange(RINGS * AROUND).reshape(RINGS, AROUND)
    a, b, c, d = number[:-1], np.roll(number, -1, 1)[:-1], np.roll(number, -1, 1)[1:], number[1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return Mesh(vertices.reshape(-1, 3) + 0.5 * (low + high), faces)


def _with_meshes(robot: RobotBody, folder: Path) -> Path:
    """An MJCF of a shipped robot with meshes in place of its shapes, as robots from elsewhere have them."""
    import mujoco

    spec, body = mujoco.MjSpec.from_file(robot.body.source), robot.body
    for geom in list(spec.geoms):
        spec.delete(geom)
    kept = {sole.body for sole in robot.soles} | {geom.body for geom in body.geoms if not geom.collides}
    parts = link_meshes(body)
    for link in sorted({link for link, _ in parts}):
        name, mesh = body.body_names[link], joined([part for (owner, _), part in parts.items() if owner == link])
        (folder / f"{name}.stl").write_bytes(_stl(mesh if link in kept else _shell(mesh)))
        spec.add_mesh(name=name, file=str(folder / f"{name}.stl"))
        spec.body(name).add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    spec.compile()
    (folder / "robot.xml").write_text(spec.to_xml(), encoding="utf-8")
    return folder / "robot.xml"


def imported() -> Image.Image:
    """What `retarget import` makes of a file with meshes: what is seen, what collides, and the observers."""
    with TemporaryDirectory() as place:
        import_robot(_with_meshes(load_robot(IMPORTED), Path(place)), Path(place) / "imported")
        robot = load_robot(Path(place) / "imported")
        named = {name: robot.frame(name).body for name in robot.profile.frames}
        collides = replace(robot.body, geoms=tuple(geom for geom in robot.body.geoms if geom.collides))
        q = robot.posture(robot.profile.postures.stand)[None]
        bodies = {"meshes": robot.solid, "shapes": solid_body(collides, named)}
        shown = {title: _standing(robot, solid, solid.poses(q)) for title, solid in bodies.items()}
        observers = robot_observers(robot)
        colours = np.array([rgb(one) for one in side_colours(robot.body, named)])[observers.links]
        shapes = tuple(
            shape_mesh(kind, size) for kind, size in zip(observers.kinds.tolist(), observers.sizes, strict=True)
        )
        solid = replace(robot.solid, meshes=shapes, colours=0.55 * colours + 0.45)
        poses = np.concatenate(placed(robot.body, observers, q), axis=-1)
        return _side_by_side(shown | {"observers": _standing(robot, solid, poses)})


def _standing(robot: RobotBody, solid: SolidBody, poses: FloatArray) -> DrawnPostures:
    """A body as drawn in one posture, poses (1, m, 7) of its meshes, its feet at the origin."""
    q, names = robot.posture(robot.profile.postures.stand)[None], tuple(robot.profile.frames)
    feet, size = feet_of(robot.points(q, names), names), robot.solid.height
    return DrawnPostures(solid, np.concatenate([(poses[..., :3] - feet) / size, poses[..., 3:]], axis=-1), size)


def _side_by_side(shown: Mapping[str, DrawnPostures], width: int = 1280) -> Image.Image:
    return next(pictures(shown, width=width))


# Observers at work.

SHOWN_S = 8.0
"""Of the motion."""


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
    """The same motion with and without a table that the robot knows of, and how far it is from it all the time."""
    scene = SceneState(load_scene("table"))
    runs = {"table unknown": _followed(None), "table in the scene": _followed("table")}
    far = {title: MM * _distances(run, scene) for title, run in runs.items()}
    tick = int(np.argmin(far["table unknown"]))
    shown = {}
    for title, run in runs.items():
        value = float(far[title][tick])
        words = f"{title}: {abs(value):.0f} mm {'inside it' if value < 0 else 'off it'}"
        shown[words] = robot_postures(replace(run, scene=scene), [run.record.following.start + tick])
    run = runs["table in the scene"]
    time = run.record.time[run.record.following]
    above, below = _side_by_side(shown), _curves(time - time[0], far, tick)
    whole = Image.new("RGB", (above.width, above.height + below.height), PAPER)
    whole.paste(above, (0, 0))
    whole.paste(below, (0, above.height))
    return whole


def _curves(time: FloatArray, far: Mapping[str, FloatArray], tick: int) -> Image.Image:
    """Distances (T,), mm, over time, s, with the tick that is drawn."""
    figure = Figure(figsize=(12.8, 2.9), dpi=100, layout="constrained")
    plot = figure.subplots()
    plot.axhspan(-200, 0, color="#b0967a", alpha=0.3, lw=0)
    for (title, values), colour in zip(far.items(), (BAD, GOOD), strict=True):
        plot.plot(time, values, color=colour, lw=3, label=title)
    plot.axhline(10.0, color=SOFT, lw=1.5, ls="--", label="margin, 10 mm")
    plot.axvline(time[tick], color=INK, lw=1.5)
    plot.set(xlim=(0, SHOWN_S), ylim=(-70, 100))
    plot.set_xlabel("s", fontsize=17)
    plot.set_ylabel("mm to the table", fontsize=17)
    plot.tick_params(labelsize=16)
    plot.legend(fontsize=16, loc="upper right", ncols=3, framealpha=1.0)
    plot.spines[["top", "right"]].set_visible(False)
    made = BytesIO()
    figure.savefig(made, format="png")
    return Image.open(made).convert("RGB")
