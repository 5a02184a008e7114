"""The page of the first evening: its commands have the options that it names, and the report has its keys."""

import re
from dataclasses import fields
from pathlib import Path

import pytest
from typer.main import get_command

from messages import shows
from retarget.cli.application import application
from retarget.cli.servo.monitor import TORQUE
from retarget.report.report import BusReport, Report, StopReport

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs/first-evening.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^    retarget (.+)$", PAGE, re.MULTILINE)


def _options(words: list[str]) -> set[str]:
    names = words[:2] if words[0] == "servo" else words[:1]
    command = get_command(application(names))
    for name in names:
        command = command.commands[name]  # type: ignore[attr-defined]
    return {option for parameter in command.params for option in parameter.opts}


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_has_the_options_that_it_is_shown_with(line: str) -> None:
    words = line.split()
    shown = {word for word in words if word.startswith("--")} - {"--help"}
    assert shown <= _options(words)


def test_every_command_of_the_group_has_its_step() -> None:
    shown = {line.split()[1] for line in COMMANDS if line.startswith("servo ")}
    assert shown == {"scan", "setup", "home", "monitor"} and "`retarget servo rest`" in PAGE


def test_what_is_to_be_read_is_in_the_report() -> None:
    parts: dict[str, type] = {"bus": BusReport, "stop": StopReport}
    keys = re.findall(r"`(bus|stop)\.(\w+)`", PAGE)
    assert {("bus", "retries"), ("bus", "hottest"), ("bus", "lowest_voltage")} <= set(keys)
    for part, key in keys:
        assert key in {field.name for field in fields(parts[part])}
    assert "`servo_error_deg`" in PAGE and "servo_error_deg" in {field.name for field in fields(Report)}


def test_every_state_of_torque_is_explained() -> None:
    assert all(f"`{state}`" in PAGE for state in TORQUE.values())


def test_the_list_of_targets_says_what_the_demo_runs_on() -> None:
    lines = (ROOT / "Makefile").read_text(encoding="utf-8").splitlines()
    line = next(line for line in lines if "echo 'make demo" in line)
    shows(line)
    assert "mock" not in line
