"""What tests leave: recordings of any kind become `Record`s, told about by an evidence file."""
