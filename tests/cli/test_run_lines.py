"""A run prints at most 12 lines on a terminal, stdout and stderr together, however long it goes on: all else is
counted, and is printed with --verbose."""

from collections.abc import Callable
from pathlib import Path

import pytest

from messages import shows
from retarget.cli import main
from retarget.cli.application import HOLDS, MOST_LINES, RunLines
from retarget.cli.exit import DONE, STOPPED
from retarget.sources.streams.raw_record import RawWriter
from sim.faults.sender import FakeSender

EACH_S, GAP_S = 2.0, 0.6
"""A drop-out of so long in each so many seconds."""


def dropping_out(path: Path, count: int) -> str:
    """Address of a stream that drops out so often, after 4 s in which the performer is measured and approached."""
    writer, sender = RawWriter(path, url="json://:14150"), FakeSender()
    for tick in range(round(100 * (5.0 + count * EACH_S))):
        now = 0.01 * tick
        lost = now > 4.0 and (now - 4.0) % EACH_S > EACH_S - GAP_S
        for datagram in sender.poll(now):
            if not lost:
                address, port = datagram.source
                writer.append(datagram.payload, time_ns=round(1e9 * datagram.arrival), address=address, port=port)
        writer.flush()
    writer.close()
    return f"replay://{path}"


@pytest.fixture
def printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., list[str]]:
    """The lines of a command on a terminal: those of stderr, then those of stdout."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("retarget.cli.run.has_terminal", lambda: True)

    def of(*words: object) -> list[str]:
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main([str(word) for word in words])
        out, err = capsys.readouterr()
        assert left.value.code in (DONE, STOPPED), err
        return [*err.splitlines(), *out.splitlines()]

    return of


FILE = ("run", "--robot", "op3", "--source", "sample", "--end", "2")
RUNS = {
    "file": FILE,
    "file with results": (*FILE, "--report", "report", "--save", "run.npz", "--plots", "plots"),
    "physics": (*FILE, "--bus", "physics"),
    "physics with perturbations": (*FILE, "--bus", "physics", "--perturb", "push", "--perturb", "latency"),
    "emulator": (*FILE, "--bus", "emulator"),
    "scene": ("run", "--robot", "poppy", "--source", "sample", "--scene", "table", "--end", "2"),
    "human": ("run", "--robot", "human", "--source", "sample", "--end", "2"),
    "demo": ("demo", "--out", "out"),
}


@pytest.mark.long
@pytest.mark.parametrize("run", RUNS)
def test_every_kind_of_run(run: str, printed: Callable[..., list[str]]) -> None:
    lines = printed(*RUNS[run])
    assert len(lines) <= MOST_LINES, "\n".join(lines)


def test_a_replay(printed: Callable[..., list[str]]) -> None:
    pytest.importorskip("mcap", reason="the extra 'record' is not installed (make test installs it)")
    assert (
        len(printed("run", "--robot", "op3", "--source", "sample", "--end", "0.5", "--record", "r.mcap")) <= MOST_LINES
    )
    assert len(printed("replay", "r.mcap")) <= MOST_LINES
    assert len(printed("replay", "r.mcap", "--goals", "--bus", "mock")) <= MOST_LINES


@pytest.mark.parametrize("count", [12, pytest.param(100, marks=pytest.mark.long)])
def test_a_stream_that_drops_out_again_and_again(count: int, tmp_path: Path, printed: Callable[..., list[str]]) -> None:
    source = dropping_out(tmp_path / "gaps.raw", count)
    robot = "op3" if count < 100 else "human"  # whose run takes a third of the time
    words = ("run", "--robot", robot, "--source", source, "--countdown", "1")
    lines = printed(*words)
    assert len(lines) <= MOST_LINES, "\n".join(lines)
    assert sum(line.startswith(HOLDS) for line in lines) == 1
    shows(next(line for line in lines if line.startswith("held ")), f"{count} times", "--verbose")
    verbose = printed(*words, "--verbose")
    assert sum(line.startswith(HOLDS) for line in verbose) > 1


def test_an_hour_of_notices_is_a_few_lines_and_a_count(capsys: pytest.CaptureFixture[str]) -> None:
    lines = RunLines()
    for text in ("stand still", "note: one", "note: two", "note: three", "measured: 1.75 m tall"):
        lines.notify(text)
    lines.moving = True
    for count in range(3600):
        lines.notify(f"l_wrist: nothing that can be used for 0.{count % 10} s ({count} times so far)")
        lines.notify(f"sender {count}")
        lines.notify(f"{HOLDS}: the robot holds")
    lines.log("stopping")
    err = capsys.readouterr().err.splitlines()
    assert len(err) == MOST_LINES - 5 + 1 and sum(line.startswith(HOLDS) for line in err) == 1
    assert lines.kept_back == 3 * 3600 + 1 - (len(err) - 5)
