"""The real pivot `tac3d-pivot`: one finger's moment–angle curve predicted from the other finger's.

An object that turned in full slip and then turns back follows [Lubkin1951]'s curve enlarged twice
([Masing1926]) until it slips the other way. This branch is fitted to one finger. Its limit gives μ,
its stiffness G; both are effective values, since the contact is elongated and the pad is not a
half-space. The other finger's branch is predicted from them and from that finger's own normal force
and contact size. One recording begins when the object is already on its way back. The missing angle
is fitted; for a prediction it follows from the recording's first moments.

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
from papers.tables import cell, finish

_LIMIT = 3.0 * np.pi / 16.0
"""Moment of full slip over μ F a, for Hertz pressure [-]."""

_STIFFNESS = 16.0 / 3.0
"""Stiffness without slip over G a³, for a rigid object on a half-space [-]."""

_FIRST = 3
"""Frames whose mean moment determines where on a predicted branch a recording begins."""

_MOST_EARLIER = np.radians(60.0)


class Finger(NamedTuple):
    """The turn on one finger since its outline turned back."""

    angle: Float[np.ndarray, " frames"]  # angle of the outline since then [rad]
    moment: Float[np.ndarray, " frames"]  # moment about the normal [N·mm]
    force: float  # mean normal force [N]
    radius: float  # mean radius of the contact [mm]
    sign: float  # direction of the turn, ±1
    # branch fitted to all frames, from full slip the other way. Its covariance is that of ln limit,
    # ln stiffness and the angle at which it began.
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
        """Predict the moment on this finger from another finger's μ and G [N·mm]."""
        limit = _LIMIT * other.friction * self.force * self.radius
        stiffness = _STIFFNESS * other.shear_modulus * self.radius**3
        earlier = np.linspace(0.0, _MOST_EARLIER, 1000)
        along = _from_slip(limit, stiffness, 0.0, 1.0).moment(earlier)
        first = self.sign * self.moment[:_FIRST].mean()
        began = float(np.interp(first, along, earlier))
        return _from_slip(limit, stiffness, began, self.sign).moment(self.angle)


def compute(quick: bool = False, track: Track = iter) -> dict[str, Finger]:
    """Measure and fit both fingers; the quick size is the full one."""
    del quick
    recordings = [read_recording(path) for path in find_recordings(datasets.fetch("tac3d-pivot"))]
    return {recording.name: _follow(recording) for recording in track(recordings)}


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
    """The branch that began in full slip the other way, by the angle `earlier` [rad] before 0."""
    unknown = np.full((3, 3), np.nan)
    return Branch(-sign * earlier, sign, limit, stiffness, -limit, unknown, np.nan, 0)


def _fit(
    angle: Float[np.ndarray, " frames"], moment: Float[np.ndarray, " frames"], sign: float
) -> Branch:
    """Fit the branch's limit and stiffness, and the angle by which it began earlier."""

    def branch(x: np.ndarray) -> Branch:
        return _from_slip(float(np.exp(x[0])), float(np.exp(x[1])), float(x[2]), sign)

    largest = float(np.abs(moment).max())
    solved = least_squares(
        lambda x: branch(x).moment(angle) - moment,
        [np.log(largest), np.log(4.0 * largest / np.ptp(angle)), 0.05],
        bounds=([-np.inf, -np.inf, 0.0], [np.inf, np.inf, _MOST_EARLIER]),
        x_scale=[0.1, 0.1, 0.02],
        diff_step=1e-3,
    )
    rms = float(np.sqrt(np.mean(solved.fun**2)))
    covariance = np.linalg.pinv(solved.jac.T @ solved.jac) * rms**2 * MarginSettings().noise_frames
    return branch(solved.x)._replace(covariance=covariance, rms=rms, points=len(angle))


def tables(result: dict[str, Finger]) -> dict[str, list[dict[str, object]]]:
    """The fitted values of each finger, and the residual on each finger by the branch's source."""
    fitted: list[dict[str, object]] = [
        {
            "finger": name,
            "turn [°]": cell(np.degrees(np.ptp(finger.angle)), 1),
            "began before [°]": cell(abs(np.degrees(finger.branch.start)), 1),
            "force [N]": round(finger.force, 2),
            "contact radius [mm]": round(finger.radius, 2),
            "limit [N·mm]": _with_error(finger.branch.limit, finger.branch.covariance[0, 0]),
            "stiffness [N·mm/rad]": _with_error(
                finger.branch.stiffness, finger.branch.covariance[1, 1]
            ),
            "μ": round(finger.friction, 3),
            "G [MPa]": round(finger.shear_modulus, 4),
        }
        for name, finger in result.items()
    ]
    tested: list[dict[str, object]] = [
        {
            "tested on": name,
            "branch from": source,
            "rms left [N·mm]": cell(rms, 2),
            "largest [N·mm]": cell(np.abs(residual).max(), 2),
            "rms over range [%]": cell(100 * rms / np.ptp(finger.moment), 1),
        }
        for name, finger in result.items()
        for source, other in result.items()
        for residual in [_residual(finger, other)]
        for rms in [np.sqrt(np.mean(residual**2))]
    ]
    return {"": fitted, "_tested": tested}


def _with_error(value: float, variance: float) -> str:
    return f"{value:.4g} ± {Z95 * value * np.sqrt(variance):.2g}"


def _residual(finger: Finger, other: Finger) -> Float[np.ndarray, " frames"]:
    """Recorded minus fitted or predicted moment [N·mm]."""
    predicted = finger.branch.moment(finger.angle) if finger is other else finger.predict(other)
    return finger.moment - predicted


def plot(result: dict[str, Finger]) -> Figure:
    """The recorded moments over the angle, with the fitted and the predicted branch."""
    figure, axes = plt.subplots(
        1, len(result), figsize=(10, 3.8), layout="constrained", squeeze=False
    )
    for axis, (name, finger) in zip(axes[0], result.items(), strict=True):
        turn = np.degrees(finger.angle)
        axis.plot(turn, finger.moment, ".", ms=4, color="0.4", label="recorded")
        axis.plot(turn, finger.branch.moment(finger.angle), color="#08306b", label="fitted to it")
        for source, other in result.items():
            if source != name:
                axis.plot(turn, finger.predict(other), "--", color="#c1440e",
                          label=f"predicted from {source}")  # fmt: skip
        turn, moment = "turn of the outline [°]", "moment [N·mm]"
        finish(axis, legend=8, title=name, xlabel=turn, ylabel=moment)
    return figure
