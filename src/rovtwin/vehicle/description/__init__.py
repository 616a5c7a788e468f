"""What a vehicle file says: schema, files, assembly of parts into totals, and the `Vehicle` that comes of it."""
