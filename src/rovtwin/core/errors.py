"""The errors a user can meet, as a tree. Programming mistakes stay standard exceptions.

RovtwinError
├── ConfigError            a vehicle, scenario, mission or override that cannot be used
├── LogError               a log that cannot be read, written or repaired
├── LinkError              a vehicle (real or simulated) that cannot be reached
│   └── LinkTimeout        ... in time
└── IdentificationError    evidence that cannot be turned into parameters

A message says where, what was found, what was expected, and the fix:
`double_blueye.yaml: parts[1].thrusters[0].gian: no such key. Did you mean 'gain'?`
"""


class RovtwinError(Exception):
    """Something the user can mend; the command line prints it without a traceback and exits with 2."""


class ConfigError(RovtwinError):
    """A vehicle file, scenario, mission or override that cannot be used."""


class LogError(RovtwinError):
    """A log that cannot be read, written, exported or repaired."""


class LinkError(RovtwinError):
    """A vehicle, real or simulated, that cannot be reached or does not answer as agreed."""


class LinkTimeout(LinkError):
    """A vehicle that did not answer in time."""


class IdentificationError(RovtwinError):
    """Evidence that cannot be turned into parameters."""


def exists_already(path: object, option: str = "") -> str:
    """What is said of a file or folder that would be overwritten; option: what replaces it, where something does."""
    return f"{path}: exists already. Choose another name" + (f", or replace it with {option}" if option else "")
