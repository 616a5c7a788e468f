"""Figures of methods that stand alone: decay, towing, thrust, panels; published results derived again."""
