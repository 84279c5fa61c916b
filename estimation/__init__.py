"""From frames of a tactile sensor to the angle of the object it holds.

Angles are counter-clockwise, seen from the object looking at the pad, in rad (degrees only where a
name ends in `_deg`); lengths are in mm.
"""

from estimation.datasets import fetch
from estimation.estimators import METHODS, RIVALS
from estimation.grasp import Grasp, compare_fingers
from estimation.layered_softness import LayeredSoftness
from estimation.noise import Noise, estimate_noise
from estimation.outline import follow_outline
from estimation.plots import plot_angles, plot_grasp, plot_maps, plot_overview
from estimation.recording import Frame, MarkerLayout, Recording, layout_markers
from estimation.references import Reference, outline_reference, read_reference
from estimation.result import Estimate, Result, State
from estimation.sensor import Elastomer, Lens, Sensor, read_sensor, write_sensor
from estimation.softness import ScalarSoftness, Softness, read_softness, write_softness
from estimation.softness_fit import SoftnessFit, fit_softness
from estimation.sources import ImageSettings, find_recordings, read_recording, write_archive
from estimation.tracker import Tracker, estimate_angles
from estimation.trials import Trial, make_trials
from estimation.two_fingers import TwoFingers, fit_two_fingers
from estimation.virtual.recording import PivotModel, Truth, simulate_pivot

__all__ = [
    "METHODS",
    "RIVALS",
    "Elastomer",
    "Estimate",
    "Frame",
    "Grasp",
    "ImageSettings",
    "LayeredSoftness",
    "Lens",
    "MarkerLayout",
    "Noise",
    "PivotModel",
    "Recording",
    "Reference",
    "Result",
    "ScalarSoftness",
    "Sensor",
    "Softness",
    "SoftnessFit",
    "State",
    "Tracker",
    "Trial",
    "Truth",
    "TwoFingers",
    "compare_fingers",
    "estimate_angles",
    "estimate_noise",
    "fetch",
    "find_recordings",
    "fit_softness",
    "fit_two_fingers",
    "follow_outline",
    "layout_markers",
    "make_trials",
    "outline_reference",
    "plot_angles",
    "plot_grasp",
    "plot_maps",
    "plot_overview",
    "read_recording",
    "read_reference",
    "read_sensor",
    "read_softness",
    "simulate_pivot",
    "write_archive",
    "write_sensor",
    "write_softness",
]
