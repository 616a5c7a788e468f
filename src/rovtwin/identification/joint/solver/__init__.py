"""The estimator: segments, multiple shooting, derivatives, the normal equations and their steps."""
