"""Parts of the data of a field fit: kinds of measurement, rings of markers, frames."""

import numpy as np
from jaxtyping import Bool, Float

from calibration.forward import FieldModel

Parts = dict[str, Bool[np.ndarray, " m"]]

_RINGS = ("inner", "middle", "outer")


def find_kinds(model: FieldModel) -> Parts:
    """Kinds of measurement, as masks of the vector of all outputs."""
    kind, _, _ = _index(model)
    names = ("in the plane", "along z", "force", "moment")
    return {name: kind == i for i, name in enumerate(names)}


def find_parts(model: FieldModel, centre: Float[np.ndarray, "2"]) -> Parts:
    """Parts that can be left out: kinds of measurement, thirds of the markers, frames.

    Args:
        model: scene, grid and markers.
        centre: centre of the three rings of markers, each with a third of the markers [mm].

    Returns:
        Masks of the vector of all outputs, by name.
    """
    _, frame, marker = _index(model)
    kinds = find_kinds(model)
    parts = {f"displacements {name}": kinds[name] for name in ("in the plane", "along z")}
    parts["forces"] = kinds["force"] | kinds["moment"]
    distance = np.linalg.norm(model.markers - centre, axis=1)
    ring = np.searchsorted(np.quantile(distance, [1 / 3, 2 / 3]), distance)
    for i, name in enumerate(_RINGS):
        parts[f"{name} third of the markers"] = (marker >= 0) & (ring[marker] == i)
    if model.frames > 1:
        names = [f"frame {i + 1} of {model.frames}" for i in range(model.frames)]
        parts |= {name: frame == i for i, name in enumerate(names)}
    return parts


def _index(model: FieldModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kind, frame and marker of each output in the order of `Prediction`; −1 if it has none."""
    frames, n = model.frames, len(model.markers)
    frame, marker, axis = np.indices((frames, n, 3)).reshape(3, -1)
    none, each = np.full(3, -1), np.arange(frames)
    return (
        np.concatenate([axis // 2, np.full(3 * frames, 2), np.full(frames, 3), none]),
        np.concatenate([frame, np.repeat(each, 3), each, none]),
        np.concatenate([marker, np.full(4 * frames + 3, -1)]),
    )
