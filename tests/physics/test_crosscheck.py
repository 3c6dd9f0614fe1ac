"""Tools of the comparison with Sionna (image sources of furnished boxes, Fresnel zones, matching of paths), and its result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import radartwin as rt
from experiments.validation import backend_crosscheck as crosscheck
from experiments.validation.oracles import box, stack
from experiments.validation.oracles.rooms import rotation
from experiments.validation.oracles.shells import Room
from experiments.validation.path_match import PathSet, partners, together
from radartwin.scene import objects

SIZE, SENSOR = (4.0, 3.0, 2.5), np.array([1.3, 1.1, 0.9])
FREQUENCY_HZ = 78e9


def walls(material: str | rt.Layered = "concrete") -> rt.Surface:
    mesh = objects.box((0.0, 0.0, 0.0), SIZE)
    mesh.invert()
    return rt.Surface(mesh, material, "walls", role="room")


def images(*surfaces: rt.Surface, bounces: int = 3) -> dict[tuple[float, ...], tuple[complex, bool]]:
    """Return amplitude and clearance of the image paths, by path length and departure direction."""
    found = Room(rt.Scene([walls(), *surfaces]), FREQUENCY_HZ).images(SENSOR, rotation()[:, 2], bounces)
    return {(round(i.length_m, 6), *np.round(i.departure, 6) + 0.0): (i.amplitude, i.clear) for i in found}


def test_an_empty_box_has_all_its_images() -> None:
    eps = stack.permittivity("concrete", FREQUENCY_HZ)

    def reflection(cosine: float) -> tuple[complex, complex]:
        te, tm = stack.fresnel(eps, cosine)
        return complex(te), complex(tm)

    expected = list(box.image_paths(np.array(SIZE), SENSOR, rotation()[:, 2], reflection, 3))
    found = images()
    assert len(found) == len(expected) == 62
    scale = 299_792_458.0 / (4 * np.pi * FREQUENCY_HZ)
    ours = sorted(abs(amplitude) for amplitude, _ in found.values())
    assert ours == pytest.approx(sorted(abs(a) * scale / length for a, length, _ in expected), rel=1e-9)


def test_screen_removes_images_and_cuts_fresnel_zones() -> None:
    """Screens leave a slot around the mirror point, a quarter of the path away, where the zone is two thirds as wide as on the wall."""
    ahead = (round(2 * (SIZE[0] - SENSOR[0]), 6), 1.0, 0.0, 0.0)
    zone = np.sqrt(299_792_458.0 / FREQUENCY_HZ * ahead[0]) / 2
    assert images(bounces=1)[ahead][1]
    for half, there, clear in ((3 * zone, True, True), (0.4 * zone, True, False), (0.0, False, False)):
        x, y = 2.0, SENSOR[1]
        left = objects.box((x, y + half, 0.2), (x + 0.01, 2.9, 2.4))
        right = objects.box((x, 0.1, 0.2), (x + 0.01, y - half, 2.4))
        found = images(rt.Surface(left, "metal", "left"), rt.Surface(right, "metal", "right"), bounces=1)
        assert (ahead in found) == there
        if there:
            assert found[ahead][1] == clear


def found(length: list[float], azimuth_deg: list[float], amplitude: list[complex]) -> PathSet:
    angle = np.radians(azimuth_deg)
    direction = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    none = np.zeros(len(length), bool)
    return PathSet(np.array(length), direction, direction, np.array(amplitude), none, none)


def test_orders_of_one_image_are_added_and_neighbours_are_not() -> None:
    each = together(found([5.0, 5.0, 5.0, 5.0001], [10.0, 10.0, 10.5, 10.0], [1.0, 0.5j, 0.25, 0.125]))
    assert sorted(np.abs(each.amplitude)) == pytest.approx([0.125, 0.25, abs(1 + 0.5j)])


def test_matched_paths_agree_in_length_and_directions() -> None:
    among = found([5.0, 5.004, 6.0], [10.0, 10.0, 20.0], [1, 1, 1])
    of = found([5.001, 5.0035, 5.02, 6.0], [10.1, 10.0, 10.0, 20.6], [1, 1, 1, 1])
    assert partners(of, among).tolist() == [0, 1, -1, -1]
    turned = replace(of, arrival=-of.arrival)
    assert partners(turned, among).tolist() == [-1, -1, -1, -1]
    assert partners(of, found([], [], [])).tolist() == [-1] * 4


def test_reference_is_scored_by_its_matched_paths() -> None:
    mine = replace(found([5.0, 6.0, 7.0], [0.0, 10.0, 20.0], [1.0, 0.1, 1e-4]), clear=np.array([True, False, True]))
    theirs = found([5.0002, 6.0, 8.0, 9.0], [0.0, 10.0, 20.0, 30.0], [2.0, 0.1, 0.5, 1e-5])
    theirs = replace(theirs, clear=np.array([True, False, False, False]))
    scored = crosscheck.compare(theirs, mine)
    assert scored.matched.tolist() == [True, True, False]  # the fourth path is 106 dB weaker than the strongest path
    assert scored.length_mm == pytest.approx([0.2, 0.0])
    assert scored.level_db == pytest.approx([6.02], abs=0.01)
    assert scored.cut_level_db == pytest.approx([0.0])
    assert scored.simulated_matched.tolist() == [True, True]


# least shares where the limit of the table, 0.95, is missed
KNOWN_SHARES = {("lab", "furnished"): 0.75, ("atrium", "furnished"): 0.85, ("squash_court", "furnished"): 0.9}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the room has .* edges:radartwin.simulation.flat.room.RoomWarning")
def test_the_cross_check_holds_in_every_room() -> None:
    """If transmitter and receiver are apart, Sionna finds further paths in furnished rooms."""
    from radartwin.config.compose import compose
    from radartwin.io.progress import Progress
    from radartwin.runs.experiment import check_rows

    result = crosscheck.run(compose(["experiment=backend_crosscheck"]), None, Progress())  # type: ignore[arg-type]
    check_rows("backend_crosscheck", result.rows)
    rows = {(r["room"], r["detail"], r["reference"], r["metric"]): r for r in result.rows}
    for room in crosscheck.ROOMS:
        for detail in crosscheck.DETAILS:
            for reference in crosscheck.REFERENCES[:2]:
                assert rows[room, detail, reference, "matched share"]["value"] == 1
                assert rows[room, detail, reference, "length error (mm)"]["high"] < 0.002
                assert rows[room, detail, reference, "level error (dB)"]["value"] < 0.4
            for reference in crosscheck.REFERENCES[2:]:
                share = rows[room, detail, reference, "matched share"]["value"]
                assert share > KNOWN_SHARES.get((room, detail), 0.95), (room, detail)
