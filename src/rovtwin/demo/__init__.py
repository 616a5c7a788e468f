"""The demonstration that `rovtwin demo` runs: the thesis's lawn-mower, a payload, a camera; and a map."""
