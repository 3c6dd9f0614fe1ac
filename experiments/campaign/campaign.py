"""The campaign of a configuration: which recordings there are, and each of them, made now unless it is in the store.

Products of the store: `clean` (a recording without its receiver; a turntable's as the aspects it is made of), `processed` (what every
feature is read from). Noise, leakage and ADC are added when a clean recording is processed, seeded by the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.campaign import tally, truth, twin
from experiments.campaign.cases import Case, Log, log, planned
from experiments.campaign.recorded import Recorded
from experiments.campaign.schedule import RecordingTask, Schedule
from experiments.campaign.turned import Turned
from radartwin.config.config import Config
from radartwin.config.materials import MaterialsConfig, VoidMaterials, default_materials
from radartwin.errors import InputError
from radartwin.features.processed import Processed, process
from radartwin.io.progress import Progress
from radartwin.radar.recording import Recording
from radartwin.runs import workers
from radartwin.store.products import Product, Store

DOMAINS = ("measured", "twin", "void")
CLEAN, PROCESSED = "clean", "processed"
_FILE = "recording"


class Campaign:
    """The campaign of a configuration.

    Args:
        config: profile, gaps, materials, simulator, radar and seed decide the recordings.
        store: keeps them.
    Raises:
        UserError: a recording set that cannot be used, or of another radar than the configuration's.
    """

    def __init__(self, config: Config, store: Store, progress: Progress):
        self.config, self.store, self.progress = config, store, progress
        self._recorded = Recorded(config, progress) if config.measured.provider == "recordings" else None

    @property
    def domain(self) -> str:
        """Of what is measured, for the tables: testbed or recordings."""
        return self.config.measured.provider

    def cases(self, domain: str, **wanted: Any) -> list[Case]:
        """Recordings of a domain under these conditions, e.g. motion="turntable", room="lab", object="mug", distance_m=1.0.

        Beside recorded ones, the twin has each of their conditions once.

        Raises:
            InputError: an unknown domain.
        """
        self._check(domain)
        if self._recorded is None:
            found = planned(self.config.profile.campaign, domain == "measured")
        else:
            found = self._recorded.cases if domain == "measured" else self._recorded.conditions
        return [case for case in found if all(getattr(case, name) == value for name, value in wanted.items())]

    def log(self, case: Case, domain: str = "measured") -> Log:
        """The nominal course of a recording of that domain. Beside recorded ones the twin has the course of a condition's longest
        repetition, of a turntable one turn."""
        if self._recorded is not None:
            return self._recorded.log(case) if domain == "measured" else self._recorded.twin_log(case)
        return log(case, self.config.profile.campaign, measured=domain == "measured")

    def processed(self, domain: str, case: Case, materials: str | MaterialsConfig | None = None) -> tuple[str, Processed]:
        """(key, what features are read from) of one recording, made now unless it is in the store.

        Args:
            materials: of the twin's room: another source than the configured one.
        """
        product = self.process(domain, case, materials)
        return product.key, Processed.load(product.path)

    def process(self, domain: str, case: Case, materials: str | MaterialsConfig | None = None) -> Product:
        """The same as a product of the store: one way for all domains, from samples to what features are read from."""
        key, recording, spec = self._source(domain, case, materials)
        doppler = case.motion != "turntable"

        def build(folder: Path) -> Mapping[str, int]:
            made = recording()
            process(made, doppler=doppler).save(folder)
            return {"frames": made.num_frames}

        return self.store.fetch(PROCESSED, spec | {"of": key, "doppler": doppler}, ["radartwin.features.processed"], build)

    def recording(self, domain: str, case: Case, materials: str | MaterialsConfig | None = None) -> Recording:
        """The recording itself, with its receiver's noise."""
        return self._source(domain, case, materials)[1]()

    def clean(self, domain: str, case: Case, materials: str | MaterialsConfig | None = None) -> Product:
        """The kept recording without its receiver, of the testbed or the twin; `load_clean` reads it."""
        spec, make, roots = self._clean(domain, case, materials)
        return self.store.fetch(CLEAN, spec, roots, lambda folder: _save(make, folder))

    def holds(self, domain: str, case: Case, materials: str | MaterialsConfig | None = None) -> bool:
        """Whether the clean recording is in the store."""
        spec, _, roots = self._clean(domain, case, materials)
        return self.store.holds(CLEAN, spec, roots)

    def prepare(self, wanted: Iterable[tuple[str, Case]], materials: str | MaterialsConfig | None = None, fresh: bool = False) -> None:
        """Make of these (domain, case) what is missing, processed ones too, by several processes where there are many (config.jobs);
        `fresh`: by new ones, so that nothing is set up where what each costs is told."""
        make_together(self.missing(wanted, materials), self.progress, fresh)

    def missing(
        self, wanted: Iterable[tuple[str, Case]], materials: str | MaterialsConfig | None = None, clean: bool = False, setup: str = ""
    ) -> dict[str, RecordingTask]:
        """{key: task} for `make_together`, of the recordings that are missing and can be made. `clean` and `setup` as in RecordingTask."""
        config, found = replace(self.config, materials=self._materials("twin", materials)), {}
        for domain, case in wanted:
            if self._recorded is None or domain != "measured":
                spec, _, roots = self._clean(domain, case, materials)
                if not self.store.holds(CLEAN, spec, roots):
                    found[self.store.key(CLEAN, spec, roots)] = RecordingTask(config, self.store.root, domain, case, clean, setup)
        return found

    def plan(self, *domains: str) -> list[tuple[str, Case]]:
        """What there is to be made, of these domains or of both: cheap motions first, and together what shares a track."""
        chosen = domains or (("measured", "twin") if self._recorded is None else ("twin",))
        order = {motion: number for number, motion in enumerate(("radial", "diagonal", "turntable", "depth", "lateral"))}
        found = [(domain, case) for domain in chosen for case in self.cases(domain)]
        return sorted(found, key=lambda one: (order[one[1].motion] > 2, one[1].room, order[one[1].motion], chosen.index(one[0])))

    def _clean(
        self, domain: str, case: Case, materials: str | MaterialsConfig | None
    ) -> tuple[dict[str, Any], Callable[[], Recording | Turned], list[str]]:
        """What decides a clean recording, a function that makes it, and the modules that do."""
        self._check(domain)
        if domain == "measured":
            if self._recorded is not None:
                raise InputError("measured=recordings has no clean recordings")
            spec = {"domain": "measured", **truth.specification(case, self.config)}
            return spec, lambda: truth.record(case, self.config), ["experiments.campaign.truth"]
        chosen, case = self._materials(domain, materials), replace(case, repetition=0)  # the twin repeats nothing
        nominal = self.log(case, domain)
        spec = {"domain": "twin", **twin.specification(case, nominal, self.config, chosen, self.store)}
        return spec, lambda: twin.record(case, nominal, self.config, chosen, self.store, self.progress.say), ["experiments.campaign.twin"]

    def _source(
        self, domain: str, case: Case, materials: str | MaterialsConfig | None
    ) -> tuple[str, Callable[[], Recording], dict[str, Any]]:
        """Key of what a recording is made from, a function that gives it, and what else decides it."""
        self._check(domain)
        if domain == "measured" and self._recorded is not None:
            recorded = self._recorded
            return recorded.key(case), lambda: recorded.recording(case), {}
        product = self.clean(domain, case, materials)
        if domain == "measured":
            spec = {"hardware": self.config.measured.gap.hardware, "seed": truth.seed_of(case, self.config)}
            return product.key, lambda: truth.receive(load_clean(product), case, self.config), spec
        return product.key, lambda: twin.noisy(load_clean(product), replace(case, repetition=0), self.config), {"seed": self.config.seed}

    def _materials(self, domain: str, materials: str | MaterialsConfig | None) -> MaterialsConfig:
        if domain == twin.VOID:
            return VoidMaterials()
        if materials is None:
            return self.config.materials
        return default_materials(materials) if isinstance(materials, str) else materials

    @staticmethod
    def _check(domain: str) -> None:
        if domain not in DOMAINS:
            raise InputError(f"campaign: there is no domain {domain!r}; choose {', '.join(DOMAINS)}")


