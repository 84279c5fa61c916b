"""Noise of a sensor at rest."""

from typing import Any

from estimation.noise import estimate_noise
from estimation.recording import Recording


def assess_noise(recording: Recording) -> dict[str, Any]:
    """Noise of a recording, in the units of a file for readers.

    Raises:
        ValueError: the recording cannot tell its noise.
    """
    noise = estimate_noise(recording)
    return {
        "format_version": 1,
        "in_plane_mm": noise.in_plane,
        "normal_mm": noise.normal,
        "correlation": list(noise.correlation),
        "frames": noise.frames,
    }
