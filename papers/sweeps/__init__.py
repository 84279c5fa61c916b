"""Studies of many cases: run locally or on a cluster, store each case, resume if interrupted."""

from papers.sweeps.executors import in_process, local_processes, on_cluster
from papers.sweeps.store import Results, read_results
from papers.sweeps.study import Study, find_study
from papers.sweeps.sweep import run_study, run_sweep, store_path

__all__ = [
    "Results",
    "Study",
    "find_study",
    "in_process",
    "local_processes",
    "on_cluster",
    "read_results",
    "run_study",
    "run_sweep",
    "store_path",
]
