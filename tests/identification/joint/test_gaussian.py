"""Draws from a covariance that a file has rounded."""

import numpy as np

from rovtwin.identification.joint.model.gaussian import root_of


def test_a_root_squares_to_its_covariance_and_rounding_does_not_stop_it():
    whole = np.array([[0.04, 0.01], [0.01, 0.09]])
    np.testing.assert_allclose(root_of(whole) @ root_of(whole).T, whole, atol=1e-15)
    rounded = np.array([[0.01, 0.0100001], [0.0100001, 0.01]])  # a correlation of one, and a little more
    np.testing.assert_allclose(root_of(rounded) @ root_of(rounded).T, rounded, atol=2e-7)
