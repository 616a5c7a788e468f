"""The operator console: watch, plan and fly from a browser.

Depends on scenario and all below it, on NiceGUI (pages) and on OpenCV (the camera's view). The autopilot, the web
server and the camera are processes of their own: none waits for another.
"""
