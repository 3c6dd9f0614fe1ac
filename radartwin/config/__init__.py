"""Typed configuration of a run: one dataclass for each kind of option. Hydra composes the configuration from the files in conf/."""
