"""The plant in C (`reference.c`), compiled when asked for, called through ctypes: what ours is held against.

One vehicle, or `lanes` vehicles side by side in the processor's vectors (single instruction, multiple data).
"""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rovtwin.vehicle import Model
from rovtwin.vehicle.physics.dynamics import State

SOURCE = Path(__file__).with_name("reference.c")
OPTIONS = ("-O3", "-march=native")
NO_COMPILER = "no C compiler (cc) here"


def compiler() -> str | None:
    """The C compiler, None where there is none."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def description() -> str:
    """Compiler and options, in words."""
    command = compiler()
    if command is None:
        return NO_COMPILER
    done = subprocess.run([command, "--version"], check=True, capture_output=True, text=True)
    return f"{done.stdout.splitlines()[0]}, {' '.join(OPTIONS)}"


class Reference:
    """`lanes` vehicles with as many thrusters each, ready to fly; parameters, state and water are theirs."""

    def __init__(self, models: Sequence[Model], states: Sequence[State], current: np.ndarray):
        """One model and one state a lane, all in a steady current, n [m/s], shape (3,)."""
        self._fly = _compiled(models[0].thrusters.count, len(models))
        self._lanes, self._rows = len(models), 8 if len(models) == 1 else 6
        self._plant = self._lay([self._parameters(model) for model in models])
        self._start = self._lay([np.concatenate([s.position, s.attitude, s.nu, s.thrust]) for s in states])
        self._state = _aligned(self._start)
        self._water = self._lay([np.pad(current, (0, 9))] * self._lanes)  # its rate and the external wrench are zero

    def commands(self, u: np.ndarray) -> np.ndarray:
        """Commands, shape (lanes, steps, n), as `fly` takes them."""
        return _aligned(np.moveaxis(u, 0, -1))

    def fly(self, commands: np.ndarray, dt: float) -> np.ndarray:
        """From the start through all commands: [position, attitude, nu, thrust] of each lane, shape (lanes, 13 + n)."""
        self._state[...] = self._start
        arrays = (self._plant, self._state, commands, self._water)
        self._fly(*(a.ctypes.data for a in arrays), dt, len(commands))
        return self._state.T.copy()

    def _lay(self, per_lane: Sequence[np.ndarray]) -> np.ndarray:
        return _aligned(np.stack(per_lane, axis=-1))

    def _parameters(self, model: Model) -> np.ndarray:
        """In the order of `Plant` in the source."""
        t = model.thrusters
        damping = (
            model.linear_damping_ahead,
            -model.linear_damping_astern,
            model.quadratic_damping_ahead,
            -model.quadratic_damping_astern,
        )
        matrices = [model.inertia, model.inertia_inverse, model.rigid_body_mass[:, :3], *damping, t.configuration]
        vectors = [model.weight, model.buoyancy, model.center_of_gravity, model.center_of_buoyancy]
        vectors += [model.displaced_mass, t.force_ahead, t.force_astern, t.exponent, t.dead_band, t.time_constant]
        vectors += [t.rate_limit, t.quantisation, t.health]
        columns = [np.pad(np.asarray(A).T, ((0, 0), (0, self._rows - 6))) for A in matrices]
        return np.concatenate([np.ravel(part) for part in (*columns, *vectors)])


def _aligned(values: np.ndarray) -> np.ndarray:
    """A copy that begins where vectors may be loaded from."""
    values = np.asarray(values, dtype=float)
    room = np.empty(values.nbytes + 64, dtype=np.uint8)
    begin = -room.ctypes.data % 64
    copy = room[begin : begin + values.nbytes].view(float).reshape(values.shape)
    copy[...] = values
    return copy


def _compiled(thrusters: int, lanes: int) -> ctypes._CFuncPtr:
    command = compiler()
    if command is None:
        raise RuntimeError(NO_COMPILER)
    with tempfile.TemporaryDirectory(prefix="rovtwin-reference-") as folder:
        library = Path(folder) / "reference.so"
        defines = (f"-DTHRUSTERS={thrusters}", f"-DLANES={lanes}")
        arguments = [command, *OPTIONS, "-fPIC", "-shared", *defines, str(SOURCE), "-o", str(library), "-lm"]
        subprocess.run(arguments, check=True, capture_output=True, text=True)
        function = ctypes.CDLL(str(library)).fly  # stays loaded when the file is gone
    function.argtypes = [ctypes.c_void_p] * 4 + [ctypes.c_double, ctypes.c_int]
    function.restype = None
    return function
