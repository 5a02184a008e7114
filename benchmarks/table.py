"""What commands of benchmarks share: their options, tables as Markdown, numbers as JSON, and the store of docs/tables.

`docs/tables/NAME.yaml` holds the cells of a measured table, the command that measured them, the day and the commit; a
benchmark writes it with `--docs`. The site shows all of them, and `benchmarks.docs_tables` sets some into their pages.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parent.parent
STORED = ROOT / "docs" / "tables"
"""Where the cells of measured tables are, a file for each table."""


@dataclass(frozen=True)
class StoredTable:
    """A measured table.

    command: what was typed, files without their folders. measured: day, and commit of the checkout. heads, rows: cells
    as they are shown; the first `text` columns are words, the others numbers.
    """

    command: str
    measured: str
    heads: list[str]
    rows: list[list[str]]
    text: int = 1


def options_of(module: str, description: str | None, **numbers: tuple[float, str]) -> argparse.Namespace:
    """Options of a command: --frames and --repeats, or `numbers` with default and help; --json and --docs."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    usual = {"frames": (720, "frames of each synthetic motion"), "repeats": (3, "runs of which times are medians")}
    for name, (default, what) in (numbers or usual).items():
        parser.add_argument(f"--{name}", type=type(default), default=default, help=what)
    parser.add_argument("--json", type=Path, help="file for the numbers")
    add_docs(parser)
    return parser.parse_args()


def add_docs(parser: argparse.ArgumentParser) -> None:
    """Add the option that stores the table of the documentation."""
    parser.add_argument("--docs", action="store_true", help="store the table of docs/; then: make docs-tables")


def write_json(path: Path | None, parts: Mapping[str, Sequence[Any]]) -> None:
    """Dataclasses by part, where numbers are asked for."""
    if path is not None:
        text = json.dumps({key: [asdict(row) for row in rows] for key, rows in parts.items()}, indent=1)
        path.write_text(text + "\n", encoding="utf-8")


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]], *, text: int = 1) -> str:
    """A Markdown table; the first `text` columns are words, the others numbers."""
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * text + "---:|" * (len(heads) - text)]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def print_table(heads: Sequence[str], rows: Iterable[Sequence[str]], *, text: int = 1) -> None:
    """Print a Markdown table."""
    print("\n" + markdown(heads, rows, text=text))


def show_table(
    name: str, heads: Sequence[str], rows: Iterable[Sequence[str]], *, text: int = 1, docs: bool = False
) -> None:
    """Print a table of the documentation, and store it where `docs` is asked for."""
    cells = [list(row) for row in rows]
    print_table(heads, cells, text=text)
    if docs:
        table = StoredTable(_command(), _today(), list(heads), cells, text)
        STORED.mkdir(exist_ok=True)
        written = yaml.safe_dump(
            asdict(table), sort_keys=False, allow_unicode=True, width=1000, default_flow_style=None
        )
        (STORED / f"{name}.yaml").write_text(written, encoding="utf-8")


def stored(name: str) -> StoredTable:
    """A stored table. Raises FileNotFoundError for one that was never measured."""
    return StoredTable(**yaml.safe_load((STORED / f"{name}.yaml").read_text(encoding="utf-8")))


def stored_table(name: str) -> str:
    """The Markdown of a stored table. Raises FileNotFoundError for one that was never measured."""
    table = stored(name)
    return markdown(table.heads, table.rows, text=table.text)


def _command() -> str:
    module = "benchmarks" if (spec := sys.modules["__main__"].__spec__) is None else spec.name.removesuffix(".__main__")
    typed = [word if word.startswith("-") else Path(word).name for word in sys.argv[1:] if word != "--docs"]
    return " ".join(["python -m", module, *typed])


def _today() -> str:
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()
    return f"{datetime.now(UTC):%Y-%m-%d}, {commit}"
