"""Estimate the sample rate from stamps with jitter and rounding, and with missing samples.

Stamps ``t`` with a step ``s`` have nearly the same phase in ``exp(2 pi i t / s)``, however many
are missing. The step that maximises the length of their mean phasor is searched coarsely with a
few stamps, and then ever finer with more.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError

_FEWEST = 100  # stamps needed for a rate
_FIRST = 256  # stamps of the coarse search
_GROWTH = 4
_MOST = 4096  # stamps of a fine search, evenly chosen
_LOWEST, _HIGHEST = 0.97, 1.35  # times the mean rate: a quarter of the samples may be missing
_COHERENT = 0.25  # least mean phasor of stamps with a step; 256 stamps without one reach 0.15
_LONG_GAP = 30.0  # times the mean step: longer than the pause between bursts of samples
_TRIALS = 5000  # largest number
_AS_GOOD = 0.9  # share of the best coherence
_PER_LOBE = 8  # trials over the width of a peak


def usual_step(stamps_ns: npt.NDArray[np.int64], known_ns: float, split_ns: int) -> float:
    """Return the time between rising stamps (n,) where none is missing, ns.

    ``known_ns`` is an earlier estimate, or 0. Stamps that come in bursts have no step; then the
    mean step is returned. Raises CalibrationError if there are too few stamps.
    """
    run = _longest_run(stamps_ns, split_ns)
    if len(run) < _FEWEST:
        if known_ns:
            return known_ns
        raise CalibrationError(
            f"{len(run)} samples in one piece are too few to tell their rate; record longer"
        )
    times = (run - run[0]).astype(float)
    if known_ns:
        return _refined(times, known_ns)
    mean_ns = _mean_step(np.diff(times))
    first = times[:_FIRST]
    number = int((_HIGHEST - _LOWEST) / mean_ns * first[-1] * _PER_LOBE) + 2
    trials = np.linspace(_LOWEST, _HIGHEST, min(number, _TRIALS)) / mean_ns
    lengths = _coherence(first, trials)
    if lengths.max() < _COHERENT:
        return mean_ns
    # Rounded stamps are as coherent at the clock's tick rate minus the true rate: take the lower.
    lowest = int(np.argmax(lengths >= _AS_GOOD * lengths.max()))
    found = 1 / float(trials[lowest + np.argmax(lengths[lowest : lowest + _PER_LOBE])])
    number = _FIRST
    while number < len(times):
        number *= _GROWTH
        found = _refined(times[:number], found)
    return found


def _longest_run(stamps_ns: npt.NDArray[np.int64], split_ns: int) -> npt.NDArray[np.int64]:
    runs = np.split(stamps_ns, np.flatnonzero(np.diff(stamps_ns) > split_ns) + 1)
    return max(runs, key=len)


def _mean_step(steps: Array) -> float:
    """Return the mean step without the long gaps."""
    for _ in range(2):
        steps = steps[steps <= _LONG_GAP * steps.mean()]
    return float(steps.mean())


def _refined(times: Array, step_ns: float) -> float:
    """Return the step near a known one, or the known one if the stamps have none."""
    picked = times[:: -(-len(times) // _MOST)]
    lobe = 1 / times[-1]
    # With a quarter of these stamps, as in the previous search, the peak is four times as wide.
    trials = 1 / step_ns + np.linspace(-1, 1, 2 * _PER_LOBE * _GROWTH + 1) * lobe * _GROWTH / 2
    lengths = _coherence(picked, trials)
    best = int(np.argmax(lengths))
    if lengths[best] <= _COHERENT:
        return step_ns
    return _fitted(picked, 1 / float(trials[best]))


def _fitted(times: Array, step_ns: float) -> float:
    """Return the slope of the line through stamps, whose grid places are unambiguous by now."""
    parts = times / step_ns
    phase = float(np.angle(np.exp(2j * np.pi * parts).mean())) / (2 * np.pi)
    places = np.rint(parts - phase)
    places -= places.mean()
    return float(places @ times / (places @ places))


def _coherence(times: Array, rates: Array) -> Array:
    """Return the length (k,) of the mean phasor at each rate."""
    return np.asarray(np.abs(np.exp(2j * np.pi * rates[:, None] * times).mean(axis=1)))
