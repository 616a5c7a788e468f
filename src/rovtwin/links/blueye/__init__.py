"""Blueye drones, protocol v3: links to real ones through the vendor's SDK, and a server that its clients take for one.

`server.BlueyeServer` speaks for the twin; `link.BlueyeLink` is one drone, `double.DoubleBlueyeLink` two that are one
vehicle. What both sides know of the wire: `protobuf`, `wire` (what clients send), `readings` (what drones send).
"""
