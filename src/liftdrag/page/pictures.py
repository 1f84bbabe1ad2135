"""The pictures of a folder, embedded."""

from __future__ import annotations

import struct
from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path

from liftdrag.files import read_bytes
from liftdrag.page.sheets import words

MOST_BYTES = 8_000_000
MOST = 24
"""Pictures of a folder."""

CAPTIONS = {
    "forces": "Drag and lift on the cylinder against displacement: samples, means over half a "
    "diameter, and the mean over the steady window with its standard error as a red band. The "
    "grey part is left out.",
    "bed": "A slice of the bed around the cylinder at half its thickness, coloured by speed.",
    "fields": "Pressure, deviator, solid fraction and speed around the cylinder, averaged over the "
    "steady part.",
    "streamlines": "Streamlines around the cylinder over the speed, in its frame and in that of "
    "the bed far away.",
    "asymmetry": "What is even and what is odd about the plane through the cylinder's axis: "
    "pressure, speed, and the odd normal stress on the cylinder beside the paper's eq. 4.",
    "cylinder": "Normal and tangential stress on the cylinder by angle, with standard errors.",
    "curve": "Apparent mass on the piston against fill: points with errors, both fits and the "
    "hydrostatic line.",
    "profile": "Stresses, mobilised friction and density of the column by height.",
    "drag": "Drag on the cylinder against displacement, the mean over the packings with its "
    "standard error.",
    "flow": "Grains around the cylinder at several displacements: a tracked cluster, and layers.",
}
"""By the name of the file; also what a reader who cannot see them is told."""

_PNG = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Picture:
    """A picture: its data, size in pixels and caption."""

    name: str
    source: str
    width: int
    height: int
    caption: str


def pictures(folder: Path) -> list[Picture]:
    """The PNG pictures of a folder, those known first."""
    known = [folder / f"{name}.png" for name in CAPTIONS]
    others = sorted(set(folder.glob("*.png")) - set(known))
    found = [_picture(path) for path in (*known, *others)[:MOST]]
    return [one for one in found if one is not None]


def _picture(path: Path) -> Picture | None:
    """The picture of a file, None where there is none, or too large a one."""
    try:
        data = read_bytes(path, MOST_BYTES)
    except OSError:
        return None
    if not data.startswith(_PNG) or len(data) < 24:
        return None
    width, height = struct.unpack(">II", data[16:24])
    source = f"data:image/png;base64,{b64encode(data).decode()}"
    caption = CAPTIONS.get(path.stem, f"{words(path.stem)}, a picture of this study or run.")
    return Picture(path.name, source, width, height, caption)
