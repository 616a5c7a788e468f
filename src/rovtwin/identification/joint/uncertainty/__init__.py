"""How sure an estimate is: agreement of its logs, effects left out, the mean beside the maximum, sampling."""
