"""List the recordings of a measurement campaign, and return each recording; a recording that is not in the store is simulated.

The store holds two results for each recording, `clean` and `processed`. The result `clean` is the recording before receiver effects (noise,
leakage, ADC). A measured turntable recording with more frames than traced target angles (aspects) is stored as the radar signals at these
angles. All features are computed from the stored result `processed`. Receiver effects are added when a clean recording is processed. The
random seed of these effects comes from the configured seed, the draw (in the testbed) and the name of the recording.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.campaign import packed, tally, truth, twin
from experiments.campaign.cases import COMPARED, DOMAINS, MEASURED, ROVER, TWIN, VOID, Case, Log, log, planned
from experiments.campaign.recorded import Recorded
from experiments.campaign.schedule import CALL_S, RecordingTask, Schedule
from experiments.campaign.turned import Turned
from radartwin.config.config import Config
from radartwin.config.materials import MaterialsConfig, VoidMaterials
from radartwin.errors import InputError
from radartwin.features.processed import Processed, process
from radartwin.io.progress import Progress
from radartwin.radar.recording import Recording
from radartwin.runs import workers
from radartwin.store import array_cache
from radartwin.store.digest import spec_digest
from radartwin.store.products import Product, Store

Call = tuple[Any, ...]  # a function of a module, and its arguments
CLEAN, PROCESSED = "clean", "processed"
NOT_OF_ROOM = {"case", "course", "families", "limits", *truth.OF_TARGET}  # entries of a specification that do not change the room


class Campaign:
    """List, simulate and read the measured and simulated recordings of one configuration, which the store keeps. `draw` is the only listed
    draw of the virtual campaign; None stands for measured.draw, or for all draws. Raises UserError if the recording set cannot be used.
    """

    def __init__(self, config: Config, store: Store, progress: Progress, draw: int | None = None):
        self.config, self.store, self.progress = config, store, progress
        self.draw = config.measured.draw if draw is None else draw
        self._recorded = Recorded(config, progress) if config.measured.provider == "recordings" else None

    def with_materials(self, materials: MaterialsConfig) -> Campaign:
        """Return this campaign with another material source of the simulated room."""
        other = copy.copy(self)
        other.config = replace(self.config, materials=materials)
        return other

    def cases(self, domain: str, **conditions: Any) -> list[Case]:
        """Return the recordings of a domain that meet conditions such as motion="turntable" or object="mug".

        A recording set has one simulated recording per condition, without repetitions. Raises InputError for an unknown domain.
        """
        self._check(domain)
        if self._recorded is None:
            cases = planned(self.config.profile.campaign, domain == MEASURED)
            cases = [case for case in cases if domain != MEASURED or self.draw in (None, case.draw)]
        else:
            cases = self._recorded.cases if domain == MEASURED else self._recorded.conditions
        return [case for case in cases if all(getattr(case, name) == value for name, value in conditions.items())]

    def log(self, case: Case, domain: str = "measured") -> Log:
        """Return the log of a recording; from a recording set the simulation follows the longest repetition, cut to one revolution."""
        if self._recorded is not None:
            return self._recorded.log(case) if domain == MEASURED else self._recorded.twin_log(case)
        return log(case, self.config.profile.campaign, measured=domain == MEASURED)

    def processed(self, domain: str, case: Case) -> tuple[str, Processed]:
        """Return (store key, processed recording) of a case (object, room, motion, distance); a missing recording is simulated."""
        product = self.process(domain, case)
        return product.key, Processed.load(product.path)

    def process(self, domain: str, case: Case) -> Product:
        """Return the processed recording as a stored result (Product)."""
        key, recording, spec = self._source(domain, case)
        doppler = case.motion != "turntable"

        def build(folder: Path) -> Mapping[str, int]:
            made = recording()
            process(made, doppler=doppler).save(folder)
            return {"frames": made.num_frames}

        return self.store.fetch(PROCESSED, spec | {"of": key, "doppler": doppler}, ["radartwin.features.processed"], build)

    def recording(self, domain: str, case: Case) -> Recording:
        """Return the recording with receiver effects. One simulated from the scan has thermal noise as its only receiver effect."""
        return self._source(domain, case)[1]()

    def clean(self, domain: str, case: Case) -> Product:
        """Return the simulated recording before receiver effects as a stored result (Product); `load_clean` reads its samples."""
        spec, make, roots = self._clean(domain, case)
        return self.store.fetch(CLEAN, spec, roots, lambda folder: _save(make, folder))

    def prepare(self, wanted: Iterable[tuple[str, Case]], fresh: bool = False) -> None:
        """Simulate the missing recordings among the (domain, case) pairs in config.jobs workers; `fresh` starts new workers."""
        make_together(self.missing(wanted), self.config.jobs, self.progress, fresh)

    def missing(self, wanted: Iterable[tuple[str, Case]], clean: bool = False) -> dict[str, RecordingTask]:
        """Return {store key: task} of the simulated recordings that the store lacks; `clean` becomes an attribute of the tasks."""
        tasks = {}
        for domain, case in wanted:
            if self._recorded is None or domain != MEASURED:
                spec, _, roots = self._clean(domain, case)
                if not self.store.holds(CLEAN, spec, roots):
                    key, setup = self.store.key(CLEAN, spec, roots), _setup(spec)
                    tasks[key] = RecordingTask(self.config, self.store.root, domain, case, clean, setup)
        return tasks

    def plan(self) -> list[tuple[str, Case]]:
        """Return all (domain, case) pairs to simulate: short motions first, and recordings along one path of the radar together."""
        domains = COMPARED if self._recorded is None else (TWIN,)
        order = {motion: number for number, motion in enumerate(("radial", "diagonal", "turntable", "depth", "lateral"))}
        pairs = [(domain, case) for domain in domains for case in self.cases(domain)]
        return sorted(pairs, key=lambda pair: (order[pair[1].motion] > 2, pair[1].room, order[pair[1].motion], domains.index(pair[0])))

    def _clean(self, domain: str, case: Case) -> tuple[dict[str, Any], Callable[[], Recording | Turned], list[str]]:
        """Return specification, simulating function and names of the deciding modules of a recording before receiver effects."""
        self._check(domain)
        if domain == MEASURED:
            if self._recorded is not None:
                raise InputError("measured=recordings has no recordings without receiver effects; use measured=testbed")
            spec = {"domain": MEASURED, **truth.specification(case, self.config)}
            return spec, lambda: truth.record(case, self.config), ["experiments.campaign.truth"]
        source, case = VoidMaterials() if domain == VOID else self.config.materials, case.condition
        nominal = self.log(case, domain)
        spec = {"domain": TWIN, **twin.specification(case, nominal, self.config, source, self.store)}
        return spec, lambda: twin.record(case, nominal, self.config, source, self.store, self.progress.say), ["experiments.campaign.twin"]

    def _source(self, domain: str, case: Case) -> tuple[str, Callable[[], Recording], dict[str, Any]]:
        """Return store key and reading function of the recording to process, and the entries that this adds to the specification."""
        self._check(domain)
        if domain == MEASURED and self._recorded is not None:
            recorded = self._recorded
            return recorded.key(case), lambda: recorded.recording(case), {}
        product = self.clean(domain, case)
        if domain == MEASURED:
            gap = self.config.measured.gap
            spec = {"hardware": gap.hardware, "unscanned": gap.unscanned_echoes, "seed": truth.seed_of(case, self.config)}
            return product.key, lambda: truth.receive(load_clean(product), case, self.config), spec
        return product.key, lambda: twin.noisy(load_clean(product), case.condition, self.config), {"seed": self.config.seed}

    @staticmethod
    def _check(domain: str) -> None:
        if domain not in DOMAINS:
            raise InputError(f"campaign: unknown domain {domain!r}; choose {', '.join(DOMAINS)}")


def _setup(spec: Mapping[str, Any]) -> str:
    """Return a digest of those entries of a recording's specification that change the set-up of its track (path of the radar in a room)."""
    room = {name: value for name, value in spec.items() if name not in NOT_OF_ROOM}
    return spec_digest(room | {"gap": {name: value for name, value in spec.get("gap", {}).items() if name not in NOT_OF_ROOM}})


