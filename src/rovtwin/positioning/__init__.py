"""Where a vehicle is, from its own cameras and printed markers: detection, observers, smoother, recorded video.

Depends on `core` and `vehicle`. OpenCV (extra `vision`) finds markers; gtsam (extra `slam`) solves the smoother.
"""
