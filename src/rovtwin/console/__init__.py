"""The operator console: watch, plan and fly from a browser on the same machine or on the boat.

Three processes: the link's host (`links/host`), the engine (autopilot, log; `engine`), and the web server (`web`). The
engine tells what it knows over ZeroMQ and takes orders from there; it outlives the web server. STOP goes from the web
server straight to the link's host. Imports everything of ours but the command line.
"""
