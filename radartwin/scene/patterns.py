"""Draw the visible patterns of surfaces as pictures: wood grain, joints, weave, mottling. Each pattern repeats without a seam.

Every pattern function has the arguments (rng, picture size (h, w), metres per pixel, colours (K, 3) in 0..1). Every pattern function
returns a picture (h, w, 3) with values in 0..1 and row 0 at the top.
"""

from __future__ import annotations

import numpy as np

Shape = tuple[int, int]


def rgb(value: int) -> tuple[float, float, float]:
    """Convert a colour 0xRRGGBB to three floats in 0..1."""
    return ((value >> 16) / 255, (value >> 8 & 255) / 255, (value & 255) / 255)


def noise(rng: np.random.Generator, shape: Shape, across_px: float, along_px: float | None = None) -> np.ndarray:
    """Draw a picture (h, w) of periodic Gaussian noise with a standard deviation of 1.

    Args:
        across_px: correlation length of the noise along a row, in pixels.
        along_px: correlation length of the noise along a column, in pixels; `across_px` by default.
    """
    rows, columns = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None]
    along_px = across_px if along_px is None else along_px
    gain = np.exp(-2 * np.pi**2 * ((columns * across_px / 2) ** 2 + (rows * along_px / 2) ** 2))
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * gain, shape)
    return (field - field.mean()) / max(field.std(), 1e-12)


