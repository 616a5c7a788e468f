"""What tests leave: recordings of any kind become `Record`s, described by an evidence file."""
