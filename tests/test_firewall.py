"""Firewalls by their files."""

from pathlib import Path

from doctor_rig import text_of
from retarget.doctor.firewall import firewall_findings
from support.messages import shows


def test_what_is_there_is_told_with_its_command(tmp_path: Path) -> None:
    (tmp_path / "etc/ufw").mkdir(parents=True)
    (tmp_path / "etc/ufw/ufw.conf").write_text("ENABLED=yes\n")
    (tmp_path / "run/firewalld").mkdir(parents=True)
    (tmp_path / "proc").mkdir()
    (tmp_path / "proc/version").write_text("Linux 5.15 Microsoft")
    (tmp_path / ".dockerenv").touch()
    text = text_of(firewall_findings(39_539, root=tmp_path))
    for part in ("sudo ufw allow 39539/udp", "--add-port=39539/udp", "mirrored", "-p 39539:39539/udp", "Windows"):
        assert part in text


def test_one_that_is_off_is_not_blamed(tmp_path: Path) -> None:
    (tmp_path / "etc/ufw").mkdir(parents=True)
    (tmp_path / "etc/ufw/ufw.conf").write_text("ENABLED=no\n")
    text = text_of(firewall_findings(9_763, protocol="tcp", root=tmp_path))
    shows(text, "TCP", 9763)
