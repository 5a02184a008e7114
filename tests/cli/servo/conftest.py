"""The emulated OP3 behind the command line."""

import pytest

from servo_lab import ServoLab


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> ServoLab:
    return ServoLab(monkeypatch, capsys)
