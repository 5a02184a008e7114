"""What commands of benchmarks share: their options, tables as Markdown, numbers as JSON."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any


def options_of(module: str, description: str | None, **numbers: tuple[float, str]) -> argparse.Namespace:
    """Options of a command: --frames and --repeats, or these numbers with their defaults and help; and --json."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    usual = {"frames": (720, "frames of each synthetic motion"), "repeats": (3, "runs of which times are medians")}
    for name, (default, what) in (numbers or usual).items():
        parser.add_argument(f"--{name}", type=type(default), default=default, help=what)
    parser.add_argument("--json", type=Path, help="file for the numbers")
    return parser.parse_args()


def write_json(path: Path | None, parts: Mapping[str, Sequence[Any]]) -> None:
    """Dataclasses by part, where numbers are asked for."""
    if path is not None:
        text = json.dumps({key: [asdict(row) for row in rows] for key, rows in parts.items()}, indent=1)
        path.write_text(text + "\n", encoding="utf-8")


def print_table(heads: Sequence[str], rows: Iterable[Sequence[str]], *, text: int = 1) -> None:
    """A Markdown table; the first `text` columns are words, the others numbers."""
    print(f"\n| {' | '.join(heads)} |")
    print("|" + "---|" * text + "---:|" * (len(heads) - text))
    for row in rows:
        print(f"| {' | '.join(row)} |")
