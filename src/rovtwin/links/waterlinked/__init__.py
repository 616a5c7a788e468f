"""Water Linked's instruments, both ways: DVL A50 (JSON over TCP) and Underwater GPS G2 (HTTP).

`DvlServer` and `UgpsServer` speak for a station, `DvlSource` and `UgpsSource` listen to a real or a served one. The
modules named `*_wire` know the messages and nothing else.
"""
