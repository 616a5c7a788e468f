"""What tests have a worker do: functions that its process can find by name."""

import os
import time


class Picky(ValueError):
    """An error that wants more arguments than it keeps, and so comes out of no pipe."""

    def __init__(self, where, what):
        super().__init__(f"{where}: {what}")


class Text(str):
    """A text of one's own class."""


def give_own():
    return Text("own")


def read_slowly(text, name, datum):
    """Way-points of a file: one, at the number of the process that read it."""
    time.sleep(0.3)
    return [{"x": float(os.getpid()), "y": 2.0}], []


def fail(error):
    raise error


def fail_pickily():
    raise Picky("here", "that")
