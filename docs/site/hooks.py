"""Hooks of mkdocs besides mkdocs.yml: pages that are made, and what Git hosts read unlike Python-Markdown."""

import re
from pathlib import Path, PurePosixPath
from typing import Any

from mkdocs.structure.files import File, Files
from pydantic import BaseModel

from command_pages import command_page
from model_tables import models_below, section
from python_pages import PAGES, python_page
from result_pages import formats_page, measurements_page, report_page
from retarget.run.table import EVERY_S, FIELDS
from retarget.schema.performer import Performer
from retarget.schema.priorities import Priorities
from retarget.schema.profile import RobotProfile
from retarget.schema.scene import Scene
from state_tables import tables_of_states

ROOT = Path(__file__).resolve().parents[2]
MODELS: dict[str, tuple[str, str, type[BaseModel]]] = {
    "reference/robot.md": ("Keys of a robot profile", "`configs/robots/NAME/robot.yaml`", RobotProfile),
    "reference/performer.md": ("Keys of a performer file", "`configs/performers/NAME.yaml`", Performer),
    "reference/priorities.md": ("Keys of a priority file", "`configs/priorities/NAME.yaml`", Priorities),
    "reference/scene.md": ("Keys of a scene file", "`configs/scenes/NAME.yaml`", Scene),
}
"""Pages of keys: title, where such files are, and the model that reads them."""
SHOWN = {"../SECURITY.md": "security.md", "../CHANGELOG.md": "changelog.md"}
"""Files beside docs/ that are pages of the site too."""
LINK = re.compile(r"\]\((\.\./[^)#]+)(#[^)]*)?\)")


def made_pages() -> dict[str, str]:
    """Every page that is made, in Markdown, by its place."""
    pages = {place: _keys(*what) for place, what in MODELS.items()}
    pages |= {place: python_page(place) for place in PAGES}
    pages["reference/command-line.md"] = command_page()
    pages["reference/run-table.md"] = run_table()
    pages["reference/report.md"] = report_page()
    pages["reference/exports.md"] = formats_page()
    pages["reference/measurements.md"] = measurements_page()
    pages["reference/states.md"] = f"# States of a run\n\n{tables_of_states()}\n"
    for path in _scripts():
        pages[f"examples/{path.stem}.md"] = _source(path)
    for beside, place in SHOWN.items():
        pages[place] = (ROOT / "docs" / beside).read_text(encoding="utf-8").replace("](docs/", "](")
    pages["examples.md"] = _examples()
    return pages


def on_config(config: Any) -> Any:
    """Every example has its place in the navigation."""
    entry = next(entry for entry in config.nav if "Examples" in entry)
    entry["Examples"] += [f"examples/{path.stem}.md" for path in _scripts()]
    return config


def on_files(files: Files, *, config: Any) -> Files:
    """Add the pages that are made."""
    for place, text in made_pages().items():
        files.append(File.generated(config, place, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Lead what points out of docs/ to its page here, and write what Git hosts read so that it is read here too."""
    text = first_page(markdown) if page.file.src_uri == "README.md" else markdown
    return captioned(plain_pipes(parted_lists(led_inside(text, page.file.src_uri))))


def first_page(documentation: str) -> str:
    """The list of pages between the top and the end of the README of the root."""
    whole = (ROOT / "README.md").read_text(encoding="utf-8")
    top, _, others = whole.partition("## The first run\n")
    end = others[others.index("## Questions") :]
    around = [text.replace("](docs/", "](").replace("](SECURITY.md", "](../SECURITY.md") for text in (top, end)]
    return f"{around[0]}#{documentation}\n{around[1]}"


def led_inside(markdown: str, place: str) -> str:
    """Links to examples and to files of the root, as links of the site."""
    up = "../" * (len(PurePosixPath(place).parts) - 1)

    def lead(match: re.Match[str]) -> str:
        target, anchor = match[1], match[2] or ""
        if target.startswith("../examples/"):
            return f"]({up}examples/{PurePosixPath(target).stem}.md{anchor})"
        if target == "../README.md":
            return f"]({up}README.md{anchor})"
        return f"]({up}{SHOWN[target]}{anchor})" if target in SHOWN else match[0]

    return LINK.sub(lead, markdown)


def parted_lists(markdown: str) -> str:
    """A blank line before a list that follows a paragraph: Git hosts need none, Python-Markdown does."""
    lines: list[str] = []
    fenced = False
    for line in markdown.split("\n"):
        fenced ^= line.startswith("```")
        before = lines[-1] if lines else ""
        starts = re.match(r"(?:[*-]|\d+\.) ", line) and before.strip()
        if starts and not fenced and not re.match(r"(?:[*-]|\d+\.) |\s", before):
            lines.append("")
        lines.append(line)
    return "\n".join(lines)


def captioned(markdown: str) -> str:
    """The text of each picture below it, as a caption."""
    return re.sub(r"^(!\[(.+)\]\(\S+\))$", r"\1\n<br>*\2*\n", markdown, flags=re.MULTILINE)


def plain_pipes(markdown: str) -> str:
    """`a|b` in a table: Git hosts want the bar escaped, Python-Markdown shows what escapes it."""
    lines = [
        re.sub(r"`[^`]+`", lambda code: code[0].replace("\\|", "|"), line) if line.startswith("|") else line
        for line in markdown.split("\n")
    ]
    return "\n".join(lines)


def _scripts() -> list[Path]:
    return sorted((ROOT / "examples").glob("*.py"))


def _keys(title: str, place: str, model: type[BaseModel]) -> str:
    """A page of keys."""
    head = (
        f"# {title}\n\n{place}. Made from the models that read the file; `retarget check` holds a file against them.\n"
    )
    return "\n".join([head, *(section(one) for one in models_below(model))])


def run_table() -> str:
    """The page of the fields of a run."""
    lines = ["# Fields of a run", "", "A row per tick. Made from the list that the files of a run are made from.", ""]
    lines += ["| field | type | of a row | unit | recording | every | `--save` | tables | meaning |", "|" + "---|" * 9]
    for name, one in FIELDS.items():
        shape, topic = ", ".join(map(str, one.shape)), f"`{one.topic}.{one.key}`" if one.topic else ""
        every = f"{EVERY_S[one.topic]:g} s" if one.topic in EVERY_S else "tick" if topic else ""
        saved, column = (f"`{name}`" if name else "" for name in (one.npz, one.column and f"{one.column}..."))
        kind = "text" if one.dtype.kind == "O" else str(one.dtype)
        cells = [f"`{name}`", kind, shape, one.unit, topic, every, saved, column, one.meaning]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def _source(path: Path) -> str:
    return f"# {path.name}\n\n```python\n{path.read_text(encoding='utf-8')}```\n"


def _examples() -> str:
    """The list of examples, by the first line of each."""
    rows = []
    for path in _scripts():
        first = path.read_text(encoding="utf-8").split('"""')[1].strip().split("\n")[0].replace("|", "\\|")
        rows.append(f"| [{path.name}](examples/{path.stem}.md) | {first} |")
    return "\n".join(
        ["# Examples", "", "Each runs as it stands: `python examples/NAME.py`.", "", "| | |", "|---|---|", *rows, ""]
    )
