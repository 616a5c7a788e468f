"""What follows from an estimate: vehicle file, payload, sampling, posterior mean, agreement, effects left out."""
