"""What is run: the words of every golden run, as the command line takes them."""

import os
from dataclasses import dataclass
from pathlib import Path

from benchmarks.golden.made_motion import write_clip, write_stream, write_walk

ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")
BUSES = ("mock", "emulator", "physics")
CLIP = Path("mocap/cmu_asfamc/02_06.amc")
STREAM = Path("streams/slimevr/full12_vmc_50hz.udprec.gz")
LIVE_END = ("--end", "2.5")
"""s of following."""
FAULT_ROWS = (
    "datagrams reordered and repeated",  # goes on
    "flood",  # goes on, or holds
    "wrist lost",  # the sensor takes no part
    "stream silent",  # holds
    "stream silent for a while",  # holds, and goes on by itself
    "sender's clock jumps forward",  # follows the new clock
    "solver not finite",  # brakes and stands; does not begin, torque off
    "servo warm",  # goes on at half its speed
    "SIGINT or SIGTERM",  # stops
    "every answer damaged",  # torque off at once; does not begin, nothing written
    "kill -9",  # the servos stop by themselves
    "clearance below margin",  # what is asked is not sent
)
"""One row of the fault table for each reaction that it knows."""
STOP_FAULT = "faults:\n  - {fault: over_temperature, ids: [5], start: 8.5}\n"
"""A servo that is too hot, about 1.5 s after following began: OP3 stops, goes to rest, and ends with exit code 1."""


@dataclass(frozen=True)
class Run:
    """One run. words: what stands behind `retarget`, but for --save and --report. wire: its bytes are kept.

    saves: it is a `run`, which writes its numbers and every tick; else it is a `faults`, which prints verdicts.
    """

    name: str
    words: tuple[str, ...]
    wire: bool = False
    saves: bool = True


@dataclass(frozen=True)
class Sources:
    """Words that name each source. clip: with its start and end; streams: by robot; faults: the file of STOP_FAULT.

    notes: what is not as it is where all recorded data are at hand.
    """

    clip: tuple[str, ...]
    streams: dict[str, tuple[str, ...]]
    faults: Path
    notes: tuple[str, ...]


def found_sources(folder: Path, root: Path) -> Sources:
    """Recorded data from `../shared`, or RETARGET_SHARED; what is missing there is made, into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    faults = folder / "stop.yaml"
    faults.write_text(STOP_FAULT, encoding="utf-8")
    made_stream: tuple[str, ...] = ("--source", f"replay://{write_stream(folder / 'stream.rec')}", *LIVE_END)
    shared = Path(os.environ.get("RETARGET_SHARED", str(root.parent / "shared"))).resolve()
    notes: list[str] = []
    clip: tuple[str, ...] = ("--source", str(shared / CLIP), "--start", "2", "--end", "4.5")
    if not (shared / CLIP).is_file():
        clip = ("--source", str(write_clip(folder / "clip.bvh")), "--end", "2.5")
        notes.append(f"no {CLIP.name} in {shared}: the clip is a made one")
    streams = dict.fromkeys(ROBOTS, made_stream)
    if (shared / STREAM).is_file():
        recorded: tuple[str, ...] = ("--source", f"replay://{shared / STREAM}", "--performer", "three", *LIVE_END)
        # The recording is over before Poppy, which approaches slowly, could follow anything of it.
        streams = {robot: made_stream if robot == "poppy" else recorded for robot in ROBOTS}
    else:
        notes.append(f"no {STREAM.name} in {shared}: every stream is a made one")
    return Sources(clip, streams, faults, tuple(notes))


def full_matrix(sources: Sources) -> list[Run]:
    """Every golden run, those that take longest first."""
    runs = [
        _followed(f"{robot} {kind} {bus}", robot, bus, words)
        for bus in reversed(BUSES)
        for robot in ROBOTS
        for kind, words in (("clip", sources.clip), ("stream", sources.streams[robot]))
    ]
    made = sources.streams["poppy"]
    runs.append(_followed("op3 five sensors emulator", "op3", "emulator", made))
    runs.append(_followed("op3 stopped emulator", "op3", "emulator", (*sources.clip, "--faults", str(sources.faults))))
    runs += [
        _followed(f"op3 {scene} mock", "op3", "mock", (*sources.clip, "--scene", scene))
        for scene in ("wall", "crossing_ball")
    ]
    runs.append(_followed("op3 clip physics+wire", "op3", "physics+wire", sources.clip))
    runs.append(_followed("op3 upper mirrored mock", "op3", "mock", (*sources.clip, "--parts", "upper", "--mirror")))
    runs += [_human(priorities, sources.clip) for priorities in ("paper", "human")]
    faults = [_faults(row, "--row", row) for row in FAULT_ROWS]
    faults.append(_faults("at random", "--no-rows", "--seeds", "1", "--seconds", "5"))
    return [*faults, *runs]


def small_matrix(folder: Path) -> list[Run]:
    """What `make test` holds against stored values: no recorded data, no physics, and seconds, not minutes."""
    folder.mkdir(parents=True, exist_ok=True)
    clip = ("--source", str(write_clip(folder / "clip.bvh")), "--end", "1.5")
    stream = ("--source", f"replay://{write_stream(folder / 'stream.rec')}", "--end", "1")
    return [
        _followed("op3 stream emulator", "op3", "emulator", stream),
        *(_followed(f"{robot} clip mock", robot, "mock", clip) for robot in ("poppy", "toddlerbot", "wolfgang")),
        _followed(
            "op3 walk mock", "op3", "mock", ("--source", str(write_walk(folder / "walk.bvh")), "--steps", "walk")
        ),
        _human("paper", clip),
    ]


def _followed(name: str, robot: str, bus: str, words: tuple[str, ...]) -> Run:
    return Run(name, ("run", "--robot", robot, "--bus", bus, *words), wire=bus in ("emulator", "physics+wire"))


def _faults(name: str, *words: str) -> Run:
    return Run(f"faults {name}", ("faults", *words), wire=True, saves=False)


def _human(priorities: str, words: tuple[str, ...]) -> Run:
    return Run(f"human {priorities}", ("run", "--robot", "human", "--priorities", priorities, *words))
