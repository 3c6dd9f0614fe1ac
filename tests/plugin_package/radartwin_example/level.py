"""The experiment `level`: the strongest echo of a recording, in dB."""

import numpy as np

from radartwin.builders.recording import simulate_scene
from radartwin.features.families import vector
from radartwin.features.log import Nominal
from radartwin.features.processed import process
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import save_arrays

TABLE = Table("level", "Level", "Level of the strongest echo.")
OVERRIDES = {"scene": "void", "trajectory": "static"}


def run(config, store, progress):
    spec = {name: getattr(config, name) for name in ("scene", "radar", "trajectory", "simulator", "materials", "features", "seed")}

    def build(folder):
        seen = process(simulate_scene(config))
        frames = seen.num_frames
        nominal = Nominal(10.0, np.full(frames, float(config.trajectory.distance_m)), None)
        _, values = vector(seen, nominal, config.features.name, config.features.without)
        save_arrays(folder, {"level_db": 10 * np.log10(seen.power.max()), "first": values[:1]})

    product = store.fetch("level", spec, ["radartwin.builders.recording"], build)
    value = float(product.arrays()["level_db"])
    row = {
        "run_keys": product.key, "metric": "level, dB", "paper": None, "value": value, "low": value, "high": value, "n": 1,
        "domain": "simulation", "verdict": "",
    }  # fmt: skip
    metrics = {"level_db": value, "first_feature": float(product.arrays()["first"][0])}
    return Result("level", [row], {}, metrics, [product.key])
