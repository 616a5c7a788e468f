"""Arrays: batches, pytrees as one vector, integration, small matrices, rotations in NumPy."""
