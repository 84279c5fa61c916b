"""What a sensor has seen: marker positions over time, and how the markers are laid out."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True)
class MarkerLayout:
    """The markers of a sensor in its unloaded state.

    Attributes:
        reference: unloaded positions [mm].
        neighbours: indices of each marker's neighbours, filled up with −1.
        grid_shape: rows and columns where the markers form a regular grid (marker
            `row * columns + column`), else None.
    """

    reference: Float[np.ndarray, "n d"]
    neighbours: Int[np.ndarray, "n k"]
    grid_shape: tuple[int, int] | None = None


@dataclass(frozen=True)
class Frame:
    """One frame of a recording, as a camera delivers it.

    Attributes:
        positions: marker positions [mm]; NaN where a marker was not seen.
        valid: which markers can be used.
        time: time stamp [s].
        source_index: number the source gave the frame.
        moment: moment about the contact normal [N·mm], NaN where unknown.
        flaw: why the frame cannot be used, empty where it can.
    """

    positions: Float[np.ndarray, "n d"]
    valid: Bool[np.ndarray, " n"]
    time: float
    source_index: int
    moment: float = float("nan")
    flaw: str = ""


@dataclass(frozen=True)
class Recording:
    """Marker positions over time.

    The sensor frame has x and y in the contact plane and z out of the elastomer towards the
    object. In two dimensions the positions are those of x and y.

    Attributes:
        layout: the markers' reference positions and neighbours.
        positions: marker positions [mm]; NaN where a marker was not seen.
        valid: which marker of which frame can be used.
        time: time stamps [s].
        source_index: number the source gave each frame; gaps are dropped frames.
        force: resultant force on the sensor [N], if the source has it.
        moment: resultant moment on the sensor [N·mm], if the source has it.
        forces: force at each marker [N], if the source has it.
        flaws: per frame, why it cannot be used; empty where it can.
        name: short name, used for folders and titles.
        source: where the recording came from.
        convention: how the source's axes lie, where they differ from the sensor frame.
    """

    layout: MarkerLayout
    positions: Float[np.ndarray, "frames n d"]
    valid: Bool[np.ndarray, "frames n"]
    time: Float[np.ndarray, " frames"]
    source_index: Int[np.ndarray, " frames"]
    force: Float[np.ndarray, "frames 3"] | None = None
    moment: Float[np.ndarray, "frames 3"] | None = None
    forces: Float[np.ndarray, "frames n d"] | None = None
    flaws: tuple[str, ...] = ()
    name: str = "recording"
    source: str = ""
    convention: str = "z out of the elastomer towards the object"
    notes: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.time)

    def __iter__(self) -> Iterator[Frame]:
        """The frames in order, as `Tracker.update` takes them."""
        for i in range(len(self)):
            yield Frame(
                positions=self.positions[i],
                valid=self.valid[i],
                time=float(self.time[i]),
                source_index=int(self.source_index[i]),
                moment=float("nan") if self.moment is None else float(self.moment[i, 2]),
                flaw=self.flaws[i] if self.flaws else "",
            )
