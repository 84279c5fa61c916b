"""Estimators: from the fields of one frame to the rotation of the elastomer where it sticks."""

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import asdict, replace
from functools import partial
from inspect import signature
from typing import Any, Protocol, runtime_checkable

from estimation.estimators.incremental import Incremental
from estimation.estimators.measurement import Measurement
from estimation.estimators.paper import STRICT_THRESHOLD, Paper, PaperSettings
from estimation.estimators.rigid import Rigid
from estimation.estimators.rivals import (
    Castano,
    Dong,
    DongSettings,
    InvariantCloud,
    Kabsch,
    Kolamuri,
)
from estimation.estimators.tracked import Tracked
from estimation.fields.measure import Fields
from estimation.fields.stencils import Stencils
from estimation.frames.noise import Noise

__all__ = [
    "DEFAULT_METHOD",
    "METHODS",
    "RIVALS",
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
    """Takes the fields of one frame after the other and says how far the elastomer has turned."""

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the elastomer where it sticks, from the fields of the next frame."""
        ...


METHODS: dict[str, Callable[..., Estimator]] = {
    "tracked": Tracked,
    "incremental": Incremental,
    "rigid": Rigid,
    "paper": Paper,
    "paper_strict": partial(Paper, settings=PaperSettings(STRICT_THRESHOLD)),
}
"""Estimators by name; each is made from the layout's stencils, the noise and its settings."""

RIVALS: dict[str, Callable[..., Estimator]] = {
    "kolamuri": Kolamuri,
    "dong": Dong,
    "dong_corrected": partial(Dong, settings=DongSettings(exact=True)),
    "castano": Castano,
    "invariantcloud": InvariantCloud,
    "kabsch": Kabsch,
}
"""Published rivals by name, made in the same way; they give angles without intervals."""

DEFAULT_METHOD = "tracked"


def share_fits(estimators: Iterable[Estimator]) -> None:
    """Let those that fit rigid motions with equal settings do so once for each frame."""
    rigids: dict[Hashable, Rigid] = {}
    for estimator in sorted(estimators, key=lambda one: not isinstance(one, Rigid)):
        if isinstance(estimator, Tracked):
            estimator = estimator.incremental
        if isinstance(estimator, Rigid):
            rigids.setdefault(estimator.key, estimator)
        elif isinstance(estimator, Incremental):
            own = estimator.rigid
            estimator.rigid = rigids.setdefault(own.key, own)


def method_settings(method: str) -> Any:
    """A method's settings at their defaults, a dataclass; None where it has none.

    Args:
        method: one of `METHODS` or `RIVALS`.

    Raises:
        ValueError: there is no such method.
    """
    if method not in METHODS | RIVALS:
        raise ValueError(f"unknown method {method!r}; choose from {', '.join(METHODS | RIVALS)}")
    settings = signature((METHODS | RIVALS)[method]).parameters.get("settings")
    return None if settings is None else settings.default


def method_constants(method: str) -> dict[str, Any]:
    """The fields of a method's settings at their defaults.

    Args:
        method: one of `METHODS` or `RIVALS`.

    Raises:
        ValueError: there is no such method.
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
    """An estimator.

    Args:
        method: one of `METHODS` or `RIVALS`.
        stencils: of the layout.
        noise: of the markers.
        gain: 1 + k.
        constants: of the method, where they are not its own.

    Raises:
        ValueError: no such method or constant, or a value out of range.
    """
    make, own = (METHODS | RIVALS)[method], method_constants(method)
    for name in constants:
        if name not in own:
            raise ValueError(
                f"{method} has no constant {name!r}; it has {', '.join(sorted(own)) or 'none'}"
            )
    settings = method_settings(method)
    given = {} if settings is None else {"settings": replace(settings, **constants)}
    takes_gain = "gain" in signature(make).parameters
    return make(stencils, noise, **given, **({"gain": gain} if takes_gain else {}))
