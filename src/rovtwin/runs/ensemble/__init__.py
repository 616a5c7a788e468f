"""Flights of one scenario by vehicles as they may truly be: who is drawn, how they fly, what they agree about."""
