"""Live streams between socket and run: admission, capture times, playout, validity, calibration.

Datagrams and an address come in; a performer's samples and reports go out. May import `human`,
`sources` and all below them.
"""
