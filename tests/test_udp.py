"""The socket of a stream: real datagrams over loopback, with the times at which they arrived."""

import socket

import pytest

from datagrams import CLOCK, LOOPBACK, PATIENCE_S, arrived, sending
from hardware.clock import wall_to_monotonic
from retarget.live import udp_socket
from retarget.live.datagram import MOST_BYTES_PER_POLL, MOST_PER_POLL
from retarget.live.udp import UdpReceiver

HOUR_NS = 3_600 * 10**9


def test_datagrams_come_in_order_with_source_and_time() -> None:
    with UdpReceiver(LOOPBACK) as receiver, sending(receiver) as sender:
        assert receiver.poll(CLOCK.now()) == []
        before = CLOCK.now()
        for payload in (b"one", b"two", b"three"):
            sender.send(payload)
        found = arrived(receiver)
        after = CLOCK.now()
        assert [datagram.payload for datagram in found] == [b"one", b"two", b"three"]
        assert {datagram.source for datagram in found} == {sender.getsockname()}
        times = [datagram.arrival for datagram in found]
        assert times == sorted(times) and before - 0.001 <= times[0] and times[-1] <= after
        assert receiver.poll(CLOCK.now()) == [] and receiver.dropped.count == receiver.overflowed == 0


def test_the_arrival_is_the_kernels_not_that_of_the_poll() -> None:
    with UdpReceiver(LOOPBACK) as receiver, sending(receiver) as sender:
        stamps = 0
        for _ in range(50):  # a kernel may switch its stamps on a moment after the first socket asks
            receiver.poll(CLOCK.now())
            sender.send(b"x")
            now = CLOCK.now() + 0.5
            (datagram,) = receiver.poll(now)
            stamps += datagram.arrival < now - 0.4
            if stamps:
                return
    pytest.skip("this kernel gives no times of arrival")


@pytest.mark.parametrize("jump", [HOUR_NS, -HOUR_NS, 10_000_000, -10_000_000, -500_000])
def test_a_wall_clock_that_is_set_has_no_effect(jump: int) -> None:
    """As the receiver sees it: the stamps are off from where its looks at both clocks put them, by turns or always."""
    looks = iter([jump, 0, jump, jump, -jump])

    def wall_offset() -> int:
        return wall_to_monotonic() + next(looks, jump)

    with UdpReceiver(LOOPBACK, wall_offset=wall_offset) as receiver, sending(receiver) as sender:
        for _ in range(7):
            emptied = CLOCK.now()
            receiver.poll(emptied)
            sender.send(b"x")
            (datagram,) = arrived(receiver)
            assert emptied <= datagram.arrival <= CLOCK.now()


def test_a_wrong_look_at_the_clocks_is_taken_again_at_once() -> None:
    looks = []

    def look() -> int:
        looks.append(1)
        return wall_to_monotonic() - HOUR_NS

    with UdpReceiver(LOOPBACK, wall_offset=look) as receiver, sending(receiver) as sender:
        for _ in range(3):
            receiver.poll(CLOCK.now())
            sender.send(b"x")
            assert len(arrived(receiver)) == 1
    assert len(looks) >= 3


def test_on_another_clock_the_arrival_is_that_of_the_poll() -> None:
    with UdpReceiver(LOOPBACK, wall_offset=None) as receiver, sending(receiver) as sender:
        sender.send(b"x")
        arrived_at = 12.5
        found = []
        for _ in range(1000):
            found += receiver.poll(arrived_at)
            if found:
                break
        assert [datagram.arrival for datagram in found] == [arrived_at]


def test_the_longest_datagram_passes_and_a_cut_one_does_not() -> None:
    longest = 65_507  # of UDP over IPv4
    with UdpReceiver(LOOPBACK) as receiver, sending(receiver) as sender:
        sender.send(bytes(longest))
        assert [len(datagram.payload) for datagram in arrived(receiver)] == [longest]
    with UdpReceiver(LOOPBACK, longest=100) as receiver, sending(receiver) as sender:
        for size in (100, 101, 0, 5000, 99):
            sender.send(bytes(size))
        assert [len(datagram.payload) for datagram in arrived(receiver)] == [100, 99]
        assert receiver.dropped.reasons == {"datagram too long": 2, "empty datagram": 1}


def test_a_poll_is_bounded_and_the_rest_waits() -> None:
    with UdpReceiver(LOOPBACK) as receiver, sending(receiver) as sender:
        for number in range(MOST_PER_POLL + 20):
            sender.send(number.to_bytes(2))
        first, second = arrived(receiver), arrived(receiver)
        assert [len(first), len(second)] == [MOST_PER_POLL, 20]
        numbers = [int.from_bytes(datagram.payload) for datagram in first + second]
        assert numbers == list(range(MOST_PER_POLL + 20))


def test_a_poll_is_bounded_in_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp_socket, "RECEIVE_BUFFER", 4 * 2**20)
    with UdpReceiver(LOOPBACK) as receiver, sending(receiver) as sender:
        if receiver.buffer < 3 * MOST_BYTES_PER_POLL:
            pytest.skip(f"the kernel grants {receiver.buffer} bytes only (net.core.rmem_max)")
        for _ in range(20):
            sender.send(bytes(60_000))
        first, second = arrived(receiver), arrived(receiver)
        assert len(first) == -(-MOST_BYTES_PER_POLL // 60_000) and len(second) == 20 - len(first)


def test_a_second_of_slimevr_waits_for_a_loop_that_was_stopped() -> None:
    with UdpReceiver(LOOPBACK) as receiver, sending(receiver) as sender:
        if receiver.buffer < 2 * udp_socket.RECEIVE_BUFFER:
            pytest.skip(f"the kernel grants {receiver.buffer} bytes only (net.core.rmem_max)")
        for number in range(232):
            sender.send(number.to_bytes(2) + bytes(2660))
        found = arrived(receiver) + receiver.poll(CLOCK.now())
        assert len(found) == 232 and receiver.overflowed == 0


def test_what_the_kernel_lost_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp_socket, "RECEIVE_BUFFER", 8192)
    with UdpReceiver(LOOPBACK) as receiver, sending(receiver) as sender:
        for _ in range(200):
            sender.send(bytes(1000))
        kept = len(arrived(receiver))
        sender.send(b"x")  # the count travels with what comes after the loss
        assert len(arrived(receiver)) == 1
        assert 0 < kept < 200 and receiver.overflowed == 200 - kept


def test_requests_leave_from_the_port_that_listens() -> None:
    with UdpReceiver(LOOPBACK) as receiver, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(PATIENCE_S)
        assert receiver.send(b"ping", server.getsockname())
        assert server.recvfrom(100) == (b"ping", ("127.0.0.1", receiver.port))
        assert not receiver.send(bytes(70_000), server.getsockname())
        receiver.close()
        assert not receiver.send(b"ping", server.getsockname())


def test_nobody_at_home_is_no_fault_of_the_stream() -> None:
    with UdpReceiver(LOOPBACK) as gone:
        port = gone.port
    with UdpReceiver(LOOPBACK) as receiver, sending(receiver) as sender:
        receiver.send(b"keep-alive", ("127.0.0.1", port))
        sender.send(b"x")
        assert len(arrived(receiver)) == 1 and receiver.dropped.count == 0


def test_a_closed_receiver_stays_quiet() -> None:
    receiver = UdpReceiver(LOOPBACK)
    assert receiver.port > 0 and receiver.fileno() >= 0
    receiver.close()
    receiver.close()
    assert (receiver.port, receiver.fileno(), receiver.poll(CLOCK.now())) == (0, -1, [])
