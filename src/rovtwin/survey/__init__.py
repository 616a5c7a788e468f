"""Coverage of an area by parallel lines: where to go so that a swath of given width sees all of it.

`area` reads polygons with holes; `room` says where the vehicle may be and what laps round obstacles see; `lines` lays
lines of one heading and groups them into cells; `ways` finds shortest ways round obstacles; `route` puts cells and laps
in an order; `pace` says how long that takes and `energy` what it draws; `plan` joins them and chooses the heading.
Depends on `core` and `vehicle`. Geometry is shapely's (extra `survey`), in the plane of n: x is north, y is east [m].
"""
