"""The feature set `decay`: the slope of the range profile behind the target in dB per metre, and two built-in families."""

import numpy as np

from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, GATE_BINS
from radartwin.features.sets import FeatureSet


def slope(processed: Processed, target_m: np.ndarray) -> dict[str, np.ndarray]:
    bin_m = float(np.diff(processed.range_m).mean())
    slopes = []
    for power, near_m in zip(processed.power, target_m, strict=True):
        behind = (processed.range_m > near_m + (GATE_BINS + 1) * bin_m) & (processed.range_m <= FAR_M)
        slopes.append(np.polyfit(processed.range_m[behind], 10 * np.log10(power[behind]), 1)[0])
    return {"decay_db_per_m": np.array(slopes)}


DECAY = FeatureSet(families=("slope", "extent", "brightness"), functions={"slope": slope}, turntable=True)
