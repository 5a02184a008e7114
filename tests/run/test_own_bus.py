"""`--bus module:Class`: a bus of the user's own is found, checked, and driven as every bus is; another is refused."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hardware.clock import VirtualClock
from hardware.errors import BusError
from hardware.guard_state import StopCause
from messages import shows
from retarget import RunOptions, load_robot, open_source
from retarget.cli import main
from retarget.cli.buses import PhysicsBench
from retarget.human.samples import Playback
from retarget.run.own_bus import OwnBus
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "own_bus.py"
HEAD = "import numpy as np\nfrom dataclasses import replace\nfrom own_bus import MyBus\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The current folder, with the example in it; what is imported from it is forgotten afterwards."""
    shutil.copy(EXAMPLE, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    for name in [*sys.modules]:
        if str(getattr(sys.modules[name], "__file__", None)).startswith(str(tmp_path)):
            del sys.modules[name]


def _run(bus: str) -> RunResult:
    """A second of the sample on virtual time, above the bus of that name."""
    options = RunOptions(robot="op3", bus=bus, parts="upper", playback=Playback(end=1.0))
    bench = PhysicsBench(options, print)
    with prepare(lambda: open_source("sample"), options, clock=VirtualClock(), make_bus=bench.make_bus) as prepared:
        return prepared.run()


def test_a_class_in_the_current_folder_is_driven(folder: Path) -> None:
    run = _run("own_bus:MyBus")
    assert run.stop is None and run.ticks_followed > 100
    assert sys.path[0] != str(folder) and str(folder) in sys.path


def test_what_the_bus_fails_to_do_stops_the_run_as_a_bus_that_fails(folder: Path) -> None:
    code = """
class Failing(MyBus):
    reads = 0
    def read(self):
        self.reads += 1
        if self.reads > 300:
            raise OSError(5, "the adapter is gone")
        return super().read()
"""
    (folder / "mine.py").write_text(HEAD + code)
    stop = _run("mine:Failing").stop
    assert stop is not None and stop.cause is StopCause.BUS
    shows(stop.reason, "mine:Failing.read", "the adapter is gone", "mine.py")


def test_a_servo_that_falls_silent_is_noticed_by_the_guard(folder: Path) -> None:
    code = """
class Silent(MyBus):
    reads = 0
    def read(self):
        self.reads += 1
        states, silent = super().read(), max(0, self.reads - 300)
        valid, age = states.valid.copy(), states.age.copy()
        valid[3], age[3] = not silent, 0.008 * silent
        return replace(states, valid=valid, age=age)
"""
    (folder / "mine.py").write_text(HEAD + code)
    run = _run("mine:Silent")
    assert run.stop is not None and load_robot("op3").joint_map.joints[3] in run.stop.reason


@pytest.mark.parametrize(
    ("bus", "code", "text"),
    [
        ("mine:", "", "this names no class of a bus"),
        ("mi-ne:Bus", "", "this names no class of a bus"),
        ("missing:Bus", "", "no such module; found 'missing:Bus'; allowed: missing.py in this folder"),
        ("mine:Buss", "class Bus(MyBus): ...", "mine has no such class; found 'mine:Buss'; allowed: MyBus, Bus"),
        ("mine:Bus", "class Bus:\n    open = close = print", "this is no ServoBus: it has no read, write, torque"),
        ("mine:Bus", "def Bus(robot, clock): ...", "it is no class"),
        ("mine:Bus", "1 / 0", "its module cannot be imported: ZeroDivisionError: division by zero (mine.py:4)"),
        ("mine:Bus", "import sys; sys.exit()", "its module cannot be imported: SystemExit"),
        ("mine:Bus", "import missing_sdk", "No module named 'missing_sdk'"),
        ("mine:Bus", "class Bus(MyBus):\n    def __init__(self): ...", "Class(robot, clock)"),
    ],
)
def test_what_is_no_bus_is_refused(
    bus: str, code: str, text: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "mine.py").write_text(HEAD + code)
    with pytest.raises(SystemExit) as left:
        main(["run", "--robot", "op3", "--source", "sample", "--bus", bus])
    err = capsys.readouterr().err
    assert left.value.code == 2 and text in err and "Traceback" not in err
    shows(err.replace(str(folder), "FOLDER"))


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("position=states.position[:3]", "position is int64 (3,); allowed: an array of integers, (20,)"),
        ("position=states.position * 1.0", "position is float64 (20,)"),
        ("valid=True", "valid is bool"),
        ("age=None", "age is NoneType"),
    ],
)
def test_states_that_no_run_can_take_are_refused_in_words(code: str, text: str, folder: Path) -> None:
    method = f"    def read(self):\n        states = super().read()\n        return replace(states, {code})\n"
    (folder / "mine.py").write_text(f"{HEAD}class Bus(MyBus):\n{method}")
    bus = OwnBus("mine:Bus", load_robot("op3"), VirtualClock())
    bus.open()
    with pytest.raises(BusError) as caught:
        bus.read()
    shows(str(caught.value), text)


def test_home_reads_a_bus_of_ones_own_and_says_what_opens_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder))
    with pytest.raises(SystemExit) as left:
        main(["servo", "home", "--robot", "op3", "--bus", "own_bus:MyBus", "--dry-run"])
    assert left.value.code in (0, None)
    shows(capsys.readouterr().out, "own_bus:MyBus does it")
    with pytest.raises(SystemExit) as left:
        main(["servo", "home", "--robot", "op3", "--bus", "own_bus:None"])
    assert left.value.code == 2
