"""A study for the tests: squares on a grid; 13 fails; every evaluation leaves a line in a log."""

import os
import time

import numpy as np

from papers.sweeps import Study

CASES = 40


def cases(quick: bool) -> dict[str, np.ndarray]:
    count = 4 if quick else CASES
    return {"x": np.arange(count, dtype=float), "cells": np.tile([2, 3], count // 2)}


def evaluate(x: float, cells: int) -> dict[str, np.ndarray]:
    if log := os.environ.get("SQUARES_LOG"):
        with open(log, "a") as file:  # short lines: appended whole
            file.write(f"{x:g}\n")
    time.sleep(float(os.environ.get("SQUARES_PAUSE", "0")))
    if x == 13.0:
        raise ValueError("13 has no square\nhere")
    return {"square": np.array(x * x), "sum": np.full(2, x * cells)}


STUDY = Study(cases, evaluate, static=("cells",), batch=4, traced=False)
