"""Bag's topic to a table: `python examples/bag_to_csv.py grasp.mcap/left/frame angles.csv`."""

import sys
from contextlib import closing
from pathlib import Path

from estimation import BagSource, Settings, Stream, TableWriter


def main(place: str, table: str) -> None:
    """Write a row for each frame, like `python -m estimation run`."""
    source, settings = BagSource(Path(place)), Settings()
    stream = Stream(source, settings)
    with closing(TableWriter(Path(table), settings.method, source.unit)) as writer:
        for answer in stream.answers(writer):
            print(answer.row, answer.estimates[settings.method].state)


if __name__ == "__main__":
    main(*sys.argv[1:])
