"""Tests of the 3-D page of a scene in a browser: drawing, colour modes, hiding and picking of surfaces, and a console without errors."""

from __future__ import annotations

import time

import numpy as np
import pytest
from trimesh.visual import ColorVisuals

from radartwin.materials import Layered
from radartwin.scene import objects, rooms
from radartwin.scene.layouts.layout import Layout
from radartwin.scene.layouts.place import furnish
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.scene.viewer.colouring import material_colours, surface_label
from radartwin.scene.viewer.page import material_label, view

WIDTH, HEIGHT, PANEL = 1280, 800, 330
PAPER = (238, 242, 245)  # behind the scene


@pytest.fixture(scope="module")
def lab():
    layout = Layout.from_dict({"objects": [{"object": "corner reflector", "position_m": [3.0, 0.0]}]})
    return furnish(rooms.lab(), layout)


@pytest.fixture(scope="module")
def opened(chromium, lab, tmp_path_factory):
    """Return the browser tab in which the page of the laboratory scene is open and drawn."""
    path = tmp_path_factory.mktemp("page") / "lab.html"
    page = chromium()
    page.open(view(lab, path, poses=trajectory.depth_sweep(rooms.lab_bench(0.4).sensor_pose)), WIDTH, HEIGHT)
    return page


def picture(page):
    """Return the pixels of the page to the left of the control panel."""
    return page.screenshot()[:, : WIDTH - PANEL].astype(int)


def changed(before, after):
    """Return the fraction of pixels that differ between two pictures."""
    return float((np.abs(before - after).max(axis=2) > 12).mean())


def legend(page):
    return page.run("[...document.querySelectorAll('#legend .label')].map(n => n.textContent)")


def test_the_room_and_its_labels_fill_the_window_and_the_console_is_silent(opened):
    labels = opened.run("[...document.querySelectorAll('#labels span')].map(n => n.textContent)")
    assert {"radar", "end, after 0.98 m", "corner_reflector", "x", "y", "z"} <= set(labels)
    drawn = np.abs(picture(opened) - PAPER).max(axis=2) > 12
    assert 0.25 < drawn.mean() < 0.9
    rows, columns = np.nonzero(drawn)
    assert np.ptp(rows) > 0.6 * HEIGHT
    assert np.ptp(columns) > 0.6 * (WIDTH - PANEL)
    assert opened.messages == []


def test_switching_the_colouring_changes_the_picture_with_its_legend_and_back(opened, lab):
    opened.click("#mode-material")
    colours = material_colours([surface_label(s) for s in lab])
    assert legend(opened) == list(colours)
    swatches = opened.run("[...document.querySelectorAll('#legend .swatch')].map(n => getComputedStyle(n).backgroundColor)")
    assert swatches == [f"rgb({r}, {g}, {b})" for r, g, b in colours.values()]
    material = picture(opened)
    opened.click("#mode-segment")
    segment = picture(opened)
    assert changed(material, segment) > 0.2
    assert set(legend(opened)) == set(lab.names)
    opened.click("#mode-reflectivity")
    assert changed(segment, picture(opened)) > 0.2
    assert "dB" in opened.run("document.querySelector('#bar').textContent")
    opened.click("#mode-material")
    assert changed(material, picture(opened)) == 0
    assert not opened.run("document.querySelector('#mode-colour').disabled"), "the rooms have textures"


def test_legend_and_walls_hide_and_show_surfaces(opened):
    opened.click("#mode-segment")
    row = 1 + legend(opened).index("floor")
    opened.click("#view-overview")
    for control, least in ((f"#legend li:nth-child({row})", 0.1), ("#hide-walls", 0.2)):  # the ceiling and two walls hide the room
        before = picture(opened)
        opened.click(control)
        assert changed(before, picture(opened)) > least
        opened.click(control)
        assert changed(before, picture(opened)) == 0


