"""Tac3D recordings: a folder of `.npy` files for each sensor.

Files of the folder (mm, N, N·mm, s):

| file | shape | use |
|---|---|---|
| `3D_Positions`, `3D_Displacements` | (frames, markers, 3) | needed |
| `sendTimestamp` | (frames,) | needed: the sensor's own clock |
| `index` | (frames,) | frame number; counted from 0 if missing |
| `3D_Forces` | (frames, markers, 3) | optional |
| `3D_ResultantForce`, `3D_ResultantMoment` | (frames, 1, 3) or (frames, 3) | optional |

Other files (`3D_Normals`, `recvTimestamp`, `overview.csv`) are ignored.

**Axes.** Positions are right-handed with z out of the pad, so no axis is changed. Rows of the
marker grid run along −y and columns along −x, so that (row, column) is left-handed: differentiate
with respect to positions, not indices. Pressing gives u_z < 0 and F_z < 0. The resultants are the
sensor's own: in the published recordings the moment is about the sensor's origin, and its z
component is about 1.4 times the sum over the markers' forces.

**Reference.** In loaded frames, position minus displacement is a constant shape to rounding: the
sensor's zero (in the published `example_1` it settles by 0.7 µm after the first loaded frame). In
frames that the sensor takes for unloaded, the displacements are exactly zero, but the positions are
still measured: they carry noise and, after a press, the deformation from which the gel has yet to
recover (up to 0.08 mm in `example_1`). The reference is therefore computed from loaded frames only,
and displacements are taken from it throughout. If no frame is loaded, the reference is the median
of the measured positions.
"""

from enum import StrEnum
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from contactmodel.common.stored import read_array
from estimation.frames.recording import ONSET_MM, Recording, layout_markers


class _Needed(StrEnum):
    """Names of the arrays that every recording has."""

    POSITIONS = "3D_Positions"
    DISPLACEMENTS = "3D_Displacements"
    TIME = "sendTimestamp"


def is_tac3d(folder: Path) -> bool:
    """Whether the folder looks like a Tac3D recording, even if it is incomplete."""
    return any(
        (folder / f"{name}.npy").exists() for name in (_Needed.POSITIONS, _Needed.DISPLACEMENTS)
    )


def read_tac3d(folder: str | Path) -> Recording:
    """Read a folder of Tac3D arrays.

    Raises:
        FileNotFoundError: an array is missing.
        ValueError: an array is damaged, not numeric, or does not fit the others.
        OSError: a file cannot be read.
    """
    folder = Path(folder)
    missing = [f"{name}.npy" for name in _Needed if not (folder / f"{name}.npy").exists()]
    if missing:
        raise FileNotFoundError(
            f"{folder} lacks {', '.join(missing)}: copy the complete folder of the recording"
        )
    positions = _read_array(folder, _Needed.POSITIONS)
    if positions.ndim != 3 or positions.shape[2] != 3 or len(positions) == 0:
        raise ValueError(
            f"{folder / _Needed.POSITIONS}.npy has shape {positions.shape}; it must be "
            "(frames, markers, 3) with at least one frame"
        )
    frames = len(positions)
    displacements = _read_array(folder, _Needed.DISPLACEMENTS, positions.shape)
    forces = _read_optional(folder, "3D_Forces", positions.shape)
    reference, notes = find_reference(positions, displacements)
    seen = np.isfinite(reference).all(axis=-1)
    if not seen.any():
        raise ValueError(f"{folder}: no marker is ever seen, all positions are zero or missing")
    if not seen.all():
        notes += (f"{(~seen).sum()} markers were never seen and are left out",)
    return Recording(
        layout=layout_markers(reference[seen]),
        positions=positions[:, seen],
        valid=np.all(np.isfinite(positions[:, seen]), axis=-1),
        time=_read_array(folder, _Needed.TIME, (frames,)),
        source_index=_read_index(folder, frames),
        force=_read_optional(folder, "3D_ResultantForce", (frames, 3)),
        moment=_read_optional(folder, "3D_ResultantMoment", (frames, 3)),
        forces=None if forces is None else forces[:, seen],
        name=folder.resolve().name,
        source=f"Tac3D folder {folder}",
        convention="z out of the elastomer towards the object, as in the sensor's data; "
        "grid rows along −y, columns along −x",
        notes=notes,
    )


