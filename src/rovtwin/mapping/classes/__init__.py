"""Classes of a seabed by spectra: angles, mixtures, areas."""
