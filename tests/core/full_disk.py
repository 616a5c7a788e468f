"""A disk that is full, without being root: the system lets no file grow beyond a size."""

import os
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch


@contextmanager
def full_at(size: int) -> Iterator[None]:
    """No file of this process, or of those that it starts, grows beyond so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    # What is imported meanwhile would leave modules cut off in __pycache__, which fail ever after.
    quiet = patch.dict(os.environ, {"PYTHONDONTWRITEBYTECODE": "1"})
    with quiet, patch.object(sys, "dont_write_bytecode", True):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
