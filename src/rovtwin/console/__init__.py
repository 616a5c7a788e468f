"""The operator console: watch, plan and fly from a browser, offline.

Composes scenario, links and below; only the command line stands above it.
"""
