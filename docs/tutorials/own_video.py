"""
1. Your own video
=================

You have a video of a gel with printed dots, a grid or speckle. You want the angle of the object in
each frame, with an interval. This takes one command. Here we draw a short clip first, so that the
page works without a sensor.
"""

# %%
# A clip to work with
# -------------------
#
# A cube is pressed into the gel. It rests, is turned by 6°, rests again, and is turned back to 2°.
# The contact model moves the gel. The renderer draws the dots, the texture of the cube, and the
# light. If you have a video, skip this step.

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import jax
import matplotlib.pyplot as plt
import numpy as np

from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, SquarePunch, make_path
from estimation import Scene, VirtualClip, write_pictures

jax.config.update("jax_enable_x64", True)

gel, cube = HalfSpace(shear_modulus=0.2, poisson_ratio=0.5), SquarePunch(8.0, edge_radius=1.0)
grid = Grid((40, 40), (24.0, 24.0))
contact = Contact(gel, Rigid(), cube, grid, friction_coefficient=1.5)
pressed, turned, back = (Pose(0.6, twist=np.radians(angle)) for angle in (0.0, 6.0, 2.0))
path = make_path(
    [Pose(0.0), Pose(0.0), pressed, pressed, turned, turned, back], [5, 6, 4, 20, 8, 12]
)
clip = VirtualClip(Scene(contact=contact, path=path))

folder = Path(tempfile.mkdtemp()) / "clip"
write_pictures(clip, folder)
print(len(clip), "pictures:", *sorted(path.name for path in folder.iterdir())[:3], "…")

# %%
# The pictures show the unloaded gel, the cube pressed against it, and the cube turned.

figure, axes = plt.subplots(1, 3, figsize=(9, 2.5), layout="constrained")
for axis, frame in zip(axes, (0, 15, 40), strict=True):
    axis.imshow(cv2.imread(str(folder / f"{frame:04d}.png"))[..., ::-1])
    axis.set_title(f"frame {frame}")
    axis.set_axis_off()

# %%
# Run
# ---
#
# Give the command a video, a folder of pictures or a bag. It detects what kind of markers the gel
# has. In a terminal you would write
#
# .. code-block:: bash
#
#    python -m estimation run clip --out result
#
# For a video install the extra ``video`` first: ``pip install ".[video]"``. Then ``--preview``
# writes an annotated copy of your video as well.

command = [sys.executable, "-m", "estimation", "run", str(folder), "--out", str(folder / "result")]
done = subprocess.run(command, capture_output=True, text=True, check=True)
print(done.stdout.replace(str(folder.parent) + "/", ""))

# %%
# Read the result
# ---------------
#
# ``report.html`` shows everything in a browser. ``angles.csv`` is for your own code. It has one
# row a frame, with the state of the contact, the angle, and the two ends of its 95 % interval. The
# page :doc:`How to read an answer </docs/answers>` explains every printed word and column.

with (folder / "result" / "angles.csv").open() as table:
    rows = list(csv.DictReader(table))
time, low, angle, high = (
    np.array([float(row[name]) for row in rows])
    for name in ("time_s", "angle_low_deg", "angle_deg", "angle_high_deg")
)
figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
axis.fill_between(time, low, high, alpha=0.3, label="95 % interval")
axis.plot(time, angle, label="estimate")
axis.plot(time, np.degrees(clip.truth.angle)[: len(time)], "k--", label="truth")
axis.set(xlabel="time [s]", ylabel="angle [°]")
axis.legend()

known = np.isfinite(angle) & np.isfinite(clip.truth.angle)
error = np.abs(angle - np.degrees(clip.truth.angle))[known]
print(f"median error {np.median(error):.2f}°, largest {error.max():.2f}°")

# %%
# What to check
# -------------
#
# - *The empty gel.* If the first pictures do not show the empty gel, give one that does:
#   ``--unloaded PICTURE``. Without it, the gel at rest is found from the dots that the object does
#   not move. If there are too few of them, or with speckle, motion is measured from the first
#   picture, and any earlier turn is missing. A note in the report says what the angle is
#   measured from.
# - *Lengths are in px* unless you give the scale: ``--mm-per-px 0.06``. Angles do not need it. A
#   wrong scale does not change them, but makes lengths in mm wrong.
# - *The sign.* Look from the object at the gel: a counter-clockwise turn is positive. A camera
#   under the gel sees the same turn as clockwise.
# - *A frame has no angle.* Then ``reason`` says why. A reason beside an angle is a warning. If
#   there are such frames, the printed answer gives their number. The page
#   :doc:`How to read an answer </docs/answers>` lists the most frequent reasons.
# - *Which clock.* Printed times and those of the report are measured from the first frame.
#   ``time_s`` in ``angles.csv`` is the recording's own time stamp. If the first frame has a
#   ``time_s`` other than 0, both times are printed. A folder of pictures needs ``--fps`` or a table
#   of times. Without them 30 pictures per second are assumed, with a warning, and all times rest on
#   that.
# - *How far it turned.* The printed angles are the turning points, such as the largest angle. The
#   last row of ``angles.csv`` has the angle at the end.
# - *When it slipped.* The printed time is that at which the first slip began, found in the frames
#   before and after it. Frame by frame, ``slip_probability`` exceeds one half up to 32 frames
#   later. For the loss of the whole contact read ``macro_slip_s`` under ``methods`` and ``tracked``
#   in ``summary.json``. Each stretch of macro slip has four times there, in s from the first frame:
#   last frame before it, first frame, last frame, first frame after it. The list ``macro_slips``
#   at the top is another estimate, for round contacts without a print, and is empty elsewhere.
# - *Mirrors or frames are in the picture.* Cut them off with ``--crop`` or cover them with
#   ``--mask``.
