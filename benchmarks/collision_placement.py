"""A table and a post where the hands of a run go: through their way, and clear of the body at the start.

Both are sized by the body: they are those of a robot half a metre high. Only forearms and hands meet them; a table that
the trunk or a leg of the free run goes through asks for another motion, not for an evasion.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.bodies import Floats
from hardware.clock import VirtualClock
from retarget.frames import SensorFrames
from retarget.model.body_file import BodyFile
from retarget.model.scene_state import SceneState
from retarget.report.clearance import (
    ClosestPairs,
    MovingGeoms,
    PlacedBody,
    among_obstacles,
    moving_geoms,
    place_body,
    scene_model,
)
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.schema.scene import load_scene
from retarget.types import FloatArray
from sim.mock_bus import mock_bus

DEPTH = 0.03
"""So deep, m, the hands of the free run enter, of a robot half a metre high."""
TABLE = (0.1, 0.15, 0.008)
POST = 0.02
"""Half sizes of the table's top, and radius of the post, m."""
INFLUENCE, MARGIN = 0.06, 0.01
STANDARD = 0.45
"""Height of that robot, by the middles of its geoms, m."""
TRIES = 150
"""Places that are tried, spread over the motion."""
APART = 0.12
"""Between table and post, m: room for an arm that is in the influence of neither, where there is such a place."""


@dataclass(frozen=True)
class Obstacle:
    """A line of a scene file, and how deep, m, the arms of the free run go into it.

    middle, along: seen from above, where it is, m, and the direction of its first half size; size: half sizes, m.
    """

    name: str
    text: str
    middle: tuple[float, float]
    along: tuple[float, float] = (1.0, 0.0)
    size: tuple[float, float] = (0.0, 0.0)
    depth: float = 0.0


@dataclass(frozen=True, eq=False)
class SceneObstacles:
    """What a body must not meet where: `start` in all its geoms, `rest` in all but the forearms, over the whole run."""

    body: BodyFile
    start: MovingGeoms
    start_times: Floats
    rest: MovingGeoms
    arms: MovingGeoms
    times: Floats


def place(motion: Motion, folder: Path) -> tuple[Obstacle, ...]:
    """The table and the post, as far as there is a place for them. Writes trial scenes to a folder."""
    scale, around = height_scale(motion), scene_obstacles(motion)
    table = _best_that_fits(_tables(motion, scale), around, scale, folder)
    posts = (post for post in _posts(motion, scale) if table is None or apart(post, table) >= APART * scale)
    post = _best_that_fits(posts, around, scale, folder) or _best_that_fits(
        _posts(motion, scale), around, scale, folder
    )
    return tuple(found for found in (table, post) if found is not None)


def apart(post: Obstacle, table: Obstacle) -> float:
    """Level distance, m, of the axis of a post from a table's top; 0 above or below it."""
    across = np.array([-table.along[1], table.along[0]])
    offset = np.array(post.middle) - table.middle
    beyond = np.abs([offset @ table.along, offset @ across]) - table.size
    return float(np.linalg.norm(np.maximum(beyond, 0.0)))


def height_scale(motion: Motion) -> float:
    """Height of the body at the start, by the middles of its geoms, over that of the standard robot."""
    return float(np.ptp(motion.geoms.position[0, :, 2])) / STANDARD


def scene_obstacles(motion: Motion) -> SceneObstacles:
    """The parts of a motion that a placement looks at."""
    body, geoms, every = motion.body, motion.geoms, np.arange(len(motion.geoms.links))
    forearms = [body.model.body(link).id for link in motion.arms]
    of_arm = np.isin(geoms.links, forearms)
    start = np.arange(motion.beginning)
    rows = np.arange(motion.first, motion.end)
    return SceneObstacles(
        body=body.file,
        start=chosen_part(geoms, start, every),
        start_times=motion.time[start],
        rest=chosen_part(geoms, rows, every[~of_arm]),
        arms=chosen_part(geoms, rows, every[of_arm]),
        times=motion.time[rows],
    )


def chosen_part(of: MovingGeoms, rows: NDArray[np.int64], which: NDArray[np.int64]) -> MovingGeoms:
    """Some of the geoms of a body in some of its postures, by number; the postures are numbered anew."""
    return MovingGeoms(of.model, of.geoms[which], of.position[rows][:, which], of.matrix[rows][:, which])


def scene_distances(body: BodyFile, part: MovingGeoms, scene: SceneState, times: FloatArray) -> FloatArray:
    """Distance (T, k) m to each obstacle in each posture, of the geom that is nearest: all are looked at."""
    count, shape = len(part.position), (len(part.geoms), len(scene.shapes.names))
    pairs = np.indices(shape).reshape(2, -1).T + np.array([shape[1], 0])
    rows, which = np.indices((count, len(pairs))).reshape(2, -1)
    measure = among_obstacles(*scene_model(body, scene.shapes), part, scene, times).distances(pairs)
    return np.asarray(measure(rows, which).reshape(count, *shape).min(axis=1))


def scene_clearance(body: BodyFile, part: MovingGeoms, scene: SceneState, times: FloatArray) -> float:
    """Smallest distance, m, to an obstacle in any posture."""
    pairs = np.indices((len(part.geoms), len(scene.shapes.names))).reshape(2, -1).T
    both, closest = among_obstacles(*scene_model(body, scene.shapes), part, scene, times), ClosestPairs(())
    pairs = pairs + np.array([len(scene.shapes.names), 0])
    closest.look(both.distances(pairs), both.bounds(pairs), len(part.position))
    return closest.smallest


