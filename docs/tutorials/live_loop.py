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
# ``ImageTracker`` learns the markers from the first picture, which should show the empty gel. Call
# ``update(image, time)`` with each picture: an array of integers, grey, or BGR as OpenCV gives it.
# The time is in s, from any start: divide a clock in ns by 1e9. In another unit the alert ``act``
# comes too late or not at all, and a warning names the clock after ten frames. ``update`` returns
# the angle, and ``tracker.alert`` then warns of a slip. At the first ``act`` or ``slips``, the loop
# calls ``stop_gripper``. Put the command of your gripper there: stop its motion and grip harder.
#
# Replace the pictures below with those of your camera. The script ``opencv_camera.py`` does that
# with OpenCV. It is on the page of :doc:`short examples </examples/README>`.
#
# The pictures below are drawn by the contact model. Drawing needs ``jax`` in double precision. Your
# loop does not.

import jax
import matplotlib.pyplot as plt
import numpy as np

from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, SquarePunch, make_path
from estimation import (
    Frame,
    ImageTracker,
    Noise,
    Scene,
    Tracker,
    VirtualClip,
    layout_markers,
    simulate_pivot,
)

jax.config.update("jax_enable_x64", True)

gel, cube = HalfSpace(shear_modulus=0.2, poisson_ratio=0.5), SquarePunch(8.0, edge_radius=1.0)
grid = Grid((40, 40), (24.0, 24.0))
contact = Contact(gel, Rigid(), cube, grid, friction_coefficient=0.3)
pressed, turned = Pose(0.6), Pose(0.6, twist=np.radians(20.0))
path = make_path([Pose(0.0), Pose(0.0), pressed, pressed, turned], [5, 6, 4, 60])
clip = VirtualClip(Scene(contact=contact, path=path))


def stop_gripper(time, level):
    """Stands for the command that stops your gripper and makes it grip harder."""
    print(f"{time:.2f} s {level}: the gripper stops and grips harder")


tracker, answers, levels, stopped = ImageTracker(), [], [], False
for picture in clip:
    answer = tracker.update(picture.image, picture.time)
    answers.append(answer)
    levels.append(tracker.alert.level)
    if tracker.alert.level in ("act", "slips") and not stopped:
        stop_gripper(picture.time, tracker.alert.level)
        stopped = True
    if picture.number % 8 == 0:
        half = (answer.high - answer.low) / 2
        angle = f"{np.degrees(answer.angle):6.2f}° ± {np.degrees(half):.2f}°"
        print(f"{answer.time:.2f} s {answer.state:10} {angle} {tracker.alert.level}")

# %%
# The drawn object turns on, since a clip cannot react to the gripper. It slips at 1.36 s here. The
# state is ``macro_slip`` only a frame after the alert. Use the alert for decisions. If your clip
# does not begin with the empty gel, give a picture of it:
# ``ImageTracker(Settings(images=ImageSettings(unloaded=empty)))``. The picture ``empty`` is an
# array or the path of a file. ``Settings`` and ``ImageSettings`` come from ``estimation`` too.
# Without such a picture, the gel at rest is worked out from the dots around the contact. If there
# are too few of them, or with speckle, motion is measured from the first picture.

# %%
# What an answer holds
# --------------------
#
# ``angle`` is the object's angle in rad. ``low`` and ``high`` are the ends of its 95 % interval.
# ``state`` is one of ``no_contact``, ``stick``, ``incipient``, ``macro_slip`` and ``unknown``.
# ``reason`` says why there is no angle. Beside an angle it is a warning, such as "the contact
# reaches the edge of the view". The page :doc:`How to read an answer </docs/answers>` lists
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
# Stop when it slips
# ------------------
#
# ``alert.level`` is ``none``, ``watch``, ``act``, ``slips`` or ``unknown``. Grip harder at the
# first ``act`` or ``slips``, and keep that force. The level can fall back to ``none``: while an
# object slides steadily, gel and markers are at rest. A fast slip shows as ``slips`` first, and as
# ``act`` for about a second after it. That is no sign of another slip. ``act`` also stays while few
# markers stick and nothing shows whether the object slips. ``watch`` means that part of the contact
# slips, or that slip is near: go on slowly, or grip a little harder. ``unknown`` means that there
# is no contact, that the picture cannot be used, or that the angle was lost. If it was lost while
# the object moved (``reason`` says so), stop as for ``act``. Otherwise keep what you do.

