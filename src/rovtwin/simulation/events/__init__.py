"""What happens during a run: faults, what goes on at the surface, a hand that tilts the vehicle."""
