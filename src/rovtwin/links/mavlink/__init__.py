"""MAVLink as ArduSub speaks it: `server.MavlinkServer` from the twin, `link.MavlinkLink` to the vehicle.

Messages, modes and numbers are those of ArduSub 4.x and of the MAVLink dialect ardupilotmega. `mixing` holds what
the autopilot's stick axes become at the thrusters, for both sides.
"""
