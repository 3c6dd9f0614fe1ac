"""Answers about materials: schema, the material that follows, storage, recorded answers, export, import and scores."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from displaced import displaced

from experiments.generators.label_questions import replace_answers
from radartwin.errors import LabelError, MissingError, SceneError
from radartwin.label.answers import Answer, Kind, interior, material_of, read_answer
from radartwin.label.journal import Journal, Record
from radartwin.label.material_score import accuracy_table, judge, wilson
from radartwin.label.question_folder import export, read_answers
from radartwin.label.questions import Question, prompt_digest, questions
from radartwin.label.recorded import (
    ANSWERS,
    SHIPPED,
    Recorded,
    load_records,
    records_for,
    room_of,
    save_records,
    ship_records,
    shipped,
    shipped_rooms,
)  # fmt: skip
from radartwin.label.surface_labels import answer_label
from radartwin.label.surface_match import matches, overlap, place_of
from radartwin.materials import Layered, reflection
from radartwin.materials.minc import MINC
from radartwin.reconstruct.frames.folder import save_frames
from radartwin.reconstruct.frames.frames import Frame, Frames
from radartwin.reconstruct.frames.layouts import load_frames
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface

pytestmark = pytest.mark.filterwarnings("ignore::radartwin.materials.itu.StandInWarning")
GOOD = {"material": "wood", "finish": "smooth", "confidence": 0.8, "reason": "grain"}


@pytest.fixture(scope="module")
def asked() -> list[Question]:
    surfaces = [Surface(objects.plate(2, 1 + k), "concrete", f"plate{k}", role="room") for k in range(2)]
    scene = Scene([*surfaces, Surface(objects.cylinder(0.05, 0.1), "metal", "can")])
    return [questions(scene, views=1, only=[k])[0] for k in range(3)]


def record(question: Question, material: str = "wood", model: str = "tiny") -> Record:
    return Record.of(question, Answer(material, 0.8, "grain"), model, "server")


def test_answer_is_found_within_other_text_and_an_invalid_one_is_refused_in_one_line() -> None:
    for text in (json.dumps(GOOD), f"Here:\n```json\n{json.dumps(GOOD)}\n```", f"{json.dumps(GOOD)} I am sure."):
        assert read_answer(text, "surface") == Answer("wood", 0.8, "grain", finish="smooth")
    wrong: list[tuple[Kind, dict[str, object], str]] = [
        ("object", {}, "'wall_thickness_mm' is a required property"),
        ("object", {"wall_thickness_mm": -1, "contents": "gold"}, "contents: 'gold' is not one of .*; wall_thickness_mm: -1 is less than"),
        ("surface", {"material": "porcelain"}, "'porcelain' is not one of"),
        ("surface", {"finish": "shiny"}, r"finish: 'shiny' is not one of \['polished', .*\]$"),
        ("surface", {"finish": ...}, r"^'finish' is a required property$"),
    ]
    for kind, changes, message in wrong:
        with pytest.raises(LabelError, match=message):
            read_answer({key: value for key, value in (GOOD | changes).items() if value is not ...}, kind)


def test_name_outside_minc_is_replaced_by_the_closest_category_or_refused() -> None:
    answer = read_answer({**GOOD, "material": "porcelain"}, "surface", names=True)
    assert answer.named == "porcelain"
    material, _, stand_in = material_of(answer)
    assert (material, stand_in) == (Layered([], backing="glass"), True)
    steel = read_answer({**GOOD, "material": "steel"}, "surface", names=True)
    assert (steel.material, material_of(steel)[0]) == ("metal", "metal")
    with pytest.raises(LabelError, match="unobtainium"):
        read_answer({**GOOD, "material": "unobtainium"}, "surface", names=True)


@pytest.mark.parametrize(
    ("material", "name", "becomes", "stand_in"),
    [
        # the answer names no material under the paint, so that the material is uncertain
        ("painted", None, MINC["painted"].material, True),
        ("painted", "drywall", MINC["painted"].material, False),
        ("painted", "concrete", "concrete", False),
        ("wallpaper", "plaster on brick", "brick", True),  # its fit ends at 40 GHz
        ("painted", "sheet steel", "metal", False),
        ("other", "mineral fibre ceiling tiles", Layered([("ceiling_board", 0.015)]), False),
        ("other", "felt of unknown make", MINC["fabric"].material, True),
        ("other", None, MINC["other"].material, True),
        ("wood", "varnished pine", MINC["wood"].material, False),
        ("wood", "plywood", Layered([("plywood", 0.02)]), True),  # its fit ends at 40 GHz
        ("plastic", "steel", MINC["plastic"].material, True),  # category and description contradict each other, and the category decides
        ("tile", "ceramic tile on concrete", MINC["tile"].material, True),
        ("stone", "something nobody can name", MINC["stone"].material, True),
    ],
)
def test_name_of_an_answer_specifies_its_category(material: str, name: str | None, becomes: object, stand_in: bool) -> None:
    answer = read_answer({**GOOD, "material": material, "name": name}, "surface")
    assert answer.named == name
    assert Answer.from_dict(json.loads(json.dumps(answer.to_dict()))) == answer
    layers, _, substituted = material_of(answer)
    assert (layers, substituted) == (becomes, stand_in)


FINISHES = {"polished": 0, "smooth": 0.03, "fine": 0.1, "sandy": 0.3, "coarse": 1, "loose": 3, "unknown": 0.05, None: 0.05}


@pytest.mark.parametrize("finish", FINISHES)
def test_finish_of_an_answer_determines_the_rms_height(finish: str | None) -> None:
    """Without a finish, paint has an rms height of 0.05 mm; its correlation length is always 2 mm."""
    answer = Answer("painted", 0.8, "grain", finish=finish)
    assert finish is None or read_answer({**GOOD, "material": "painted", "finish": finish}, "surface") == answer
    assert Answer.from_dict(json.loads(json.dumps(answer.to_dict()))) == answer
    roughness = material_of(answer)[1]
    assert (roughness.height_m, roughness.correlation_m) == pytest.approx((FINISHES[finish] * 1e-3, 2e-3))


def test_provenance_of_a_label_tells_an_absent_finish_and_an_invalid_answer(asked: list[Question]) -> None:
    plate = Surface(objects.plate(1, 1), "wood", "plate")
    label = answer_label(Record.of(asked[0], Answer("stone", 0.9, "wall"), "tiny", "server"), plate)
    assert (label.roughness_m, label.correlation_m, "finish" in label.provenance) == (1e-3, 10e-3, False)
    with pytest.raises(LabelError, match=r"^a recorded answer has the unknown finish 'shiny'$"):
        Answer.from_dict({"material": "wood", "finish": "shiny"})
    marks = answer_label(Record.of(asked[0], Answer.none("rubbish", 3), "tiny", "server"), plate).provenance
    assert (marks["minc"], marks["invalid"], marks["confidence"]) == ("other", True, 0.0)
    assert "3 attempts: rubbish" in marks["reason"]


def test_contents_are_behind_a_shell_of_the_outer_material() -> None:
    bottle = Answer("plastic", 0.9, "bottle", wall_thickness_mm=1.0, contents="water-like liquid")
    material, _, _ = material_of(bottle)
    assert material == Layered([("hdpe", 0.001)], backing="water")
    empty = interior(MINC["plastic"].material, 1.0, "empty")
    assert empty == Layered([("hdpe", 0.001)])
    full, void = (abs(reflection(m, np.array(1.0), np.array(77e9))[0]) for m in (material, empty))
    assert full > 1.5 * void, "the water behind the wall reflects"
    for contents, wall in (("solid", 1.0), ("unknown", 1.0), ("water-like liquid", None), (None, None)):
        assert interior("glass", wall, contents) == "glass"
    assert interior("metal", 0.2, "oil-like liquid") == "metal", "nothing passes metal"


def test_journal_removes_an_incomplete_last_line_and_names_a_damaged_line(tmp_path: Path, asked: list[Question]) -> None:
    path = tmp_path / "labels" / "answers.jsonl"
    journal = Journal(path)
    journal.append(record(asked[0]))
    journal.append(record(asked[1], "metal"))
    whole = path.read_bytes()
    path.write_bytes(whole[:-40])
    again = Journal(path)
    assert [r.key for r in again.records] == [asked[0].key]
    again.append(record(asked[1], "metal"))
    assert path.read_bytes() == whole
    stored = Journal(path).get("tiny", asked[1].key)
    assert stored is not None
    assert (stored.answer, stored.images) == (Answer("metal", 0.8, "grain"), asked[1].images)
    assert Journal(path).get("another", asked[1].key) is None
    path.write_text(path.read_text() + '{"format": 1}\n')
    with pytest.raises(LabelError, match=r"answers\.jsonl, line 3: a recorded answer lacks 'place'"):
        Journal(path)


def test_surfaces_of_a_rescan_match_their_surfaces() -> None:
    lab = rooms.lab(detail="cluttered")
    scanned = displaced(lab, np.random.default_rng(3), offset_m=0.02, tilt_deg=0.3)
    pairs = [pair for pair in matches([place_of(s.mesh) for s in scanned], [place_of(s.mesh) for s in lab]) if pair]
    assert [lab.surfaces[index].name for index, _ in pairs] == list(scanned.names)
    assert min(share for _, share in pairs) > 0.6
    hall, patch = (place_of(rooms.rectangle(at, *np.eye(3)[:2], size=size)) for at, size in (((0, 0, 0), (14, 10)), ((5, 5, 0), (1, 1))))
    assert overlap(patch, hall) == 1
    elsewhere = place_of(objects.plate(1, 1).apply_translation([50, 0, 0]))
    assert matches([elsewhere], [place_of(s.mesh) for s in lab]) == [None]


def test_recorded_answers_match_the_question_first_and_the_place_second(tmp_path: Path) -> None:
    lab = rooms.lab(detail="furnished")
    known = questions(lab, views=1, only=[0, 2, 8])
    materials = ["wood", "painted", "glass"]
    path = save_records(tmp_path / "answers.json", "lab", [record(q, m) for q, m in zip(known, materials, strict=True)])
    records = load_records(path)
    assert [r.answer.material for r in Recorded(records).by_place([q.place for q in known])] == materials  # type: ignore[union-attr]
    same = list(Recorded(records).answers(known))
    assert all(found.key == question.key for question, found in same)
    rescan = questions(displaced(lab, np.random.default_rng(1)), views=1, only=[0, 2, 8])
    moved = dict(Recorded(records).answers(rescan))
    assert [found.answer.material for found in moved.values()] == materials
    assert all(found.key != question.key for question, found in moved.items())
    assert list(Recorded(records, model="another").answers(known)) == []
    assert save_records(tmp_path / "again.json", "lab", list(reversed(records))).read_bytes() == path.read_bytes()
    (tmp_path / "answers.json").write_text('{"format": "radartwin-answers", "version": 2}')
    with pytest.raises(LabelError, match=r"answers\.json is not a radartwin-answers version 1"):
        load_records(path)


def test_confidence_of_an_answer_by_place_is_reduced_to_the_covered_share() -> None:
    x, y, _ = np.eye(3)

    def floor(width_m: float) -> Surface:
        return Surface(rooms.rectangle([0, 0, 0], x, y, (width_m, 4.0)), "plasterboard", "floor", role="room", provenance={"planar": True})

    question = questions(Scene([floor(4.0)]), views=1)[0]
    given = record(question)
    for width, share in ((4.0, 1.0), (8.0, 0.5)):
        label = answer_label(given, floor(width), transferred=True).provenance
        assert label["transferred"] is True
        assert label["covered"] == pytest.approx(share, abs=0.05)
        assert label["confidence"] == pytest.approx(0.8 * label["covered"], abs=0.001)
    label = answer_label(given, floor(8.0)).provenance
    assert label["confidence"] == 0.8
    assert "covered" not in label


def test_room_without_recorded_answers_or_with_earlier_ones_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(MissingError, match="no recorded answers for nowhere; they ship for"):
        shipped("nowhere")
    for folder, remedy in ((None, "use materials=uniform"), (tmp_path, "ask a model: radartwin label .* --provider server")):
        with pytest.raises(MissingError, match=f"no recorded answers for nowhere; {remedy}"):
            records_for(Scene([], {"room": "nowhere"}), folder)
    monkeypatch.setattr("radartwin.label.recorded.prompt_digest", lambda: "0" * 64)
    with pytest.raises(LabelError, match="shipped answers about lab belong to an earlier version of the questions"):
        records_for(Scene([], {"room": "lab"}), None)


def test_shipped_answers_depend_on_the_scanned_room_and_not_on_file_names(tmp_path: Path) -> None:
    facts = ({"source": "lab"}, {"source": "lab", "scan_of": "sha256:01"}, {"source": "lab_frames", "scan_of": "lab"}, {"room": "lab"})
    assert [room_of(Scene([], provenance)) for provenance in facts] == [None, None, "lab", "lab"]
    camera = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 1.5], [0, 0, 0, 1]])
    lens = np.array([[30.0, 0, 16], [0, 30, 12], [0, 0, 1]])
    depth, confidence = np.full((24, 32), 2.0, np.float32), np.full((24, 32), 2, np.uint8)
    frames = Frames.of([Frame(name, camera, lens, depth, None, None, confidence) for name in "ab"], scan_of="lab")
    kept = load_frames(save_frames(frames, tmp_path / "lab_frames"))
    assert [f.scan_of for f in (kept, kept[1:], kept.with_poses(kept.poses))] == ["lab"] * 3
    stranger = load_frames(save_frames(Frames.of(list(frames)), tmp_path / "lab"))
    assert stranger.scan_of.startswith("sha256:")
    assert save_frames(load_frames(tmp_path / "lab"), tmp_path / "elsewhere").name == "elsewhere"
    assert load_frames(tmp_path / "elsewhere").scan_of == stranger.scan_of


def test_shipped_answers_of_every_room_are_complete() -> None:
    folders = {path.parent.name for path in SHIPPED.glob("*/answers.json")}
    assert folders == set(shipped_rooms())
    for room in shipped_rooms():
        assert all(r.images and r.model for r in shipped(room))
        assert {r.prompt for r in shipped(room)} == {prompt_digest()}, "answers to the present questions"
        assert all(r.answer.finish for r in shipped(room) if not r.answer.invalid)


def test_new_answers_replace_the_recorded_answers_if_every_question_has_one(tmp_path: Path, asked: list[Question]) -> None:
    ship_records([record(asked[0])], "den", tmp_path / "to")
    before = (tmp_path / "to" / "den" / ANSWERS).read_bytes()
    lines = [json.dumps({"id": question.id, **GOOD, "finish": "sandy"}) for question in asked[:2]]
    path = tmp_path / "answers.jsonl"
    path.write_text(lines[0])
    with pytest.raises(LabelError, match=f"lacks 1 of 2 answers: {asked[1].id}"):
        replace_answers("den", asked[:2], path, "someone", "blind", tmp_path / "to")
    assert (tmp_path / "to" / "den" / ANSWERS).read_bytes() == before
    path.write_text("\n".join(lines))
    written = replace_answers("den", asked[:2], path, "someone", "blind", tmp_path / "to")
    assert {(r.key, r.answer.finish, r.prompt) for r in load_records(written)} == {(q.key, "sandy", prompt_digest()) for q in asked[:2]}
    digests: dict = {}
    exec((tmp_path / "to" / "digests.py").read_text(), digests)
    assert digests["DIGESTS"] == {"den": hashlib.sha256(written.read_bytes()).hexdigest()}


def test_export_is_complete_and_does_not_reveal_the_materials(tmp_path: Path) -> None:
    lab = rooms.lab(detail="furnished")
    asked = questions(lab, views=1, only=[0, 1, 7, 12])
    folder = export(asked, tmp_path / "out")
    lines = [json.loads(line) for line in (folder / "questions.jsonl").read_text().splitlines()]
    assert [line["id"] for line in lines] == sorted(q.id for q in asked), "in the order of digests, not of surfaces"
    for line in lines:
        assert set(line) == {"id", "kind", "images", "sha256", "question"}
        assert all((folder / name).read_bytes()[:2] == b"\xff\xd8" for name in line["images"])
    everything = "\n".join(p.read_text() for p in folder.iterdir() if p.is_file()) + "\n".join(p.name for p in folder.rglob("*"))
    for name in lab.names:
        if "_" in name:
            assert name not in everything
    for surface in lab:
        assert json.dumps(surface.provenance.get("look", "no look")) not in everything
    assert "Exif" not in "".join(p.read_bytes()[:200].decode("latin1") for p in (folder / "crops").iterdir())
    assert len(list((folder / "crops").iterdir())) == sum(len(line["images"]) for line in lines)


def test_import_accepts_all_lines_or_names_every_invalid_line(tmp_path: Path, asked: list[Question]) -> None:
    thing = {**GOOD, "material": "metal", "wall_thickness_mm": 0.2, "contents": "water-like liquid"}
    good = [{"id": asked[0].id, **GOOD}, {"id": asked[1].id, **GOOD, "material": "drywall"}, {"id": asked[2].id, **thing}]
    path = tmp_path / "answers.jsonl"
    path.write_text("\n".join(json.dumps(line) for line in good) + "\n\n")
    records = read_answers(path, asked, "someone")
    assert [r.answer.material for r in records] == ["wood", "painted", "metal"]
    assert {(r.model, r.provider) for r in records} == {("someone", "import")}
    assert records[2].answer.wall_thickness_mm == 0.2
    bad = [
        json.dumps(good[0]), "nonsense", json.dumps({"id": "abc", **GOOD}), json.dumps({**good[1], "material": "cheese"}),
        json.dumps(good[0]), json.dumps({"id": asked[2].id, **GOOD}),
    ]  # fmt: skip
    path.write_text("\n".join(bad))
    with pytest.raises(LabelError) as caught:
        read_answers(path, asked, "someone")
    message = str(caught.value)
    assert "no answer is imported; correct 5 lines" in message
    for words in ("line 2: not valid JSON", "line 3: the id is not", "line 4: material: 'cheese'", "line 5: ", "line 6: 'wall_thick"):
        assert words in message, words


def room(labels: list[str], truth: list[str], areas: list[float]) -> tuple[Scene, Scene]:
    def build(names: list[str], source: str) -> Scene:
        surfaces = []
        for k, (name, area) in enumerate(zip(names, areas, strict=True)):
            mesh = objects.plate(area, 1.0).apply_translation([3.0 * k, 0, 0])
            surfaces.append(Surface(mesh, MINC[name].material, f"s{k}", role="room", provenance={"source": source, "minc": name}))
        return Scene(surfaces)

    return build(labels, "vlm"), build(truth, "true")


def test_score_weights_accuracy_and_error_by_area() -> None:
    judged = judge(*room(["painted", "wallpaper", "wood", "metal"], ["painted", "painted", "metal", "metal"], [6, 2, 1, 3]))
    frame = accuracy_table(judged)
    assert list(frame["minc"]) == ["metal", "painted", "all"]
    table = {row["minc"]: row for row in frame.to_dict("records")}
    assert table["painted"]["accuracy"] == pytest.approx(6 / 8)
    assert table["painted"]["close"] == 1.0, "wallpaper instead of paint has no error"
    assert table["metal"]["accuracy"] == pytest.approx(3 / 4)
    assert table["metal"]["worst_db"] > 10, "wood instead of metal has a large error"
    assert table["all"]["accuracy"] == pytest.approx(9 / 12)
    assert table["all"]["n"] == 4
    assert table["all"]["mean_db"] == pytest.approx(table["metal"]["worst_db"] / 12)
    assert all(row["low"] <= row["accuracy"] <= row["high"] for row in table.values())


def test_score_of_roughness_is_the_ratio_of_diffuse_power() -> None:
    labelled, truth = room(["painted", "painted"], ["painted", "painted"], [3, 1])
    rough = Scene([s.replaced(roughness_m=height) for s, height in zip(truth, (0.3e-3, 0.05e-3), strict=True)])
    smooth = Scene([s.replaced(roughness_m=0.05e-3) for s in labelled])
    table = {row["minc"]: row for row in accuracy_table(judge(smooth, rough)).to_dict("records")}
    k = 2 * np.pi * 78.72e9 / 299792458.0
    ratio = (1 - np.exp(-((2 * k * 0.3e-3) ** 2))) / (1 - np.exp(-((2 * k * 0.05e-3) ** 2)))
    assert table["all"]["diffuse_db"] == pytest.approx(0.75 * 10 * np.log10(ratio), rel=1e-6)
    assert table["all"]["mean_db"] == 0.0


def test_wilson_interval_matches_published_values() -> None:
    # R. Newcombe, Statistics in Medicine 17 (1998) 857, table I, method 3: 81 of 263 and 15 of 148.
    for hits, n, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611)):
        share, least, most = wilson(np.ones(n), np.arange(n) < hits)
        assert (share, round(least, 4), round(most, 4)) == (pytest.approx(hits / n), low, high)
    _, one, _ = wilson(np.array([100.0, 1e-6]), np.array([True, False]))
    assert one == pytest.approx(wilson(np.ones(1), np.ones(1, bool))[1], abs=1e-4), "one large wall is one decision"


def test_unmatched_surfaces_do_not_count_and_truth_needs_categories() -> None:
    labelled, truth = room(["wood", "metal"], ["wood", "metal"], [1, 1])
    far = labelled.surfaces[0].replaced(mesh=labelled.surfaces[0].mesh.copy().apply_translation([0, 30, 0]))
    assert len(judge(Scene([*labelled.surfaces, far]), truth)) == 2
    blank = Scene([dataclasses.replace(s, provenance={"source": "true"}) for s in truth])
    with pytest.raises(SceneError, match="true surface 's0' has no MINC category"):
        judge(labelled, blank)
