"""Pages of results: keys of a report, formats of an export, and every measured table."""

from benchmarks.table import STORED, stored, stored_table
from model_tables import docstrings_below
from retarget.recording.exports.formats import format_table
from retarget.report.report import Report

CAPTIONS = {
    "shipped-robots": "The shipped robots follow recordings. Mock servos, speed 1, as sent: angles between the "
    "limbs of robot and performer, in brackets the mean that the joints would allow; the worse hand from its shoulder; "
    "and how far feet, pelvis and heading went of the performer's.",
    "standing": "Which motions stand. Whole runs of OP3 in physics, the path to rest included, at speed 1.",
    "robustness": "OP3 through 02_06 at half speed under perturbations, 50 seeds of each kind.",
    "walking": "OP3 walks with performers in physics: m and degrees of those asked, by the length of the leg.",
    "hanging": "OP3 on a gantry at speed 1: mean error of head, pelvis and soles, lag included.",
    "ends": "Ends of runs in simulation, with mass: with and without the table, as planned, with masses, centre of "
    "mass, friction and latency drawn, and with servos 0.6 as stiff. A third ended with the motion, the others were "
    "stopped at a tick drawn.",
    "collisions": "OP3 in 27 recordings, with a table and a post put where the hands go, judged by MuJoCo.",
    "unsensed": "Reconstruction from few sensors: mean distance, mm, from the recorded ones of pelvis, knees, elbows, "
    "shoulders and neck, of those that wear no sensor.",
    "judged": "OP3 at 30 Hz: runs on the mock bus beside a fit that solves each frame alone (weighted least squares to "
    "the same landmarks within the joints' ranges, soles flat, a pull to the stance).",
    "paper": "The paper's experiments 1 to 3. Distances in mm, negative inside; in brackets the frames more than 1 mm "
    "inside. Frames per second are those of a busy machine.",
    "frames": "A frame beside PlaCo and mink, median us; in brackets the mean error of the ankles, mm.",
    "observed": "A frame with collision observers, the same shapes and pairs, damper on all pairs, median us.",
    "obstacles": "A frame with obstacles around the arms of OP3, half of them within influence, us.",
    "tick": "A live tick of OP3: five sensors as JSON, emulated servos.",
    "latency": "Time from a motion of a hand to the shafts, in a live run of five sensors at 90 Hz. The last line "
    "compares what was sent with the shafts, and knows of no stage.",
    "lateness": "Lateness of ticks, in the live loop and in an empty one by turns, at a load of 9.5.",
    "bus": "A cycle of 20 emulated XM430-W350 behind a pseudo-terminal, no wire delay, beside dynamixel-sdk 4.1.0.",
    "physics-speed": "Whole runs of OP3 with mass at half speed.",
}
"""What each table of `docs/tables` shows."""


def measurements_page() -> str:
    """Every measured table, with its command, day and commit."""
    lines = ["# Measurements", "", "Made from `docs/tables`; each table says which command measured it, and when.", ""]
    for name in [*CAPTIONS, *sorted({path.stem for path in STORED.glob("*.yaml")} - CAPTIONS.keys())]:
        table = stored(name)
        lines += [f"## {name.replace('-', ' ').capitalize()}", "", CAPTIONS.get(name, ""), "", stored_table(name), ""]
        lines += [f"`{table.command}`, {table.measured}.", ""]
    return "\n".join(lines)


def report_page() -> str:
    """The keys of a report, from the docstrings of its fields."""
    lines = ["# Keys of a report", "", "`report.json`, in its order. A key is `null` where its value is not known.", ""]
    lines += ["| key | meaning |", "|---|---|"]
    lines += [f"| `{name}` | {' '.join(text.split())} |" for name, text in docstrings_below(Report)]
    return "\n".join([*lines, ""])


def formats_page() -> str:
    """The formats of `retarget export`."""
    return f"# Formats of an export\n\n`retarget export --to FORMAT`.\n\n{format_table()}\n"
