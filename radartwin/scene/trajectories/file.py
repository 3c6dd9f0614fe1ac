"""Read sensor trajectories from files: TUM text files, CSV files with a header, and ROS bags."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from radartwin.errors import MissingError, PoseError
from radartwin.io.git_lfs import refuse_pointer
from radartwin.scene.trajectories.ros import read_bag
from radartwin.scene.trajectories.track import Axes, Track, check_samples, from_quaternions, pose_matrices

TUM = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
# Column names that CSV files of various tools use, with the TUM column that each name means.
ALIASES = {
    "timestamp": "t", "time": "t", "time_s": "t", "t_s": "t", "timestamp_s": "t", "seconds": "t",
    "tx": "x", "ty": "y", "tz": "z", "x_m": "x", "y_m": "y", "z_m": "z",
}  # fmt: skip


def read_track(path: str | Path, axes: Axes = "sensor", topic: str | None = None) -> Track:
    """Read the timed poses in a trajectory file.

    A TUM file has lines `t x y z qx qy qz qw`, and "#" begins a comment. A CSV file has the same columns in any order, named in the first
    line. Aliases of the column names, such as timestamp and tx, are accepted. In a CSV file, a column yaw_deg (counter-clockwise from +x)
    may replace the quaternion. A ROS bag is a .bag file, an .mcap file or a folder.

    Args:
        axes: body axes of the poses in the file: "sensor" (x forward, y left, z up), or "optical" (x right, y down, z forward) for a
            camera.
        topic: topic to read from a ROS bag; `ros.read_bag` explains it.
    Raises:
        MissingError: the file does not exist.
        PoseError: the file is unreadable or a pose is invalid. If a line of a text file is invalid, the message names this line.
    """
    path = Path(path)
    if not path.exists():
        raise MissingError(f"trajectory {path} is not there; give a TUM or CSV text file, or a ROS bag")
    refuse_pointer(path, PoseError)
    if path.is_dir() or path.suffix.lower() in (".bag", ".mcap", ".db3"):
        return read_bag(path, topic).from_axes(axes)
    if topic:
        raise PoseError(f"{path} is a text file, which has no topic; leave it out")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (UnicodeDecodeError, OSError) as error:
        raise PoseError(f"{path} cannot be read as text; give TUM or CSV text, or a ROS bag (.bag, .mcap or a folder)") from error
    return parse_track(text, str(path), csv=path.suffix.lower() == ".csv").from_axes(axes)


def parse_track(text: str, source: str, csv: bool) -> Track:
    """Read the timed poses in TUM or CSV text; `read_track` explains both formats."""
    lines = numbered(text)
    names: Sequence[str] = TUM
    if csv:
        if not lines:
            raise PoseError(f"{source} is empty; its first line must name the columns: {','.join(TUM)}")
        names = [ALIASES.get(name, name) for name in (n.strip().strip('"').lower() for n in lines.pop(0)[1].split(","))]
    columns = _columns(names, source)
    table = number_rows(lines, names, columns, source, "," if csv else None)

    def place(k: int) -> str:
        return f"{source}, line {lines[k][0]}"

    check_samples(table[:, 0], table, place)
    if columns[-1] == "yaw_deg":
        rotations = Rotation.from_euler("z", table[:, 4:], degrees=True).as_matrix()
    else:
        rotations = from_quaternions(table[:, 4:8], place)
    return Track(table[:, 0], pose_matrices(table[:, 1:4], rotations), source)


def numbered(text: str) -> list[tuple[int, str]]:
    """Return the lines of a text with their numbers, without blank lines and lines that begin with the character #."""
    return [(k, line.strip()) for k, line in enumerate(text.splitlines(), 1) if line.strip() and not line.strip().startswith("#")]


def number_rows(
    lines: Sequence[tuple[int, str]], names: Sequence[str], columns: Sequence[str], source: str, separator: str | None = None
) -> np.ndarray:
    """Read the numbers (N, C) of the C `columns` from lines that hold a word for each of `names`. An invalid line raises PoseError."""
    rows = []
    for number, line in lines:
        words = line.split(separator)
        try:
            if len(words) != len(names):
                raise ValueError
            rows.append([float(words[names.index(name)]) for name in columns])
        except ValueError:
            raise PoseError(f"{source}, line {number}: {len(names)} numbers are expected ({' '.join(names)}), not {line[:80]!r}") from None
    return np.array(rows, dtype=np.float64).reshape(-1, len(columns))


def _columns(names: Sequence[str], source: str) -> list[str]:
    """Return the names of the columns to read: the eight columns of TUM, or yaw_deg instead of the four quaternion columns."""
    orientation = ["yaw_deg"] if "yaw_deg" in names else ["qx", "qy", "qz", "qw"]
    columns = ["t", "x", "y", "z", *orientation]
    if missing := [name for name in columns if name not in names]:
        raise PoseError(
            f"{source}: the first line lacks the column {', '.join(missing)}; name {','.join(TUM)} (or yaw_deg for the last four)"
        )
    return columns
