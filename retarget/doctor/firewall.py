"""What may stand between a sender and a port of this machine: its firewalls, a container, a virtual machine."""

from contextlib import suppress
from pathlib import Path
from typing import Literal

from retarget.doctor.finding import Finding, note

__all__ = ["firewall_findings"]

ROOT = Path("/")
SUBJECT = "firewall"


def firewall_findings(port: int, *, protocol: Literal["udp", "tcp"] = "udp", root: Path = ROOT) -> list[Finding]:
    """Which are there, as far as files that anybody may read tell, and the command that opens the port."""
    found = []
    if "ENABLED=yes" in _text(root / "etc/ufw/ufw.conf"):
        found.append(note(SUBJECT, "ufw is on", f"Open the port: sudo ufw allow {port}/{protocol}"))
    if (root / "run/firewalld").is_dir():
        step = f"Open the port: sudo firewall-cmd --add-port={port}/{protocol}"
        found.append(note(SUBJECT, "firewalld runs", step))
    if "microsoft" in _text(root / "proc/version").lower():
        step = "Set networkingMode=mirrored in .wslconfig, and open the port in Windows Defender Firewall"
        found.append(note(SUBJECT, "this is WSL, which the network does not reach by itself", step))
    if (root / ".dockerenv").exists() or (root / "run/.containerenv").exists():
        step = f"Start it with --network host, or with -p {port}:{port}/{protocol}"
        found.append(note(SUBJECT, "this is a container, which the network does not reach by itself", step))
    if not found:
        step = f"sudo nft list ruleset shows what lets {protocol.upper()} port {port} in"
        found.append(note(SUBJECT, "no ufw and no firewalld here; other rules can only be seen by root", step))
    sender = "On a sender with Windows, allow its program in Windows Defender Firewall, for private and public networks"
    found.append(note(SUBJECT, "the sender's computer has one too", sender))
    return found


def _text(path: Path) -> str:
    with suppress(OSError):
        return path.read_text(encoding="utf-8", errors="replace")[:4096]
    return ""
