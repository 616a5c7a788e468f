"""Pictures of plans: a test and a survey."""
