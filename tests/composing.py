"""Compose configurations in tests. The option files are read once per combination of options and process, which takes 0.2 s."""

from collections.abc import Sequence

from radartwin.config.compose import Composer
from radartwin.config.config import Config

COMPOSER = Composer()


def compose(overrides: Sequence[str] = ()) -> Config:
    return COMPOSER.compose(overrides)
