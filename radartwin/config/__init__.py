"""Typed configuration: one dataclass per group, composed by Hydra from conf/."""
