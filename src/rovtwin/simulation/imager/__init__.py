"""The virtual line imager: lines of a scene through slit, port and water, as counts. Depends on `imaging` besides."""
