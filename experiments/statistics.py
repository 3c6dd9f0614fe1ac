"""Intervals shared by the tables."""

import numpy as np
from scipy.stats import bootstrap


def bootstrap_mean(samples: np.ndarray, resamples: int, seed: int) -> tuple[float, float, float]:
    """(low, mean, high): percentile bootstrap, 95 %. One sample has no spread to speak of and is its own interval.

    >>> bootstrap_mean(np.array([2.0]), 100, 0)
    (2.0, 2.0, 2.0)
    """
    samples = np.asarray(samples, float)
    mean = float(samples.mean())
    if len(samples) < 2 or np.ptp(samples) == 0:
        return mean, mean, mean
    interval = bootstrap(
        (samples,), np.mean, n_resamples=resamples, method="percentile", rng=np.random.default_rng(seed)
    ).confidence_interval
    return min(float(interval.low), mean), mean, max(float(interval.high), mean)
