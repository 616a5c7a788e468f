"""External physics for ArduSub's software-in-the-loop, over its JSON backend: the real firmware flies our twin.

`wire` has the packets, `motors` what its outputs are to our thrusters, `lockstep` the server that answers each packet.
"""
