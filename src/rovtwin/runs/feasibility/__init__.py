"""Before a mission: what the vehicle cannot do, with the numbers."""
