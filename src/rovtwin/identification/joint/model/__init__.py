"""The model that is estimated: parameters, their couplings and groups, the prior, evidence that is no motion."""
