"""The control socket: words in, lines out; for its owner only; no input raises, and polling never waits."""

import os
import random
import socket
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from messages import refuses
from retarget.errors import UsageError
from retarget.run.control_socket import MAX_LINE, MOST_CLIENTS, ControlSocket, connect_to, socket_path


class Words:
    """Records the words, and answers with them."""

    def __init__(self) -> None:
        self.received: list[str] = []

    def __call__(self, word: str) -> str:
        self.received.append(word)
        return f"ok {word}"


@pytest.fixture
def place(tmp_path: Path) -> Path:
    return tmp_path / "control"


@pytest.fixture
def server(place: Path) -> Iterator[ControlSocket]:
    with ControlSocket(place) as made:
        yield made


def test_a_word_is_obeyed_and_answered(server: ControlSocket, place: Path) -> None:
    words = Words()
    server.poll(words)
    with connect_to(place) as client:
        client.sendall(b"stop\nsta")
        server.poll(words)
        assert client.recv(100) == b"ok stop\n"
        client.sendall(b"tus\r\n")
        server.poll(words)
        assert client.recv(100) == b"ok status\n"
    server.poll(words)
    assert words.received == ["stop", "status"] and not server._clients


def test_the_word_of_a_client_that_leaves_at_once_is_received(server: ControlSocket, place: Path) -> None:
    words = Words()
    with connect_to(place) as client:
        client.sendall(b"stop\n")
    server.poll(words)
    assert words.received == ["stop"]


def test_only_its_owner_may_connect_and_it_is_gone_afterwards(place: Path) -> None:
    before = os.umask(0)
    try:
        with ControlSocket(place):
            assert stat.S_IMODE(place.stat().st_mode) == 0o600
            assert os.umask(0) == 0
    finally:
        os.umask(before)
    assert not place.exists()


def test_a_stale_socket_is_replaced_and_one_in_use_is_not(place: Path) -> None:
    stale = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    stale.bind(str(place))
    stale.close()
    with ControlSocket(place) as server:
        with refuses(UsageError):
            ControlSocket(place)
        words = Words()
        with connect_to(place) as client:
            client.sendall(b"stop\n")
            server.poll(words)
            server.poll(words)
        assert words.received == ["stop"]


def test_what_cannot_be_a_socket_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    with refuses(UsageError):
        ControlSocket(tmp_path / "file")
    assert (tmp_path / "file").exists()
    with refuses(UsageError):
        ControlSocket(tmp_path / "gone/control")
    with refuses(UsageError, 200, allowed=107):
        socket_path("x" * 200)
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    with refuses(UsageError, "XDG_RUNTIME_DIR"):
        socket_path("usual")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert socket_path(None) == socket_path("usual") == tmp_path / "retarget.sock"


def test_a_client_without_an_end_of_line_is_disconnected(server: ControlSocket, place: Path) -> None:
    words = Words()
    with connect_to(place) as client:
        for _ in range(10):
            try:
                client.sendall(b"x" * MAX_LINE)
            except OSError:
                break
            server.poll(words)
        assert not words.received and not server._clients
    with connect_to(place) as client:
        client.sendall(b"y" * (MAX_LINE + 1) + b"\nstop\n")
        server.poll(words)
        assert client.recv(100) == b"error: too long\nok stop\n" and words.received == ["stop"]


def test_silent_clients_keep_no_other_out(server: ControlSocket, place: Path) -> None:
    words = Words()
    silent = []
    for _ in range(3 * MOST_CLIENTS):
        silent.append(connect_to(place))
        server.poll(words)
    assert len(server._clients) == MOST_CLIENTS
    with connect_to(place) as client:
        client.sendall(b"stop\n")
        server.poll(words)
        assert client.recv(100) == b"ok stop\n"
    for one in silent:
        one.close()


def test_a_client_that_does_not_read_is_disconnected(server: ControlSocket, place: Path) -> None:
    client = connect_to(place)
    client.settimeout(0.0)
    for _ in range(20_000):
        try:
            client.send(b"s\n" * 8)
        except OSError:
            break
        server.poll(lambda word: "x" * 200)
    assert not server._clients
    client.close()


def test_no_input_raises_and_memory_is_bounded(server: ControlSocket, place: Path) -> None:
    chance, words = random.Random(5), Words()
    clients: list[socket.socket] = []
    for _ in range(600):
        if chance.random() < 0.2:
            clients.append(connect_to(place))
        if clients:
            one = chance.choice(clients)
            try:
                one.settimeout(0.0)
                one.send(chance.randbytes(chance.randrange(1, 300)) + chance.choice([b"", b"\n", b"\0\n"]))
            except OSError:
                clients.remove(one)
                one.close()
        if chance.random() < 0.1 and clients:
            clients.pop(chance.randrange(len(clients))).close()
        server.poll(words)
        assert len(server._clients) <= MOST_CLIENTS
        assert all(len(rest) <= MAX_LINE for rest in server._clients.values())
    assert words.received and all(len(word) <= MAX_LINE for word in words.received)
    for one in clients:
        one.close()
