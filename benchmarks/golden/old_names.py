"""What earlier commits call things that have other names now, so that a rename does not end the comparison."""

import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Names:
    """words: what stands on the command line, or in a YAML file of a run. keys: of reports and of saved arrays, and
    names within them (phases, states, priority files). Each from the name of now to the name of then."""

    words: Mapping[str, str] = field(default_factory=dict)
    keys: Mapping[str, str] = field(default_factory=dict)

    def word(self, word: str) -> str:
        """The name of then."""
        return self.words.get(word, word)

    def files(self, words: list[str], folder: Path) -> list[str]:
        """The same words, with YAML files that are written in the names of then, in `folder`."""
        if not self.words:
            return words
        return [str(self._rewritten(Path(word), folder)) if word.endswith(".yaml") else word for word in words]

    def _rewritten(self, path: Path, folder: Path) -> Path:
        text = path.read_text(encoding="utf-8")
        for now, then in self.words.items():
            text = text.replace(f"{now}:", f"{then}:").replace(f": {now},", f": {then},")
        made = folder / path.name
        made.write_text(text, encoding="utf-8")
        return made


OLD_NAMES: dict[str, Names] = {
    "150b0e3": Names(
        words={
            "--perturb": "--trouble",
            "deflection_compensation": "uphold",
            "speed_margin": "reserve",
            "soft_limits": "off_stops",
            "tracking_delay": "late",
            "lead_time": "ahead",
            "following_error_sustained": "following_error_lasting",
            "balanced": "steady",
            "balanced_sustained": "lasting",
            "fixed_base": "held",
            "sender's clock jumps forward": "sender's clock leaps on",
        },
        keys={
            "no_command_frames": "unled_frames",
            "perturbations": "trouble",
            "balanced": "steady",
            "balanced_sustained": "lasting",
            "fixed_base": "held",
        },
    ),
    "77404fc": Names(
        words={
            "datagrams reordered and repeated": "late, reordered, twice",
            "SIGINT or SIGTERM": "SIGINT, SIGTERM",
        }
    ),
}
"""By the last commit that has them: that commit, and all before it. A rename adds an entry, with its parent as the
commit: {"0123abc": Names(words={"--perturb": "--trouble"}, keys={"no_command_frames": "unled_frames"})}."""


def names_in(root: Path, sha: str) -> Names:
    """All old names that a commit has."""
    words: dict[str, str] = {}
    keys: dict[str, str] = {}
    for last, names in OLD_NAMES.items():
        done = subprocess.run(
            ["git", "merge-base", "--is-ancestor", sha, last], cwd=root, capture_output=True, check=False
        )
        if done.returncode == 0:
            words |= names.words
            keys |= names.keys
    return Names(words, keys)
