"""What stands in for hardware and performer: mock bus, synthetic performer. Imported by the command line and the tests only."""