def test_the_card_describes_the_surface_under_the_pointer(opened, lab):
    opened.click("#view-top")
    opened.click("#mode-material")
    free = (WIDTH - PANEL) // 2
    opened.hover(free, HEIGHT // 2)
    name = opened.run("document.querySelector('#card h2').textContent")
    surface = next(s for s in lab if s.name == name)
    card = opened.run("document.querySelector('#card').innerText")
    assert material_label(surface.material) in card
    for fact in ("roughness", "reflects", "source", "kind"):
        assert fact in card
    opened.hover(20, HEIGHT // 2)
    assert opened.run("document.querySelector('#card').hidden")
    opened.click_at(free, HEIGHT // 2)
    assert not opened.run("document.querySelector('#card').hidden")
    opened.drag((free, HEIGHT // 2), (free + 60, HEIGHT // 2))
    assert opened.run("document.querySelector('#card').hidden")
    opened.click("#view-overview")


def test_a_phone_shows_the_scene_above_the_panel_and_the_card_after_a_tap(chromium, lab, tmp_path):
    page = chromium()
    page.open(view(lab, tmp_path / "lab.html"), 390, 844)
    boxes = "['header', 'canvas', '#panel', 'footer'].map(s => document.querySelector(s).getBoundingClientRect())"
    top, left, right = (page.run(f"{boxes}.map(b => b.{side})") for side in ("top", "left", "right"))
    assert np.diff([*top, 844]).min() > 40, "one below the other"
    assert top[2] - top[1] > 350
    assert (left, right) == ([0] * 4, [390] * 4)
    scene = np.abs(page.screenshot()[int(top[1]) : int(top[2])].astype(int) - PAPER).max(axis=2) > 12
    assert np.ptp(np.nonzero(scene)[1]) > 0.7 * 390, "the room fills the width"
    page.tap(195, 0.5 * (top[1] + top[2]))
    assert "roughness" in page.run("document.querySelector('#card').innerText")
    page.tap(5, top[1] + 5)
    assert page.run("document.querySelector('#card').hidden")
    assert page.messages == []


def test_a_scene_opened_in_a_frame_without_a_size_fills_it_once_it_has_one(chromium, lab, tmp_path):
    view(lab, tmp_path / "lab.html")
    frame = '<body style="margin:0" data-ready="yes"><iframe src="lab.html" style="width:0; height:0; border:0"></iframe></body>'
    (tmp_path / "frame.html").write_text(frame)
    page = chromium()
    page.open(tmp_path / "frame.html", WIDTH, HEIGHT)
    page.until("document.readyState === 'complete'")
    page.run("new Promise(done => setTimeout(done, 500))")
    page.run(f"document.querySelector('iframe').style = 'width:{WIDTH}px; height:{HEIGHT}px; border:0'")
    end = time.monotonic() + 10
    while (np.abs(picture(page) - PAPER).max(axis=2) > 12).mean() < 0.25:
        assert time.monotonic() < end, "the room stays small"


def test_colours_of_a_scan_are_drawn(chromium, tmp_path):
    mesh = objects.box([0, 0, 0], [1, 1, 1]).subdivide().subdivide()
    colours = np.where(mesh.vertices[:, 2:] > 0.5, [[200, 30, 30, 255]], [[30, 30, 200, 255]]).astype(np.uint8)
    mesh.visual = ColorVisuals(mesh, vertex_colors=colours)
    page = chromium()
    page.open(view(Scene([Surface(mesh, "concrete", "box")]), tmp_path / "page.html", by="colour"), WIDTH, HEIGHT)
    pixels = picture(page)
    for strong, weak in ((0, 2), (2, 0)):
        assert (pixels[..., strong] > pixels[..., weak] + 60).mean() > 0.03
    assert page.messages == []


def test_names_with_markup_and_stacks_are_shown_unchanged(chromium, tmp_path):
    name = 'a "wall" </script> & <b>more</b>'
    glazing = Layered([("glass", 0.004), ("air", 0.016), ("glass", 0.004)])
    page = chromium()
    page.open(view(Scene([Surface(objects.plate(1, 1), glazing, name)]), tmp_path / "page.html", title=name, by="segment"))
    assert legend(page) == [name]
    assert page.run("document.querySelector('h1').textContent") == name
    page.click("#mode-material")
    assert legend(page) == ["glass 4 mm | air 16 mm | glass 4 mm"]
    assert page.messages == []
