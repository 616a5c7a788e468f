"""Commissioning from the console: stages run in a process of their own, whose questions are answered on a page."""
