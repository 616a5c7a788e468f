"""Roll and pitch decay to inertia, damping and restoring."""
