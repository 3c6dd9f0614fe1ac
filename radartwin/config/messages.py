"""Make one-line messages for configuration mistakes from the several exceptions of Hydra and OmegaConf: what, where, what to do."""

from __future__ import annotations

import dataclasses
import difflib
import re
from collections.abc import Iterator, Sequence
from typing import Any

from radartwin import plugins
from radartwin.config.config import SCHEMAS, Config
from radartwin.config.plugged import GROUPS

GONE = {  # keys and options of version 1.0 that are no longer known, and what to write in their place
    "experiment/baselines": "experiment=stability has rows of RF-Genesis",
    "experiment/sensitivity": "sweep over the settings, as in radartwin run -m experiment=turntable_shape simulator.max_bounces=1,2,4",
    "materials.among": "leave it out, because wrong labels are categories of the room",
    "materials.concurrency": "write radartwin label --concurrency",
    "materials.provider": "write radartwin label --provider",
    "materials.timeout_s": "write radartwin label --timeout",
    "materials.url": "write radartwin label --url",
    "materials.views": "write radartwin label --views",
    "profile.strength_draws": "write profile.strength_campaign.draws",
    "profile.strength_rover_draws": "write profile.strength_campaign.rover_draws",
    "scene.llm_model": "write the sentence in the fixed grammar, or scene.layout=FILE",
    "scene.llm_url": "write the sentence in the fixed grammar, or scene.layout=FILE",
    "simulator.points": "leave it out, because simulator=points puts a point at the centre of each object",
    "supervision.encoder.symmetric": "leave it out, because the encoder has one loss",
    "trajectory.frame": "write trajectory.topic with a topic of Odometry or PoseStamped",
}
METRICS = {  # experiment: metrics of version 1.0 (patterns) and values of its column `metric` that are no longer known, and what to write
    "contrastive": {r"(geometry|material)_(object|recording)": r"write accuracy_\1_other_\2s_embeddings"},
    "encoder_comparison": {
        "accuracy_two-layer_network": "write accuracy_no_labels_two_layer_network_texts_of_looks",
        "accuracy_two-layer_network_radar_texts": "write accuracy_no_labels_two_layer_network",
        r"accuracy_(boosted_trees|convolutional_network)": r"write accuracy_no_labels_\1", "chance": "read the column chance",
    },
    "headline": {
        "holds": "write supported", "fails": "write 'direction shown', undecided or contradicted",
        "untestable": "write 'not testable here'", "gain in correlation": "read the row with the metric \"gain in Fisher's z\"",
    },
    "labelled_probe": {
        r"accuracy_pretrained_(.+)": r"write accuracy_\1_trained_on_simulation", "chance": "read the column chance",
        r"accuracy_raw_(.+)": r"write accuracy_\1_raw_features",
    },
    "randomisation_ablation": {r"accuracy_(nearest_text|other_recordings)_(.+)": r"write accuracy_\2_\1"},
    "reality": {"fails_rows": "write misses_rows", "untestable_rows": "count the rows with an empty verdict"},
    "reconstruction_ablation": {
        r"(object|shape)_(.+)": r"write accuracy_\1_\2",
        "share of the unequal answers": "read the rows with the metric 'share of the unequal objects'",
    },
    "simulation_parts": {r"(accuracy_.+)_RF-Genesis_corrected": r"write \1_RF_Genesis_corrected"},
    "turntable_label_free": {r"accuracy_(geometry|identity|material)": r"write accuracy_\1_encoder_on_ranks"},
    "validation": {"cases_fails": "write cases_misses", "cases_untestable": "write cases_absent"},
}  # fmt: skip


def explain(error: BaseException) -> str:
    """Return one line that explains an exception of Hydra or OmegaConf."""
    from hydra.errors import MissingConfigException, OverrideParseException
    from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

    chain = list(_causes(error))
    for cause in chain:
        if isinstance(cause, OverrideParseException):
            return unreadable(cause.override)
        if isinstance(cause, MissingConfigException) and cause.missing_cfg_file:
            return unknown_option(cause.missing_cfg_file, cause.options or ())
    for cause in reversed(chain):
        if isinstance(cause, ConfigKeyError | ConfigAttributeError) and cause.full_key:
            return unknown_key(cause.full_key, cause.object_type)
        if isinstance(cause, OmegaConfBaseException) and cause.full_key:
            return f"{cause.full_key}: {_first_line(cause)}"
    if match := re.match(r"Could not override '([^']+)'", str(error)):
        return unknown_key(match.group(1), Config)
    if match := re.match(r"Ambiguous value for argument '(.+)'", str(error)):
        return several_values(match.group(1))
    return _first_line(error)


def unreadable(override: str | None) -> str:
    return f"cannot read the override '{override}'; write group=option or key=value"


def several_values(key: str) -> str:
    return f"{key} lists several values; add -m to run them as a sweep, or choose one"


def unknown_option(config_file: str, options: Sequence[str]) -> str:
    """Return the error message for a missing option file GROUP/OPTION; the message lists the existing options of the group."""
    options = [known for known in options if not known.startswith("schema_")]
    group, _, option = config_file.removesuffix(".yaml").rpartition("/")
    if f"{group}/{option}" in GONE:
        return f"{group}={option} was removed after version 1.0; {GONE[f'{group}/{option}']}"
    if (group, option) == ("hydra/launcher", "submitit_slurm"):
        return "hydra/launcher=slurm needs more packages; run pip install 'radartwin[slurm]'"
    if not group:
        return f"there is no configuration '{option}'"
    options = sorted({*options, *(plugins.names(GROUPS[group]) if group in GROUPS else ())})
    return f"{group}={option} is not an option of {group}{_nearest(option, options)}; options: {', '.join(options)}"


def unknown_key(full_key: str, owner: Any) -> str:
    """Return the error message for a configuration key that the dataclass `owner` does not have."""
    if full_key in GONE:
        return f"{full_key} was removed after version 1.0; {GONE[full_key]}"
    parent, _, name = full_key.rpartition(".")
    keys = _keys(owner)
    schemas = SCHEMAS.get(parent, {})
    options = "|".join(option for option, schema in schemas.items() if schema is owner)
    if schemas and not options:
        return f"{full_key} is not known because the file of this option names no schema; begin it with 'defaults: [schema_NAME]'"
    if readers := [option for option, schema in schemas.items() if name in _keys(schema)]:
        choose = f"choose {parent}={'|'.join(readers)}, or leave it out"
        return f"{full_key} is not read by {parent}={options}; {choose}; {parent}={options} has {', '.join(keys)}"
    where = f"{parent}={options} has" if options else f"{parent} has" if parent else "groups and keys are"
    known = f"; {where} {', '.join(keys)}" if keys else ""
    return f"there is no configuration key '{full_key}'{_nearest(name, keys)}{known}"


def _keys(owner: Any) -> list[str]:
    return [f.name for f in dataclasses.fields(owner)] if dataclasses.is_dataclass(owner) else []


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    seen: set[int] = set()  # two exceptions can be each other's context
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__ or error.__context__


def _first_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


def _nearest(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    return f" (did you mean {near[0]}?)" if near else ""
