"""
6. Enter the leaderboard
========================

You have a method of your own. The leaderboard gives it recordings, takes its angles as a CSV file,
and ranks it beside ours and those of other groups.
"""

# %%
# Get the recordings
# ------------------
#
# This command writes them in two to three minutes. Its ``README.md`` states the rules, and
# ``cases.csv`` lists the cases:
#
# .. code-block:: bash
#
#    python -m papers leaderboard --export recordings
#
# The folder ``tuning`` has recordings to try your method on, with their truth in ``truth.csv``. The
# folder ``scored`` has those that are ranked, without it. Real recordings are left out unless they
# are on your machine: run ``python -m estimation fetch NAME`` first, with the ``NAME`` of each data
# set that the command names. To keep this page short, we make two tuning cases here.
#
# The export also has ``baseline.csv``, an entry of plain rigid fits. To try the scoring, change its
# angles, and give it to the command below, without ``--split``.

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from estimation import read_recording
from papers.leaderboard.board import score_all, tabulate
from papers.leaderboard.cases import list_cases
from papers.leaderboard.entries import read_entry
from papers.leaderboard.export import export_cases
from papers.leaderboard.settings import TUNING_SEED
from papers.leaderboard.sources import open_cases

folder = Path(tempfile.mkdtemp())
names = ("virtual/rigid-0", "finite-strain/sphere-0")
cases = {name: list_cases("tuning")[name] for name in names}
sources = list(open_cases(cases, TUNING_SEED))
export_cases(sources, folder)
print(*sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.*")), sep="\n")

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
for path in sorted((folder / "tuning").rglob("*.npz")):
    name = path.relative_to(folder / "tuning").with_suffix("").as_posix()
    angles = answer(read_recording(path))
    known = np.flatnonzero(np.isfinite(angles))
    rows += [f"{name},{frame},{angles[frame]:.4f}" for frame in known]
entry_file = folder / "kabsch.csv"
entry_file.write_text("\n".join(rows) + "\n")
print(*rows[:3], sep="\n")

# %%
# The frame is the row of ``positions`` in the recording, from 0. A frame that you leave out counts
# as wrong if it is scored.
#
# See where it stands
# -------------------
#
# .. code-block:: bash
#
#    python -m papers leaderboard --angles kabsch.csv --split tuning --alone
#
# The command checks the file first. A wrong case, frame or number ends in an error that names the
# line. Then it makes all cases of the split, which takes about a minute, and scores the file.
# Without ``--split tuning`` it ranks by the scored cases, beside the published rows. Without
# ``--alone`` it runs all other methods too, which takes some minutes more. Cases without rows count
# as wrong, and a note gives their number. The files are in ``build/papers/leaderboard``.
#
# In Python scoring takes two calls. The numbers printed here come from these calls, and not from
# the command. They are of the two cases made above:

entry = read_entry(entry_file, cases)
for row in tabulate(score_all([entry], sources), "case"):
    print(f"{row['of']}: {row['right [%]']} % right")

figure, axes = plt.subplots(len(sources), figsize=(7, 5), layout="constrained")
for axis, source in zip(axes, sources, strict=True):
    name = source.case.name
    axis.plot(np.degrees(source.truth.angle), "k--", label="truth")
    axis.plot(np.degrees(entry.angle[name]), label="this method")
    axis.set(title=name, xlabel="frame", ylabel="angle [°]")
axes[0].legend()

# %%
# Most frames are wrong by more than the 0.5° that are allowed, since slipping markers lag behind
# the object. The ranking of all methods is on the page of the leaderboard.
