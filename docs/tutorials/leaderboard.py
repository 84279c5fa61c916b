"""
6. Enter the leaderboard
========================

You have a method of your own. The leaderboard gives it recordings, reads its angles from a CSV
file, and ranks it beside our methods and those of other groups.
"""

# %%
# Get the recordings
# ------------------
#
# This command writes them in one to two minutes:
#
# .. code-block:: bash
#
#    python -m papers leaderboard --export recordings
#
# In the new folder, ``README.md`` states the rules and ``cases.csv`` lists the cases. There are two
# splits. The split ``tuning`` has recordings to try your method on, with their truth in
# ``truth.csv``. The split ``scored`` has the recordings that are ranked, without their truth. Each
# split has its folder. Write one file of answers for each split.
#
# The cases form three tiers. ``virtual`` has recordings simulated by the contact model. In
# ``finite strain`` finite elements simulate a gel at large strain. ``real`` has published
# recordings. An angle is right within 0.5° in the two simulated tiers, and within 2° in ``real``.
# The score of a tier is the share of right answers, averaged over its groups of cases.
#
# Real recordings are left out unless they are on your machine. The command names the data sets that
# are missing. Run ``python -m estimation fetch NAME`` for each of them, then export again. This
# matters: entries are ordered by the mean of the three tiers (``mean [%]``), and a tier without
# answers counts as 0. Without the real tier your mean cannot exceed two thirds of 100 %.
#
# The export also has an entry of plain rigid fits to the scored cases. Rank it to see how the
# scoring works. ``--alone`` ranks only your file, beside the published rows, and runs no other
# method. In the two simulated tiers the row of this entry equals that of ``kabsch (listed)``:
#
# .. code-block:: bash
#
#    python -m papers leaderboard --angles recordings/baseline.csv --alone
#
# To keep this page short, we make only two tuning cases here:

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
# counter-clockwise, seen from the object looking at the pad. The method below fits a rigid motion
# to all markers that moved (Kabsch). It ignores slip.


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
entry_file = folder / "my_method.csv"
entry_file.write_text("\n".join(rows) + "\n")
print(*rows[:3], sep="\n")

# %%
# The frame is the row of ``positions`` in the recording, from 0. A frame that you leave out counts
# as wrong if it is scored. Write angles from −180 to 180, with a decimal point. The entry takes the
# name of the file.
#
# Some real cases are lifts. Their ``question`` in ``cases.csv`` is ``slipped``: they ask whether
# the object slipped out, not for an angle. Answer a lift with one row. Its frame is 0, its angle is
# empty, and a fourth column, ``slipped``, has the probability from 0 to 1. The answer is right if
# the object slipped out and the probability is 0.5 or more, or if it was held and the probability
# is below 0.5. A file with angles and a lift looks like this::
#
#    case,frame,angle_deg,slipped
#    virtual/rigid-0,12,3.4100,
#    real/slip-lifts/object001/067_10_mm,0,,0.15
#
# See where it stands
# -------------------
#
# .. code-block:: bash
#
#    python -m papers leaderboard --angles my_method.csv --split tuning --alone
#
# The command checks the file first. It rejects a wrong case, frame or number with an error that
# names the line. Then it makes all cases of the split, which takes up to a minute, and scores the
# file. Cases without rows count as wrong, and a note gives their number. The results are in
# ``build/papers/leaderboard``.
#
# Without ``--split tuning`` the command ranks a file for the scored
# cases, beside the rows of the leaderboard's page. These are marked ``(listed)``. For the tuning
# cases there are no listed rows, so with ``--alone`` the file stands alone in the table. Without
# ``--alone`` the command also runs all other methods, which takes some minutes more.
#
# In Python, two calls score the file. Here they score the two cases made above:

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
# In most frames the error exceeds the allowed 0.5°, since slipping markers lag behind the object.
# The page of the :doc:`leaderboard </papers/leaderboard/README>` ranks all methods.
