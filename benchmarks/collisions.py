"""`python -m benchmarks.collisions`: does a body keep clear of itself and of what stands in its way, and does it move?

Every recording of a folder (`--mocap`, or `mocap` in $RETARGET_SHARED, or `../shared/mocap`), free, and with a table
and a post where its hands go. Clearances are those of the body's own geoms, in what was sent. Three runs each: without
observers (and without gate: the measure of jerk), free, and with obstacles.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from benchmarks.collision_numbers import Numbers, numbers
from benchmarks.collision_placement import height_scale, place, write_scene
from benchmarks.collision_runs import play, unobserving
from benchmarks.table import print_table
from hardware.errors import RetargetError
from retarget.frames import SensorFrames
from retarget.run.options import RunOptions
from retarget.sources.open import open_source

FORMATS = (".amc", ".bvh", ".c3d")
FREE, OBSTACLES = "free", "obstacles"
HEADS = (
    "recording", "scene", "frames", "self mm", "> 1 mm", "scene mm", "> 1 mm", "gated %", "hands mm", "unhindered mm",
    "path ratio", "jerk p95", "jerk ratio", "switches/s", "stopped",
)  # fmt: skip


def recordings(folder: Path) -> list[Path]:
    """Motion files of a folder and its folders."""
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in FORMATS)


def skeleton_of(path: Path) -> Path | None:
    """The ASF of an AMC where none is named for it: the only one beside it."""
    if path.suffix.lower() != ".amc":
        return None
    beside = sorted(path.parent.glob("*.asf"))
    return beside[0] if len(beside) == 1 else None


def measured(name: str, frames: SensorFrames, options: RunOptions, scenes: Sequence[str]) -> Iterator[Numbers | str]:
    """Rows of one recording, and what there is to say. Raises RetargetError."""
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder)
        bare = str(unobserving(options.robot, where))
        without = play(frames, replace(options, gate=options.is_human, priorities=bare))
        free = play(frames, options)
        if FREE in scenes:
            yield numbers(name, FREE, free, free=None, without=without)
        if OBSTACLES not in scenes:
            return
        placed = place(free, where)
        for missing in sorted({"table", "post"} - {obstacle.name for obstacle in placed}):
            yield f"{name}: no place for a {missing} that only the hands meet and that is clear at the start"
        if not placed:
            return
        for obstacle in placed:
            yield f"{name}: the arms go {1e3 * obstacle.depth:.0f} mm into the {obstacle.name}: {obstacle.text}"
        scene = str(write_scene(placed, where / "placed.yaml", scale=height_scale(free)))
        among = play(frames, replace(options, scene=scene))
        yield numbers(name, "+".join(o.name for o in placed), among, free=free, without=without)


def main() -> None:
    """Measure, print the table, and write the rows."""
    chosen = _arguments()
    options = RunOptions(chosen.robot, gate=not chosen.no_gate, priorities=chosen.priorities)
    rows: list[Numbers] = []
    notes: list[str] = []
    for path in chosen.files or recordings(chosen.mocap):
        name = f"{path.parent.name}/{path.name}"
        try:
            for found in measured(
                name, open_source(path, skeleton=skeleton_of(path)), options, chosen.scenes.split(",")
            ):
                if isinstance(found, Numbers):
                    rows.append(found)
                    print(" | ".join(row_of(found)), flush=True)
                else:
                    notes.append(found)
        except RetargetError as error:
            notes.append(f"{name}: skipped: {error}")
    print_table(HEADS, [row_of(row) for row in [*rows, *worst(rows)]], text=2)
    notes += [f"not compared: {pair}" for pair in sorted({pair for row in rows for pair in row.left_out})]
    print("\n" + "\n".join(f"* {note}" for note in notes))
    if chosen.json is not None:
        text = json.dumps({"rows": [asdict(row) for row in rows], "notes": notes}, indent=1)
        chosen.json.write_text(text + "\n", encoding="utf-8")


def row_of(row: Numbers) -> list[str]:
    """Cells of the table."""
    return [
        row.recording,
        row.scene,
        str(row.frames),
        _number(row.self_mm, 2) + _pair(row.self_pair, row.self_deep),
        str(row.self_deep),
        _number(row.scene_mm, 2) + _pair(row.scene_pair, row.scene_deep),
        "" if row.scene_mm is None else str(row.scene_deep),
        "" if row.gated is None else f"{100.0 * row.gated:.2f}",
        _number(row.hands_mm, 1),
        _number(row.unhindered_mm, 2) + ("" if row.unhindered_share is None else f" ({row.unhindered_share:.0%})"),
        _number(row.path_ratio, 3),
        _number(row.jerk_p95, 0),
        _number(row.jerk_ratio, 2),
        _number(row.switches, 1) + (f" {row.busiest}" if row.busiest else ""),
        row.stop or "",
    ]


def worst(rows: list[Numbers]) -> list[Numbers]:
    """One row for the free runs and one for those with obstacles: the worst of each number, and all frames."""
    found = []
    for scene in (FREE, OBSTACLES):
        group = [row for row in rows if (row.scene == FREE) == (scene == FREE)]
        if group:
            found.append(_worst_of(group, scene))
    return found


def _worst_of(rows: list[Numbers], scene: str) -> Numbers:
    def least(key: str) -> float | None:
        return min((value for row in rows if (value := getattr(row, key)) is not None), default=None)

    def most(key: str) -> float | None:
        return max((value for row in rows if (value := getattr(row, key)) is not None), default=None)

    stopped = sum(row.stop is not None for row in rows)
    return Numbers(
        recording="worst of all",
        scene=scene,
        frames=sum(row.frames for row in rows),
        self_mm=least("self_mm"),
        self_pair=None,
        self_deep=sum(row.self_deep for row in rows),
        scene_mm=least("scene_mm"),
        scene_pair=None,
        scene_deep=sum(row.scene_deep for row in rows),
        gated=most("gated"),
        hands_mm=most("hands_mm"),
        unhindered_mm=most("unhindered_mm"),
        unhindered_share=None,
        path_ratio=least("path_ratio"),
        jerk_p95=most("jerk_p95"),
        jerk_ratio=most("jerk_ratio"),
        switches=most("switches"),
        busiest=None,
        stop=f"{stopped} runs" if stopped else None,
    )


def _arguments() -> argparse.Namespace:
    shared = Path(os.environ.get("RETARGET_SHARED", str(Path(__file__).resolve().parents[2] / "shared")))
    parser = argparse.ArgumentParser(prog="python -m benchmarks.collisions", description=__doc__)
    parser.add_argument("--robot", default="op3", help="robot by name or path; human: the virtual human")
    parser.add_argument("--files", type=Path, nargs="+", help="these recordings instead of the folder's")
    parser.add_argument("--mocap", type=Path, default=shared / "mocap", help="folder of recordings")
    parser.add_argument("--priorities", help="priority file of the last stage, instead of the robot's own")
    parser.add_argument("--no-gate", action="store_true", help="what the observers do alone")
    parser.add_argument("--scenes", default=f"{FREE},{OBSTACLES}", help="free, obstacles, or both")
    parser.add_argument("--json", type=Path, help="write the rows to a file")
    chosen = parser.parse_args()
    if chosen.robot == "human":
        chosen.no_gate = False
    return chosen


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _pair(pair: tuple[str, str] | None, deep: int) -> str:
    """Named where it is to be looked at."""
    return f" {pair[0]}, {pair[1]}" if pair is not None and deep else ""


if __name__ == "__main__":
    main()