def joined(task_sets: Iterable[Mapping[str, RecordingTask]]) -> dict[str, RecordingTask]:
    """Join the task dictionaries of several campaigns. A recording is processed if at least one of the campaigns needs it processed."""
    tasks: dict[str, RecordingTask] = {}
    for missing in task_sets:
        for key, task in missing.items():
            first = tasks.setdefault(key, task)
            tasks[key] = replace(first, clean=first.clean and task.clean)
    return tasks


def make_together(
    missing: Mapping[str, RecordingTask], jobs: int, progress: Progress, fresh: bool = False, calls: Sequence[Call] = ()
) -> None:
    """Simulate the missing recordings of one or more campaigns in at most `jobs` workers; `fresh` starts new workers, and a single worker
    is the calling process. `calls` are further simulations, which the workers start before the recordings. Recordings of one track are
    simulated one after the other, because they share a set-up.
    """
    tasks = list(missing.values())
    if not (tasks or calls):
        return
    count = workers.worker_count(jobs, len(tasks) + len(calls))
    schedule, ahead = Schedule(tasks), list(reversed(calls))

    running: dict[int, float] = {}  # expected processor time in seconds of each worker's call

    def waiting() -> float:
        return schedule.remaining() + CALL_S * len(ahead)

    def next_call(worker: int) -> Call | None:
        before = waiting()
        call = ahead.pop() if ahead else (_make, task) if (task := schedule.next_task(worker)) else None
        running[worker] = before - waiting()
        return call

    def remaining() -> float:
        return (waiting() + sum(running.values()) / 2) / count

    with progress.task("recordings", len(tasks) + len(calls), remaining) as made:
        if count > 1:
            workers.run(_called, next_call, lambda _: made(), count, fresh)
        else:
            while (call := next_call(0)) is not None:
                _called(*call)
                made()


