"""Times as people read them: minutes and seconds."""


def clock(seconds: float) -> str:
    """A time or a long duration: 2:05; hours are not split off."""
    whole = int(seconds)
    return f"{whole // 60}:{whole % 60:02d}"


def lasting(seconds: float) -> str:
    """A duration: 12 s below a minute, 2:05 min from there on."""
    return f"{seconds:.0f} s" if round(seconds) < 60 else f"{clock(round(seconds))} min"
