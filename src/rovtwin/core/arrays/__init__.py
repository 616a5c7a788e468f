"""Arrays: batches, pytrees as one vector, integration, filters of a tick, small matrices, correlation, rotations."""
