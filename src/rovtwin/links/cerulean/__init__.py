"""Cerulean Sonar's DVL-75 and Tracker 650: NMEA sentences over UDP.

`wire` knows the sentences and nothing else, `source` listens.
"""