def _called(function: Callable[..., object], *arguments: Any) -> None:
    function(*arguments)


def _make(task: RecordingTask) -> None:
    """Simulate the recording of a task in a worker. Workers share the traced paths of radars at rest; nobody reads those of a drive."""
    campaign = _campaign_of(task.config, task.root)
    with nullcontext() if task.case.motion in ROVER else array_cache.in_folder(task.root / "paths"):
        if task.clean:
            campaign.clean(task.domain, task.case)
        else:
            campaign.process(task.domain, task.case)


_last: list[tuple[Config, Path, Campaign]] = []


def _campaign_of(config: Config, root: Path) -> Campaign:
    """Return the campaign of this worker's last task if configuration and store have not changed, else a new campaign."""
    if not _last or _last[0][:2] != (config, root):
        _last[:] = [(config, root, Campaign(config, Store(root), Progress(quiet=True)))]
    return _last[0][2]


def load_clean(product: Product) -> Recording:
    """Read all frames of the recording from a stored `clean` result."""
    return Turned.load(product.path).recording() if Turned.is_in(product.path) else packed.load(product.path)


def _save(make: Callable[[], Recording | Turned], folder: Path) -> Mapping[str, int]:
    """Simulate a recording, save it as 16-bit counts (quantisation noise ten times below the receiver's noise), and return its metadata."""
    with tally.counted() as counts:
        made = make()
    if isinstance(made, Turned):
        made.save(folder)
        return {"frames": len(made.angles), "traced": made.traced, **counts}
    packed.save(made, folder)
    return {"frames": made.num_frames, "traced": made.num_frames, **counts}
