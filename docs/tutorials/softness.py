"""
3. The softness of an object
============================

A soft object twists inside the grasp. The gel then turns less than the object, by a constant
factor. You measure that factor in three grasps or more, and later runs correct for it.
"""

# %%
# Four grasps of one object
# -------------------------
#
# The first three grasps have a reference angle, from a rotary stage for example. The fourth one has
# none. Here all are simulated. The object is twice as stiff as the gel, so k is 0.5.
# ``friction_ratio`` is μp₀/2G*: the coefficient of friction times the peak pressure, over twice the
# combined shear modulus of both bodies. With a larger value, more of the contact holds.

import tempfile
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

from calibration import Reference, fit_softness, make_trials
from estimation import PivotModel, estimate_angles, simulate_pivot, write_softness

jax.config.update("jax_enable_x64", True)


def grasp(radius, seed):
    """Turn to 10° and back to −6°."""
    model = PivotModel(stiffness_ratio=0.5, contact_radius=radius, friction_ratio=0.3)
    return simulate_pivot(model, angles_deg=(0, 10, -6), frames=(25, 35), seed=seed)


def measure(recording, truth):
    """The stage's angle of a grasp."""
    seen = np.isfinite(truth.angle)
    return Reference(
        time=recording.time[seen],
        angle=truth.angle[seen],
        error=np.full(seen.sum(), np.radians(0.05)),
        zeroed=True,
        same_clock=True,
        source="virtual stage",
    )


# %%
# Fit k
# -----
#
# A reference has times, angles and their errors. ``zeroed`` means that the angle is 0 at the moment
# of contact. ``same_clock`` means that the stage and the sensor share a clock. If they do not, the
# fit finds the offset.
#
# The object turns by (1 + k)φ − L/2, where φ is the rotation of the gel that sticks. L is the load
# term: it stands for the effect of pressing and of the finite size of the bodies, and is 0 between
# two thick ones. The fit includes it only if the data call for it, and the command then prints it
# beside k.

trials = []
for seed, radius in enumerate((5.0, 4.5, 5.5)):
    recording, truth = grasp(radius, seed)
    trials += make_trials(recording, measure(recording, truth))
fit = fit_softness(trials)
print(f"k = {fit.stiffness_ratio:.4f}, 95 % interval {fit.low:.4f} to {fit.high:.4f}")

# %%
# Do not rely on the interval of a single grasp. It covers the noise of the readings only: not how k
# varies between grasps, and not an error in the zero of the reference. Fit several grasps. Save the
# fit for later runs:

write_softness(fit.softness, Path(tempfile.mkdtemp()) / "softness.toml")

# %%
# The same on the command line:
#
# .. code-block:: bash
#
#    python -m calibration softness GRASP1 GRASP2 GRASP3 --reference STAGE1.csv \
#        --reference STAGE2.csv --reference STAGE3.csv --zeroed --same-clock --out soft
#
# A ``GRASP`` is any recording that ``run`` reads, such as a video, a folder of pictures or a bag.
# The stage's table looks like this::
#
#    time_s,angle_deg,error_deg
#    0.00,0.00,0.05
#    0.04,0.12,0.05
#    0.08,0.25,0.05
#
# - ``time_s``: with ``--same-clock``, on the recording's clock, as in the column ``time_s`` of
#   ``angles.csv``. Most videos start at 0. Without it, the zero of the times does not matter.
# - ``angle_deg``: or ``angle_rad``. With ``--zeroed`` it must be 0 at the moment of contact. The
#   table may start earlier, as rows before the contact are not used. Jumps from 180° to −180° or
#   from 360° to 0 are removed.
# - ``error_deg``: the standard error, or ``error_rad``. It gives noisy readings less weight. The
#   interval of k follows from the scatter of the readings, and does not contain an error that all
#   of them share.
#
# Correct a later grasp
# ---------------------
#
# The fourth grasp has another contact size. We estimate its angle without and with the
# correction. The printed errors are those of the frames in which ten or more markers have stuck
# since full load.

