"""What an identification found, as one object: in Python and notebooks, kept in a file, drawn, and used to predict."""

from rovtwin.identification.result.identification import Identification

__all__ = ["Identification"]
