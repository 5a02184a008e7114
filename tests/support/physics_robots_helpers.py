"""To be described."""

from pathlib import Path

ROBOTS = sorted(
    path.parent.name for path in (Path(__file__).parent.parent.parent / "configs/robots").glob("*/robot.yaml")
)
