"""
3. The softness of an object
============================

A soft object twists inside the grasp. The gel then turns less than the object, by a constant
factor. You measure that factor once, and later runs correct for it.
"""

# %%
# Two grasps of one object
# ------------------------
#
# The first grasp has a reference angle, from a rotary stage for example. The second one has none.
# Here both are simulated. The object is twice as stiff as the gel, so k is 0.5.

import jax
import matplotlib.pyplot as plt
import numpy as np

from calibration import Reference, fit_softness, make_trials
from estimation import PivotModel, estimate_angles, simulate_pivot

jax.config.update("jax_enable_x64", True)


def grasp(radius, seed):
    """Turn to 10° and back to −6°."""
    model = PivotModel(stiffness_ratio=0.5, contact_radius=radius, friction_ratio=0.3)
    return simulate_pivot(model, angles_deg=(0, 10, -6), frames=(25, 35), seed=seed)


recording, truth = grasp(radius=5.0, seed=0)

# %%
# Fit k
# -----
#
# A reference has times, angles and their errors. ``zeroed`` means that the angle counts from the
# moment of contact. ``same_clock`` means that the stage and the sensor share a clock. If they do
# not, the fit finds the offset.

seen = np.isfinite(truth.angle)
reference = Reference(
    time=recording.time[seen],
    angle=truth.angle[seen],
    error=np.full(seen.sum(), np.radians(0.05)),
    zeroed=True,
    same_clock=True,
    source="virtual stage",
)
fit = fit_softness(make_trials(recording, reference))
low, high = fit.low, fit.high
print(f"k = {fit.stiffness_ratio:.4f}, 95 % interval {low:.4f} to {high:.4f}")

# %%
# The same on the command line, for a stage that writes ``time_s`` and ``angle_deg`` to a table:
#
# .. code-block:: bash
#
#    python -m calibration softness GRASP --reference STAGE.csv --zeroed --same-clock --out soft
#
# Correct a later grasp
# ---------------------
#
# The second grasp has another contact size. We answer it without and with the fit.

recording, truth = grasp(radius=4.0, seed=1)
firm = truth.stick.sum(axis=1) >= 10
figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
axis.plot(recording.time, np.degrees(truth.angle), "k--", label="truth")
for name, options in {"uncorrected": {}, "corrected": {"softness": fit.softness}}.items():
    result = estimate_angles(recording, **options)
    error = np.degrees(np.abs(result.angle - truth.angle))[firm]
    axis.plot(recording.time, np.degrees(result.angle), label=name)
    print(f"{name}: mean error {np.nanmean(error):.3f}°, largest {np.nanmax(error):.2f}°")
axis.set(xlabel="time [s]", ylabel="angle [°]")
axis.legend()

# %%
# On the command line: ``python -m estimation run GRASP --softness soft/softness.toml``.
#
# What to check
# -------------
#
# - *A thin gel.* One number k is exact on a thick gel only. Below a thickness of about the
#   contact's size, give ``--thickness-mm`` to the first command. It then fits a model of the
#   layer. Take the thickness from the maker. ``python -m calibration field`` can measure it if
#   forces are known. It is within 1 % on virtual data. On a published Tac3D recording it finds
#   that a flat layer does not describe the pad. The fitted thickness is then between 6 and 16 mm,
#   depending on the part of the data (:doc:`details </papers/softness/README>`).
# - *A ball.* Its surface turns more than a flat one. Give ``--radius-mm`` with its radius in mm.
#   A radius or a thickness needs a CSV that is zeroed at touch and on the sensor's clock. So give
#   ``--zeroed --same-clock``. Do not give a radius for the virtual grasps above: their object turns
#   like a flat one.
# - *Two fingers, one known angle.* Each finger sees the object turn the other way. Write one CSV
#   for each finger, and change the sign of the angles in the second. Then give both recordings,
#   and repeat the option: ``--reference LEFT.csv --reference RIGHT.csv``. Do not use ``--flip``
#   here, as it changes the sign in all of them.
# - *Two fingers, no angle.* ``--second-ratio`` gives k, but only if one gel is stiffer than the
#   other. Two fingers of the same stiffness cannot determine k.
# - *Files of a Tac3D.* See the :doc:`table of files </estimation/README>`.
# - *No stage?* Use ``--reference outline``. The angle then comes from the object's imprint or from
#   the contact's outline. It needs an object that prints, or a contact that is not round.
# - *Turn far enough.* With noise of 10 µm, turn one way by 10° or more. After a reversal, such
#   noise hides slip. The grasps above have noise of 1 µm, which permits the reversal.
# - *A fit is refused?* The message names the cause, such as too few frames in which markers stick.
