"""A plan flown on the twin before it is flown: what is asked for, the process that flies it, the flight beside it."""
