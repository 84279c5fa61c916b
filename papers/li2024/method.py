"""Constants of the method as printed, and the library's defaults.

The quantity that Eq. (15) bounds has no unit, but the bound is printed as "0.4°". Method `paper`
reads it as 0.4, `paper_strict` as 0.4° in radians.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from estimation.estimators.paper import STRICT_THRESHOLD, PaperSettings
from estimation.fields.contact import CONTACT_SHARE
from estimation.fields.stick import ANGLE_FLOOR_DEG
from estimation.frames.recording import ONSET_MM
from papers.items import Track
from papers.tables import finish

Method = dict[str, float]


def compute(quick: bool = False, track: Track = iter) -> Method:
    """The library's default constants."""
    settings = PaperSettings()
    constants = {
        "contact_share": CONTACT_SHARE,
        "onset": ONSET_MM,
        "threshold": settings.threshold,
        "fewest_stick_markers": settings.min_stick_markers,
        "window": settings.window_frames,
    }
    return {name: float(value) for name, value in constants.items()}


def numbers(result: Method) -> dict[str, float]:
    """Our numbers for `published.csv`."""
    return result


def tables(result: Method) -> dict[str, list[dict[str, object]]]:
    """A row for each default."""
    return {"": [{"constant": name, "default": value} for name, value in result.items()]}


def plot(result: Method) -> Figure:
    """The largest distance of φ_i from the region's mean that Eq. (15) admits."""
    mean = np.linspace(0.05, 20.0, 400)
    figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
    for name, threshold in (("0.4", result["threshold"]), ("0.4° = 0.007", STRICT_THRESHOLD)):
        root = threshold / 2.0 + np.sqrt(1.0 + threshold**2 / 4.0)  # √(φ_i/φ̄) at the bound
        above = np.maximum((root**2 - 1.0) * mean, threshold * ANGLE_FLOOR_DEG)
        below = np.maximum((1.0 - root**-2) * mean, threshold * ANGLE_FLOOR_DEG)
        axis.fill_between(mean, -below, above, alpha=0.5, label=f"threshold read as {name}")
    axis.set_xlabel("mean φ of the stick region [°]")
    finish(axis, legend=10, ylabel="φ of a marker that may join, less the mean [°]")
    return figure
