"""`web://`: a page for a phone, a camera or a headset, in place of trackers."""
