"""From recordings to Records: rovtwin logs, CSV, npz, Qualisys, C3D, rosbag 1 and 2, Blueye, ArduPilot, PX4.

Each format's module turns its file into tables; `assemble` makes signals and commands of them as `log_spec` says;
`timing`
puts the clocks of several files together. Libraries of single formats are extras, imported where they are used.
"""

from rovtwin.identification.logs.readers.reading import Test, detect, read_record, read_records, read_tests, split

__all__ = ["Test", "detect", "read_record", "read_records", "read_tests", "split"]
