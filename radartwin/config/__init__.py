"""Typed configuration: one dataclass for each kind of option, composed by Hydra from conf/."""
