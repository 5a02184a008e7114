"""The command line's frame: help, version, exit codes and the boundary where errors become messages."""

import errno
import importlib
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import pytest
from rich.table import Table

from command_line import Typed, code_of, said_by
from hardware.clock import MonotonicClock
from hardware.errors import RetargetError, TorqueError
from messages import mentions, shows
from retarget import cli
from retarget.cli import controls
from retarget.cli.application import console, log, progress_bar
from retarget.cli.controls import WORDS, ControlRequest, ControlSocket, LiveStatus
from retarget.cli.exit import DEFECT, DONE, INTERRUPTED, LEAST_MEMORY, REFUSED, STOPPED, exit_code_of
from retarget.cli.run import USUAL_OPTIONS
from retarget.cli.stop import sent
from retarget.schema.catalogue import shipped_folder
from retarget.sources.open import open_source


def test_help_lists_every_command_and_exit_code_and_imports_no_command(done: Typed) -> None:
    before = set(sys.modules)
    shown = done("--help")
    assert all(name in shown for name in cli.COMMANDS)
    assert not {f"retarget.cli.{name}" for name in cli.COMMANDS} & (set(sys.modules) - before)
    codes = " ".join(shown.split()).split("Exit codes:")[1]
    assert all(f"{code} " in codes for code in (DONE, STOPPED, REFUSED, DEFECT, INTERRUPTED))


def test_the_help_of_a_command_has_headings_and_fits_a_screen(monkeypatch: pytest.MonkeyPatch, done: Typed) -> None:
    shown = done("run", "--help-all")
    assert shown.index("retarget run session.yaml --speed 0.5") < shown.index("Robot:") < shown.index("--bus NAME|PORT")
    assert shown.index("Live streams:") < shown.index("--person") < shown.index("Results:") < shown.index("--report")
    assert max(map(len, shown.splitlines())) > 150, "in a pipe nothing is wrapped"
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    lines = done("run", "--help").splitlines()
    assert len(lines) <= 24 and max(map(len, lines)) <= 80 and lines[-1] == "more: --help-all"
    assert all(any(line.startswith(f"  {option} ") for line in lines) for option in USUAL_OPTIONS["run"])
    lines = done("run", "--help-all").splitlines()
    assert len(lines) <= 100 and max(map(len, lines)) <= 80
    assert not any("--no-mirror" in line for line in lines), "the opposites of switches go without saying"


@pytest.mark.long
def test_a_process_of_its_own_starts_fast_and_a_shared_one_is_left_alone() -> None:
    code = "import atexit, gc, sys; from retarget.cli import main; sys.argv = ['retarget', 'check', 'op3']\n"
    shown = "gc.get_threshold()[0] > 10_000, gc.get_freeze_count() > 0, 'glfw' in sys.modules"
    code += f"atexit.register(lambda: print({shown}))\n"
    for call, said in (("main()", "True True False"), ("main(['robots'])", "False False False")):
        result = subprocess.run([sys.executable, "-c", code + call], capture_output=True, text=True, timeout=60)
        assert (result.returncode, result.stdout.splitlines()[-1]) == (0, said), result.stderr


EVIL = "a\x1b[31m\x9b\u202e.bvh"
SPELLED = r"a\x1b[31m\x9b\u202e.bvh"


def test_no_name_of_a_file_acts_on_the_terminal(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / EVIL).write_text("HIERARCHY")
    for words in (["inspect", tmp_path / EVIL], ["check", EVIL], ["run", "--robot", EVIL, "--source", "sample"]):
        assert code_of(*words) == REFUSED
        shown = capfd.readouterr().err
        assert SPELLED in shown and shown.replace("\n", "").isprintable()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.stderr, "isatty", lambda: True)
        patch.setattr(sys.stdout, "isatty", lambda: True)
        patch.setenv("TERM", "xterm")
        console().print(EVIL, highlight=False)
        with progress_bar(EVIL, 10) as show:
            show(5)
            log(EVIL)
    out, err = capfd.readouterr()
    assert SPELLED in out and SPELLED in err and err.count(SPELLED[:9]) > 2, "the bar is cut where it is too wide"
    assert not any(code in out + err for code in (EVIL[:6], "\x9b", "\u202e"))
    assert "\x1b" in err, "the codes of the bar itself pass"
    assert exit_code_of(Mock(side_effect=AssertionError(EVIL))) == DEFECT
    shown = capfd.readouterr().err
    assert SPELLED in shown and "\x1b" not in shown