def mixed(first: np.ndarray, second: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Mix two colours or pictures to a picture (h, w, 3); `share` (h, w) is the weight, 0 to 1, of the second colour."""
    share = np.clip(share, 0, 1)[..., None]
    return first * (1 - share) + second * share


def shaded(colour: np.ndarray, tone: np.ndarray) -> np.ndarray:
    """Multiply a colour or a picture by the brightness factor 1 + tone, where `tone` is an array (h, w).

    The result is a picture (h, w, 3).
    """
    return colour * (1 + tone[..., None])


def grid(shape: Shape, pixel_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinates of the pixel centres in metres: to the right as an array (1, w), and down as an array (h, 1)."""
    return (np.arange(shape[1])[None] + 0.5) * pixel_m, (np.arange(shape[0])[:, None] + 0.5) * pixel_m


def joints(position_m: np.ndarray, pitch_m: float, width_m: float) -> np.ndarray:
    """Return whether each position lies in a joint of width `width_m`; joints are at the multiples of `pitch_m`."""
    return (position_m + width_m / 2) % pitch_m < width_m


def wood(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw wood grain that runs along the columns of the picture."""
    drift = noise(rng, shape, 0.08 / pixel_m, 0.9 / pixel_m)
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (3 * drift + 0.15 * noise(rng, shape, 0.01 / pixel_m, 0.2 / pixel_m)))
    fibre = noise(rng, shape, 1.5, 0.06 / pixel_m)
    return shaded(mixed(colours[0], colours[1], 0.15 + 0.45 * rings**2), 0.05 * fibre)


def planks(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray, width_m: float = 0.12) -> np.ndarray:
    """Draw floor boards that run along the columns of the picture and have staggered ends."""
    right, down = grid(shape, pixel_m)
    board = (right / width_m).astype(int)
    count = int(board.max()) + 1
    start = rng.uniform(0, 1.2, count)[board]
    piece = np.floor((down + start) / 1.2).astype(int) % round(shape[0] * pixel_m / 1.2)
    tone = rng.normal(0, 0.06, (count, int(piece.max()) + 1))[board, piece]
    image = shaded(wood(rng, shape, pixel_m, colours), tone)
    gap = joints(right, width_m, 1.2 * pixel_m) | joints(down + start, 1.2, 1.2 * pixel_m)
    return np.where(gap[..., None], 0.55 * image, image)


def long_planks(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw the narrow floor boards of a sports court, which run along the rows of the picture."""
    return planks(rng, (shape[1], shape[0]), pixel_m, colours, 0.08).transpose(1, 0, 2)


def panelling(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw veneered wood panels of 0.6 x 1.2 m with open joints."""
    right, down = grid(shape, pixel_m)
    column, row = (right / 0.6).astype(int), (down / 1.2).astype(int)
    leaf = wood(rng, shape, pixel_m, colours)
    tone = rng.normal(0, 0.07, (int(row.max()) + 1, int(column.max()) + 1))[row, column]
    image = shaded(leaf, tone)
    gap = joints(right, 0.6, 0.012) | joints(down, 1.2, 0.012)
    edge = joints(right, 0.6, 0.028) | joints(down, 1.2, 0.028)
    return np.where(gap[..., None], 0.25 * image, np.where(edge[..., None], 0.85 * image, image))


def plaster(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw rolled paint, with faint vertical bands and fine dots."""
    bands = noise(rng, shape, 0.12 / pixel_m, 0.5 / pixel_m)
    return shaded(colours[0], 0.012 * bands + 0.008 * noise(rng, shape, 1.5) + np.zeros(shape))


def concrete(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw bare concrete, with grey clouds and pores."""
    clouds = 0.35 + 0.2 * noise(rng, shape, 0.35 / pixel_m) + 0.1 * noise(rng, shape, 0.05 / pixel_m)
    image = shaded(mixed(colours[0], colours[1], clouds), 0.03 * noise(rng, shape, 1.2))
    pores = noise(rng, shape, 2.0) > 2.7
    return np.where(pores[..., None], 0.6 * image, image)


def painted_concrete(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw a painted concrete wall with faint clouds and scuff marks."""
    clouds = 0.3 + 0.25 * noise(rng, shape, 0.4 / pixel_m)
    image = shaded(mixed(colours[0], colours[1], clouds), 0.01 * noise(rng, shape, 1.5))
    scuffs = noise(rng, shape, 0.03 / pixel_m, 0.008 / pixel_m) > 3.0
    return np.where(scuffs[..., None], 0.82 * image, image)


def brick(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw a brick wall: rows 75 mm high and bricks 225 mm long, both including 10 mm of mortar, shifted by half a
    brick from row to row.
    """
    right, down = grid(shape, pixel_m)
    course = (down / 0.075).astype(int)
    shifted = right + 0.1125 * (course % 2)
    stone = (shifted / 0.225).astype(int) % round(shape[1] * pixel_m / 0.225)
    tone = rng.normal(0, 0.12, (int(course.max()) + 1, int(stone.max()) + 1))[course, stone]
    face = shaded(colours[0], tone + 0.07 * noise(rng, shape, 3))
    mortar = shaded(colours[1], 0.05 * noise(rng, shape, 2))
    return np.where((joints(down, 0.075, 0.01) | joints(shifted, 0.225, 0.01))[..., None], mortar, face)


def carpet(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw a carpet of cut pile in two colours of yarn."""
    return shaded(mixed(colours[0], colours[1], 0.35 + 0.3 * noise(rng, shape, 1.6)), 0.12 * noise(rng, shape, 1.0))


def tiles(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw veined porcelain tiles of 0.6 x 0.6 m with grey joints."""
    right, down = grid(shape, pixel_m)
    column, row = (right / 0.6).astype(int), (down / 0.6).astype(int)
    tone = rng.normal(0, 0.025, (int(row.max()) + 1, int(column.max()) + 1))[row, column]
    veins = np.exp(-np.abs(noise(rng, shape, 0.25 / pixel_m)) * 12)
    face = shaded(colours[0], tone - 0.07 * veins + 0.012 * noise(rng, shape, 2))
    return np.where((joints(right, 0.6, 0.008) | joints(down, 0.6, 0.008))[..., None], colours[1], face)


def ceiling_board(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw perforated acoustic ceiling boards of 0.6 x 0.6 m in a metal grid."""
    right, down = grid(shape, pixel_m)
    face = shaded(colours[0], 0.015 * noise(rng, shape, 2))
    holes = noise(rng, shape, 2.2, 1.6) > 1.9
    face = np.where(holes[..., None], mixed(face, np.broadcast_to(colours[1], face.shape), np.full(shape, 0.7)), face)
    bar = joints(right, 0.6, 0.024) | joints(down, 0.6, 0.024)
    slit = joints(right + 0.014, 0.6, 0.006) | joints(down + 0.014, 0.6, 0.006)
    return np.where(bar[..., None], np.where(slit[..., None], 0.6, 0.97) * np.ones(3), face)


def brushed(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw brushed metal with fine horizontal lines and a broad sheen."""
    return shaded(colours[0], 0.09 * noise(rng, shape, 0.1 / pixel_m, 1.0) + 0.05 * noise(rng, shape, 0.3 / pixel_m))


def glass(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw pale glass panes with soft, oblique reflections."""
    right, down = grid(shape, pixel_m)
    streak = np.sin(2 * np.pi * (right + down) / (shape[1] * pixel_m)) + 0.4 * noise(rng, shape, 0.4 / pixel_m)
    return mixed(colours[0], colours[1], 0.35 + 0.3 * streak)


def fabric(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw a plain weave of two yarns with a period of 6 mm."""
    right, down = grid(shape, pixel_m)
    weave = np.sign(np.sin(2 * np.pi * right / 0.006) * np.sin(2 * np.pi * down / 0.006))
    return shaded(mixed(colours[0], colours[1], 0.4 + 0.3 * weave + 0.1 * noise(rng, shape, 2)), 0.05 * noise(rng, shape, 8))


def leather(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw leather with creases between cells and with worn patches."""
    creases = np.exp(-np.abs(noise(rng, shape, 0.008 / pixel_m)) * 5)
    return shaded(mixed(colours[0], colours[1], 0.7 * creases), 0.07 * noise(rng, shape, 0.08 / pixel_m))


def plastic(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw a uniform colour with a faint texture, like plastic or paint."""
    return shaded(colours[0], 0.012 * noise(rng, shape, 2) + 0.01 * noise(rng, shape, 0.1 / pixel_m))


def cardboard(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw corrugated cardboard with visible flutes and a strip of tape."""
    right, down = grid(shape, pixel_m)
    image = shaded(colours[0], 0.02 * np.sin(2 * np.pi * right / 0.008) + 0.03 * noise(rng, shape, 0.05 / pixel_m))
    tape = np.abs(down - shape[0] * pixel_m / 2) < 0.025
    return np.where((tape & (right > 0))[..., None], 0.35 * image + 0.65 * colours[1], image)


def foliage(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw leaves with light edges and midribs on dark green."""
    layers = noise(rng, shape, 0.05 / pixel_m, 0.09 / pixel_m)
    ribs = np.exp(-np.abs(np.sin(4 * layers)) * 6)
    return shaded(mixed(colours[0], colours[1], 0.3 + 0.2 * layers + 0.3 * ribs), 0.1 * noise(rng, shape, 4))


def monitor(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw a computer screen with a dark frame, a coloured desktop and windows with lines of text."""
    image = np.broadcast_to(colours[0], (*shape, 3)).copy()
    h, w = shape
    inside = (slice(round(0.05 * h), round(0.95 * h)), slice(round(0.03 * w), round(0.97 * w)))
    image[inside] = colours[1] * np.linspace(1.1, 0.7, inside[0].stop - inside[0].start)[:, None, None]
    for top, left, bottom, right in ((0.15, 0.1, 0.75, 0.5), (0.3, 0.55, 0.85, 0.92)):
        image[round(top * h) : round(bottom * h), round(left * w) : round(right * w)] = colours[2]
        for line in range(round((top + 0.06) * h), round((bottom - 0.04) * h), max(3, h // 28)):
            end = left + 0.02 + rng.uniform(0.3, 0.95) * (right - left - 0.04)
            image[line : line + max(1, h // 90), round((left + 0.02) * w) : round(end * w)] = 0.35
    return image


def poster(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw a poster with a heading, a picture of coloured shapes and lines of text."""
    h, w = shape
    image = np.broadcast_to(colours[0], (*shape, 3)).copy()
    image[round(0.05 * h) : round(0.13 * h), round(0.1 * w) : round(0.9 * w)] = colours[2]
    picture = (slice(round(0.18 * h), round(0.62 * h)), slice(round(0.1 * w), round(0.9 * w)))
    size = (picture[0].stop - picture[0].start, picture[1].stop - picture[1].start)
    share = 0.5 + 0.6 * noise(rng, size, w / 5)
    image[picture] = mixed(colours[1], colours[2], np.rint(3 * share) / 3)
    for line in range(round(0.68 * h), round(0.93 * h), max(4, h // 36)):
        image[line : line + max(1, h // 110), round(0.1 * w) : round(rng.uniform(0.6, 0.9) * w)] = 0.3
    return image


def label(rng: np.random.Generator, shape: Shape, pixel_m: float, colours: np.ndarray) -> np.ndarray:
    """Draw the paper label of a can, with a coloured upper half, a medallion, a name and small print, and bare metal at both rims."""
    right, down = grid(shape, pixel_m)
    width, height = shape[1] * pixel_m, shape[0] * pixel_m
    image = np.where((down < 0.5 * height)[..., None], colours[1], colours[0]) * np.ones((*shape, 3))
    away = np.hypot(right - width / 2, down - height / 2)
    image[away < 0.22 * height] = colours[2]
    image[away < 0.18 * height] = colours[0]
    name = (np.abs(down - 0.28 * height) < 0.05 * height) & (np.abs(right - width / 2) < 0.38 * width)
    image[name & (noise(rng, shape, 0.004 / pixel_m, 0.02 / pixel_m) > -0.6)] = 0.95
    for line in np.linspace(0.72, 0.9, 5):
        print_ = (np.abs(down - line * height) < 0.008 * height) & (np.abs(right - width / 2) < rng.uniform(0.2, 0.42) * width)
        image[print_] = 0.25
    seam = np.abs(down - height / 2) > 0.465 * height
    return np.where(seam[..., None], 0.72, image)
