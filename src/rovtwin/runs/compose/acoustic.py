"""What a filter is given of an acoustic position whose errors last: white noise that says as little.

A filter that gets an error of time constant tau many times in that time, and takes it for white noise, takes the place
for better known than it is. White noise has the same weight at the filter's frequencies when its variance per reading
is

    R = f 2 sigma^2 tau / (1 + omega tau),

f being the rate of the readings and omega the bandwidth of the filter: a steady-state filter whose model errs by a walk
of the force, q on a mass m, and that hears a position with white noise of intensity R / f, has omega^3 = (q / m) /
sqrt(R / f). The two are solved together. That is an approximation, right to a factor of two of the variance where a
filter can be computed, on the side of too little belief (tests/runs/test_acoustic.py).

Reference: Bryson and Johansen (1965), Linear filtering for time-varying systems using measurements containing colored
noise, IEEE TAC 10(1), for what a filter with the error among its states would do.
"""

import equinox as eqx
import numpy as np

from rovtwin.core.numerics import as_array
from rovtwin.gnc.mounting import Mount
from rovtwin.simulation.sensors.sensor import Sensor
from rovtwin.vehicle import Model


def acoustic_mount(sensor: Sensor, model: Model, force_walk: float) -> Mount:
    """A position with an Underwater GPS's errors as the filter knows it.

    Args:
        sensor: With `errors`.
        model: Of the vehicle, for the filter's bandwidth.
        force_walk: Disturbance force that the filter is laid out for [N/sqrt(s)].
    """
    assert sensor.errors is not None
    errors, white = sensor.errors, float(np.asarray(sensor.noise)[0])
    rate = sensor.rate / 1000 * (1.0 - float(sensor.dropout))
    jerk = force_walk / float(np.asarray(model.inertia)[0, 0])

    def equivalent(std: object, memory: object) -> float:
        return equivalent_white(float(np.asarray(std)), float(np.asarray(memory)), rate, jerk)

    along = np.hypot(equivalent(errors.along, errors.along_memory), white)
    across = np.hypot(equivalent(errors.across, errors.across_memory), white)
    growth = across / np.hypot(float(errors.across), white) * float(errors.bearing)
    return Mount(float(across), sensor.lever, sensor.rotation, as_array([along, across, growth]))


def as_white(sensor: Sensor, model: Model, force_walk: float) -> Sensor:
    """A sensor with white noise in place of errors that last, for what knows no other; any other sensor as it is.

    On each axis it tells as much as the position tells along and across the line of sight on average, near the antenna.
    """
    if sensor.errors is None:
        return sensor
    mount = acoustic_mount(sensor, model, force_walk)
    assert mount.sight is not None
    along, across = np.asarray(mount.sight)[:2]
    std = np.sqrt(2.0 / (along**-2 + across**-2))
    return eqx.tree_at(
        lambda one: (one.noise, one.errors), sensor, (np.full(2, std), None), is_leaf=lambda x: x is None
    )


def equivalent_white(std: float, memory: float, rate: float, jerk: float) -> float:
    """Standard deviation of white noise on each reading that weighs as much as a first-order error at low frequencies.

    Args:
        std: Of the error.
        memory: Its time constant [s].
        rate: Of the readings [Hz].
        jerk: What the model's acceleration walks by [m/s2/sqrt(s)].
    """
    bandwidth = intensity = 0.0
    for _ in range(50):
        intensity = 2.0 * std**2 * memory / (1.0 + bandwidth * memory)
        bandwidth = (jerk / np.sqrt(max(intensity, 1e-12))) ** (1.0 / 3.0)
    # An error that fades within a reading is white as it is.
    return float(max(std, np.sqrt(rate * intensity)))
