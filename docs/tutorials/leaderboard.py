"""
6. Enter the leaderboard
========================

You have a method of your own. The leaderboard gives it recordings, takes its angles as a CSV file,
and ranks it beside ours and the published ones.
"""

# %%
# Get the recordings
# ------------------
#
# This command writes them, with a page that states the rules:
#
# .. code-block:: bash
#
#    python -m papers leaderboard --quick --export recordings
#
# Here we make a single recording of the same kind, to keep the page short.

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from estimation import read_recording, simulate_pivot, write_archive

folder = Path(tempfile.mkdtemp())
recording, truth = simulate_pivot(seed=3)
write_archive(recording, folder / "pivot.npz")

# %%
# Answer them
# -----------
#
# A method takes marker positions and returns an angle in degrees for each frame. Positive is
# counter-clockwise, seen from the object looking at the pad. The one below fits a rigid motion to
# all markers that moved (Kabsch). It takes no account of slip.


def answer(recording):
    """The angle of a rigid fit to the markers that have moved [°]."""
    rest, angles = recording.layout.reference[:, :2], []
    for positions in recording.positions[..., :2]:
        moved = np.hypot(*(positions - rest).T) > 0.05
        if moved.sum() < 9:
            angles.append(np.nan)
            continue
        before, now = rest[moved] - rest[moved].mean(0), positions[moved] - positions[moved].mean(0)
        turned = np.sum((now @ [1, 1j]) * np.conj(before @ [1, 1j]))
        angles.append(np.degrees(np.angle(turned)))
    return np.array(angles)


rows = ["case,frame,angle_deg"]
for path in sorted(folder.glob("*.npz")):
    angles = answer(read_recording(path))
    known = np.flatnonzero(np.isfinite(angles))
    rows += [f"{path.stem},{frame},{angles[frame]:.4f}" for frame in known]
(folder / "kabsch.csv").write_text("\n".join(rows) + "\n")
print(*rows[:3], sep="\n")

# %%
# The frame is the row of ``positions`` in the recording, from 0. A frame that you leave out counts
# as not answered.
#
# See where it stands
# -------------------
#
# .. code-block:: bash
#
#    python -m papers leaderboard --quick --angles kabsch.csv --out ranked
#
# The command checks the file first. A wrong case, frame or number ends in an error that names the
# line. For the recording on this page we can compare with the truth at once.

firm = truth.stick.sum(axis=1) >= 10
error = np.abs(angles - np.degrees(truth.angle))[firm]
figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
axis.plot(recording.time, np.degrees(truth.angle), "k--", label="truth")
axis.plot(recording.time, angles, label="this method")
axis.set(xlabel="time [s]", ylabel="angle [°]")
axis.legend()
print(f"mean error of this method: {np.nanmean(error):.2f}° in {firm.sum()} frames")

# %%
# That is large, since slipping markers lag behind the object. The ranking of all methods is on the
# page of the leaderboard.
