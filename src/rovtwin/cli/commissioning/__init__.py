"""rovtwin commission and verify."""
