"""Pages of the Python reference: which modules, in which order. mkdocstrings fills them from the docstrings."""

import inspect
from dataclasses import dataclass

import retarget

HOMES: dict[str, str] = retarget._HOMES
OPTIONS = "{show_root_heading: false, show_root_toc_entry: false, heading_level: 3}"


@dataclass(frozen=True)
class Page:
    """A page of modules. text: what they are for."""

    title: str
    text: str
    modules: tuple[str, ...]


PAGES = {
    "reference/run.md": Page(
        "Python: a run",
        "From a performer to a finished run: prepared, played, measured, saved; `Pipeline` for a loop of your own.",
        (
            "retarget.pipeline",
            "retarget.run.options",
            "retarget.human.samples",
            "retarget.run.prepare",
            "retarget.run.loop",
            "retarget.run.run_result",
            "retarget.run.record",
            "retarget.run.table",
            "retarget.report.measure",
            "retarget.report.report",
            "retarget.recording.npz",
            "retarget.pictures.plots",
            "retarget.recording.read_run",
            "retarget.recording.reading",
            "retarget.errors",
        ),
    ),
    "reference/performers.md": Page(
        "Python: performers",
        "Sensors, from files and from live streams, and the human that they are made into.",
        (
            "retarget.frames",
            "retarget.sources.open",
            "retarget.sources.streams.stream_frame",
            "retarget.live.begin",
            "retarget.run.own_source",
            "retarget.live.open_stream",
            "retarget.live.stream",
            "retarget.live.admission",
            "retarget.schema.performer",
            "retarget.human.calibration",
            "retarget.model.human_dimensions",
            "retarget.model.human",
            "retarget.human.reconstruction",
            "sim.performer",
        ),
    ),
    "reference/robots.md": Page(
        "Python: robots",
        "Profiles, bodies, priorities, scenes, and who follows.",
        (
            "retarget.schema.profile",
            "retarget.model.robot",
            "retarget.model.body",
            "retarget.setup.import_robot",
            "retarget.schema.priorities",
            "retarget.ik.solver",
            "retarget.ik.hierarchy",
            "retarget.robot.landmarks",
            "retarget.robot.follower",
            "retarget.safety.gate",
            "retarget.model.observers",
            "retarget.schema.scene",
            "retarget.model.scene_state",
            "retarget._solver",
        ),
    ),
    "reference/servos.md": Page(
        "Python: servos",
        "The bus, the guard who alone writes to it, and what stands in for servos.",
        (
            "hardware.bus",
            "hardware.guard_state",
            "hardware.guard",
            "hardware.clock",
            "hardware.servo",
            "hardware.joint_map",
            "hardware.errors",
            "hardware.dynamixel.bus",
            "hardware.no_bus",
            "sim.mock_bus",
            "sim.buses",
        ),
    ),
}
"""By the place of the page."""
PUBLIC = "reference/python.md"
PAGES = {
    PUBLIC: Page(
        "Python: the public names",
        "`from retarget import RunOptions, measure, ...`; everything else is imported from where it lives.",
        (),
    ),
    **PAGES,
}


def python_page(place: str) -> str:
    """The Markdown of a page, for mkdocstrings to fill."""
    page = PAGES[place]
    lines = [f"# {page.title}", "", page.text, ""]
    if place == PUBLIC:
        lines += ["| name | |", "|---|---|"]
        lines += [f"| [`{name}`][{home}.{name}] | {_summary(name)} |" for name, home in sorted(HOMES.items())]
    for module in page.modules:
        lines += [f"## {module}", "", f"::: {module}", f"    options: {OPTIONS}", ""]
    return "\n".join(lines)


def _summary(name: str) -> str:
    """The first paragraph of a public name's docstring."""
    first = (inspect.getdoc(getattr(retarget, name)) or "").split("\n\n")[0]
    return " ".join(first.split()).replace("|", "\\|")
