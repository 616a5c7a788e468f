"""What a vehicle amounts to before it swims: balance, stability, performance, ballast, findings, tables, drawings."""
