"""Configuration of the material source."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from radartwin.config.checks import no_password, one_of, positive, unkeyed
from radartwin.errors import ConfigError

# What each material source reads, with its default.
MATERIALS_FIELDS: dict[str, dict[str, Any]] = {
    "vlm": {
        "missing": None, "model": None, "provider": "recorded", "url": "http://127.0.0.1:8000/v1", "timeout_s": 120.0, "concurrency": 4,
        "views": 3,
    },
    "uniform": {"material": "plasterboard"},
    "void": {},
    "true": {},
    "random": {"p": 0.5, "among": "room"},
    "scene": {},
}  # fmt: skip


@dataclass
class MaterialsConfig:
    """Who says what the room's surfaces are made of. A field that the chosen source does not read is null; null is the default elsewhere.

    `vlm` takes recorded answers in a run; `provider` and what follows it are the defaults of `radartwin label`, which asks.
    """

    source: str = "uniform"  # vlm | uniform | void | true | random | scene: as a scan's manifest says
    material: str | None = None  # uniform: of every room surface
    missing: str | None = None  # vlm: the material of surfaces that nobody answered; null refuses them
    model: str | None = None  # vlm: whose answers; null takes any recorded ones, and the server's default
    p: float | None = None  # random: share of wrong labels
    among: str | None = None  # random: wrong labels from the room's categories, or from all
    provider: str | None = unkeyed(None)  # recorded | server | local
    url: str | None = unkeyed(None)  # server: base of an OpenAI-compatible API; the key is in RADARTWIN_VLM_KEY
    timeout_s: float | None = unkeyed(None)  # server: of one request
    concurrency: int | None = unkeyed(None)  # server: requests under way at once
    views: int | None = unkeyed(None)  # pictures of each surface

    def __post_init__(self) -> None:
        one_of("materials.source", self.source, tuple(MATERIALS_FIELDS))
        read = MATERIALS_FIELDS[self.source]
        for name in (f.name for f in fields(self) if f.name != "source"):
            value = getattr(self, name)
            if name not in read and value is not None:
                readers = "|".join(source for source, names in MATERIALS_FIELDS.items() if name in names)
                raise ConfigError(
                    f"materials.{name}={value} is not read by materials={self.source}; leave it out, or choose materials={readers}"
                )
        no_password("materials.url", self.url, "set RADARTWIN_VLM_KEY instead")
        if self.p is not None and not 0 <= self.p <= 1:
            raise ConfigError(f"materials.p={self.p:g} must be from 0 to 1")
        for name, options in (("among", ("room", "all")), ("provider", ("recorded", "server", "local"))):
            if (value := getattr(self, name)) is not None:
                one_of(f"materials.{name}", value, options)
        for name in ("timeout_s", "concurrency", "views"):
            positive(f"materials.{name}", getattr(self, name))

    def options(self, seed: int = 0) -> dict[str, Any]:
        """What `radartwin.label.sources.material_source` takes beside the source's name."""
        named = {"uniform": ("material",), "vlm": ("missing", "model"), "random": ("p", "among")}.get(self.source, ())
        return {name: self.value(name) for name in named} | ({"seed": seed} if self.source == "random" else {})

    def value(self, name: str) -> Any:
        """A field, or its default where it is null."""
        given = getattr(self, name)
        return MATERIALS_FIELDS[self.source].get(name) if given is None else given