def find_reference(
    positions: Float[np.ndarray, "frames n 3"], displacements: Float[np.ndarray, "frames n 3"]
) -> tuple[Float[np.ndarray, "n 3"], tuple[str, ...]]:
    """Compute the unloaded shape.

    Args:
        positions: of the markers [mm]; NaN or zero where not visible.
        displacements: of the markers [mm].

    Returns:
        Reference positions [mm], NaN for markers that no frame shows; and notes on the reference.

    Raises:
        ValueError: the displacements are zero in all frames although the markers move.
    """
    # change of the sensor's zero that gets a note, of the size of the markers' noise [mm]
    zero_drift = 1e-3
    loaded = np.nan_to_num(displacements).any(axis=(1, 2))
    if not loaded.any():
        shown = np.nan_to_num(positions).any(axis=(1, 2))
        rest = _median(positions[shown])
        _expect_rest(positions[shown] - rest)
        note = "no frame is loaded: the reference is the median of the measured positions"
        return rest, (note,)
    zero = positions[loaded] - displacements[loaded]
    reference = _median(zero)
    off = np.abs(zero - reference)
    drift = float(off[np.isfinite(off)].max(initial=0.0))
    if drift <= zero_drift:
        return reference, ()
    return reference, (
        f"the sensor's zero is not constant: it differs by up to {drift:.2g} mm from the median, "
        "which is the reference",
    )


def _expect_rest(motion: Float[np.ndarray, "frames n 3"]) -> None:
    """Check that the gel rests in frames that count as unloaded.

    Args:
        motion: of the markers from their median positions [mm].

    Raises:
        ValueError: more markers move than single misread ones.
    """
    few = 0.02  # share of positions that may be misread
    far = np.linalg.norm(motion, axis=-1)
    far = far[np.isfinite(far)]
    if len(far) and (most := float(np.quantile(far, 1.0 - few))) > ONSET_MM:
        raise ValueError(
            f"3D_Displacements.npy is zero in all frames, but the markers move by {most:.2g} mm: "
            "it must hold their displacements from the unloaded gel"
        )


def _median(shapes: Float[np.ndarray, "frames n 3"]) -> Float[np.ndarray, "n 3"]:
    """Median over frames, without missing values; NaN where all are missing."""
    median = np.full(shapes.shape[1:], np.nan)
    present = np.isfinite(shapes).any(axis=0)
    median[present] = np.nanmedian(shapes[:, present], axis=0)
    return median


def _read_array(
    folder: Path, name: str, shape: tuple[int, ...] | None = None
) -> Float[np.ndarray, "..."]:
    """One array in double precision, of the given shape except for axes of length one."""
    path = folder / f"{name}.npy"
    stored = read_array(path)
    if stored.dtype.kind not in "iuf":
        raise ValueError(f"{path} holds {stored.dtype}; it must hold numbers")
    if shape is None:
        return np.array(stored, dtype=float)
    if [n for n in stored.shape if n != 1] != [n for n in shape if n != 1]:
        raise ValueError(
            f"{path} has shape {stored.shape}; {_Needed.POSITIONS}.npy requires {shape}: the files "
            "are not of one recording"
        )
    return np.array(stored, dtype=float).reshape(shape)


def _read_optional(
    folder: Path, name: str, shape: tuple[int, ...]
) -> Float[np.ndarray, "..."] | None:
    """The array, or None if the sensor did not write it."""
    return _read_array(folder, name, shape) if (folder / f"{name}.npy").exists() else None


def _read_index(folder: Path, frames: int) -> Int[np.ndarray, " frames"]:
    """Frame numbers of the source, counted from 0 if there are none."""
    index = _read_optional(folder, "index", (frames,))
    if index is None:
        return np.arange(frames)
    if not (np.abs(index) < 2**53).all() or (index != np.rint(index)).any():
        raise ValueError(f"{folder / 'index'}.npy must hold whole numbers below 2^53 only")
    return index.astype(int)