def test_too_little_memory_is_one_message(capsys: pytest.CaptureFixture[str]) -> None:
    load = Mock(side_effect=ImportError("libmujoco.so: failed to map segment from shared object"))
    allocate = Mock(side_effect=OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)))
    for lacking in (lambda: bytearray(1 << 60), load, allocate):
        assert exit_code_of(lacking) == REFUSED
        shown = capsys.readouterr().err
        mentions(shown, "too little memory", "700 MB or more", "ulimit -v unlimited")
        assert len(shown.splitlines()) == 1
    assert exit_code_of(lambda: importlib.import_module("no_such_module")) == DEFECT


def test_a_run_does_not_begin_on_too_little_memory(tmp_path: Path) -> None:
    """The limit is far above what the command needs to say so, and below what a run may take."""
    limit = LEAST_MEMORY - 1_000_000
    code = f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({limit}, {limit}))\n"
    code += "from retarget.cli import main; main()"
    words = ["run", "--robot", "op3", "--source", "sample", "--end", "1", "--save", str(tmp_path / "a.npz")]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60)
    assert done.returncode == REFUSED and not [*tmp_path.iterdir()], done.stderr
    assert "Traceback" not in done.stderr and len(done.stderr.splitlines()) == 1
    mentions(done.stderr, "too little memory", "699 MB", "700 MB", "ulimit -v")


def interrupted() -> None:
    raise KeyboardInterrupt


def interrupted_import() -> None:
    try:
        interrupted()
    except KeyboardInterrupt as error:
        raise ImportError("initialization failed") from error


def refused_because_of_an_interrupted_import() -> None:
    try:
        interrupted_import()
    except ImportError:
        raise RetargetError("C3D needs ezc3d: install it") from None


def torque_on_after_an_interrupt() -> None:
    try:
        interrupted()
    except KeyboardInterrupt as error:
        raise TorqueError("port gone (cut the power)") from error


