"""What the summary of a live run says of its stream: one line."""

from retarget.live.account import LiveReport

__all__ = ["stream_line"]

MOST = 3


def stream_line(live: LiveReport | None) -> str:
    """ "" for a file."""
    if live is None:
        return ""
    parts = [f"{live.frames} frames in {live.datagrams} datagrams, played {live.playout_delay_ms:.0f} ms late"]
    if live.dropped:
        parts.append("not used: " + ", ".join(f"{count} {reason}" for reason, count in [*live.dropped.items()][:MOST]))
    if live.lost_s:
        longest = sorted(live.lost_s.items(), key=lambda item: -item[1])[:MOST]
        parts.append("lost: " + ", ".join(f"{name} {seconds:.1f} s" for name, seconds in longest))
    if live.holds.count:
        parts.append(f"held {live.holds.count} times, {live.holds.s:.1f} s")
    if live.refused:
        parts.append(f"not listened to: {', '.join(live.refused[:MOST])}")
    return "; ".join(parts)
