"""Estimators: from the fields of one frame to the rotation of the sticking elastomer."""

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import asdict, replace
from functools import partial
from inspect import signature
from typing import Any, Protocol, runtime_checkable

from estimation.estimators.incremental import Incremental
from estimation.estimators.law.fit import LawFits
from estimation.estimators.measurement import Measurement
from estimation.estimators.paper import STRICT_THRESHOLD, Paper, PaperSettings
from estimation.estimators.published import (
    Castano,
    Dong,
    DongSettings,
    InvariantCloud,
    Kabsch,
    Kolamuri,
)
from estimation.estimators.rigid import Rigid
from estimation.estimators.tracked import Tracked
from estimation.fields.measure import Fields
from estimation.fields.stencils import Stencils
from estimation.frames.noise import Noise

__all__ = [
    "DEFAULT_METHOD",
    "METHODS",
    "PUBLISHED_METHODS",
    "Estimator",
    "Incremental",
    "Measurement",
    "Paper",
    "Rigid",
    "Tracked",
    "make_estimator",
    "method_constants",
    "method_settings",
    "share_fits",
]


@runtime_checkable
class Estimator(Protocol):
    """Measures the elastomer's rotation frame by frame."""

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the sticking elastomer, from the fields of the next frame."""
        ...


METHODS: dict[str, Callable[..., Estimator]] = {
    "tracked": Tracked,
    "incremental": Incremental,
    "rigid": Rigid,
    "paper": Paper,
    "paper_strict": partial(Paper, settings=PaperSettings(STRICT_THRESHOLD)),
}
"""Estimators by name; each is made from the layout's stencils, the noise and its settings."""

PUBLISHED_METHODS: dict[str, Callable[..., Estimator]] = {
    "kolamuri": Kolamuri,
    "dong": Dong,
    "dong_corrected": partial(Dong, settings=DongSettings(exact=True)),
    "castano": Castano,
    "invariantcloud": InvariantCloud,
    "kabsch": Kabsch,
}
"""Published methods of other groups by name, made in the same way; they give no intervals."""

DEFAULT_METHOD = "tracked"
"""Method whose angles are reported unless another is chosen."""


def share_fits(estimators: Iterable[Estimator]) -> None:
    """Make estimators of the same frames share the fits that are equal."""
    rigids: dict[Hashable, Rigid] = {}
    law = LawFits()
    for estimator in sorted(estimators, key=lambda item: not isinstance(item, Rigid)):
        if isinstance(estimator, Tracked):
            estimator = estimator.incremental
        if isinstance(estimator, Rigid):
            rigids.setdefault(estimator.key, estimator)
        elif isinstance(estimator, Incremental):
            own = estimator.keyframes.rigid
            estimator.keyframes.rigid = rigids.setdefault(own.key, own)
            estimator.law.fits.share(law)


def method_settings(method: str) -> Any:
    """The default settings of a method, a dataclass; None if it has no settings.

    Args:
        method: name from `METHODS` or `PUBLISHED_METHODS`.

    Raises:
        ValueError: an unknown method.
    """
    known = METHODS | PUBLISHED_METHODS
    if method not in known:
        raise ValueError(f"unknown method {method!r}; choose from {', '.join(known)}")
    settings = signature(known[method]).parameters.get("settings")
    return None if settings is None else settings.default


def method_constants(method: str) -> dict[str, Any]:
    """The default values of a method's settings, by name.

    Raises:
        ValueError: an unknown method.
    """
    settings = method_settings(method)
    return {} if settings is None else asdict(settings)


def make_estimator(
    method: str,
    stencils: Stencils,
    noise: Noise | None,
    gain: float,
    constants: Mapping[str, Any],
) -> Estimator:
    """Make the estimator of a method.

    Args:
        method: name from `METHODS` or `PUBLISHED_METHODS`.
        stencils: stencils of the layout.
        noise: noise of the markers; None if unknown.
        gain: 1 + k [-].
        constants: constants of the method that differ from their defaults.

    Raises:
        ValueError: an unknown method or constant, or a value out of range.
    """
    make, own = (METHODS | PUBLISHED_METHODS)[method], method_constants(method)
    for name in constants:
        if name not in own:
            raise ValueError(
                f"{method} has no setting {name!r}; it has {', '.join(sorted(own)) or 'none'}"
            )
    settings = method_settings(method)
    arguments = {} if settings is None else {"settings": replace(settings, **constants)}
    if "gain" in signature(make).parameters:
        arguments["gain"] = gain
    return make(stencils, noise, **arguments)
