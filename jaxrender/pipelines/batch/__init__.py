"""A batch: the runs of a sweep, done by several processes, in one folder that can be resumed.

:mod:`.plan` names the runs and finds their states, :mod:`.task` is the work of a worker,
:mod:`.workers` are its processes, :mod:`.batch` does a whole sweep, :mod:`.folder` is its folder,
:mod:`.index` the table of all runs in it.
"""

from jaxrender.pipelines.batch.batch import BatchReport, list_runs, run_batch
from jaxrender.pipelines.batch.workers import cluster, in_process

__all__ = ["BatchReport", "cluster", "in_process", "list_runs", "run_batch"]
