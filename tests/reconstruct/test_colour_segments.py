"""Coplanar pieces are joined, and surfaces separated by colour, in rooms that are built triangle by triangle."""

import numpy as np
import pytest
import trimesh
from built_rooms import BROWN, GREY, WHITE, H, L, W, X, Y, Z, block, coloured, saved, scan, sheet, shell, with_door

from radartwin.reconstruct.build import reconstruct
from radartwin.reconstruct.segmentation import coplanar
from radartwin.reconstruct.segmentation.faces import Faces, members
from radartwin.reconstruct.segmentation.growing import grow
from radartwin.reconstruct.segmentation.segment import segmented


def test_divided_wall_is_one_surface_and_two_tables_are_two():
    strips = [sheet([0, 0, 0], X, Z, (1.2, H)), sheet([2.4, 0, 0], X, Z, (1.6, H))]  # a gap from floor to ceiling
    tables = [sheet([x, 1.0, 0.75], X, Y, (0.8, 0.6)) for x in (0.5, 2.5)]
    mesh = scan([sheet([0, 0, 0], X, Y, (L, W)), *strips, *tables], 0.003)
    segments = segmented(mesh, bodies=False)
    assert sorted(round(s.area_m2, 1) for s in segments if s.normal is not None) == [
        0.5,
        0.5,
        pytest.approx(6.72, abs=0.15),
        pytest.approx(20, abs=0.2),
    ]


def test_pieces_with_points_behind_their_gap_are_not_joined():
    strips = [sheet([0, 0, 0], X, Z, (1.2, H)), sheet([2.4, 0, 0], X, Z, (1.6, H))]
    alcove = sheet([1.2, 0.6, 0], X, Z, (1.2, H))  # behind the strips, which face -y
    faces = Faces.of(scan([*strips, alcove], 0.002), 0.08)
    label = coplanar.merge(faces, grow(faces, 25.0, 0.04, 0.06))
    assert len(members(label)) == 3
    open_gap = Faces.of(scan(strips, 0.002), 0.08)
    assert len(members(coplanar.merge(open_gap, grow(open_gap, 25.0, 0.04, 0.06)))) == 1


def test_door_in_the_plane_of_its_wall_is_separated_by_colour(tmp_path):
    mesh = coloured(scan(shell(), 0.004), with_door)
    door = [s for s in segmented(mesh) if 1.0 < s.area_m2 < 3.0]
    assert [s.area_m2 for s in door] == [pytest.approx(1.8, rel=0.1)]
    assert len(segmented(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))) == 6
    assert len(segmented(mesh, colour=False)) == 6
    walls = [s for s in reconstruct(saved(mesh, tmp_path)) if s.mesh.bounds[0, 0] > L - 0.05]
    assert sum(float(s.mesh.area) for s in walls) == pytest.approx(W * H, rel=0.01)  # neither gap nor overlap between them
    leaf = min(walls, key=lambda s: s.mesh.area)
    assert leaf.mesh.area == pytest.approx(1.8, rel=0.05)
    assert len(leaf.mesh.faces) <= 6


def test_reflection_in_a_panel_is_not_separated_and_a_patch_on_the_wall_is():
    def seen(step_on_wall):
        def rule(v):  # a grey panel with a brighter upper half in the brown wall x = 5, and a patch of another brown beside it
            u = W - v[1]
            if v[0] < L - 0.05:
                return WHITE
            if 0.5 < u < 1.6 and v[2] < 2.0:
                return (175, 175, 180) if v[2] > 1.3 else (130, 130, 135)
            return (165, 112, 72) if step_on_wall and 2.4 < u < 3.4 and 0.5 < v[2] < 1.5 else BROWN

        found = segmented(coloured(scan(shell(), 0.003), rule))
        return sorted(round(s.area_m2, 1) for s in found if s.area_m2 < 3)

    assert seen(False) == [pytest.approx(2.2, abs=0.15)]
    assert seen(True) == [pytest.approx(1.0, abs=0.15), pytest.approx(2.2, abs=0.15)]


def test_two_panels_joined_by_bleeding_colour_are_two():
    def rule(v):
        u = W - v[1]
        panel = (0.5 < u < 1.4 or 2.0 < u < 2.9) and v[2] < 2.0
        return GREY if v[0] > L - 0.05 and (panel or (0.5 < u < 2.9 and v[2] < 0.03)) else BROWN if v[0] > L - 0.05 else WHITE

    found = segmented(coloured(scan(shell(), 0.003), rule))
    assert [s.area_m2 for s in found if s.area_m2 < 3] == [pytest.approx(1.8, rel=0.1)] * 2


def test_light_and_painted_lines_separate_nothing():
    def lit(v):
        spot = 90 * np.exp(-((v[0] - 2) ** 2 + (v[1] - 1.5) ** 2) / 0.5)
        line = 80 if abs(v[2] - 1.2) < 0.03 else 0
        return np.array([150 + spot, 150 + spot - line, 150 + spot - line])

    assert len(segmented(coloured(scan(shell(), 0.003), lit))) == 6


def test_sides_of_one_colour_are_one_body_and_of_two_colours_two():
    room = shell()
    box = block((0.6, 0.6, 0.6), [2, 1.5, 0.3])
    mesh = scan([*room, box], 0.002)

    def one(v):
        return WHITE if v[2] > 0.7 or np.abs(v[:2] - [2, 1.5]).max() > 0.32 or v[2] < 0.01 else BROWN

    def two(v):
        return GREY if 0.58 < v[2] < 0.62 and np.abs(v[:2] - [2, 1.5]).max() < 0.28 else one(v)

    def seen(rule):  # not the box's underside, which touches nothing else
        return [s for s in segmented(coloured(mesh, rule)) if s.area_m2 < 0.6 and s.normal is not None and s.normal[2] > -0.5]

    sides = seen(one)
    assert len({s.body for s in sides}) == 1
    assert len({s.body for s in seen(two)}) == 2
