"""`retarget stop` from the command line: confirmed, not confirmed, no run."""

import threading
from pathlib import Path

import pytest

from hardware.clock import MonotonicClock
from retarget.cli import main
from retarget.cli.controls import WORDS, Asked, ControlSocket, LiveStatus


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as ended:
        main(["stop", *words])
    code, said = ended.value.code, capsys.readouterr()
    assert isinstance(code, int)
    return code, said.out + said.err


@pytest.mark.parametrize(
    ("words", "known", "code", "said"),
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
    said: str,
) -> None:
    clock, asked, done = MonotonicClock(), list[Asked](), threading.Event()
    server = ControlSocket(tmp_path / "control", status=lambda: LiveStatus(None, True, False, None))
    if not known:
        monkeypatch.delitem(WORDS, "stop")

    def serve() -> None:
        deadline = clock.now() + 5.0
        while not done.is_set() and clock.now() < deadline:
            asked.extend(kind for kind, _ in server.poll(clock.now()))
            clock.sleep_until(clock.now() + 0.002)

    thread = threading.Thread(target=serve)
    thread.start()
    found = run(capsys, "--socket", str(server.path), *words)
    done.set()
    thread.join()
    server.close()
    assert found[0] == code and said in found[1]
    assert asked == ([Asked.TORQUE_OFF if words else Asked.STOP] if known else [])
