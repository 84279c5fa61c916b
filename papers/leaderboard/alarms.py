"""False alarms of slip warnings while the grip is firm, and their lead before macro slip."""

import numpy as np

from estimation.slip.warnings import SLIP_WARNINGS
from estimation.virtual.recording import PivotModel, simulate_pivot
from papers.leaderboard import settings
from papers.tables import cell


def tabulate_warnings(draws: int) -> list[dict[str, object]]:
    """One row per warning and grip, on sphere contacts twisted one way until all markers slip.

    A false alarm is a frame with a warning in which at least 90 % of the markers under the object
    stick; frames of the press before the twist count too. The lead is the time from the first
    warning that is not false to macro slip. A grip too firm for macro slip has no lead.
    """
    rows = []
    for ratio in settings.GRIPS:
        pivots = [
            simulate_pivot(PivotModel(friction_ratio=ratio), seed=draw, **settings.TWIST)
            for draw in range(draws)
        ]
        for name, warn in SLIP_WARNINGS.items():
            false, firm_frames, leads, missed = 0, 0, [], 0
            for recording, truth in pivots:
                warned = warn(recording).warned
                contact = truth.contact.sum(axis=1)
                firm = (contact > 0) & (truth.sticking_now.sum(axis=1) >= 0.9 * contact)
                false, firm_frames = false + int((warned & firm).sum()), firm_frames + firm.sum()
                if truth.macro_slip.any():
                    slip = int(np.argmax(truth.macro_slip))
                    before = np.flatnonzero(warned & ~firm)
                    if len(before) and before[0] < slip:
                        leads.append(float(recording.time[slip] - recording.time[before[0]]))
                    else:
                        missed += 1
            slips = len(leads) + missed
            rows.append(
                {
                    "μp0/2G*": ratio,
                    "warning": name,
                    "false alarms [%]": cell(100 * false / firm_frames, 1),
                    "firm frames": int(firm_frames),
                    "mean lead [s]": cell(leads, 2),
                    "missed": f"{missed} of {slips}" if slips else None,
                }
            )
    return rows
