"""Who holds a UDP port: from made process tables, and from this very machine."""

import os
import socket
from pathlib import Path

from retarget.live.port_holder import port_holder

HEAD = (
    "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode ref pointer drops"
)
ROW = " 1: {address}:{port:04X} 00000000:0000 07 00000000:00000000 00:00000000 00000000  1000        0 {inode} 2 0 0"


def processes(folder: Path) -> Path:
    (folder / "net").mkdir()
    (folder / "net/udp").write_text("\n".join([HEAD, ROW.format(address="0100007F", port=39539, inode=77), "odd"]))
    (folder / "net/udp6").write_text("\n".join([HEAD, ROW.format(address="0" * 32, port=9000, inode=78)]))
    for number, inode in ((12, 77), (345, 78), (346, 99)):
        (folder / str(number) / "fd").mkdir(parents=True)
        (folder / str(number) / "fd/3").symlink_to(f"socket:[{inode}]")
        (folder / str(number) / "cmdline").write_bytes(b"/opt/studio\0--port\0" + str(number).encode() + b"\0")
    return folder


def test_the_holder_is_found_by_its_socket(tmp_path: Path) -> None:
    tables = processes(tmp_path)
    assert port_holder(39539, tables) == "process 12 (studio --port 12)"
    assert port_holder(9000, tables) == "process 345 (studio --port 345)"


def test_tcp_has_tables_of_its_own(tmp_path: Path) -> None:
    tables = processes(tmp_path)
    assert port_holder(39539, tables, protocol="tcp") == "another process"
    (tables / "net/tcp").write_text("\n".join([HEAD, ROW.format(address="0100007F", port=39539, inode=99)]))
    assert port_holder(39539, tables, protocol="tcp") == "process 346 (studio --port 346)"


def test_what_cannot_be_seen_is_said(tmp_path: Path) -> None:
    assert port_holder(39539, tmp_path) == "another process"
    tables = processes(tmp_path)
    assert port_holder(1, tables) == "another process"
    (tables / "12/fd/3").unlink()
    assert port_holder(39539, tables) == "another process"


def test_this_process_is_found() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as held:
        held.bind(("127.0.0.1", 0))
        assert f"process {os.getpid()}" in port_holder(held.getsockname()[1])
