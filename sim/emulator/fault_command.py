"""Faults from a keyboard: one line of words, one change."""

from collections.abc import Callable, Sequence
from pathlib import Path

from retarget.errors import ConfigError, UsageError, suggest
from retarget.strict_yaml import Document, Node, scan
from sim.emulator.fault_file import Buses, FaultEntry, read_fault
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import FaultKind

HELP = (
    "NAME [ID ...] [KEY=VALUE ...] begins a fault (missing 5; flip rate=0.01; unplug end=2), times counted from now; "
    "clear [NAME] ends them; list shows them. Names: " + ", ".join(kind.value for kind in FaultKind)
)
MAX_LINE = 1000
"""Longest line that is read, characters."""

_KEYS = tuple(name for name in FaultEntry.model_fields if name not in ("fault", "ids"))


def obey(line: str, states: dict[str, FaultState], buses: Buses, now: Callable[[], float]) -> str:
    """Carry out one line on the faults of all buses (by name); returns what to say. Never raises for bad words."""
    words = line[:MAX_LINE].split()
    if not words:
        return ""
    try:
        match words:
            case ["help" | "?"]:
                return HELP
            case ["list"]:
                return _shown(states)
            case ["clear", *rest]:
                return _clear(rest, states, now())
        return _begin(words, states, buses, now())
    except (ConfigError, UsageError) as error:
        return f"{error} Type help for help."


def _clear(words: Sequence[str], states: dict[str, FaultState], now: float) -> str:
    kinds: list[FaultKind | None] = [_kind(word) for word in words]
    for state in states.values():
        for kind in kinds or [None]:
            state.clear(now, kind)
    return f"cleared {' '.join(words) or 'all faults'}"


def _begin(words: Sequence[str], states: dict[str, FaultState], buses: Buses, now: float) -> str:
    kind = _kind(words[0])
    data: dict[str, Node] = {"fault": kind.value}
    ids: list[Node] = []
    for word in words[1:]:
        key, equals, text = word.partition("=")
        if equals:
            if key not in _KEYS:
                raise UsageError(
                    "unknown key", found=repr(key), allowed=", ".join(_KEYS), next_step=suggest(key, _KEYS)
                )
            data[key] = _scalar(text)
        else:
            ids.append(_scalar(word))
    if ids:
        data["ids"] = ids
    fault = read_fault(Document(Path("faults"), data, {}), buses)
    for name, state in states.items():
        if (
            fault.bus in (None, name)
            and (not fault.ids or set(fault.ids) & set(buses[name]))
            and not state.add(fault, now)
        ):
            return "too many faults; type clear first"
    return f"{' '.join(words)}: begun"


def _kind(word: str) -> FaultKind:
    names = [kind.value for kind in FaultKind]
    if word not in names:
        raise UsageError("unknown fault", found=repr(word), allowed=", ".join(names), next_step=suggest(word, names))
    return FaultKind(word)


def _scalar(text: str) -> Node:
    """A word as the strict reader of files understands it."""
    return scan(f"value: {text}", Path("faults")).data["value"] if text.isascii() else text


def _shown(states: dict[str, FaultState]) -> str:
    lines = [
        f"{name}: {fault.kind.value}" + "".join(f" {device}" for device in fault.ids)
        for name, state in states.items()
        for fault in state.active
    ]
    return "\n".join(lines) or "no fault"
