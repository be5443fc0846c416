"""A batch: the runs of a sweep, done by several processes, in one folder that can be resumed.

:mod:`.plan` names the runs and sees what is there already, :mod:`.task` is what a worker does,
:mod:`.workers` are the processes that do it, :mod:`.batch` goes from a sweep to its folder,
:mod:`.folder` is that folder, :mod:`.index` the table of all runs in it.
"""

from jaxrender.pipelines.batch.batch import BatchReport, list_runs, run_batch
from jaxrender.pipelines.batch.workers import cluster, in_process

__all__ = ["BatchReport", "cluster", "in_process", "list_runs", "run_batch"]
