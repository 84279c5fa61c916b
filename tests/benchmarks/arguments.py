"""Command lines of the benchmarks: the docstring of a module is its help."""

import argparse


def make_parser(text: str | None) -> argparse.ArgumentParser:
    """A parser without arguments, described by a text.

    Args:
        text: docstring of the benchmark's module.
    """
    return argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
