"""Spectra by wavelength: what water takes and scatters, how the seabed looks, what lamps and daylight give."""
