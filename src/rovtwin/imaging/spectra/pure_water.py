"""Pure water by wavelength: a table of its absorption, a formula of its scattering.

References: absorption 380 to 725 nm Pope and Fry (1997), Applied Optics 36(33), 8710; from 727 nm Kou, Labrie and
Chylek (1993), Applied Optics 32(19), 3531, at 22 deg C. Below 380 nm the value there is held. Scattering of sea water
Morel (1974), in Jerlov and Steemann Nielsen, Optical Aspects of Oceanography, as in Mobley (1994), Light and Water.
"""

import numpy as np
from jaxtyping import Float

# Wavelength [nm], absorption [1/m].
_TABLE = np.array(
    [
        (380, 0.01137), (385, 0.00941), (390, 0.00851), (395, 0.00813), (400, 0.00663), (405, 0.00530),
        (410, 0.00473), (415, 0.00444), (420, 0.00454), (425, 0.00478), (430, 0.00495), (435, 0.00530),
        (440, 0.00635), (445, 0.00751), (450, 0.00922), (455, 0.00962), (460, 0.00979), (465, 0.01011),
        (470, 0.0106), (475, 0.0114), (480, 0.0127), (485, 0.0136), (490, 0.0150), (495, 0.0173),
        (500, 0.0204), (505, 0.0256), (510, 0.0325), (515, 0.0396), (520, 0.0409), (525, 0.0417),
        (530, 0.0434), (535, 0.0452), (540, 0.0474), (545, 0.0511), (550, 0.0565), (555, 0.0596),
        (560, 0.0619), (565, 0.0642), (570, 0.0695), (575, 0.0772), (580, 0.0896), (585, 0.1100),
        (590, 0.1351), (595, 0.1672), (600, 0.2224), (605, 0.2577), (610, 0.2644), (615, 0.2678),
        (620, 0.2755), (625, 0.2834), (630, 0.2916), (635, 0.3012), (640, 0.3108), (645, 0.325),
        (650, 0.340), (655, 0.371), (660, 0.410), (665, 0.429), (670, 0.439), (675, 0.448),
        (680, 0.465), (685, 0.486), (690, 0.516), (695, 0.559), (700, 0.624), (705, 0.704),
        (710, 0.827), (715, 1.007), (720, 1.231), (725, 1.489),
        (727, 1.665), (730, 1.962), (732, 2.197), (734, 2.448), (736, 2.612), (738, 2.673), (740, 2.768),
        (745, 2.834), (750, 2.848), (755, 2.879), (760, 2.861), (765, 2.858), (770, 2.823), (775, 2.757),
        (780, 2.691), (785, 2.593), (790, 2.466), (795, 2.355), (800, 2.246), (805, 2.201), (810, 2.188),
        (820, 2.329), (825, 2.620), (829, 3.108), (832, 3.459), (836, 3.788), (840, 3.949), (850, 4.199),
        (861, 4.466), (870, 4.752), (880, 5.298), (890, 5.831), (901, 6.458),
    ]
)  # fmt: skip
_SIDEWAYS, _WHOLE = 4.72e-4, 16.06  # volume scattering of sea water at 90 deg, 400 nm [1/(m sr)]; b over it


def pure_absorption(wavelength: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Of pure water [1/m], linear between the rows of the table, held beyond them, at wavelengths [nm]."""
    return np.interp(wavelength, _TABLE[:, 0], _TABLE[:, 1])


def pure_scattering(wavelength: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Of pure sea water, in all directions [1/m], at wavelengths [nm]; half of it goes backwards."""
    return _WHOLE * _SIDEWAYS * (400.0 / np.asarray(wavelength)) ** 4.32
