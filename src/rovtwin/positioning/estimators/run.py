"""Observers run over a whole recording."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.block import Block, Start
from rovtwin.core.numerics import jax
from rovtwin.positioning.estimators.ekf import MarkerEkf
from rovtwin.positioning.estimators.ekf_steps import NEW, NOBODY, USED
from rovtwin.positioning.images.observations import Frames

Outputs = Any  # a block's output as a tree of NumPy arrays with a leading axis of frames


@jax.jit
def step(block: Block, memory: Any, input: Any, dt: Any) -> tuple[Any, Any]:
    """One step of any observer, compiled once for each form of it."""
    return block.step(memory, input, dt)


def run_observer(block: Block, frames: Frames, start: Start) -> Outputs:
    """The observer's outputs, as a tree of NumPy arrays with a leading axis of frames."""
    memory, outputs = block.init(jax.random.key(0), start), []
    for k, dt in enumerate(frames.dt):
        memory, output = step(block, memory, frames.at(k), dt)
        outputs.append(output)
    return jax.tree.map(lambda *leaves: np.stack(leaves), *outputs)


@dataclass(frozen=True, eq=False)
class Association:
    """Which landmark each slot of each frame showed.

    A marker that was moved is two landmarks: one before, one after.

    Attributes:
        landmark: By its row; -1 where a slot is empty, or what is in it was not accepted.
        ids: Id of each landmark.
        known: Place of each in the layout, or -1.
        position: As the filter left them [m].
        attitude: Quaternions R_nm.
    """

    landmark: Int[np.ndarray, "n slots"]
    ids: Int[np.ndarray, " landmarks"]
    known: Int[np.ndarray, " landmarks"]
    position: Float[np.ndarray, "landmarks 3"]
    attitude: Float[np.ndarray, "landmarks 4"]


def associate(filter: MarkerEkf, frames: Frames, out: Outputs) -> Association:
    """From what the filter did with each sighting."""
    layout = np.asarray(filter.layout.ids)
    rows = [[int(number), k] for k, number in enumerate(layout) if number != NOBODY]  # id, place in the layout
    place = {number: row for row, (number, _) in enumerate(rows)}
    left: dict[int, tuple[np.ndarray, np.ndarray]] = {
        row: (np.asarray(filter.layout.position)[k], np.asarray(out.marker_attitude)[0, k])
        for row, (_, k) in enumerate(rows)
    }
    landmark = np.full(out.status.shape, -1)
    for k in range(len(frames)):
        for slot in np.flatnonzero((out.status[k] == USED) | (out.status[k] == NEW)):
            number = int(frames.sightings.ids[k, slot])
            if out.status[k, slot] == NEW:
                place[number] = len(rows)
                rows.append([number, -1])
            landmark[k, slot] = place[number]
        for at in np.flatnonzero(out.ids[k] != NOBODY):
            left[place[int(out.ids[k, at])]] = (out.marker_position[k, at], out.marker_attitude[k, at])
    ids, known = np.array(rows, int).reshape(-1, 2).T
    position = np.array([left[row][0] for row in range(len(rows))]).reshape(-1, 3)
    attitude = np.array([left[row][1] for row in range(len(rows))]).reshape(-1, 4)
    return Association(landmark, ids, known, position, attitude)
