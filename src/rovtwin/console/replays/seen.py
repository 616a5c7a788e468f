"""What the vehicle's eyes had seen of the floor by each time of a finished run, painted as in flight."""

from typing import Any

import numpy as np

from rovtwin.console.replays.replay import Recording
from rovtwin.console.swath.eyes import eyes_of, looks_down, sounders_of
from rovtwin.console.swath.painter import Depths, Painter

ESTIMATE = "autopilot/eta"
STEP = 0.1  # between two instants at least [s]


def has_seen(recording: Recording) -> bool:
    """Whether a run's log has an estimated pose, and its vehicle something that looks down."""
    scenario = recording.scenario
    estimated = ESTIMATE in recording.log and len(recording.log[ESTIMATE]) > 0
    return estimated and scenario is not None and looks_down(scenario)


def seen(recording: Recording) -> dict[str, Any] | None:
    """The message `swath` of all of a run: of each eye when every cell was seen, and from when on why nothing was.

    None where nothing can have been seen.
    """
    scenario = recording.scenario
    if not has_seen(recording) or scenario is None:
        return None
    eyes, notes = eyes_of(scenario)
    depths = Depths(sounders_of(scenario), scenario.world.floor)
    painted = [_painted(recording, Painter(eye), depths) for eye in eyes]
    return {"kind": "swath", "flying": False, "area": None, "notes": notes, "eyes": painted}


def _painted(recording: Recording, painter: Painter, depths: Depths) -> dict[str, Any]:
    t = recording.tape["eta"].t
    t = t[np.unique(np.floor((t - t[0]) / STEP + 1e-6), return_index=True)[1]]
    for at in t.tolist():
        eta, timing = recording.at("eta", at), recording.at("timing", at)
        state = {
            "t": at,
            "eta": eta,
            "sensors": recording.sensors(at),
            "link_age": 0.0 if timing is None else timing[1],
        }
        if (instant := depths.instant(state)) is not None:
            painter.take(instant)
    painter.finish()
    eye = painter.eye
    return {"name": eye.name, "kind": eye.kind, "reach": eye.reach, "by": depths.source, "course": painter.course} | {
        "began": painter.began,
        "ended": painter.ended,
        "cells": painter.cells.message(times=True),
    }
