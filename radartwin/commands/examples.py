"""Examples at the end of `radartwin VERB --help`, as pairs (command, purpose); test_documents.py composes their configurations."""

from __future__ import annotations

EXAMPLES: dict[str, tuple[tuple[str, str], ...]] = {
    "demo": (("radartwin demo", "outputs/demo/index.html"),),
    "run": (
        ("radartwin run experiment=validation", "the tracer against closed forms and series"),
        ("radartwin run experiment=environment -m materials=uniform,void seed=0,1", "a sweep: four jobs"),
        (
            "radartwin run experiment=environment -m seed=0,1,2,3 hydra/launcher=joblib hydra.launcher.n_jobs=2",
            "a sweep of four jobs, two in parallel",
        ),
        ("radartwin run experiment=mine --config-dir FOLDER", "an experiment of your own"),
        (
            "radartwin run experiment=mine --config-dir FOLDER --search correlation 'trajectory.height_m=interval(0.5,1.5)'",
            "search for the best value of a metric",
        ),
    ),
    "tables": (
        ("radartwin tables", "all tables in the quick profile"),
        ("radartwin tables --only environment --only validation", "two tables"),
    ),
    "simulate": (
        ("radartwin simulate scene=lab trajectory=static trajectory.distance_m=2", "a corner reflector at 2 m in the laboratory"),
        ("radartwin simulate scene=lab scene.target=mug trajectory.frames=25 --noise", "a mug that turns, with noise"),
        ("radartwin simulate scene=scan scene.path=room trajectory=static", "your own room"),
        (
            "radartwin simulate scene=squash_court trajectory=depth trajectory.distance_m=2 --out outputs/recordings/drive",
            "a drive towards the target",
        ),
        ("radartwin simulate scene=lab scene.target=mug simulator=auto features=rotation", "the cheapest settings that keep the features"),
        ("radartwin simulate scene=lab radar=iwr1843 radar.array=antennas.csv trajectory=static", "your own antenna array"),
    ),
    "process": (
        ("radartwin process outputs/recordings/lab", "a recording of radartwin simulate"),
        ("radartwin process capture.bin", "a capture, its .mmwave.json beside it"),
        ("radartwin process cube.npy --radar openradar_77ghz --moving", "a cube of a known radar, without static echoes"),
    ),
    "import": (
        (
            "radartwin import capture.bin --out measurements object=mug distance_m=1.0 room=lab motion=turntable "
            "licence=CC-BY-4.0 who='A. Researcher' sensor=IWR1843BOOST when=2026-03-01",
            "one capture with its origin",
        ),
        ("radartwin import captures --out measurements --map map.yaml", "a folder of captures"),
    ),
    "export": (
        ("radartwin export outputs/recordings/lab --mcap lab.mcap", "a recording as a timeline for Foxglove"),
        ("radartwin export --out virtual", "the quick campaign"),
        (
            "radartwin export 'profile.campaign.turntable_objects=[corner_reflector,mug]' measured.gap.clutter=0 --out virtual",
            "two objects, without clutter",
        ),
    ),
    "reconstruct": (
        ("radartwin reconstruct room.glb --out room --material concrete", "a mesh"),
        ("radartwin reconstruct frames --out room", "RGB-D frames with poses"),
        (
            "radartwin reconstruct frames --out room --intrinsics 518 519 325.5 253.5 --depth-unit 0.001",
            "RGB-D frames without a camera file",
        ),
    ),
    "label": (
        ("radartwin label room", "recorded answers of the scene"),
        ("radartwin label room --provider server --model OpenGVLab/InternVL2_5-8B", "a server on 127.0.0.1:8000"),
        ("radartwin label room --export questions", "pictures and questions as files"),
        ("radartwin label room --import answers.jsonl --model my-model --missing uniform:plasterboard", "answers from a file"),
    ),
    "view": (
        ("radartwin view room", "room/view.html, by material"),
        ("radartwin view room --layout layout.yaml --trajectory drive.csv", "with objects and the radar's track"),
        ("radartwin view room --live", "a page in which you drag the radar and see its answer"),
        ("radartwin view lab --live --recording outputs/recordings/lab", "a recording beside its simulation"),
    ),
    "classify": (
        (
            "radartwin classify capture.bin --model outputs/cache/run/KEY/models/recogniser --distance 1.0 --period 25",
            "a turntable recording; KEY is the key of a run",
        ),
        ("radartwin classify outputs/recordings/lab --model my-model", "a simulated recording, by a model of radartwin train"),
    ),
    "train": (
        ("radartwin train objects.yaml --out my-model", "your objects, in free space"),
        ("radartwin train objects.yaml --out my-model --room room 'trajectory.position_m=[1.0,2.0,1.0]'", "in your room"),
        (
            "radartwin train objects.yaml --out my-model --distances 0.8,1.2 --frames 128 trajectory.period_s=20 radar=openradar_77ghz",
            "for your turntable and radar",
        ),
    ),
    "benchmark": (
        ("radartwin benchmark", "the shipped methods on all problems"),
        ("radartwin benchmark --method FOLDER", "signals of your own program, see docs/benchmark.md"),
    ),
    "dashboard": (("radartwin dashboard", "the runs in outputs"),),
    "report": (("radartwin report", "outputs/report/index.html"),),
    "doctor": (
        ("radartwin doctor", "this machine"),
        ("radartwin doctor --data measurements", "the faults and the content of a recording set"),
    ),
}


def epilog(verb: str, more: str = "") -> str:
    """Format the examples of a verb for the end of its help text.

    >>> print(epilog("report"))
    examples:
      outputs/report/index.html
        radartwin report
    """
    lines = ["examples:", *(line for command, text in EXAMPLES[verb] for line in (f"  {text}", f"    {command}"))]
    return "\n".join([*lines, *(["", more] if more else [])])
