"""What stands in for hardware and performer. Imported by the command line and the tests only."""
