"""The water around a vehicle: current, waves, sea states, floor, and the `World` that joins them."""
