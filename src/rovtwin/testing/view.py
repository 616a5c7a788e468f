"""The contract of a view of one's own: made without arguments, something to show in every stage, changing nothing."""

import copy
import time
from typing import Any

from rovtwin.console.view import LEAST, MOST, View, shown
from rovtwin.core.errors import ConfigError

SOON = 1.0  # for one look [s]; the console waits for 5
_ALWAYS = {"kind": "state", "stage": "making", "armed": False, "scenario": "square", "link": "twin://", "alerts": []}
_ALWAYS |= {"note": "", "running": False, "stopped": False, "submitted": False, "folder": "", "speed": 1.0}


def view_states(thrusters: int = 6) -> list[dict[str, Any]]:
    """States of a flight as the engine reports them: before there is a vehicle, diving, on a leg, aborted."""
    six = [0.0] * 6
    flying = _ALWAYS | {"stage": "ready", "running": True, "phase": "dive", "reason": "", "t": 3.0, "progress": 0.1}
    flying |= {"eta": [0.1, -0.2, 1.5, 0.01, -0.02, 0.3], "nu": [0.2, 0.0, 0.1, 0.0, 0.0, 0.05], "sd": [0.1] * 6}
    flying |= {"reference": six, "reference_rate": six, "setpoint": six, "wave": six, "bias": six, "tau": [1.0] * 6}
    flying |= {"u": [0.2] * thrusters, "health": [1.0] * thrusters, "ellipse": [[0.01, 0.0], [0.0, 0.01]]}
    flying |= {"waypoint": 0, "count": 4, "on_leg": False, "to_go": 2.0, "leg": [[0.0] * 3, [3.0, 0.0, 3.0]]}
    flying |= {"sensors": {"pressure": {"age": 0.02, "value": [1.5]}, "dvl": {"age": None, "value": None}}}
    flying |= {"truth": [0.1, -0.2, 1.5, 0.0, 0.0, 0.3], "current": [0.0, 0.1, 0.0], "resumable": False}
    ended = {"phase": "aborted", "reason": "leak", "u": [0.0] * thrusters, "truth": None, "current": None}
    return [dict(_ALWAYS), flying, flying | {"t": 9.0, "phase": "go", "on_leg": True, "armed": True}, flying | ended]


def check_view(kind: type[View], states: list[dict[str, Any]] | None = None) -> None:
    """Hold a view to what the console needs of it.

    Args:
        kind: Its class.
        states: That it is shown; None: those of `view_states`.

    Raises:
        AssertionError: It breaks a clause.
    """
    assert isinstance(kind, type) and issubclass(kind, View), f"found {kind!r:.60}, expected a class of View"
    try:
        view = kind()
    except Exception as error:  # of somebody else's code: anything
        raise AssertionError(f"{kind.__name__} cannot be made without arguments: {error}") from error
    good = isinstance(view.every, int | float) and LEAST <= view.every <= MOST
    assert good, f"{kind.__name__}.every is {view.every!r}, expected {LEAST:g} to {MOST:g} s"
    for i, state in enumerate(view_states() if states is None else states):
        given, stage = copy.deepcopy(state), f"of state {i} ({state.get('phase') or state.get('stage')})"
        try:
            began = time.monotonic()
            found = shown(view, given)
            took = time.monotonic() - began
        except ConfigError as error:
            raise AssertionError(f"{error}, {stage}") from error
        assert given == state, f"{kind.__name__}.show changes the state, {stage}"
        assert i == 0 or took < SOON, f"{kind.__name__}.show took {took:.1f} s, {stage}, expected less than {SOON:g}"
        assert any(found.get(key) for key in ("svg", "rows", "text")), f"{kind.__name__}.show gave nothing, {stage}"
