"""What is kept of a run: records, channels of the log, where it came from, films."""
