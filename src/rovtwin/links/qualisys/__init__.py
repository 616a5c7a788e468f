"""Qualisys Track Manager's real-time protocol, both ways.

`QtmServer` streams a station's `mocap` as QTM streams a rigid body, `QtmSource` reads a real or a served QTM through
the vendor's qtm-rt. `wire` knows the packets, `poses` the lab's frame.
"""
