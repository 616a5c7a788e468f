"""How errors of a smoothed track hang together in time: covariances between any two of its key frames.

    Cov(x_i, x_j | all) = G_i G_(i+1) ... G_(j-1) P_j,   i < j

G being the smoother's gains. Products of the gains of the whole error x from key frame to key frame are kept, and only
what comes out is cut to the pose: a pose's own six errors are no Markov chain, a product of cut gains would forget what
velocity, forces and biases carry from one to the next.

Constants of the sensors come on top: with response V of the poses, C + V S V'.

Reference: Särkkä (2013), Bayesian Filtering and Smoothing, ch. 8.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.errors import LogError
from rovtwin.core.log.files import atomic, write_error
from rovtwin.core.user_files.files import checked

FORMAT = 1  # of the file
POSE = 6  # errors of a pose: place with the waves' motion in n, small rotation in b


@dataclass(frozen=True)
class KeyFrames:
    """A smoothed track at some instants, and how its errors hang together.

    Attributes:
        t: [s].
        position: Of CO in n, waves and all [m].
        attitude: Quaternion q_nb.
        gains: Products of the smoother's gains from each key frame to the next.
        covariance: Of the state's error at each.
        pose: T; T x is the pose's error: of position in n [m], small rotation in b [rad].
        constants: Names of the sensors' constants.
        response: V, of the poses' errors to them.
        constants_std: Of the constants before the dive.
        constants_value: Estimated; they have been taken out of the track.
        constants_covariance: S, after the dive.
        nonlinearity: Of each response, as a share of it.
    """

    t: Float[np.ndarray, " k"]
    position: Float[np.ndarray, "k 3"]
    attitude: Float[np.ndarray, "k 4"]
    gains: Float[np.ndarray, "k-1 n n"]
    covariance: Float[np.ndarray, "k n n"]
    pose: Float[np.ndarray, "6 n"]
    constants: tuple[str, ...]
    response: Float[np.ndarray, "k 6 c"]
    constants_std: Float[np.ndarray, " c"]
    constants_value: Float[np.ndarray, " c"]
    constants_covariance: Float[np.ndarray, "c c"]
    nonlinearity: Float[np.ndarray, " c"]

    def joint(self, chosen: Int[np.ndarray, " n"] | None = None) -> Float[np.ndarray, "m m"]:
        """Covariance of the errors of poses and constants together: six for each key frame, then the constants.

        Args:
            chosen: Numbers of key frames, growing; None: all. A thousand make a matrix of 288 MB.
        """
        chosen = np.arange(len(self.t)) if chosen is None else chosen
        poses = joint_covariance(self.gains, self.covariance, self.pose, chosen)
        S = self.constants_covariance
        V = self.response[chosen].reshape(len(poses), len(S))
        return np.block([[poses + V @ S @ V.T, V @ S], [S @ V.T, S]])

    def save(self, path: Path, overwrite: bool = False) -> None:
        """As netCDF, 15 kB a key frame and less.

        Raises:
            LogError: The file cannot be written, or it exists.
        """
        import netCDF4  # on use: a heavy library

        try:
            with atomic(path, overwrite) as temporary, netCDF4.Dataset(temporary, "w", format="NETCDF4") as file:
                file.setncatts({"format": "rovtwin key frames", "format_version": np.int32(FORMAT)})
                file.setncattr("constants", ",".join(self.constants))
                for name in _ARRAYS:
                    values = getattr(self, name)
                    for axis, size in enumerate(values.shape):
                        file.createDimension(f"{name}_{axis}", size)
                    axes = tuple(f"{name}_{axis}" for axis in range(values.ndim))
                    file.createVariable(name, "f8", axes, zlib=values.size > 64)[:] = values
        except RuntimeError as error:  # of the netCDF library, such as a full disk
            raise write_error(path, error) from error

    @classmethod
    def load(cls, path: Path) -> "KeyFrames":
        """What `save` wrote.

        Raises:
            LogError: The file is missing, damaged, or another kind of file.
        """
        import netCDF4

        wrong = f"{path}: is no file of key frames, such as `rovtwin smooth` writes beside smoothed.mcap"
        try:
            with netCDF4.Dataset(checked(path, np.inf), "r") as file:
                if getattr(file, "format", "") != "rovtwin key frames" or int(file.format_version) != FORMAT:
                    raise LogError(wrong)
                file.set_auto_mask(False)
                arrays = {name: np.asarray(file[name][:]) for name in _ARRAYS}
                names = tuple(name for name in file.constants.split(",") if name)
        except (OSError, RuntimeError, IndexError, KeyError, AttributeError) as error:
            raise LogError(f"{wrong} ({error})") from None
        return cls(**arrays, constants=names)


_ARRAYS = tuple(name for name in KeyFrames.__dataclass_fields__ if name != "constants")


def joint_covariance(
    gains: Float[np.ndarray, "k-1 n n"],
    covariance: Float[np.ndarray, "k n n"],
    T: Float[np.ndarray, "m n"],
    chosen: Int[np.ndarray, " c"],
) -> Float[np.ndarray, "cm cm"]:
    """Covariance of T x at some links of a chain, m numbers for each.

    Args:
        gains: G of each link to the next.
        covariance: P of each.
        T: What is asked for.
        chosen: Numbers of links, growing.
    """
    m, count = len(T), len(chosen)
    whole, column = np.zeros((count, m, count, m)), np.zeros((T.shape[1], 0))
    for place in range(count - 1, -1, -1):
        k = int(chosen[place])
        if place < count - 1:
            for step in range(int(chosen[place + 1]) - 1, k - 1, -1):
                column = gains[step] @ column
        column = np.hstack([covariance[k] @ T.T, column])
        cross = (T @ column).reshape(m, count - place, m)
        whole[place, :, place:] = cross
        whole[place:, :, place] = cross.transpose(1, 2, 0)
    found = whole.reshape(m * count, m * count)
    return 0.5 * (found + found.T)
