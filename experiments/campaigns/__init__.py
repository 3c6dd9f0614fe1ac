"""The recordings that the tables share, of the measured domain and of its twin, each made once, kept, and processed alike.

Products of the store: `clean` (a recording without its receiver), `processed` (what every feature is read from). Noise, leakage and ADC are
added when a clean recording is processed, seeded by the recording.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from experiments.campaigns import truth, twin
from experiments.campaigns.cases import Case, Log, log, planned
from radartwin.config import Config, MaterialsConfig
from radartwin.errors import InputError
from radartwin.features.processed import Processed, process
from radartwin.progress import Progress
from radartwin.radar.recording import Recording
from radartwin.store import Product, Store

__all__ = ["DOMAINS", "Campaign", "Case", "Log"]

DOMAINS = ("measured", "twin", "void")
_FILE = "recording"


class Campaign:
    """The campaign of a configuration.

    Args:
        config: profile, gaps, materials, simulator, radar and seed decide the recordings.
        store: keeps them.
    """

    def __init__(self, config: Config, store: Store, progress: Progress):
        self.config, self.store, self.progress = config, store, progress
        self._provider = None
        if config.measured.provider == "recordings":
            from radartwin.measured.provider import SetProvider

            assert config.measured.folder is not None
            self._provider = SetProvider(config.measured.folder)

    @property
    def domain(self) -> str:
        """Of what is measured, for the tables: testbed or recordings."""
        return self.config.measured.provider

    def cases(self, domain: str, **wanted: Any) -> list[Case]:
        """Recordings of a domain under these conditions, e.g. motion="turntable", room="lab", object="mug", distance_m=1.0.

        Raises:
            InputError: an unknown domain.
        """
        self._check(domain)
        if domain == "measured" and self._provider is not None:
            found = [
                Case(row.object, row.room, row.motion, row.distance_m, row.repetition)  # type: ignore[arg-type]
                for row in self._provider.rows()
                if row.motion in ("turntable", "radial", "diagonal", "depth", "lateral") and row.distance_m is not None
            ]
        else:
            found = planned(self.config.profile.campaign, domain == "measured")
        return [case for case in found if all(getattr(case, name) == value for name, value in wanted.items())]

    def log(self, case: Case, domain: str = "measured") -> Log:
        """The nominal course of a recording of that domain."""
        return log(case, self.config.profile.campaign, measured=domain == "measured")

    def processed(self, domain: str, case: Case, materials: str | MaterialsConfig | None = None) -> tuple[str, Processed]:
        """(key, what features are read from) of one recording, made now unless it is in the store.

        Args:
            materials: of the twin's room: another source than the configured one.
        """
        key, recording, spec = self._source(domain, case, materials)

        def build(folder: Path) -> None:
            process(recording(), doppler=case.motion != "turntable").save(folder)

        product = self.store.fetch("processed", spec | {"of": key}, ["experiments.campaigns.receiving"], build)
        return product.key, Processed.load(product.path)

    def recording(self, domain: str, case: Case, materials: str | MaterialsConfig | None = None) -> Recording:
        """The recording itself, with its receiver's noise."""
        return self._source(domain, case, materials)[1]()

    def clean(self, domain: str, case: Case, materials: str | MaterialsConfig | None = None) -> Product:
        """The kept recording without its receiver, of the testbed or the twin."""
        self._check(domain)
        if domain == "measured":
            if self._provider is not None:
                raise InputError("measured=recordings has no clean recordings")
            spec = {"domain": "measured", **truth.specification(case, self.config)}
            make, roots = (lambda: truth.record(case, self.config)), ["experiments.campaigns.truth"]
        else:
            chosen = self._materials(domain, materials)
            spec = {"domain": "twin", **twin.specification(case, self.config, chosen, self.store)}
            make, roots = (lambda: twin.record(case, self.config, chosen, self.store)), ["experiments.campaigns.twin"]
        return self.store.fetch("clean", spec, roots, lambda folder: _save(make(), folder))

    def generate(self) -> Iterator[tuple[str, Case, Product]]:
        """Every recording of both domains, made where it is missing."""
        for domain in ("measured", "twin") if self._provider is None else ("twin",):
            for case in self.progress.over(self.cases(domain), f"{domain} recordings"):
                yield domain, case, self.clean(domain, case)

    def _source(self, domain: str, case: Case, materials: str | MaterialsConfig | None) -> tuple[str, Any, dict[str, Any]]:
        """Key of what a recording is made from, a function that gives it, and what else decides it."""
        self._check(domain)
        if domain == "measured" and self._provider is not None:
            row = self._provider.rows(
                object=case.object, room=case.room, motion=case.motion, distance_m=case.distance_m, repetition=case.repetition
            )[0]
            return self._provider.key(row), lambda: self._provider.set.read(row), {}  # type: ignore[union-attr]
        product = self.clean(domain, case, materials)
        if domain == "measured":
            spec = {"hardware": self.config.measured.gap.hardware, "seed": truth.seed_of(case, self.config)}
            return product.key, lambda: truth.receive(Recording.load(product.path / _FILE), case, self.config), spec
        return product.key, lambda: twin.noisy(Recording.load(product.path / _FILE), case, self.config), {"seed": self.config.seed}

    def _materials(self, domain: str, materials: str | MaterialsConfig | None) -> MaterialsConfig:
        if domain == twin.VOID:
            return MaterialsConfig(source=twin.VOID)
        if materials is None:
            return self.config.materials
        return MaterialsConfig(source=materials) if isinstance(materials, str) else materials

    @staticmethod
    def _check(domain: str) -> None:
        if domain not in DOMAINS:
            raise InputError(f"campaign: there is no domain {domain!r}; choose {', '.join(DOMAINS)}")


def _save(recording: Recording, folder: Path) -> None:
    """As 16-bit counts, 96 dB below the loudest sample: ten times below the receiver's own noise."""
    recording.save(folder / _FILE)
