"""`python -m benchmarks.collisions`: does a robot keep clear of itself and of what stands in its way?

Every recording of a folder (`--mocap`, or `mocap` in $RETARGET_SHARED, or `../shared/mocap`), free, and with a table
and a post where its hands go. Clearances are those of the body's own geoms, in what was sent.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from benchmarks.collision_placement import Motion, height_scale, place, play, write_scene
from benchmarks.recording import SHARED
from benchmarks.table import add_docs, print_table, show_table
from hardware.errors import RetargetError
from retarget.frames import SensorFrames
from retarget.report.clearance import Clearance
from retarget.run.options import RunOptions
from retarget.sources.open import open_source

FORMATS = (".amc", ".bvh", ".c3d")
FREE = "free"
HEADS = ("recording", "scene", "frames", "self", "scene, nearest", "frames inside", "gated", "stopped")
DOCS_HEADS = ("OP3", "runs", "frames", "self, nearest", "scene, nearest", "frames more than 1 mm inside", "gated")


@dataclass(frozen=True)
class Row:
    """One run. Clearances in mm (negative: inside), None without a scene, with the pair that came closest.

    deep: frames deeper than 1 mm. gated: share of the ticks that the gate changed. stopped: why it ended early, or "".
    """

    recording: str
    scene: str
    frames: int
    self_mm: float | None
    self_pair: tuple[str, str] | None
    scene_mm: float | None
    scene_pair: tuple[str, str] | None
    deep: int
    gated: float
    stopped: str


def row_of(recording: str, scene: str, motion: Motion) -> Row:
    """Measure a run."""
    itself = motion.body.to_itself(neutral=motion.neutral, ignored=motion.ignored)
    around = motion.run.scene
    fixtures = Clearance(None, 0, None) if around is None else motion.body.to_scene(around, motion.time)
    return Row(
        recording,
        scene,
        len(motion.time),
        None if itself.smallest is None else 1e3 * itself.smallest,
        itself.pair,
        None if fixtures.smallest is None else 1e3 * fixtures.smallest,
        fixtures.pair,
        itself.deep + fixtures.deep,
        motion.gated,
        motion.run.reason or "",
    )


def skeleton_of(path: Path) -> Path | None:
    """The ASF of an AMC where none is named for it: the only one beside it."""
    beside = sorted(path.parent.glob("*.asf"))
    return beside[0] if path.suffix.lower() == ".amc" and len(beside) == 1 else None


def measured(name: str, frames: SensorFrames, options: RunOptions) -> Iterator[Row | str]:
    """Rows of one recording, and what there is to say. Raises RetargetError."""
    with tempfile.TemporaryDirectory() as folder:
        free = play(frames, options)
        yield row_of(name, FREE, free)
        placed = place(free, Path(folder))
        for missing in sorted({"table", "post"} - {obstacle.name for obstacle in placed}):
            yield f"{name}: no place for a {missing} that only the hands meet and that is clear at the start"
        if not placed:
            return
        for obstacle in placed:
            yield f"{name}: the arms go {1e3 * obstacle.depth:.0f} mm into the {obstacle.name}: {obstacle.text}"
        scene = write_scene(placed, Path(folder) / "placed.yaml", scale=height_scale(free))
        among = play(frames, replace(options, scene=str(scene)))
        yield row_of(name, "+".join(obstacle.name for obstacle in placed), among)


def main() -> None:
    """Measure, print the tables, and write the rows."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.collisions", description=__doc__)
    parser.add_argument("--robot", default="op3", help="robot by name or path")
    parser.add_argument("--files", type=Path, nargs="+", help="these recordings instead of the folder's")
    parser.add_argument("--mocap", type=Path, default=SHARED / "mocap", help="folder of recordings")
    parser.add_argument("--no-gate", action="store_true", help="what the observers do alone")
    parser.add_argument("--json", type=Path, help="write the rows to a file")
    add_docs(parser)
    asked = parser.parse_args()
    options, rows = RunOptions(asked.robot, gate=not asked.no_gate), []
    for path in asked.files or sorted(one for one in asked.mocap.rglob("*") if one.suffix.lower() in FORMATS):
        name = f"{path.parent.name}/{path.name}"
        try:
            for found in measured(name, open_source(path, skeleton=skeleton_of(path)), options):
                if isinstance(found, Row):
                    rows.append(found)
                else:
                    print(f"* {found}", flush=True)
        except RetargetError as error:
            print(f"* {name}: skipped: {error}", flush=True)
    print_table(HEADS, [cells_of(row) for row in rows], text=2)
    show_table("collisions", DOCS_HEADS, worst(rows), docs=asked.docs)
    if asked.json is not None:
        asked.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n", encoding="utf-8")


def cells_of(row: Row) -> list[str]:
    """Cells of a run."""
    nearest = (_nearest(row.self_mm, row.self_pair), _nearest(row.scene_mm, row.scene_pair))
    return [row.recording, row.scene, str(row.frames), *nearest, str(row.deep), f"{row.gated:.2%}", row.stopped]


def worst(rows: Sequence[Row]) -> Iterator[list[str]]:
    """Cells for all free runs, and for those with obstacles: the nearest of each distance, and all frames."""
    groups = {"free": True, "table and post": False}
    for words, free in groups.items():
        if not (runs := [row for row in rows if (row.scene == FREE) == free]):
            continue
        frames = sum(row.frames for row in runs)
        own = min((row.self_mm for row in runs if row.self_mm is not None), default=None)
        scene = min((row.scene_mm for row in runs if row.scene_mm is not None), default=None)
        gated = sum(row.gated * row.frames for row in runs) / frames
        counts = (str(sum(row.deep for row in runs)), f"{100.0 * gated:.2f} %")
        yield [words, str(len(runs)), f"{frames:,}", _nearest(own), _nearest(scene), *counts]


def _nearest(mm: float | None, pair: tuple[str, str] | None = None) -> str:
    return "-" if mm is None else f"{mm:.1f} mm" + (f" ({', '.join(pair)})" if pair else "")


if __name__ == "__main__":
    main()
