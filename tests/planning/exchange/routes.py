"""Files of other programs, as those write them."""

GPX = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="plotter" xmlns="http://www.topografix.com/GPX/1/1">
{marks}<rte><name>harbour</name>
<rtept lat="63.4501" lon="10.3601"><ele>-3.5</ele><name>A</name></rtept>
<rtept lat="63.4502" lon="10.3604"><ele>-4</ele></rtept></rte></gpx>"""

KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>
<name>places.kml</name><Style id="s"/><Folder><Placemark><name>wreck</name>{shape}</Placemark></Folder>
</Document></kml>"""
PATH = """<LineString><tessellate>1</tessellate>{mode}<coordinates>
10.3601,63.4501,-3.5 10.3604,63.4502,-4
</coordinates></LineString>"""

# As QGroundControl lays items out: a speed, a way-point, one to be waited at, a camera trigger, a fence with a hole.
PLAN = {
    "fileType": "Plan",
    "geoFence": {
        "circles": [],
        "polygons": [
            {
                "inclusion": True,
                "polygon": [[63.449, 10.358], [63.452, 10.358], [63.452, 10.364], [63.449, 10.364]],
                "version": 1,
            },
            {"inclusion": False, "polygon": [[63.45, 10.36], [63.4505, 10.36], [63.45, 10.361]], "version": 1},
        ],
        "version": 2,
    },
    "groundStation": "QGroundControl",
    "mission": {
        "cruiseSpeed": 15,
        "firmwareType": 3,
        "globalPlanAltitudeMode": 1,
        "hoverSpeed": 5,
        "items": [
            {
                "autoContinue": True,
                "command": 178,
                "doJumpId": 1,
                "frame": 2,
                "params": [1, 0.3, -1, 0, 0, 0, 0],
                "type": "SimpleItem",
            },
            {
                "AMSLAltAboveTerrain": None,
                "Altitude": -3.5,
                "AltitudeMode": 1,
                "autoContinue": True,
                "command": 16,
                "doJumpId": 2,
                "frame": 3,
                "params": [0, 0.5, 0, None, 63.4501, 10.3601, -3.5],
                "type": "SimpleItem",
            },
            {"autoContinue": True, "command": 206, "doJumpId": 3, "frame": 2, "params": [0] * 7, "type": "SimpleItem"},
            {
                "AMSLAltAboveTerrain": None,
                "Altitude": -4,
                "AltitudeMode": 1,
                "autoContinue": True,
                "command": 16,
                "doJumpId": 4,
                "frame": 3,
                "params": [20, 0, 0, 90, 63.4502, 10.3604, -4],
                "type": "SimpleItem",
            },
        ],
        "plannedHomePosition": [63.45, 10.36, 0],
        "vehicleType": 12,
        "version": 2,
    },
    "rallyPoints": {"points": [], "version": 2},
    "version": 1,
}
POINTS = """{"type": "FeatureCollection", "name": "harbour",
"crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}, "features": [
{"type": "Feature", "properties": {"fid": 1, "depth_m": 3.5},
"geometry": {"type": "Point", "coordinates": [10.3601, 63.4501]}},
{"type": "Feature", "properties": {"fid": 2}, "geometry": {"type": "Point", "coordinates": [10.3604, 63.4502, -4]}}]}"""
PLACES = [(63.4501, 10.3601, 3.5), (63.4502, 10.3604, 4.0)]
