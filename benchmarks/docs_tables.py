"""`python -m benchmarks.docs_tables` (`make docs-tables`): writes the measured tables of README and docs/ anew.

A table stands between `<!-- table: NAME -->` and `<!-- end -->`. Its cells are in `docs/tables/NAME.yaml`, with the
command that measured them, the day and the commit (see `benchmarks.table`), or are computed here within a second.
"""

from __future__ import annotations

import re
from collections import Counter

import mujoco
import numpy as np

from benchmarks.bus import BAUDS, expected_ms
from benchmarks.table import ROOT, markdown, stored_table
from retarget.model.robot import RobotBody, load_robot

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"(<!-- table: ([\w-]+) -->\n\n).*?(\n\n<!-- end -->)", re.DOTALL)
"""A table on a page: its marker with its name, the table, and the marker of its end."""
SERVOS = 20
"""On one line: as many as OP3 has."""
ROBOTS = {
    "op3": "ROBOTIS OP3",
    "poppy": "Poppy Humanoid",
    "toddlerbot": "ToddlerBot 2.0",
    "wolfgang": "Wolfgang-OP",
}
"""Names of the shipped robots by their folders."""


def wire() -> str:
    """Time of a cycle of SERVOS servos, ms, from the protocol's byte counts."""
    rows = [
        [name, *(f"{expected_ms(SERVOS, baud, plain=plain):.2f}" for baud in BAUDS)]
        for name, plain in (("fast sync read", False), ("sync read", True))
    ]
    return markdown([f"{SERVOS} servos, ms", *(f"{baud // 1_000_000} Mbps" for baud in BAUDS)], rows)


def robots() -> str:
    """What the profiles and body files of the shipped robots say."""
    heads = ("robot", "servos", "lines", "joints", "mass, kg", "height, m", "ticks, Hz")
    return markdown(heads, [_robot(name) for name in ROBOTS], text=3)


def _robot(name: str) -> list[str]:
    robot = load_robot(name)
    profile = robot.profile
    models = Counter(servo.model for servo in profile.servos.values()).most_common()
    ((protocol, lines),) = Counter(bus.protocol for bus in profile.buses.values()).items()
    return [
        f"`{name}`, {ROBOTS[name]}",
        ", ".join(f"{count} {model}" for model, count in models),
        f"{lines} of protocol {protocol}",
        str(len(robot.body.joint_names) - 1),  # without the free root
        f"{robot.body.total_mass:.2f}",
        f"{height(robot):.2f}",
        f"{profile.safety.rate_hz:g}",
    ]


def height(robot: RobotBody) -> float:
    """Height, m, of the body's shapes that collide, with all joints at zero, by their bounding boxes."""
    model = mujoco.MjModel.from_xml_path(str(robot.body.source))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    upwards = data.geom_xmat.reshape(-1, 3, 3)[:, 2]  # row z of each rotation: world z of the shape's own axes
    centre, half = model.geom_aabb[:, :3], model.geom_aabb[:, 3:]
    middle = data.geom_xpos[:, 2] + np.sum(upwards * centre, axis=1)
    reach = np.sum(np.abs(upwards) * half, axis=1)
    collides = model.geom_contype != 0
    return float((middle + reach)[collides].max() - (middle - reach)[collides].min())


COMPUTED = {"wire": wire, "robots": robots}
"""Makers of the tables, Markdown, by name."""


def with_tables(page: str) -> str:
    """The text of a page, with its tables as they are stored or computed."""

    def written(block: re.Match[str]) -> str:
        table = COMPUTED[block[2]]() if block[2] in COMPUTED else stored_table(block[2])
        return f"{block[1]}{table}{block[3]}"

    return BLOCK.sub(written, page)


def main() -> None:
    """Write the tables of every page."""
    for path in PAGES:
        path.write_text(with_tables(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
