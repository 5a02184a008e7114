"""Live streams between socket and pipeline: admission of senders, capture times, playout, validity, calibration."""
