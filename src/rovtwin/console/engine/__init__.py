"""The autopilot's process: a link, the compiled autopilot, a log of each flight; it publishes and takes orders."""
