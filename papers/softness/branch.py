"""The real pivot `tac3d-pivot`: the moment against the angle, from one finger to the other.

An object that turned in full slip and is then turned back follows [Lubkin1951]'s curve enlarged
twice ([Masing1926]) until it slips the other way. That branch is fitted to one finger: its limit
gives μ, its stiffness G, both effective, since the contact is elongated and the pad no half-space.
With them and its own normal force and size of contact the other finger's branch is predicted. One
recording begins when the object is already on its way back; how far is fitted, and of a prediction
taken from the moment with which the recording begins.

[Lubkin1951] J. L. Lubkin, "The torsion of elastic spheres in contact"; [Masing1926] G. Masing,
"Eigenspannungen und Verfestigung beim Messing".
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.optimize import least_squares

from estimation.estimators.measurement import Z95
from estimation.fields.outline import follow_outline
from estimation.frames import datasets
from estimation.frames.recording import Recording
from estimation.slip.branch import Branch, MarginSettings
from estimation.softness import disc_radius
from estimation.sources import find_recordings, read_recording
from estimation.tracking.tracker import estimate_angles
from papers.items import Track

_LIMIT = 3.0 * np.pi / 16.0
"""Moment of full slip over μ F a, Hertz pressure [-]."""

_STIFFNESS = 16.0 / 3.0
"""Stiffness without slip over G a³, a rigid object on a half-space [-]."""

_FIRST = 3
"""Frames whose mean moment tells where on a predicted branch a recording begins."""

_MOST_EARLIER = np.radians(60.0)


class Finger(NamedTuple):
    """One finger's turn, from where its outline turns back.

    Attributes:
        angle: of the outline, since then [rad].
        moment: about the normal [N·mm].
        force: normal force, mean [N].
        radius: of the contact, mean [mm].
        sign: which way it turns, ±1.
        branch: through all of it, from full slip the other way; its covariance that of ln limit,
            ln stiffness and the angle at which it began.
    """

    angle: Float[np.ndarray, " frames"]
    moment: Float[np.ndarray, " frames"]
    force: float
    radius: float
    sign: float
    branch: Branch

    @property
    def friction(self) -> float:
        """Effective μ [-]."""
        return self.branch.limit / (_LIMIT * self.force * self.radius)

    @property
    def shear_modulus(self) -> float:
        """Effective G [MPa]."""
        return self.branch.stiffness / (_STIFFNESS * self.radius**3)

    def predict(self, other: "Finger") -> Float[np.ndarray, " frames"]:
        """Moment on this finger, from the other one's μ and G [N·mm]."""
        limit = _LIMIT * other.friction * self.force * self.radius
        stiffness = _STIFFNESS * other.shear_modulus * self.radius**3
        earlier = np.linspace(0.0, _MOST_EARLIER, 1000)
        along = _from_slip(limit, stiffness, 0.0, 1.0).moment(earlier)
        first = self.sign * self.moment[:_FIRST].mean()
        began = float(np.interp(first, along, earlier))
        return _from_slip(limit, stiffness, began, self.sign).moment(self.angle)


def compute(quick: bool = False, track: Track = iter) -> dict[str, Finger]:
    """Both fingers."""
    del quick
    recordings = [read_recording(path) for path in find_recordings(datasets.fetch("tac3d-pivot"))]
    return {one.name: _follow(one) for one in track(recordings)}


def _follow(recording: Recording) -> Finger:
    outline = follow_outline(recording).angle
    contact = estimate_angles(recording, "incremental").contact
    assert recording.force is not None
    assert recording.moment is not None
    sign = float(np.sign(outline[-1] - outline[0]))
    rows = np.arange(int(np.argmin(sign * outline)), len(recording))
    radius = [disc_radius(recording.positions[i][contact[i], :2]) for i in rows]
    angle, moment = outline[rows] - outline[rows[0]], recording.moment[rows, 2]
    return Finger(
        angle=angle,
        moment=moment,
        force=float(-recording.force[rows, 2].mean()),
        radius=float(np.mean(radius)),
        sign=sign,
        branch=_fit(angle, moment, sign),
    )


