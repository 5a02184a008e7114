"""What a message about a motion file advises helps: followed to the letter, the file is accepted, and a run begins."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from command_line import said_by
from messages import mentions
from motion_texts import JOINTS, amc_text, asf_text, bvh_text, c3d_bytes

ARMS = {f"Left{part}": f"Right{part}" for part in ("Shoulder", "Arm", "ForeArm", "Hand")}
CROSSED = ARMS | {right: left for left, right in ARMS.items()}
STRANGE = {name: f"j{place}" for place, (name, _, _) in enumerate(JOINTS)}
"""Names that nobody knows."""


@dataclass(frozen=True)
class Advice:
    """A file that is refused, what the message advises, and what follows it: another content, or options."""

    name: str
    content: str | bytes
    advised: str
    better: str | bytes | None = None
    options: tuple[str, ...] = ()
    beside: Mapping[str, str] | None = None
    """Other files of the folder, that the options name."""


def two_performers() -> str:
    """Two figures in one file."""
    head, motion = bvh_text().split("MOTION\n")
    frames, rate, *rows = motion.splitlines()
    second = head.removeprefix("HIERARCHY\n").replace("ROOT Hips", "ROOT Other").replace("JOINT ", "JOINT other")
    return "\n".join([head + second + "MOTION", frames, rate, *(f"{row} {row}" for row in rows)]) + "\n"


def one_arm_hangs(names: Mapping[str, str] | None = None) -> str:
    """The figure with an arm that hangs at rest: what its names do not say, its shape does not, either."""
    return bvh_text(names=names).replace("OFFSET -29 0 0", "OFFSET 0 -29 0").replace("OFFSET -26 0 0", "OFFSET 0 -26 0")


def renamed_markers() -> tuple[bytes, str]:
    """Markers by names of nobody, and the table that says which they are."""
    groups = {"head": ("LFHD", "RFHD"), "l_wrist": ("LWRA",), "r_wrist": ("RWRA",), "l_ankle": ("LANK",)}
    groups["r_ankle"] = ("RANK",)
    names = {name: f"m{name[1:]}{name[0]}" for group in groups.values() for name in group}
    others = {name: f"x{place}" for place, name in enumerate(("LBHD", "RBHD", "LWRB", "RWRB", "LTOE", "RTOE"))}
    others |= {name: f"y{place}" for place, name in enumerate(("LASI", "RASI", "LPSI", "RPSI"))}
    rows = [f"  {sensor}: [{', '.join(names[name] for name in group)}]" for sensor, group in groups.items()]
    return c3d_bytes(names=names | others), "markers:\n" + "\n".join(rows) + "\n"


MARKERS, TABLE = renamed_markers()
CASES = [
    Advice("two.bvh", two_performers(), "--performer-root Hips", options=("--performer-root", "Hips")),
    Advice("huge.bvh", bvh_text(scale=5.0), "--stature", options=("--stature", "1.75")),
    Advice("crossed.bvh", bvh_text(names=CROSSED), "Exchange the names", bvh_text()),
    Advice("lacks.bvh", one_arm_hangs({"LeftLeg": "omega"}), "rename the joints", one_arm_hangs()),
    Advice("strange.bvh", one_arm_hangs(STRANGE), "Rename the joints to Hips, LeftUpLeg", one_arm_hangs()),
    Advice("count.bvh", bvh_text().replace("CHANNELS 3", "CHANNELS 4", 1), "Correct the number", bvh_text()),
    Advice("time.bvh", bvh_text(frame_time="0"), "0.008333", bvh_text(frame_time="0.008333")),
    Advice("fps.bvh", bvh_text(frame_time="60"), "--rate", options=("--rate", "60")),
    Advice("comma.bvh", bvh_text().replace("OFFSET 0 11 0", "OFFSET 0 1,100.0 0"), "decimal points", bvh_text()),
    Advice("own.c3d", MARKERS, "--markers", options=("--markers", "table.yaml"), beside={"table.yaml": TABLE}),
    Advice("unit.c3d", c3d_bytes(unit="furlong"), "--unit", options=("--unit", "mm")),
    Advice("small.c3d", c3d_bytes(unit="m"), "--unit", options=("--unit", "mm")),
    Advice("lone.amc", amc_text(3), "--skeleton", options=("--skeleton", "b.asf"), beside={"b.asf": asf_text()}),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_what_is_advised_helps(
    case: Advice, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, content in {**(case.beside or {}), case.name: case.content}.items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    code, _, err = said_by(capsys, "inspect", case.name)
    assert code == 2
    mentions(err, case.advised)
    if case.better is not None:
        (tmp_path / case.name).write_bytes(case.better if isinstance(case.better, bytes) else case.better.encode())
    code, out, err = said_by(capsys, "inspect", case.name, *case.options, "--json")
    assert code == 0, err
    assert json.loads(out)["refused"] is None


def test_the_axis_that_a_note_advises_is_taken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "up.bvh"
    path.write_text(bvh_text(root=(0.0, 20.0, 0.0)).replace("0 20 0 0 0 0 ", "0 20 0 0 90 0 "))  # lies on its floor
    heights = []
    for options in ((), ("--up", "z")):
        code, out, err = said_by(capsys, "inspect", path, *options, "--json")
        assert code == 0, err
        said = json.loads(out)
        head = next(sensor for sensor in said["sensors"] if sensor["name"] == "head")
        ankle = next(sensor for sensor in said["sensors"] if sensor["name"] == "l_ankle")
        heights.append(head["highest_m"] - ankle["highest_m"])
        assert any("--up" in note for note in said["notes"])
    assert abs(heights[0]) < 0.5 < 1.2 < heights[1]
