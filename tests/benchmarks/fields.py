"""Time of a field fit in units of forward solves: `python -m tests.benchmarks.fields [CELLS]`.

A ball is pressed on a layer and twisted. Five numbers are fitted to the noisy displacements of 400
markers in both states, and to the forces. A forward solve is the path that the fit solves, without
derivatives. Both are processor times without compilation.
"""

import time
from collections.abc import Callable

import equinox as eqx
import jax
import numpy as np

from calibration.field_fit import fit_fields
from papers.softness.fields import EXPERIMENTS, measure, plan
from tests.benchmarks.arguments import make_parser

FITS = 5


def clock(function: Callable, *arguments: object) -> float:
    """Processor time of a call [s]."""
    start = time.process_time()
    jax.block_until_ready(function(*arguments))
    return time.process_time() - start


if __name__ == "__main__":
    parser = make_parser(__doc__)
    parser.add_argument("cells", nargs="?", type=int, default=64, help="cells along a side")
    cells = parser.parse_args().cells
    jax.config.update("jax_enable_x64", True)
    model, experiment = plan(cells), EXPERIMENTS[0]
    predict = eqx.filter_jit(lambda numbers: model.predict(numbers)[:3])
    seen = model.predict(experiment.truth)
    one = np.median([clock(predict, experiment.truth) for _ in range(FITS + 1)][1:])
    print(f"{cells}² cells, forward solve of the path: {one:.3f} s")
    for draw in range(FITS + 1):
        data = measure(seen, experiment, draw)
        spent = clock(fit_fields, model, experiment.numbers, data)
        if draw > 0:  # the first one compiles
            print(f"fit: {spent:.2f} s, {spent / one:.1f} forward solves")