def write_scene(obstacles: tuple[Obstacle, ...], path: Path, *, scale: float = 1.0) -> Path:
    """A scene file of some obstacles."""
    zone = f"influence: {INFLUENCE * scale:.4g}, margin: {MARGIN * scale:.4g}"
    lines = [f"  {obstacle.name}: {{{obstacle.text}, {zone}}}" for obstacle in obstacles]
    head = ["name: placed", "description: In reach of the hands of one recording", "obstacles:"]
    path.write_text("\n".join([*head, *lines, ""]), encoding="utf-8")
    return path


def _best_that_fits(
    candidates: Iterator[Obstacle], around: SceneObstacles, scale: float, folder: Path
) -> Obstacle | None:
    """The first that is met deep enough, or else the one that is met deepest, if by half of that."""
    best: Obstacle | None = None
    for obstacle in candidates:
        scene = SceneState(load_scene(write_scene((obstacle,), folder / "trial.yaml", scale=scale)))
        if scene_clearance(around.body, around.start, scene, around.start_times) < 2.0 * MARGIN * scale:
            continue
        depth = max(0.0, -scene_clearance(around.body, around.arms, scene, around.times))
        if depth < max(0.5 * DEPTH * scale, 0.0 if best is None else best.depth):
            continue
        if scene_clearance(around.body, around.rest, scene, around.times) >= MARGIN * scale:
            best = replace(obstacle, depth=depth)
            if depth >= DEPTH * scale:
                break
    return best


def _tables(motion: Motion, scale: float) -> Iterator[Obstacle]:
    """Tops that a hand goes through from above or from the side, lowest and farthest hands first."""
    depth = DEPTH * scale
    length, width, thick = (scale * size for size in TABLE)
    for hand, outwards in _ways(motion, lowest=True):
        middle = hand + outwards * (length - depth)
        angle = 0.5 * np.arctan2(outwards[1], outwards[0])
        for lift in (depth - thick, 0.0):
            pos = _numbers([*middle[:2], hand[2] + lift])
            if hand[2] + lift > thick:
                turn = f"quat: {_numbers([np.cos(angle), 0.0, 0.0, np.sin(angle)])}"
                text = f"shape: {{box: {{size: {_numbers([length, width, thick])}}}}}, at: {{pos: {pos}, {turn}}}"
                yield Obstacle("table", text, _level(middle), _level(outwards), (length, width))


def _posts(motion: Motion, scale: float) -> Iterator[Obstacle]:
    """Upright cylinders from the ground up to above a hand, farthest hands first."""
    radius = POST * scale
    for hand, outwards in _ways(motion, lowest=False):
        for way in (0.0, -2.0, 1.0):
            x, y = _level(hand + way * radius * outwards)
            low, high = _numbers([x, y, 0.0]), _numbers([x, y, hand[2] + 5.0 * radius])
            text = f"shape: {{cylinder: {{from: {low}, to: {high}, radius: {radius:.4g}}}}}"
            yield Obstacle("post", text, (x, y), size=(radius, radius))


def _ways(motion: Motion, *, lowest: bool) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Places (3,) of the hands, most telling first, and the level direction (3,) away from the body there."""
    hands = motion.reached
    ticks = np.linspace(0, len(hands) - 1, min(len(hands), TRIES // 2), dtype=np.int64)
    trunk = motion.geoms.position[motion.first + ticks, 0]
    away = hands[ticks] - trunk[:, None]
    away[..., 2] = 0.0
    reach = np.linalg.norm(away, axis=-1)
    moved = np.linalg.norm(hands[ticks] - hands[:1], axis=-1)
    score = moved + (reach - hands[ticks][..., 2] if lowest else reach)
    order = np.dstack(np.unravel_index(np.argsort(-score, axis=None), score.shape))[0]
    for tick, side in order[:TRIES]:
        if reach[tick, side] > 0.0:
            yield hands[ticks[tick], side], away[tick, side] / reach[tick, side]


def _level(point: FloatArray) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _numbers(values: list[float]) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"


# Whole runs in this process, as `retarget run` makes them, and what of them the measuring needs.

HANDS = ("l_hand", "r_hand")


@dataclass(frozen=True, eq=False)
class Motion:
    """A robot in all T postures of a run.

    time (T,) s, on the scene's clock; first, end: rows of following. reached (F, 2, 3) m: both hands, while following.
    arms: the links of each forearm. neutral (nq,). gated: share of the ticks of following that the gate changed.
    """

    run: RunResult
    body: PlacedBody
    geoms: MovingGeoms
    time: Floats
    first: int
    end: int
    reached: Floats
    arms: tuple[str, ...]
    neutral: Floats
    ignored: tuple[tuple[str, str], ...]
    gated: float

    @property
    def beginning(self) -> int:
        """How many rows pass until the clip begins, its first posture with them."""
        return self.first + 1


def play(frames: SensorFrames, options: RunOptions) -> Motion:
    """Let a robot run on a virtual clock and a mock bus. Raises RetargetError."""
    with prepare(lambda: frames, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        run = prepared.run()
    following, robot, sent = run.record.following, run.robot, run.record.robot
    assert robot is not None and sent is not None
    names, _, reached = run.followed
    profile = robot.profile
    body = place_body(profile.body_path, sent.q, root=profile.root)
    assert len(body.rows) == len(run.record), "every posture that was sent is known"
    followed = sent.gated[run.record.phase == Phase.FOLLOW]
    return Motion(
        run=run,
        body=body,
        geoms=moving_geoms(body.model, body.postures),
        time=run.record.time,
        first=following.start,
        end=following.stop,
        reached=reached[following][:, [names.index(hand) for hand in HANDS]],
        arms=tuple(profile.frames[profile.landmarks[hand].frame].link for hand in HANDS),
        neutral=robot.posture(profile.postures.neutral),
        ignored=tuple(ignored.pair for ignored in profile.ignore_pairs),
        gated=float(np.mean(followed)) if followed.size else 0.0,
    )