recording, truth = grasp(radius=4.0, seed=3)
many_stick = truth.stick.sum(axis=1) >= 10
figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
axis.plot(recording.time, np.degrees(truth.angle), "k--", label="truth")
for name, options in {"uncorrected": {}, "corrected": {"softness": fit.softness}}.items():
    result = estimate_angles(recording, **options)
    error = np.degrees(np.abs(result.angle - truth.angle))[many_stick]
    axis.plot(recording.time, np.degrees(result.angle), label=name)
    print(f"{name}: mean error {np.nanmean(error):.3f}°, largest {np.nanmax(error):.2f}°")
axis.set(xlabel="time [s]", ylabel="angle [°]")
axis.legend()

# %%
# On the command line: ``python -m estimation run GRASP --softness soft/softness.toml``.
#
# Where pictures show the object's print, the angle comes from the print. It shows the object's own
# rotation, so k does not scale it. The output and the report then give the number of such angles.
#
# The table ``[validity]`` of ``softness.toml`` has the ranges of the gel's rotation, of the normal
# force and of the contact's radius in the grasps that were fitted. Angles outside them are counted
# in a note of the report.
#
# What to check
# -------------
#
# - *A thin gel.* One number k is exact on a thick gel only. Unless the gel is much thicker than the
#   contact is wide, give ``--thickness-mm``, ``--zeroed`` and ``--same-clock`` to the first
#   command. It then fits a model of the layer. Pictures need a scale for that (``mm_per_px`` in the
#   sensor description). Take the thickness from the maker. ``python -m calibration field`` can
#   measure it if forces are known. It is within 1 % on virtual data. On a published Tac3D recording
#   it finds that a flat layer does not describe the pad. The fitted thickness is then between 6 and
#   16 mm, depending on the part of the data (:doc:`details </docs/field_fits>`).
# - *A ball.* Its surface turns more than a flat one. Give ``--radius-mm`` with its radius in mm.
# - *A cylinder, cube or plate.* Give ``--height-mm``, for a cylinder also its radius ``--side-mm``,
#   and for a cube or square bar its ``--width-mm``. If a low cylinder has rounded edges, give their
#   radius ``--edge-mm``.
#   A radius or a thickness needs a CSV that is zeroed at touch and on the sensor's clock. So give
#   ``--zeroed --same-clock``. Do not give a radius for the virtual grasps above: their object turns
#   like a flat one.
# - *Two fingers, one known angle.* Each finger sees the object turn the other way. Write one CSV
#   for each finger, and change the sign of the angles in the second. Then give both recordings,
#   and repeat the option: ``--reference LEFT.csv --reference RIGHT.csv``. Do not use ``--flip``
#   here, as it changes the sign in all of them.
# - *Two fingers, no angle.* If one gel is stiffer than the other, give the ratio of their k by
#   ``--k-ratio``: k on the first finger over k on the second. The two recordings then
#   determine k. Two fingers of the same stiffness cannot.
# - *Files of a Tac3D.* See the :doc:`table of files </estimation/README>`.
# - *No stage?* Use ``--reference outline``. The angle then comes from the object's imprint or from
#   the contact's outline. This requires edges or texture that show through the gel, or a contact
#   that is not round. The fit compares that angle with the rotation of the gel that sticks, not
#   of the print. The fit therefore counts fewer usable frames than ``run``.
# - *Turn far enough.* With noise of 10 µm (``noise_in_plane_px`` times ``mm_per_px``), rotate in
#   one direction by 10° or more. After a reversal, such noise hides slip. The grasps above have
#   noise of 1 µm, which permits the reversal.
# - *A rejected fit.* The message gives the cause, for example too few frames in which
#   markers stick. Frames in macro slip are never used. The gel must turn by 1° at the least, and by
#   eight standard errors of its rotation.
