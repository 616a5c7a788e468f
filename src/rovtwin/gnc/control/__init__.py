"""Control by the model: the reference that is tracked, and the wrench that it takes."""
