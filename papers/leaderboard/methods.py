"""Entries of our methods, of other groups' published ones, and of standard ones on pictures."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from estimation.estimators import DEFAULT_METHOD, METHODS, PUBLISHED_METHODS
from estimation.estimators.result import State
from estimation.frames.noise import Noise, find_noise
from estimation.frames.recording import Recording
from estimation.softness import RIGID_OBJECT, ScalarSoftness
from estimation.tracking.tracker import Tracker
from papers.items import Track
from papers.leaderboard import pictures, settings
from papers.leaderboard.entries import Entry
from papers.leaderboard.sources import Source
from papers.slip_lifts.lifts import follow

METHOD_NAMES = (*METHODS, *PUBLISHED_METHODS, *pictures.METHODS)
"""Names of all methods that are ranked."""

SLIPPING = ("tracked", "incremental", "rigid", "paper", "paper_strict", "dong", "dong_corrected")
"""Methods that distinguish sticking markers from slipping ones, and so can detect a slip."""


def answer_all(sources: Sequence[Source], track: Track = iter) -> list[Entry]:
    """Run every method on every case."""
    entries = {name: Entry(name, {}, {}, {}) for name in METHODS | PUBLISHED_METHODS}
    entries |= {name: Entry(name, {}, {}, {}, pictures=True) for name in pictures.METHODS}
    for source in track(sources):
        recording = source.read()
        noise, _ = find_noise(recording)
        for method in METHODS | PUBLISHED_METHODS:
            if not source.case.lift:
                _answer(entries[method], method, source, recording, noise)
            elif method in SLIPPING:
                chance = call_slip(method, recording, noise)
                entries[method].slipped[source.case.name] = chance
        if source.draw is not None and not source.case.lift:
            for name, follow_pictures in pictures.METHODS.items():
                _answer_pictures(entries[name], follow_pictures, source)
    return list(entries.values())


def call_slip(method: str, recording: Recording, noise: Noise | None) -> float:
    """Probability that the object of a lift slips out [-], by one of `SLIPPING`.

    The default method takes it from the shear and the print on the gel. The others return 1 if in
    some frame no marker sticks, else 0.
    """
    if method == DEFAULT_METHOD:
        _, shears = follow(recording, noise)
        return float(np.nanmax([shear.slip_probability for shear in shears], initial=0.0))
    tracker = Tracker(recording.layout, method, noise=noise)
    states = [tracker.update(frame).state for frame in replace(recording, hold=None)]
    return float(State.MACRO_SLIP in states)


def _answer(
    entry: Entry, method: str, source: Source, recording: Recording, noise: Noise | None
) -> None:
    corrects = method in settings.AXIS_METHODS
    softness = RIGID_OBJECT if corrects else ScalarSoftness(stiffness_ratio=source.truth.softness)
    tracker = Tracker(recording.layout, method, noise=noise, softness=softness)
    start = time.perf_counter()
    entry.angle[source.case.name] = np.array([tracker.update(frame).angle for frame in recording])
    entry.latency[source.case.name] = (time.perf_counter() - start) / len(recording)


def _answer_pictures(
    entry: Entry, follow_pictures: Callable[..., np.ndarray], source: Source
) -> None:
    assert source.draw is not None
    images = list(source.draw())
    start = time.perf_counter()
    entry.angle[source.case.name] = follow_pictures(images)
    entry.latency[source.case.name] = (time.perf_counter() - start) / len(images)
