"""Commissioning for browsers: one stage at a time, in a process of its own, with a page that answers its questions."""
