"""Logs: named channels, each with its own clock, unit and frame, plus provenance; on disk an MCAP file.

Depends on numpy, mcap, lz4 and zstandard, and on netCDF4 and pymap3d when exporting. No JAX: looking at a log is quick.
"""

from rovtwin.core.log.channel import Channel
from rovtwin.core.log.export import export_csv, export_netcdf
from rovtwin.core.log.info import ChannelInfo, LogInfo, info, summary
from rovtwin.core.log.maps import export_map
from rovtwin.core.log.reader import Log, Series
from rovtwin.core.log.repair import Repair, repair
from rovtwin.core.log.writer import LogWriter

__all__ = [
    "Channel",
    "ChannelInfo",
    "Log",
    "LogInfo",
    "LogWriter",
    "Repair",
    "Series",
    "export_csv",
    "export_map",
    "export_netcdf",
    "info",
    "repair",
    "summary",
]
