"""
2. A live loop
==============

Your controller reads a camera and needs the angle at once. Make one tracker, and call it with each
picture. Its memory use is bounded, so it can run all day.
"""

# %%
# The loop
# --------
#
# ``ImageTracker`` learns the markers from the first picture. That one should show the empty gel.
# Call ``update(image, time)``. The picture is grey, or BGR as OpenCV gives it. The time is in s.
# Replace the pictures below with those of your camera. The script ``opencv_camera.py`` does that
# with OpenCV. It is one of the :doc:`short examples </examples/README>`.
#
# The pictures below are drawn by the contact model. Only this needs ``jax`` and its double
# precision. Your loop needs neither.

import time

import jax
import matplotlib.pyplot as plt
import numpy as np

from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, SquarePunch, make_path
from estimation import ImageTracker, Scene, VirtualClip

jax.config.update("jax_enable_x64", True)

gel, cube = HalfSpace(shear_modulus=0.2, poisson_ratio=0.5), SquarePunch(8.0, edge_radius=1.0)
grid = Grid((40, 40), (24.0, 24.0))
contact = Contact(gel, Rigid(), cube, grid, friction_coefficient=0.3)
pressed, turned = Pose(0.6), Pose(0.6, twist=np.radians(20.0))
path = make_path([Pose(0.0), Pose(0.0), pressed, pressed, turned], [5, 6, 4, 60])
clip = VirtualClip(Scene(contact=contact, path=path))

tracker, answers, took = ImageTracker(), [], []
for picture in clip:
    began = time.process_time()
    answer = tracker.update(picture.image, picture.time)
    took.append(time.process_time() - began)
    answers.append(answer)
    if picture.number % 6 == 0 and picture.number < 30:
        print(f"{answer.time:.2f} s {answer.state:10} {np.degrees(answer.angle):6.2f}°")
print(f"{1e3 * np.median(took):.1f} ms of processor time a picture")

# %%
# What an answer holds
# --------------------
#
# ``angle`` is the object's angle in rad. ``low`` and ``high`` are the ends of its 95 % interval.
# ``state`` is one of ``no_contact``, ``stick``, ``incipient``, ``macro_slip`` and ``unknown``.
# ``reason`` says why there is no angle. Beside an angle it is a warning, such as "the contact
# reaches the edge of the view". The page :doc:`Recordings to angles </estimation/README>` lists
# the frequent ones. ``stick_markers`` counts the markers that hold.

times = [answer.time for answer in answers]
angle, low, high = (
    np.degrees([getattr(answer, name) for answer in answers]) for name in ("angle", "low", "high")
)
figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
axis.fill_between(times, low, high, alpha=0.3, label="95 % interval")
axis.plot(times, angle, label="estimate")
axis.plot(times, np.degrees(clip.truth.angle), "k--", label="truth")
axis.set(xlabel="time [s]", ylabel="angle [°]")
axis.legend()

# %%
# React when it slips
# -------------------
#
# The rim of the contact slips first. The ring of slip then grows inwards, until nothing holds.
# The tracker notices this late, as the two times below show. In pictures it often misses partial
# slip. See the :doc:`limits </docs/limits>`.
#
# While the object is being pressed on, states are not reliable yet. The rule below waits for the
# first ``stick``, and then grips harder at the first other state.

states = [answer.state for answer in answers]
held = states.index("stick")
warned = next(row for row in range(held, len(states)) if states[row] != "stick")
print(f"noticed at {times[warned]:.2f} s: {states[warned]}, {angle[warned]:.1f}°")
print(f"true macro slip from {times[clip.truth.onset]:.2f} s on")

# %%
# Grip harder at the first such state, and do not loosen again at the next ``stick``. While an
# object slides evenly, the state can return to ``stick`` for some frames, since gel and markers
# are at rest then.

# %%
# Alerts and slip probability
# ---------------------------
#
# These are not in the answers of ``ImageTracker``. A ``Stream`` has them. It takes the pictures
# from a camera or a folder by itself:
#
# .. code-block:: python
#
#    settings = Settings()
#    for answer in Stream(PictureSource(Path("camera:0")), settings).answers():
#        estimate = answer.estimates[settings.method]
#        print(estimate.angle, answer.alert.level, answer.shear.slipped)
#
# On the clip above this alert is ``act`` some frames before the state leaves ``stick``.
#
# - *The first answers.* ``ImageTracker`` answers from the first picture on. The command ``live``,
#   and a ``Stream`` of a camera, hold back the first 24 frames to measure the noise. If you give
#   the noise, they answer at once.
# - *A jump.* The angle can jump once, when a better picture of the gel at rest is found. Then
#   ``tracker.reader.layout`` is a new object. Watch ``since`` and ``anew`` too. ``since`` is the
#   time from which the angle counts. ``anew`` is how often it was counted anew.
# - *Speed.* Latencies and memory are on the page :doc:`speed and sizes </docs/speed>`.

# %%
# Other sources
# -------------
#
# - *Marker positions of your own.*
#   ``Tracker(layout_markers(reference)).update_positions(positions, time)`` takes them.
# - *A camera from the terminal.* ``python -m estimation live camera:0`` prints a line for each
#   picture. ``--window`` shows it on a page in your browser. ``--sink udp:9000`` sends the lines as
#   packets, for a controller in another language.
# - *ROS 2, PyTac3D, two fingers.* Each has a script of at most 30 lines among the
#   :doc:`short examples </examples/README>`.