alarm = next(row for row, level in enumerate(levels) if level in ("act", "slips"))
print(f"{levels[alarm]} at {times[alarm]:.2f} s, turned by {angle[alarm]:.1f}°")
print(f"true macro slip from {times[clip.truth.onset]:.2f} s on")
print(f"probability of a slip in the last picture: {tracker.shear.slip_probability:.2f}")

# %%
# Do not count on an early warning. Pictures show partial slip poorly, so the alert usually comes
# with the slip or a few frames after it. See the :doc:`limits </docs/limits>` for how often. Forces
# and moments make it earlier, as the next section shows.
#
# Before you rely on a tracker, know these:
#
# - *The interval.* It needs the noise of the markers, above all where no print is in view. Without
#   it, the misfit of each frame is used instead. Run a recording of your sensor once: its
#   ``summary.json`` has ``noise_in_plane_px``. Give that number to the tracker:
#   ``ImageTracker(Settings(noise=Noise.from_std(0.02, unit="px")))``. Noise in another unit than
#   the lengths is refused.
# - *A jump.* The angle can jump once, when a better picture of the gel at rest is found. Then
#   ``tracker.reader.layout`` is a new object.
# - *A restart.* An angle that was lost starts again. ``since`` is the time from which the angle
#   is measured, and ``restarts`` counts the restarts since the object touched.
# - *Speed.* Latencies and memory are on the page :doc:`speed and sizes </docs/speed>`.

# %%
# Marker positions and forces of your own
# ---------------------------------------
#
# Make a ``Frame`` of each set of positions [mm], with its time [s] and its number. Add the force
# and moment on the sensor if you have them. The order of ``wrench`` is Fx, Fy, Fz [N], Mx, My, Mz
# [N·mm]. The axis z points out of the pad, so pressing makes Fz negative. Give NaN for an unknown
# value, and for the position of a marker that was not seen.

sensor, _ = simulate_pivot(angles_deg=(0, 10), frames=(20,))  # in place of your own
tracker = Tracker(layout_markers(sensor.layout.reference), noise=Noise.from_std(1e-3))  # 1 µm
for number, positions in enumerate(sensor.positions):
    wrench = (*sensor.force[number], *sensor.moment[number])
    answer = tracker.update(Frame(positions, sensor.time[number], number, wrench=wrench))
    if number % 6 == 0:
        left = np.degrees(tracker.margin.angle)
        print(f"{np.degrees(answer.angle):5.2f}° {tracker.alert.level:8} {left:5.1f}° remain")

# %%
# ``margin.angle`` is the angle [rad] that remains before macro slip. Without measured moments it
# follows from the markers, also in ``ImageTracker``. ``friction`` needs forces, so
# ``ImageTracker`` has none. ``alert.time_to_slip`` is in s. The
# :doc:`reference </docs/reference/estimation>` has all fields. For lengths in px give
# ``unit="px"`` to ``Noise.from_std``. Then ``onset_mm`` of ``ContactSettings`` is in px too.
#
# Positions without z show no indentation. All markers then count as in contact, and the state is
# never ``stick``. If you know which markers the object touches, say so: ``Frame(positions, time,
# number, contact=touched)``. The array ``touched`` has a bool for each marker. The law of friction
# then has the contact's outline from the first touch on; otherwise it finds it as the object turns.

# %%
# Other ways
# ----------
#
# - *All methods at once, files and recordings.* ``Stream(source, Settings())`` processes any
#   source: ``read_recording``, ``PictureSource`` or ``FrameStream``. Each of its answers has
#   ``estimates["tracked"]`` and the alert. It first reads some frames to measure the noise: 24 of a
#   live source, else 96.
# - *A camera from the terminal.* ``python -m estimation live camera:0`` prints a line for each
#   picture. ``--window`` shows it on a page in your browser. ``--sink udp:9000`` sends the lines as
#   packets, for a controller in another language.
# - *ROS 2, PyTac3D, two fingers.* Each has a script of at most 30 lines among the
#   :doc:`short examples </examples/README>`.