@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        (Mock(side_effect=RetargetError("robot.yaml:3: inverted")), REFUSED, "error: robot.yaml:3: inverted\n"),
        (Mock(side_effect=TorqueError("cut the power")), STOPPED, "error: cut the power\n"),
        (torque_on_after_an_interrupt, STOPPED, "error: port gone (cut the power)\n"),
        (interrupted, 130, "interrupted\n"),
        (interrupted_import, 130, "interrupted\n"),
        (refused_because_of_an_interrupted_import, 130, "interrupted\n"),
    ],
    ids=["refusal", "torque", "torque and interrupt", "interrupt", "import", "refusal of import"],
)
def test_every_end_but_a_defect_is_one_message(
    command: Callable[[], None], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code_of(command) == code
    assert capsys.readouterr().err == said


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_to_end_is_an_interrupt_too(number: signal.Signals, capsys: pytest.CaptureFixture[str]) -> None:
    closed: list[bool] = []
    signal.signal(number, signal.SIG_DFL)  # a shell that starts the tests in the background ignores some

    def command() -> None:
        try:
            signal.raise_signal(number)
        finally:
            closed.append(True)

    assert exit_code_of(command) == INTERRUPTED
    assert capsys.readouterr().err == "interrupted\n" and closed == [True]
    assert signal.getsignal(number) is signal.SIG_DFL


def test_nothing_of_weight_is_imported_before_main() -> None:
    code = "import sys, retarget.cli; print('typer' in sys.modules, 'numpy' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert result.stdout.split() == ["False", "False"]


def test_a_defect_shows_its_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code_of(lambda: 1 // 0) == DEFECT
    shown = capsys.readouterr().err
    assert "ZeroDivisionError" in shown
    shows(shown)


def test_a_table_in_a_pipe_has_no_blanks_at_the_ends_of_lines(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("a", "b", box=None)
    table.add_row("short", "a much longer text")
    table.add_row("a longer name", "short")
    console().print(table)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3 and lines == [line.rstrip() for line in lines]


# `retarget demo`: works on its own, and leaves a report, a recording and pictures.


def cut_sample(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    whole = open_source("sample")
    monkeypatch.setattr("retarget.cli.run.open_source", lambda name: whole.cut(0.0, seconds))


@pytest.mark.long
def test_the_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: Typed) -> None:
    cut_sample(monkeypatch, 4.0)
    monkeypatch.chdir(tmp_path)
    out = done("demo")
    folder = tmp_path / "out" / "demo"
    names = {path.name for path in folder.iterdir()}
    assert names == {"report.json", "report.html", "run.npz", "tracking.png", "angles.png", "balance.png", "poses.png"}
    page = (folder / "report.html").read_text(encoding="utf-8")
    headings = {"Limits", "Motion", "Poses", "Tracking", "Asked and reached", "Balance", "Joint angles"}
    assert headings <= set(re.findall(r"<h2>(.*?)</h2>", page)) and "✗" not in page
    report = json.loads((folder / "report.json").read_text())
    assert report["frames"] == 121 and report["stop"]["reason"] is None
    assert report["limit_violations"] == {"position": 0, "velocity": 0, "acceleration": 0}
    assert report["hand_path_ratio"] > 0.5
    assert len(out.splitlines()) <= 12 and "out/demo\n" in out
    said = out.splitlines()[-1]
    assert re.fullmatch(r"op3 follows: hands \d+ mm off, nothing touched, .* Open out/demo/report.html", said)


def test_the_demo_of_another_robot_keeps_that_of_the_usual_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cut_sample(monkeypatch, 0.2)
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "mine" / "robot.yaml"
    shutil.copytree(shipped_folder() / "robots" / "poppy", own.parent)
    for robot in ("op3", "poppy", own.parent, own):  # again: the same folder
        assert code_of("demo", "--robot", robot, "--bus", "none") == DONE
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"demo", "demo-poppy", "demo-mine"}
    assert json.loads(Path("out/demo/report.json").read_text())["robot"] == "op3"
    assert code_of("demo", "--robot", "poppy", "--out", "out/demo") == REFUSED, "that is another's"


# `retarget stop` from the command line: confirmed, not confirmed, no run.


@pytest.mark.parametrize(
    ("words", "known", "code", "answer"),
    [
        ((), True, 0, "ok stopping"),
        (("--torque-off",), True, 0, "ok torque off"),
        ((), False, 1, "did not confirm it (error: found 'stop', allowed: torque_off"),
    ],
)
def test_a_run_receives_the_word(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    known: bool,
    code: int,
    answer: str,
) -> None:
    clock, asked, done = MonotonicClock(), list[ControlRequest](), threading.Event()
    server = ControlSocket(tmp_path / "control", status=lambda: LiveStatus(None, True, False, None))
    if not known:
        monkeypatch.setattr(controls, "WORDS", {word: WORDS[word] for word in WORDS if word != "stop"})

    def serve() -> None:
        deadline = clock.now() + 5.0
        while not done.is_set() and clock.now() < deadline:
            asked.extend(kind for kind, _ in server.poll(clock.now()))
            clock.sleep_until(clock.now() + 0.002)

    thread = threading.Thread(target=serve)
    thread.start()
    found = said_by(capsys, "stop", server.path, *words)
    done.set()
    thread.join()
    server.close()
    assert found[0] == code and answer in found[1] + found[2]
    assert asked == ([ControlRequest.TORQUE_OFF if words else ControlRequest.STOP] if known else [])


@pytest.mark.parametrize("words", [("{}",), ("{}", "--torque-off"), ("--torque-off",)])
def test_a_stop_needs_nothing_that_takes_time_to_import(tmp_path: Path, words: tuple[str, ...]) -> None:
    """Where none of these can be imported, the run still receives the word, and its answer is printed."""
    place = tmp_path / "retarget.sock"
    code = (
        "import sys; before = set(sys.modules)\n"
        "import os\n"
        f"sys.modules |= dict.fromkeys({('typer', 'rich', 'numpy', 'pydantic', 'mujoco')!r})\n"
        "sys.argv = ['retarget', 'stop', *sys.argv[1:]]\n"
        "import retarget.cli as cli\n"
        "assert not {'logging', 'typing', 'pathlib'} & set(sys.modules) - before\n"
        "cli.main()"
    )
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(place))
        listener.listen(1)
        listener.settimeout(30.0)
        given = [word.format(place) for word in words]
        process = subprocess.Popen(
            [sys.executable, "-c", code, *given],
            env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        client, _ = listener.accept()
        with client, client.makefile("rwb") as lines:
            word = lines.readline()
            lines.write(b"ok stopping\n")
            lines.flush()
            out, err = process.communicate(timeout=30.0)
    assert word == (b"torque_off\n" if "--torque-off" in words else b"stop\n")
    assert (process.returncode, out) == (DONE, "ok stopping\n"), err


@pytest.mark.parametrize("words", [("a", "b"), ("--torque", "a"), ("-x",), ("--help",)])
def test_words_that_are_no_plain_stop_send_nothing(words: tuple[str, ...]) -> None:
    assert sent(words) is None
