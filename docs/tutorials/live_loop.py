"""
2. A live loop
==============

Your controller reads a camera and needs the angle at once. Make one tracker, and call it with each
picture. Its memory use is bounded (:doc:`measured </docs/speed>`).
"""

# %%
# The loop
# --------
#
# ``ImageTracker`` learns the markers from the first picture. That one should show the empty gel.
# Call ``update(image, time)``. The picture is grey, or BGR as OpenCV gives it. The time is in s.
# Replace the pictures below with those of your camera. The script ``opencv_camera.py`` does that
# with OpenCV. It is shown on the page of :doc:`short examples </examples/README>`.
#
# The pictures below are drawn by the contact model. Only this needs ``jax`` and its double
# precision. Your loop needs neither.

import tempfile
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, SquarePunch, make_path
from estimation import (
    Frame,
    FrameStream,
    ImageTracker,
    Noise,
    PictureSource,
    Scene,
    Settings,
    Stream,
    VirtualClip,
    layout_markers,
    simulate_pivot,
    write_pictures,
)

jax.config.update("jax_enable_x64", True)

gel, cube = HalfSpace(shear_modulus=0.2, poisson_ratio=0.5), SquarePunch(8.0, edge_radius=1.0)
grid = Grid((40, 40), (24.0, 24.0))
contact = Contact(gel, Rigid(), cube, grid, friction_coefficient=0.3)
pressed, turned = Pose(0.6), Pose(0.6, twist=np.radians(20.0))
path = make_path([Pose(0.0), Pose(0.0), pressed, pressed, turned], [5, 6, 4, 60])
clip = VirtualClip(Scene(contact=contact, path=path))

tracker, answers = ImageTracker(), []
for picture in clip:
    answer = tracker.update(picture.image, picture.time)
    answers.append(answer)
    if picture.number % 6 == 0 and picture.number < 30:
        print(f"{answer.time:.2f} s {answer.state:10} {np.degrees(answer.angle):6.2f}°")

# %%
# What an answer holds
# --------------------
#
# ``angle`` is the object's angle in rad. ``low`` and ``high`` are the ends of its 95 % interval, so
# the half-width behind a ± is ``(high - low) / 2``.
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
# In pictures the tracker often misses this partial slip, and its state leaves ``stick`` late, as
# the two times below show. The alert of the next section comes earlier. See the :doc:`limits
# </docs/limits>`.
#
# While the object is being pressed on, states are not reliable yet. The rule below waits for the
# first ``stick``, and then grips harder at the first other state.

states = [answer.state for answer in answers]
held = states.index("stick")
warned = next(row for row in range(held, len(states)) if states[row] != "stick")
print(f"noticed at {times[warned]:.2f} s: {states[warned]}, {angle[warned]:.1f}°")
print(f"true macro slip from {times[clip.truth.onset]:.2f} s on")

# %%
# Grip harder at the first such state. Keep that force when the state returns to ``stick``: while an
# object slides evenly, gel and markers are at rest, and the state can be ``stick`` for some frames.

# %%
# Alerts and slip probability
# ---------------------------
#
# The answers of a ``Stream`` have these too, for pictures and for marker positions.
#
# *Marker positions of your own.* Make a ``Frame`` of each set of positions [mm], with its time [s]
# and its number. Add the force and moment on the sensor if you have them. The order of ``wrench``
# is Fx, Fy, Fz [N], Mx, My, Mz [N·mm]. The axis z points out of the pad, so pressing makes Fz
# negative. Give NaN for an unknown value, and for the position of a marker that was not seen.

sensor, _ = simulate_pivot(angles_deg=(0, 10), frames=(20,))  # in place of your own


def receive():
    """The frames of a sensor, one after the other."""
    for number, positions in enumerate(sensor.positions):
        wrench = (*sensor.force[number], *sensor.moment[number])
        yield Frame(positions, sensor.time[number], number, wrench=wrench)


source = FrameStream(layout_markers(sensor.layout.reference), receive(), live=True)
for answer in Stream(source, Settings(noise=Noise.given(1e-3))).answers():  # 1 µm
    if answer.row % 6 == 0:
        print(f"{answer.alert.level:8} {np.degrees(answer.margin.angle):5.1f}° remain")

# %%
# ``margin.angle`` is the remaining angle [rad] before macro slip. It needs moments. ``friction``
# needs the force as well. ``alert.time_to_slip`` is in s. The :doc:`reference
# </docs/reference/estimation>` has all fields. For lengths in px give ``unit="px"`` to
# ``FrameStream`` and to ``Noise.given``. Then ``onset_mm`` of ``ContactSettings`` is in px too.
#
# *Pictures.* A ``PictureSource`` takes them by itself from a folder, or from a camera:
# ``PictureSource(Path("camera:0"))``. Here it reads the clip from above.

folder = Path(tempfile.mkdtemp()) / "clip"
write_pictures(clip, folder)
alerts = list(Stream(PictureSource(folder), Settings()).answers())
first = next(answer for answer in alerts if answer.alert.level == "act")
print(f"first act at {times[first.row]:.2f} s, probability of a slip {first.shear.slipped:.2f}")

# %%
# This alert comes two frames after the true macro slip, and nine frames before the state leaves
# ``stick``. It goes back to ``none`` for three frames in between. So treat the first ``act`` like
# the first state other than ``stick``: keep the stronger grip.
#
# - *The first answers.* ``ImageTracker`` answers from the first picture on. A ``Stream`` without a
#   given noise first reads some frames to measure it: 24 of a live source, else 96. It answers them
#   after that. With ``Settings(noise=Noise.given(...))`` it answers at once.
# - *A jump.* The angle can jump once, when a better picture of the gel at rest is found. Then
#   ``tracker.reader.layout`` is a new object. Watch ``since`` and ``anew`` too. ``since`` is the
#   time from which the angle counts. ``anew`` is the number of restarts of the angle since the
#   object touched.
# - *Speed.* Latencies and memory are on the page :doc:`speed and sizes </docs/speed>`.

# %%
# Other sources
# -------------
#
# - *Marker positions, without alerts.*
#   ``Tracker(layout_markers(reference)).update_positions(positions, time)`` takes them.
# - *Positions in the plane.* Without z, all markers count as in contact, and the state is never
#   ``stick``. If you know which markers the object touches, say so:
#   ``tracker.update(Frame(positions, time, number, contact=touched))``. The array ``touched`` has a
#   bool for each marker.
# - *A camera from the terminal.* ``python -m estimation live camera:0`` prints a line for each
#   picture. ``--window`` shows it on a page in your browser. ``--sink udp:9000`` sends the lines as
#   packets, for a controller in another language.
# - *ROS 2, PyTac3D, two fingers.* Each has a script of at most 30 lines among the
#   :doc:`short examples </examples/README>`.