def make_together(missing: Mapping[str, RecordingTask], progress: Progress, fresh: bool = False) -> None:
    """Make the missing recordings of one or more campaigns in several workers (config.jobs). Few recordings are left to their first reader.

    Args:
        fresh: as for workers.run.
    Raises:
        as workers.run.
    """
    tasks = list(missing.values())
    count = workers.worker_count(tasks[0].config.jobs, len(tasks)) if tasks else 1
    if count > 1:
        schedule = Schedule(tasks)

        def next_call(worker: int) -> tuple[RecordingTask] | None:
            task = schedule.next_task(worker)
            return None if task is None else (task,)

        with progress.task("recordings", len(tasks)) as made:
            workers.run(_make, next_call, lambda _: made(), count, fresh)


def _make(task: RecordingTask) -> None:
    """Make one recording, in a worker."""
    campaign = _campaign_of(task.config, task.root)
    if task.clean:
        campaign.clean(task.domain, task.case)
    else:
        campaign.process(task.domain, task.case)


_last: list[tuple[Config, Path, Campaign]] = []


def _campaign_of(config: Config, root: Path) -> Campaign:
    """The campaign of the last task of this worker, or a new one."""
    if not _last or _last[0][:2] != (config, root):
        _last[:] = [(config, root, Campaign(config, Store(root), Progress(quiet=True)))]
    return _last[0][2]


def load_clean(product: Product) -> Recording:
    """The recording that a `clean` product holds, all its frames."""
    return Turned.load(product.path).recording() if Turned.is_in(product.path) else Recording.load(product.path / _FILE)


def _save(make: Callable[[], Recording | Turned], folder: Path) -> Mapping[str, int]:
    """Samples as 16-bit counts, 96 dB below the loudest: ten times below the receiver's own noise. Tells what it took."""
    with tally.counted() as told:
        made = make()
    if isinstance(made, Turned):
        made.save(folder)
        return {"frames": len(made.angles), "traced": made.traced, **told}
    made.save(folder / _FILE)
    return {"frames": made.num_frames, "traced": made.num_frames, **told}