def _from_slip(limit: float, stiffness: float, earlier: float, sign: float) -> Branch:
    """The branch that began in full slip the other way, so far before angle 0."""
    unknown = np.full((3, 3), np.nan)
    return Branch(-sign * earlier, sign, limit, stiffness, -limit, unknown, np.nan, 0)


def _fit(
    angle: Float[np.ndarray, " frames"], moment: Float[np.ndarray, " frames"], sign: float
) -> Branch:
    """Limit, stiffness and how much earlier the branch began."""

    def branch(x: np.ndarray) -> Branch:
        return _from_slip(float(np.exp(x[0])), float(np.exp(x[1])), float(x[2]), sign)

    largest = float(np.abs(moment).max())
    found = least_squares(
        lambda x: branch(x).moment(angle) - moment,
        [np.log(largest), np.log(4.0 * largest / np.ptp(angle)), 0.05],
        bounds=([-np.inf, -np.inf, 0.0], [np.inf, np.inf, _MOST_EARLIER]),
        x_scale=[0.1, 0.1, 0.02],
        diff_step=1e-3,
    )
    rms = float(np.sqrt(np.mean(found.fun**2)))
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * rms**2 * MarginSettings().noise_frames
    return branch(found.x)._replace(covariance=covariance, rms=rms, points=len(angle))


def tables(result: dict[str, Finger]) -> dict[str, list[dict[str, object]]]:
    """What each finger gives, and what is left on each by where the branch is from."""
    fitted: list[dict[str, object]] = [
        {
            "finger": name,
            "turn [°]": round(float(np.degrees(np.ptp(one.angle))), 1),
            "began before [°]": round(abs(float(np.degrees(one.branch.start))), 1),
            "force [N]": round(one.force, 2),
            "contact radius [mm]": round(one.radius, 2),
            "limit [N·mm]": _with_error(one.branch.limit, one.branch.covariance[0, 0]),
            "stiffness [N·mm/rad]": _with_error(one.branch.stiffness, one.branch.covariance[1, 1]),
            "μ": round(one.friction, 3),
            "G [MPa]": round(one.shear_modulus, 4),
        }
        for name, one in result.items()
    ]
    tested: list[dict[str, object]] = [
        {
            "tested on": name,
            "branch from": source,
            "rms left [N·mm]": round(float(np.sqrt(np.mean(left**2))), 2),
            "largest [N·mm]": round(float(np.abs(left).max()), 2),
            "rms over range [%]": round(
                100 * float(np.sqrt(np.mean(left**2)) / np.ptp(one.moment)), 1
            ),
        }
        for name, one in result.items()
        for source, other in result.items()
        for left in [_left(one, other)]
    ]
    return {"": fitted, "_tested": tested}


def _with_error(value: float, variance: float) -> str:
    return f"{value:.4g} ± {Z95 * value * np.sqrt(variance):.2g}"


def _left(one: Finger, other: Finger) -> Float[np.ndarray, " frames"]:
    """Recorded less fitted, or predicted, moment [N·mm]."""
    predicted = one.branch.moment(one.angle) if one is other else one.predict(other)
    return one.moment - predicted


def plot(result: dict[str, Finger]) -> Figure:
    """Moments, the fitted branch and the predicted one."""
    figure, axes = plt.subplots(
        1, len(result), figsize=(10, 3.8), layout="constrained", squeeze=False
    )
    for axis, (name, one) in zip(axes[0], result.items(), strict=True):
        turn = np.degrees(one.angle)
        axis.plot(turn, one.moment, ".", ms=4, color="0.4", label="recorded")
        axis.plot(turn, one.branch.moment(one.angle), color="#08306b", label="fitted to it")
        for source, other in result.items():
            if source != name:
                axis.plot(turn, one.predict(other), "--", color="#c1440e",
                          label=f"predicted from {source}")  # fmt: skip
        axis.set_title(name, fontsize=10)
        axis.set_xlabel("turn of the outline [°]")
        axis.set_ylabel("moment [N·mm]")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8, frameon=False)
    return figure
