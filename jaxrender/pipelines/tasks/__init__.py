"""The tasks: what a run may recover.

``material`` ``light`` ``texture`` ``brdf_spectrum``
    one module for each, and a ``TASK`` in it
``task``
    what a run asks of a task, and what all fits of a few unknown numbers have in common
``recovery``
    the input of every task, and its result

A new task is a module with a ``TASK``, a page of the report, and an entry in ``config/tasks.py``.
"""

import importlib

from jaxrender.pipelines.config.tasks import TASKS
from jaxrender.pipelines.tasks.task import Task


def task_named(name: str) -> Task:
    """Find a task by the name that configs call it."""
    return importlib.import_module(f"{__name__}.{TASKS[name].home}").TASK


__all__ = ["Task", "task_named"]
