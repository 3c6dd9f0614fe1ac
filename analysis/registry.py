"""List the tables of the study in the order of the report. The constant `TABLE` in an experiment's module declares title, caption and
chart.
"""

import functools

from radartwin.config.compose import conf_dir
from radartwin.config.study import ExperimentConfig
from radartwin.errors import ConfigError
from radartwin.io import untrusted_yaml
from radartwin.runs.experiment import Table, declared

NAMES = (  # names of the experiments; each has a file conf/experiment/NAME.yaml
    "reality", "validation", "angle_resolution", "backend_crosscheck", "speed_accuracy", "growth", "stability", "complexity",
    "campaign", "scan", "labels", "gallery", "gaps", "gap_attribution",
    "turntable_shape", "turntable_material", "turntable_size", "linear_rail", "environment",
    "rover_fidelity", "rover_disentangle", "point_clouds", "corner_reflector_calibration",
    "labelled_probe", "many_objects", "simulation_parts", "encoder_comparison", "randomisation_ablation", "unlabelled_adaptation",
    "turntable_label_free", "contrastive", "rover_recognition",
    "reconstruction_ablation", "material_errors", "headline", "positioning",
)  # fmt: skip

# Slow tables, by name: the profiles in which `radartwin tables` makes the table only if --only names it.
ON_REQUEST = {
    "scan": ("quick",), "gaps": ("quick",), "many_objects": ("quick",), "simulation_parts": ("quick",),
    "randomisation_ablation": ("quick",),
}  # fmt: skip

# Printed under every table file that is scored against the testbed.
TESTBED_NOTE = (
    "Scored against the testbed, a virtual measurement campaign that deliberately differs from the twin. The table tests the method and "
    "each named gap; it is not a measurement of reality."
)


def of_profile(profile: str) -> list[str]:
    """Return the names of the tables that `radartwin tables` writes in a profile if the option --only is not given."""
    return [name for name in NAMES if profile not in ON_REQUEST.get(name, ())]


@functools.cache
def table(name: str) -> Table:
    """Return the declaration (title, caption, chart) of a table, read from the table's experiment module."""
    declaration = untrusted_yaml.load((conf_dir() / "experiment" / f"{name}.yaml").read_text(encoding="utf-8"))
    return declared(ExperimentConfig(name=name, module=declaration["experiment"]["module"]))


def check(names: list[str]) -> None:
    """Raise ConfigError if one of the names is not the name of a table."""
    for name in names:
        if name not in NAMES:
            raise ConfigError(f"--only {name}: there is no such table; tables: {', '.join(NAMES)}")
