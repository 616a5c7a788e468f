"""From a wrench to commands of thrusters within their limits."""
