"""What is known of each frame is declared once: all that is made of it follows."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from jaxtyping import Float

from estimation.estimators.result import (
    Estimate,
    Record,
    Result,
    State,
    Track,
    Withdrawn,
    per_frame,
    show_numbers,
)
from estimation.output.table import csv_text, tabulate
from estimation.slip.lookback import withdraw
from estimation.slip.onset import MacroSlip

NONE = np.zeros(4, dtype=bool)


@dataclass(frozen=True, kw_only=True)
class WarmEstimate(Estimate):
    """An estimate with a quantity that is made up."""

    warmth: float = field(metadata=per_frame("warmth_K", show_numbers, answer=True))


@dataclass(frozen=True, kw_only=True)
class WarmResult(Result):
    """A result of such estimates."""

    warmth: Float[np.ndarray, " frames"] = field(
        metadata=per_frame("warmth_K", show_numbers, answer=True)
    )


def gather(count: int = 10) -> Result:
    """A result in which all four markers stick to begin with, and one after the other lets go."""
    estimates = [
        WarmEstimate(
            time=0.1 * i,
            source_index=2 * i,
            state=State.INCIPIENT,
            reason="",
            angle=0.01 * i,
            low=0.01 * i - 1e-3,
            high=0.01 * i + 1e-3,
            since=0.0,
            restarts=0,
            stick=np.arange(4) >= i,
            stick_markers=max(4 - i, 0),
            contact=~NONE,
            contact_markers=4,
            contact_radius=float("nan"),
            gel_thinness=float("nan"),
            flat_share=float("nan"),
            elongation=float("nan"),
            disc_ratio=float("nan"),
            disc_error=float("nan"),
            disc_twist=float("nan"),
            gel_low=0.0,
            gel_high=0.01 * i,
            moment=float("nan"),
            centre_moment=float("nan"),
            shear_moment_x=float("nan"),
            shear_moment_y=float("nan"),
            gel_moment=float("nan"),
            rotation=np.full(4, 0.01 * i),
            stiffness_ratio=0.0,
            load_term=0.0,
            covered=True,
            warmth=300.0 + i,
        )
        for i in range(count)
    ]
    return WarmResult.gather("rigid", estimates)


def test_a_new_quantity_is_gathered_taken_and_tabulated():
    result = gather()
    np.testing.assert_array_equal(result.warmth, 300.0 + np.arange(10))
    every_third = result.take(slice(1, None, 3))
    np.testing.assert_array_equal(every_third.warmth, [301.0, 304.0, 307.0])
    table = tabulate(every_third)
    assert table["warmth_K"] == ["301.000000", "304.000000", "307.000000"]
    assert table["withdrawn_angle_deg"] == ["", "", ""]
    assert table["frame"] == ["0", "1", "2"]
    lengths = {name for name in tabulate(result, unit="px") if name.endswith(("_mm", "_px"))}
    assert lengths == {"contact_radius_px"}
    assert csv_text(table).splitlines()[0] == ",".join(table)


def test_every_declared_quantity_is_in_every_form():
    result = gather().take(slice(2, 5))
    for name, column in result.columns().items():
        assert len(getattr(result, name)) == 3
        assert not column.name or len(tabulate(result)[column.name]) == 3
    assert Estimate.columns() == Result.columns()
    assert Withdrawn.columns() == Track.columns() == Record.columns()
    assert Record.columns().items() <= Result.columns().items()
    assert {*result.columns()} == {*Result.columns(), "warmth"}


def test_an_answer_is_withdrawn_as_a_whole():
    result = gather()
    slip = MacroSlip(onset=0.55, low=0.5, high=0.6)
    back = withdraw(result, [slip], np.full(10, np.nan))
    doubtful = result.time >= slip.onset
    np.testing.assert_array_equal(np.isnan(back.warmth), doubtful)
    np.testing.assert_array_equal(back.withdrawn.rows, doubtful)
    np.testing.assert_array_equal(back.withdrawn.angle[doubtful], result.angle[doubtful])
    assert back.withdrawn.state == tuple(State.INCIPIENT if one else None for one in doubtful)
    assert not back.withdrawn.stick_markers[~doubtful].any()
    later = back.take(slice(5, None))
    np.testing.assert_array_equal(later.withdrawn.rows, doubtful[5:])
    assert tabulate(later)["withdrawn_angle_deg"][:2] == ["", f"{np.degrees(0.06):.6f}"]


def test_quantities_of_other_lengths_are_refused():
    result = gather()
    with pytest.raises(ValueError, match="`moment` has 9 frames, `time` 10"):
        replace(result, moment=result.moment[:-1])


def test_zero_has_no_sign_in_tables():
    cells = show_numbers([-1e-9, 0.0, -1e-6, np.nan])
    assert cells == ["0.000000", "0.000000", "-0.000001", "nan"]
